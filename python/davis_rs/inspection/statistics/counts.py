"""Counts histograms of non-negative integers over many orders of magnitude, and what they say."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

IntArray = npt.NDArray[np.int64]

_EXACT_BITS = 7
_EXACT = 1 << _EXACT_BITS
_HALF = _EXACT // 2
_OCTAVES = 63 - _EXACT_BITS


class Histogram:
    """Counts of integers in 0..2^63 - 1: one bin each below 128, beyond that 64 bins an octave (1.6 % wide).

    Attributes:
        counts: int64, of each bin.
        least: the smallest value so far, None without any.
        most: the largest.
    """

    def __init__(self) -> None:
        self.counts: IntArray = np.zeros(_EXACT + _OCTAVES * _HALF, np.int64)
        self.least: int | None = None
        self.most: int | None = None

    def add(self, values: IntArray) -> None:
        """Count these values, int64 (n,), >= 0."""
        if not len(values):
            return
        low, high = int(values.min()), int(values.max())
        bins = values
        if high >= _EXACT:
            bits = values.astype(np.float64).view(np.int64) >> 52  # of the exponent, which is 1023 for 1
            exponents = np.maximum(bits - 1022 - _EXACT_BITS, 0)
            # A large integer may round up to a power of two: its mantissa then lies in the octave above.
            exponents -= (values >> exponents) < np.where(exponents > 0, _HALF, 0)
            bins = exponents * _HALF + (values >> exponents)
        added = np.bincount(bins)
        self.counts[: len(added)] += added
        self.least = low if self.least is None else min(self.least, low)
        self.most = high if self.most is None else max(self.most, high)

    @property
    def total(self) -> int:
        """How many values there are."""
        return int(self.counts.sum())

    @property
    def mean(self) -> float:
        """The mean of the values; that of large ones is accurate to the width of their bins. NaN without values."""
        edges = bin_edges()
        middles = 0.5 * (edges[:-1] + edges[1:] - 1)
        return float(np.average(middles, weights=self.counts)) if self.total else float("nan")

    def percentile(self, percent: float) -> float:
        """Return the value that ``percent`` of all do not exceed, to the width of its bin; NaN without values."""
        if self.least is None or self.most is None:
            return float("nan")
        below = np.cumsum(self.counts)
        at = int(np.searchsorted(below, max(percent / 100 * below[-1], 1)))
        edges = bin_edges()
        middle = 0.5 * (float(edges[at]) + float(edges[at + 1]) - 1)
        return min(max(middle, float(self.least)), float(self.most))


def bin_edges() -> IntArray:
    """Return the first value of each bin, and one behind the last bin."""
    exact = np.arange(_EXACT, dtype=np.int64)
    octaves = [np.arange(_HALF, _EXACT, dtype=np.int64) << k for k in range(1, _OCTAVES + 1)]
    return np.concatenate([exact, *octaves, [np.iinfo(np.int64).max]])
