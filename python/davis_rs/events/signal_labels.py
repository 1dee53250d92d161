"""Labels the events of a noisy stream, packet by packet: signal, or noise.

>>> labels = SignalLabels(size=(346, 260))
>>> for packet in simulate(scene, sensor="davis346", signal_window_us=10_000):
...     for_the_oldest = labels.add(packet.events, packet.noiseless, packet.end_us)
>>> for_the_last = labels.finish()
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .._util.argument_checks import as_size, check_number
from .._util.argument_error import ArgumentError
from .._util.close_names import names_checked
from .arrays import EventArray
from .matching import DEFAULT_WINDOW_US, LARGEST_WINDOW_US, aligned, checked_events, coincident

_LONGEST = 100
"""Windows after which a run of events without a pause as long as the window is cut."""

_NOISE, _SIGNAL, _OPEN = 0, 1, 2


@names_checked
class SignalLabels:
    """Labels events by a twin of their stream: what the same pixels make of the same light without noise.

    An event is signal if it is matched with one of the twin, as :func:`~davis_rs.compare_events` matches: one to one,
    of the same pixel and polarity, at most ``window_us`` apart. All others are noise. Labels do not depend on how the
    streams are cut into packets.

    Memory is that of the events that still wait. An event waits until its pixel has made none of its polarity for
    ``window_us``, in either stream. Where that takes longer than 100 windows, events up to the longest pause in the
    second half of these are matched among themselves.

    Args:
        size: (width, height) of the sensor in pixels.
        window_us: the largest time between the two events of a match in microseconds, 0 to 2^31 - 1.

    Attributes:
        signal, noise: how many events were labelled so.

    Raises:
        ValueError: for a size or a window out of range.
    """

    def __init__(self, size: tuple[int, int], *, window_us: int = DEFAULT_WINDOW_US) -> None:
        check_number("window_us", window_us, 0, LARGEST_WINDOW_US, whole=True)
        self._size, self._window_us = as_size(size), int(window_us)
        self._waiting = _Waiting.none()
        self._until_us = -1
        self._labels = np.zeros(0, np.uint8)  # of the events from the first one on that waits
        self.signal = self.noise = 0

    def add(self, events: npt.ArrayLike, noiseless: npt.ArrayLike | None, until_us: int) -> npt.NDArray[np.bool_]:
        """Take the next packet of both streams; return the labels that are decided by now, in the order of the events.

        Args:
            events: (n,) events of the noisy stream, anything that :func:`~davis_rs.as_events` takes, sorted by time.
            noiseless: (m,) events of the twin, likewise.
            until_us: both streams are complete up to this time, in microseconds: later packets have later events.

        Returns:
            The labels of the first k events that had none yet, bool (k,), True for signal.

        Raises:
            ValueError: for events out of order, outside of the sensor or of another time (with the first one), and
                without a twin.
        """
        if noiseless is None:
            raise ArgumentError("{noiseless} events are missing: simulate with {signal_window_us}")
        ours, theirs = self._checked(events, "events", until_us), self._checked(noiseless, "noiseless", until_us)
        self._until_us = int(until_us)
        self._take(ours, theirs)
        return self._decide(self._until_us)

    def finish(self) -> npt.NDArray[np.bool_]:
        """Return the labels of all events that still wait, once both streams are over: bool (k,)."""
        return self._decide(None)

    def _checked(self, array: npt.ArrayLike, name: str, until_us: int) -> EventArray:
        events = checked_events(array, name, self._size)
        if not len(events):
            return events
        first_us, last_us = int(events["t"][0]), int(events["t"][-1])
        if first_us <= self._until_us or last_us > until_us:
            raise ArgumentError(
                "{stream} must lie after {} us, where the last packet ended, up to {until_us}, {} us: got {} to {} us",
                *(self._until_us, until_us, first_us, last_us),
                stream=name,
            )
        return events

    def _take(self, ours: EventArray, theirs: EventArray) -> None:
        number = len(self._labels)
        self._labels = np.concatenate([self._labels, np.full(len(ours), _OPEN, np.uint8)])
        added = _Waiting.of(ours, theirs, number)
        # Those of one time come in one packet, so they are told before others wait.
        paired = coincident(added.t_us, added.is_ours, added.first)
        self._label(added.select(paired), signal=True)
        self._waiting = self._waiting.with_later(added.select(~paired))

    def _decide(self, until_us: int | None) -> npt.NDArray[np.bool_]:
        """Label what no later event can change, and return the labels up to the first event that waits."""
        while len(self._waiting):
            clusters = _Clusters(self._waiting, self._window_us, until_us)
            if not clusters.over.any():
                break
            decided = self._waiting.select(clusters.over)
            paired = aligned(decided.t_us, decided.is_ours, clusters.begins[clusters.over], self._window_us)
            self._label(decided.select(paired), signal=True)
            self._label(decided.select(~paired), signal=False)
            self._waiting = self._waiting.select(~clusters.over)
        waits = self._labels == _OPEN
        count = int(waits.argmax()) if waits.any() else len(waits)
        told, self._labels = self._labels[:count] == _SIGNAL, self._labels[count:]
        self._waiting.number -= count
        self.signal += int(np.count_nonzero(told))
        self.noise += int(np.count_nonzero(~told))
        return told

    def _label(self, events: _Waiting, *, signal: bool) -> None:
        self._labels[events.number[events.is_ours]] = _SIGNAL if signal else _NOISE


class _Waiting:
    """Holds events of both streams in order (pixel and polarity, time, twin first).

    Attributes:
        line: int64 (n,), pixel and polarity as one number.
        t_us: int64 (n,).
        is_ours: bool (n,), False for the twin's.
        number: int64 (n,), which of the labels is the event's; without a meaning for the twin's.
    """

    def __init__(
        self,
        line: npt.NDArray[np.int64],
        t_us: npt.NDArray[np.int64],
        is_ours: npt.NDArray[np.bool_],
        number: npt.NDArray[np.int64],
    ) -> None:
        self.line, self.t_us, self.is_ours, self.number = line, t_us, is_ours, number

    @classmethod
    def none(cls) -> _Waiting:
        integers = np.zeros(0, np.int64)
        return cls(integers, integers, np.zeros(0, np.bool_), integers.copy())

    @classmethod
    def of(cls, ours: EventArray, theirs: EventArray, number: int) -> _Waiting:
        """Sort a packet of both streams; ``number`` is that of the first of ours."""
        t_us, x, y, p = (np.concatenate([theirs[name], ours[name]]).astype(np.int64) for name in ("t", "x", "y", "p"))
        numbers = np.concatenate([np.zeros(len(theirs), np.int64), np.arange(number, number + len(ours))])
        is_ours = np.arange(len(t_us)) >= len(theirs)
        return cls(((y << 16) + x) * 2 + (p != 0), t_us, is_ours, numbers)._sorted()

    def _sorted(self) -> _Waiting:
        return self.select(np.lexsort([self.is_ours, self.t_us, self.line]))

    def with_later(self, others: _Waiting) -> _Waiting:
        """Return these events and others, which are later."""
        names = ("line", "t_us", "is_ours", "number")
        return _Waiting(*(np.concatenate([getattr(self, name), getattr(others, name)]) for name in names))._sorted()

    def select(self, which: npt.NDArray[np.bool_ | np.intp]) -> _Waiting:
        return _Waiting(self.line[which], self.t_us[which], self.is_ours[which], self.number[which])

    @property
    def first(self) -> npt.NDArray[np.bool_]:
        """Return which events are the first of their pixel and polarity."""
        first = np.ones(len(self), np.bool_)
        first[1:] = self.line[1:] != self.line[:-1]
        return first

    def __len__(self) -> int:
        return len(self.t_us)


class _Clusters:
    """Finds runs of events in which each is at most the window after the one before, and cuts those that are too long.

    Attributes:
        begins: bool (n,), the event is the first of its run.
        over: bool (n,), nothing that comes after ``until_us`` can belong to the event's run; None: nothing comes.
    """

    def __init__(self, waiting: _Waiting, window_us: int, until_us: int | None) -> None:
        t_us = waiting.t_us
        gaps = np.diff(t_us, prepend=t_us[:1])
        self.begins = waiting.first | (gaps > window_us)
        starts = np.flatnonzero(self.begins)
        lengths = np.diff(starts, append=len(t_us))
        ends_us, since_us = t_us[starts + lengths - 1], t_us - np.repeat(t_us[starts], lengths)
        over = np.full(len(starts), until_us is None)
        if until_us is not None:
            over |= ends_us + window_us <= until_us
        longest_us = _LONGEST * window_us
        known = True if until_us is None else t_us[starts] + longest_us + window_us <= until_us
        long = (ends_us - t_us[starts] > longest_us) & known
        self.over = np.repeat(over & ~long, lengths)
        if long.any():
            # The event after the longest pause begins another run; among equal pauses it is the first one.
            may = np.repeat(long, lengths) & (since_us > longest_us // 2) & (since_us <= longest_us)
            pause = np.where(may, gaps, -1)
            longest = may & (pause == np.repeat(np.maximum.reduceat(pause, starts), lengths))
            at = np.flatnonzero(longest)
            run = np.repeat(np.arange(len(starts)), lengths)[at]
            cuts = at[np.unique(run, return_index=True)[1]]
            self.begins[cuts] = True
            # What lies before the cut is over now; what lies behind it is looked at again.
            for_cut = np.zeros(len(starts), np.int64)
            for_cut[long] = cuts
            self.over |= np.repeat(long, lengths) & (np.arange(len(t_us)) < np.repeat(for_cut, lengths))


@names_checked
def label_signal(
    events: npt.ArrayLike, noiseless: npt.ArrayLike, *, size: tuple[int, int], window_us: int = DEFAULT_WINDOW_US
) -> npt.NDArray[np.bool_]:
    """Label the events of a whole stream, as :class:`SignalLabels` does: bool (n,), True for signal, False for noise.

    >>> signal = label_signal(noisy, clean, size=(346, 260))
    >>> print(f"{1 - signal.mean():.1%} of the events are noise")

    Args:
        events: (n,) events of the noisy stream, anything that :func:`~davis_rs.as_events` takes, sorted by time.
        noiseless: (m,) events of the same run without noise, likewise.
        size, window_us: as of :class:`SignalLabels`.

    Raises:
        ValueError: as :class:`SignalLabels`.
    """
    labels = SignalLabels(size, window_us=window_us)
    ours, theirs = (
        checked_events(given, name, labels._size) for given, name in ((events, "events"), (noiseless, "noiseless"))
    )
    last_us = max((int(each["t"][-1]) for each in (ours, theirs) if len(each)), default=0)
    return np.concatenate([labels.add(ours, theirs, last_us), labels.finish()])
