"""Counts the levels of a pixel's events from the start of its stream."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..events.arrays import as_events

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


class EventLevels(NamedTuple):
    """Events of ideal pixels, in the given order.

    Attributes:
        t_us: (n,) their stamps, float64.
        pixel: (n,) y W + x.
        sign: (n,) 1 for ON, -1 for OFF.
        on, off: (n,) how many ON and OFF events the pixel has had, this one among them: the event is where log luma has
            changed by on C_on - off C_off since the start.
    """

    t_us: FloatArray
    pixel: IntArray
    sign: FloatArray
    on: FloatArray
    off: FloatArray

    def take(self, index: IntArray) -> EventLevels:
        """Return the events with these numbers."""
        return EventLevels(self.t_us[index], self.pixel[index], self.sign[index], self.on[index], self.off[index])


def count_levels(events: npt.ArrayLike, width: int, height: int, end_us: float) -> EventLevels:
    """Count each pixel's events up to each of them.

    Args:
        events: the whole stream of each of its pixels from the start of the run.
        end_us: of the run.

    Raises:
        ValueError: for events that are not a structured array, not sorted by time, outside of the sensor, of a polarity
            that is neither 0 nor 1, or not in (0, ``end_us``].
    """
    stream = as_events(events)
    t_us, x, y, p = (stream[name].astype(np.int64) for name in ("t", "x", "y", "p"))
    for rule, wrong in (
        ("must be sorted by time", np.diff(t_us, prepend=t_us[:1]) < 0),
        (f"must lie in the {width} x {height} pixels of the sensor", (x >= width) | (y >= height)),
        ("must have a polarity of 0 or 1", p > 1),
        (f"must be stamped within the run, after 0 and up to {end_us:.0f} us", (t_us <= 0) | (t_us > end_us)),
    ):
        if wrong.any():
            index = int(np.flatnonzero(wrong)[0])
            raise ValueError(f"events {rule}; event {index} is (t, x, y, p) = {tuple(map(int, stream[index]))}")
    pixel = y * width + x
    order = np.argsort(pixel, kind="stable")
    first = np.diff(pixel[order], prepend=-1) != 0
    group = np.cumsum(first) - 1
    counts = []
    for polarity in (1, 0):
        kind = (p[order] == polarity).astype(np.float64)
        before = (np.cumsum(kind) - kind)[first][group] if len(kind) else kind
        count = np.empty(len(kind))
        count[order] = np.cumsum(kind) - before
        counts.append(count)
    return EventLevels(t_us.astype(np.float64), pixel, np.where(p == 1, 1.0, -1.0), *counts)
