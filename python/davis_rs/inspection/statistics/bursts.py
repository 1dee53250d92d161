"""Counts bursts, which tell how a stream was read out: runs of events of one row with one stamp."""

from __future__ import annotations

import numpy as np

from ...events.arrays import EventArray, concatenate_events
from .counts import Histogram, IntArray

WINDOW_US = 10
"""Row bursts are also counted in windows of this length, one that begins with each of them."""

_MOST_HELD = 1 << 20


class Bursts:
    """What is counted of a stream's row bursts: events of one row and one stamp that follow each other.

    Events of the last stamp wait for those that may follow; of more than a million events with one stamp a burst may
    be counted as two.

    Attributes:
        rows_per_us: row bursts with one stamp, of the stamps that have any.
        rows_per_window: row bursts in the ``WINDOW_US`` that begin with each burst.
        events_per_row: events in a burst.
        ascending, descending, unordered: bursts of more than one event by the order of their columns.
        sharing: events whose stamp another event has, too.
    """

    def __init__(self) -> None:
        self.rows_per_us, self.rows_per_window, self.events_per_row = Histogram(), Histogram(), Histogram()
        self.ascending = self.descending = self.unordered = self.sharing = 0
        self._held: list[EventArray] = []
        self._rows: IntArray = np.zeros(0, np.int64)  # stamps of bursts whose window has not ended

    def add(self, events: EventArray) -> None:
        """Add events that are sorted by time."""
        if not len(events):
            return
        held = sum(map(len, self._held))
        whole = int(np.searchsorted(events["t"], events["t"][-1]))
        if whole == 0 and held + len(events) <= _MOST_HELD and (not held or self._held[0]["t"][0] == events["t"][0]):
            self._held.append(events)
            return
        self._take(concatenate_events([*self._held, events[:whole]]))
        self._held = [events[whole:]] if whole < len(events) else []

    def finish(self) -> None:
        """Finish: the stream has ended."""
        self._take(concatenate_events(self._held))
        self._held = []
        self._count_windows(len(self._rows))

    def _take(self, events: EventArray) -> None:
        if not len(events):
            return
        t, x, y = events["t"], events["x"].astype(np.int64), events["y"]
        anew = t[1:] != t[:-1]
        alone = np.append(anew, True) & np.append(True, anew)
        self.sharing += int(len(t) - np.count_nonzero(alone))
        starts = np.append(0, np.flatnonzero(anew | (y[1:] != y[:-1])) + 1)
        sizes = np.diff(np.append(starts, len(t)))
        self.events_per_row.add(sizes)
        stamps = np.append(0, np.flatnonzero(np.diff(t[starts])) + 1)
        self.rows_per_us.add(np.diff(np.append(stamps, len(starts))))
        self._count_orders(x, starts, sizes)
        self._rows = np.append(self._rows, t[starts])
        # Of a window that ends behind the last stamp not all bursts are known.
        known = int(np.searchsorted(self._rows, t[-1] - WINDOW_US, side="right"))
        self._count_windows(known if len(self._rows) - known <= _MOST_HELD else len(self._rows))

    def _count_orders(self, x: IntArray, starts: IntArray, sizes: IntArray) -> None:
        steps = np.sign(np.diff(x, append=x[-1]))
        steps[starts + sizes - 1] = 0  # to the next burst
        inside = sizes - 1
        total = np.add.reduceat(steps, starts)
        several = inside > 0
        up, down = np.count_nonzero(several & (total == inside)), np.count_nonzero(several & (total == -inside))
        self.ascending += int(up)
        self.descending += int(down)
        self.unordered += int(np.count_nonzero(several) - up - down)

    def _count_windows(self, known: int) -> None:
        ends = np.searchsorted(self._rows, self._rows[:known] + WINDOW_US, side="left")
        self.rows_per_window.add(ends - np.arange(known))
        self._rows = self._rows[known:]
