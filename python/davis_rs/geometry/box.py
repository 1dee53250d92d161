"""Handles boxes along the axes."""

from __future__ import annotations

from itertools import product

import numpy as np

from .pose import FloatArray


def box_corners(ends: FloatArray) -> FloatArray:
    """Return the corners (..., 8, 3) of boxes, given their lowest and their highest corners (2, ..., 3)."""
    corners = [[ends[end, ..., axis] for axis, end in enumerate(which)] for which in product((0, 1), repeat=3)]
    return np.stack([np.stack(corner, -1) for corner in corners], -2)
