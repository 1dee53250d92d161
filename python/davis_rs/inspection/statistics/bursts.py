"""Counts bursts, which tell how a stream was read out: runs of events of one row with one stamp."""

from __future__ import annotations

import numpy as np

from ...events.arrays import EventArray, concatenate_events
from .counts import Histogram, IntArray

WINDOW_US = 10
"""Row bursts are also counted in windows of this length, one that begins with each of them."""

_MOST_HELD = 1 << 20

SIZES_BY_COLUMNS = {(346, 260)}
"""Sizes of cameras whose bus reads columns of the image: to its bus, a DAVIS346 has 346 rows and 260 columns."""


class Bursts:
    """What is counted of a stream's row bursts: events of one row and one stamp that follow each other.

    Events of the last stamp wait for those that may follow; of more than a million events with one stamp a burst may
    be counted as two.

    Args:
        by_columns: whether rows of the bus are columns of the image.

    Attributes:
        by_columns: the same.
        rows_per_us: row bursts with one stamp, of the stamps that have any.
        rows_per_window, events_per_window: row bursts, and events, in the ``WINDOW_US`` that begin with each burst.
        events_per_row: events in a burst.
        ascending, descending, unordered: bursts of more than one event by the order of their columns.
        rows_up, rows_down: steps from a burst to the next one of the same stamp, by the direction in which rows go.
        sharing: events whose stamp another event has, too.
    """

    def __init__(self, *, by_columns: bool = False) -> None:
        self.by_columns = by_columns
        self.rows_per_us, self.events_per_row = Histogram(), Histogram()
        self.rows_per_window, self.events_per_window = Histogram(), Histogram()
        self.ascending = self.descending = self.unordered = self.rows_up = self.rows_down = self.sharing = 0
        self._held: list[EventArray] = []
        # Of bursts whose window has not ended: stamps, and how many events each has.
        self._rows: IntArray = np.zeros(0, np.int64)
        self._sizes: IntArray = np.zeros(0, np.int64)

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
        t, row, column = events["t"], events["y"].astype(np.int64), events["x"].astype(np.int64)
        if self.by_columns:
            row, column = column, row
        anew = t[1:] != t[:-1]
        alone = np.append(anew, True) & np.append(True, anew)
        self.sharing += int(len(t) - np.count_nonzero(alone))
        starts = np.append(0, np.flatnonzero(anew | (row[1:] != row[:-1])) + 1)
        sizes = np.diff(np.append(starts, len(t)))
        self.events_per_row.add(sizes)
        stamps = np.append(0, np.flatnonzero(np.diff(t[starts])) + 1)
        self.rows_per_us.add(np.diff(np.append(stamps, len(starts))))
        self._count_orders(column, starts, sizes)
        steps = np.diff(row[starts])[np.diff(t[starts]) == 0]
        self.rows_up += int(np.count_nonzero(steps > 0))
        self.rows_down += int(np.count_nonzero(steps < 0))
        self._rows, self._sizes = np.append(self._rows, t[starts]), np.append(self._sizes, sizes)
        # Of a window that ends behind the last stamp not all bursts are known.
        known = int(np.searchsorted(self._rows, t[-1] - WINDOW_US, side="right"))
        self._count_windows(known if len(self._rows) - known <= _MOST_HELD else len(self._rows))

    def _count_orders(self, column: IntArray, starts: IntArray, sizes: IntArray) -> None:
        steps = np.sign(np.diff(column, append=column[-1]))
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
        before = np.append(0, np.cumsum(self._sizes))
        self.events_per_window.add(before[ends] - before[:known])
        self._rows, self._sizes = self._rows[known:], self._sizes[known:]
