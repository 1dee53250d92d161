"""Tolerates numbers of files that lie beyond their bounds only by rounding."""

from __future__ import annotations

import numpy as np

from ...geometry.pose import FloatArray

ROUNDING = 1e-5
"""How far a number may lie beyond a bound, as a fraction of it: float32, or decimals cut after the fifth."""


def within(values: FloatArray, low: float, high: float) -> FloatArray | None:
    """Clip numbers that lie beyond the bounds by rounding; return None where one lies further out."""
    bounds = np.array([low, high])
    below, above = bounds + ROUNDING * np.maximum(1.0, np.abs(bounds)) * [-1, 1]
    if not ((values >= below) & (values <= above)).all():
        return None
    return np.clip(values, low, high)
