"""Checks numbers of small arrays: of a few, plain floats are checked several times as fast as arrays, which the steps
of a closed loop are made of."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

_FEW = 16


def all_finite(array: npt.NDArray[np.float64]) -> bool:
    """Return whether all of an array's numbers are finite."""
    if array.size <= _FEW:
        return all(map(math.isfinite, array.ravel().tolist()))
    return bool(np.isfinite(array).all())


def all_within(array: npt.NDArray[np.float64], low: float, high: float) -> bool:
    """Return whether all of an array's numbers lie in [low, high]; NaN does not."""
    if array.size <= _FEW:
        return all(low <= number <= high for number in array.ravel().tolist())
    return bool(array.min() >= low and array.max() <= high)
