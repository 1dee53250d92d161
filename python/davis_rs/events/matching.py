"""Compares an event stream with a reference stream: which events are the same, and how far apart in time."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from .._util.argument_checks import as_size, check_number
from .._util.close_names import names_checked
from .._util.html_table import html_table
from .arrays import EventArray, as_events, check_sorted

DEFAULT_WINDOW_US = 10_000
"""The sampling period of a 100 Hz simulation: it stamps a crossing within the interval in which it falls, so less than
that off. A much longer window would match events of different edges that pass the same pixel."""

LARGEST_WINDOW_US = 2**31 - 1  # with it, the costs of 10^8 events of one pixel still add up in 64 bits
_PART = 2**16  # events

_Flags = npt.NDArray[np.bool_]
_Integers = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class EventComparison:
    """Holds what :func:`compare_events` found.

    Attributes:
        reference: how many events the reference stream holds.
        compared: how many events the other stream holds.
        matched: how many of them form pairs.
        missing: events of the reference without a partner.
        spurious: events of the other stream without a partner.
        time_error_us: (matched,) float64, time of the other stream's event minus that of the reference's, in
            microseconds; ordered by the pair's (y, x, p) and, in one pixel and polarity, by time.
    """

    reference: int
    compared: int
    matched: int
    missing: int
    spurious: int
    time_error_us: npt.NDArray[np.float64]

    def _repr_html_(self) -> str:
        rows = [
            ("reference", f"{self.reference:,} events"),
            ("compared", f"{self.compared:,} events"),
            ("matched", f"{self.matched:,}"),
            ("missing", f"{self.missing:,}, {self.missing_percent:.3g} % of the reference"),
            ("spurious", f"{self.spurious:,}, {self.spurious_percent:.3g} % of the reference"),
            ("time error, median", f"{self.median_us:.3g} us"),
            ("time error, 99th percentile", f"{self.p99_us:.3g} us"),
        ]
        return html_table("EventComparison", rows)

    @property
    def median_us(self) -> float:
        """Return the median of the absolute time error in microseconds; NaN where nothing matched."""
        return self._percentile(50)

    @property
    def p99_us(self) -> float:
        """Return the 99th percentile of the absolute time error in microseconds; NaN where nothing matched."""
        return self._percentile(99)

    @property
    def missing_percent(self) -> float:
        """Return the missing events in percent of the reference's; NaN for an empty reference."""
        return 100 * self.missing / self.reference if self.reference else np.nan

    @property
    def spurious_percent(self) -> float:
        """Return the spurious events in percent of the reference's, perhaps above 100; NaN for an empty reference."""
        return 100 * self.spurious / self.reference if self.reference else np.nan

    def _percentile(self, percent: float) -> float:
        return float(np.percentile(np.abs(self.time_error_us), percent)) if self.matched else np.nan


@names_checked
def compare_events(
    events: npt.ArrayLike,
    reference: npt.ArrayLike,
    *,
    size: tuple[int, int],
    window_us: int = DEFAULT_WINDOW_US,
) -> EventComparison:
    """Match the events of a stream with those of a reference, one to one.

    Only events of the same pixel and polarity (every p but 0 is ON) match, in time order (no two pairs cross), at most
    ``window_us`` apart. Of all such matchings the one is taken whose sum of absolute time errors is the least, where
    two events left without a partner, one of each stream, count as an error of ``window_us`` + 1/2: a pair at the very
    edge of the window is still better than none. This is the alignment of Victor and Purpura's spike train metric. Its
    optimum is local: a missing event shifts no other, not even where a spurious one follows in the same burst (the
    largest possible number of pairs would, at the price of moving every event between the two), and an event that both
    streams hold at the same time is neither missing nor spurious.

    Swapping the streams swaps ``missing`` and ``spurious`` and negates the errors, also where several matchings are
    equally good.

    Args:
        events: (n,) events of the stream in question, anything that :func:`~davis_rs.as_events` takes, sorted by time.
        reference: (m,) events to compare it with, likewise.
        size: (width, height) of the sensor in pixels.
        window_us: the largest time error of a match in microseconds, 0 to 2^31 - 1.

    Raises:
        ValueError: for events out of time order or outside of the sensor (with the index of the first one), and for a
            window out of range.

    Source: Victor and Purpura, "Nature and precision of temporal coding in visual cortex: a metric-space analysis",
    Journal of Neurophysiology 76(2), 1996 (D^spike with q = 2 / window).
    """
    check_number("window_us", window_us, 0, LARGEST_WINDOW_US, whole=True)
    size = as_size(size)
    ours, theirs = checked_events(events, "events", size), checked_events(reference, "reference", size)
    columns = [np.concatenate([theirs[name], ours[name]]) for name in ("t", "p", "x", "y")]
    columns[1] = columns[1] != 0
    # Stable, and by time as its last key but one run after the other: among equals the reference comes first.
    order = np.lexsort(columns)
    t_us, is_ours = columns[0][order], order >= len(theirs)
    first = np.ones(len(order), np.bool_)  # of its pixel and polarity
    first[1:] = np.any([np.diff(column[order]) != 0 for column in columns[1:]], axis=0)
    # Part by part, so that the many passes over a part stay in the processor's cache and need little memory.
    starts = np.flatnonzero(first)
    chunks = np.searchsorted(starts, np.arange(0, len(order), _PART), side="right") - 1
    cuts = [*np.unique(starts[chunks]), len(order)]
    errors = [_time_errors(t_us[a:b], is_ours[a:b], first[a:b], int(window_us)) for a, b in pairwise(cuts)]
    time_error_us = np.concatenate([np.zeros(0), *errors])
    matched = len(time_error_us)
    return EventComparison(len(theirs), len(ours), matched, len(theirs) - matched, len(ours) - matched, time_error_us)


