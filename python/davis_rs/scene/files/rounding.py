"""Numbers of files that lie beyond their bounds by rounding alone."""

from __future__ import annotations

import numpy as np

from ...geometry.pose import FloatArray

ROUNDING = 1e-5
"""What a number may lie beyond its bounds, as a share of them: float32, and decimals cut after the fifth."""


def within(values: FloatArray, low: float, high: float) -> FloatArray | None:
    """Return numbers with what rounding put beyond the bounds brought back, or None where one lies further out."""
    bounds = np.array([low, high])
    below, above = bounds + ROUNDING * np.maximum(1.0, np.abs(bounds)) * [-1, 1]
    if not ((values >= below) & (values <= above)).all():
        return None
    return np.clip(values, low, high)
