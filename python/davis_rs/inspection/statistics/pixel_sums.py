"""Keeps sums of each pixel and polarity over a stream: events, and the moments of the intervals between them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ...events.arrays import EventArray
from .counts import Histogram, IntArray

_NEVER = np.iinfo(np.int64).min


class PixelSums:
    """Holds what is added up of each pixel.

    Attributes:
        events: int64 (2, H, W), OFF and ON.
        intervals: int64 (2, H, W), OFF and ON: intervals between events of a pixel with the same polarity.
        interval_sum, interval_squares: float64 (2, H, W): their sum in us, and that of their squares.
        same, any: histograms in us of the intervals of a pixel between events of the same polarity, and of any.
    """

    def __init__(self, width: int, height: int) -> None:
        self._width = width
        self.events = np.zeros((2, height, width), np.int64)
        self.intervals = np.zeros((2, height, width), np.int64)
        self.interval_sum = np.zeros((2, height, width))
        self.interval_squares = np.zeros((2, height, width))
        self.same, self.any = Histogram(), Histogram()
        self._last_same = np.full(2 * height * width, _NEVER)
        self._last_any = np.full(height * width, _NEVER)

    def add(self, events: EventArray) -> None:
        """Add events that are sorted by time and lie in the sensor."""
        pixel = events["y"].astype(np.int64) * self._width + events["x"]
        polarity, t = events["p"].astype(np.int64), events["t"]
        key = polarity * len(self._last_any) + pixel
        self.any.add(_EventsByPixel(pixel, t, self._last_any).intervals)
        groups = _EventsByPixel(key, t, self._last_same)
        self.same.add(groups.intervals)
        self.events.reshape(-1)[groups.keys] += groups.counts
        keys, counts, sums, squares = groups.moments()
        self.intervals.reshape(-1)[keys] += counts
        self.interval_sum.reshape(-1)[keys] += sums
        self.interval_squares.reshape(-1)[keys] += squares


class _EventsByPixel:
    """Groups the events of a piece of a stream by pixel, and finds the interval to the event before each.

    Args:
        key: which pixel an event belongs to.
        last: for each pixel the time of its last event; brought up to date.
    """

    def __init__(self, key: IntArray, t: IntArray, last: IntArray) -> None:
        # Sorting one number of both is several times as fast as an argsort, and as stable.
        bits = max(len(key) - 1, 1).bit_length()
        packed = np.sort(key << bits | np.arange(len(key)))
        key, t = packed >> bits, t[packed & ((1 << bits) - 1)]
        first = np.ones(len(key), np.bool_)
        first[1:] = key[1:] != key[:-1]
        starts = np.flatnonzero(first)
        self.keys: IntArray = key[starts]
        """The pixels that have events, and how many."""
        self.counts: IntArray = np.diff(np.append(starts, len(key)))
        before = np.empty_like(t)
        before[1:] = t[:-1]
        before[starts] = last[self.keys]
        last[self.keys] = t[starts + self.counts - 1]
        known = before != _NEVER
        self._key = key[known]
        self.intervals: IntArray = t[known] - before[known]

    def moments(self) -> tuple[IntArray, IntArray, npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Return, for each pixel that has an interval, its key, the number of intervals, their sum, and the sum of
        their squares.
        """
        starts = np.flatnonzero(np.diff(self._key, prepend=-1))
        if not len(starts):
            nothing = np.zeros(0, np.int64)
            return nothing, nothing, np.zeros(0), np.zeros(0)
        counts = np.diff(np.append(starts, len(self._key)))
        length = self.intervals.astype(np.float64)
        return self._key[starts], counts, np.add.reduceat(length, starts), np.add.reduceat(length * length, starts)