def checked_events(array: npt.ArrayLike, name: str, size: tuple[int, int]) -> EventArray:
    events, (width, height) = as_events(array), size
    check_sorted(events, name)
    outside = (events["x"] >= width) | (events["y"] >= height)
    if outside.any():
        at = int(outside.argmax())
        _, x, y, _ = events[at].tolist()
        raise ValueError(f"{name}: event {at} at (x, y) = ({x}, {y}) lies outside of the {width} x {height} sensor")
    return events


def _time_errors(t_us: _Integers, is_ours: _Flags, first: _Flags, window_us: int) -> _Integers:
    """Return errors of the pairs of a best matching of events in order (pixel and polarity, time, reference first)."""
    paired = coincident(t_us, is_ours, first)
    rest = np.flatnonzero(~paired)
    group = np.cumsum(first)[rest]
    paired[rest] = aligned(t_us[rest], is_ours[rest], np.diff(group, prepend=0) != 0, window_us)
    # In each pixel and polarity as many are paired of one stream as of the other: in order, they are the pairs.
    return t_us[paired & is_ours] - t_us[paired & ~is_ours]


def coincident(t_us: _Integers, is_ours: _Flags, first: _Flags) -> _Flags:
    """Return which events have one of the other stream at the same time, as many of either stream.

    The events are in order (pixel and polarity, time, reference first); ``first`` marks the first of a pixel and
    polarity.

    Some best matching pairs them: by the triangle inequality, whatever their partners were may as well pair. Without
    them the order by time is strict, and does not depend on which stream is the reference.
    """
    new = first.copy()
    new[1:] |= t_us[1:] != t_us[:-1]
    starts = np.flatnonzero(new)
    of_ours = np.add.reduceat(is_ours, starts, dtype=np.int64)
    lengths = np.diff(starts, append=len(new))
    of_theirs = lengths - of_ours
    pairs = np.minimum(of_ours, of_theirs)
    rank = np.arange(len(new)) - np.repeat(starts, lengths)
    rank[is_ours] -= np.repeat(of_theirs, of_ours)
    return rank < np.repeat(pairs, lengths)


def aligned(t_us: _Integers, is_ours: _Flags, first: _Flags, window_us: int) -> _Flags:
    """Return which events a best matching pairs, for events by (pixel and polarity, time) of which no two coincide.

    A matching is a flow along the time axis, from the events of one stream to those of the other: across a gap between
    two events it costs the gap's length times the number of pairs that span it. It is best when no change of one unit
    between two events makes it cheaper (no negative cycle in the residual graph); such changes are made, the best ones
    of disjoint stretches at once, until there are none.
    """
    paired = np.zeros(len(t_us), np.bool_)
    active = np.arange(len(t_us))
    gaps = np.diff(t_us).view(np.uint64)  # may exceed the largest int64
    new = first.copy()
    new[1:] |= gaps > window_us  # no pair spans this: a cluster ends
    while len(active):
        starts = np.flatnonzero(new)
        lengths = np.diff(starts, append=len(new))
        # The two streams' roles by which of them comes first, not by their names: swapping them changes nothing.
        source = is_ours[active] == np.repeat(is_ours[active[starts]], lengths)
        t = t_us[active]
        # In units of 1/4 us, so that half of window_us + 1/2 is an integer.
        price = 2 * window_us + 1
        gap = 4 * np.diff(t)
        span = 4 * (t[starts + lengths - 1] - t[starts])
        gap[starts[1:] - 1] = span[:-1] + span[1:] + 2 * price  # more than any change can save on both sides
        now = paired[active]
        changed = np.zeros(len(active), np.bool_)
        for from_stream in (source, ~source):
            ends = _improvements(from_stream, now, gap, price)
            now[ends] ^= True
            changed[ends] = True
        paired[active] = now
        keep = np.repeat(np.logical_or.reduceat(changed, starts), lengths)
        active, new = active[keep], new[keep]
    return paired


def _improvements(source: _Flags, paired: _Flags, gap: _Integers, price: int) -> npt.NDArray[np.intp]:
    """Return both ends of each stretch that becomes cheaper by one more unit of flow to the right.

    At its left end a source gets paired or a sink loses its partner, at its right end the other way round.
    """
    flow = np.cumsum(np.where(paired, np.where(source, 1, -1), 0))[:-1]
    position = np.concatenate([[0], np.cumsum(np.where(flow >= 0, gap, -gap))])  # cost of going there
    cost = np.where(paired, price, -price)
    left = source != paired
    start_cost = np.where(left, cost - position, np.iinfo(np.int64).max // 2)
    best = np.minimum.accumulate(start_cost)
    ends = np.flatnonzero(~left & (best + position + cost < 0))
    if not len(ends):
        return ends
    # All ends between one best start and the next belong to the former: stretches of different starts are disjoint.
    starts = np.flatnonzero(np.concatenate([[True], best[1:] < best[:-1]]))
    start = starts[np.searchsorted(starts, ends, side="right") - 1]
    by_start = np.lexsort([(position + cost)[ends], start])
    cheapest = np.flatnonzero(np.diff(start[by_start], prepend=-1))
    return np.concatenate([start[by_start[cheapest]], ends[by_start[cheapest]]])
