"""Filters event streams: background activity, refractory period, flicker, and pixels that are dropped.

>>> quiet = filter_events(events, [BackgroundActivity(2000), Refractory(500)], size=(346, 260))

A filter is a description; :class:`EventFilters` runs several of them over a stream, packet by packet, each on what the
one before let pass. Events are never changed, only left out. What decides is in ``rust/src/filter.rs``.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import astuple, dataclass

import numpy as np
import numpy.typing as npt

from .._core import EventFilter as CoreFilter
from .._util.argument_checks import as_size, check_number
from .._util.argument_error import ArgumentError
from .arrays import EVENT_DTYPE, EventArray, as_events

_LONGEST_US = 2**62

Passes = Callable[[EventArray], npt.NDArray[np.bool_]]
"""Tells for each event of the packet that comes next whether it passes."""


class Filter(ABC):
    """Describes which events pass."""

    @abstractmethod
    def start(self, size: tuple[int, int]) -> Passes:
        """Return what tells which events of a stream pass, on a sensor of (width, height) pixels."""


@dataclass(frozen=True)
class BackgroundActivity(Filter):
    """Passes events near which others came shortly before, because noise comes alone.

    Of the eight pixels around, ``neighbours`` must have had an event of any polarity at most ``window_us`` before, also
    one that did not pass.

    Args:
        window_us: in microseconds, >= 0.
        neighbours: 1..8.

    Source: Delbruck, "Frame-free dynamic digital vision", 2008; the activity noise filter of Metavision.
    """

    window_us: int = 2000
    neighbours: int = 1

    def __post_init__(self) -> None:
        check_number("window_us", self.window_us, 0, _LONGEST_US, whole=True)
        check_number("neighbours", self.neighbours, 1, 8, whole=True)

    def start(self, size: tuple[int, int]) -> Passes:
        return CoreFilter.background_activity(size, self.window_us, self.neighbours).passes


@dataclass(frozen=True)
class Refractory(Filter):
    """Passes an event whose pixel has passed none for ``period_us`` before, of either polarity.

    Args:
        period_us: in microseconds, >= 0.
    """

    period_us: int

    def __post_init__(self) -> None:
        check_number("period_us", self.period_us, 0, _LONGEST_US, whole=True)

    def start(self, size: tuple[int, int]) -> Passes:
        return CoreFilter.refractory(size, self.period_us).passes


@dataclass(frozen=True)
class Flicker(Filter):
    """Drops the events of pixels that see flickering light, such as lamps on the mains, at 100 or 120 Hz.

    A pixel flickers once it has turned from OFF to ON ``periods`` times in a row at even intervals: within
    ``lowest_hz`` .. ``highest_hz``, and each within ``tolerance_us`` of the one before. It ends when a turn does not
    come in time. The first periods pass.

    Args:
        lowest_hz, highest_hz: frequencies that are flicker, > 0 and <= 100,000.
        tolerance_us: in microseconds, >= 0.
        periods: 1..255.

    Source: the anti-flicker filter of Metavision, whose parameters these are.
    """

    lowest_hz: float = 50.0
    highest_hz: float = 520.0
    tolerance_us: int = 1500
    periods: int = 7

    def __post_init__(self) -> None:
        check_number("lowest_hz", self.lowest_hz, 1e-3, 1e5)
        check_number("highest_hz", self.highest_hz, 1e-3, 1e5)
        if self.highest_hz < self.lowest_hz:
            raise ArgumentError("{highest_hz} must not be below {lowest_hz}, got {:g} and {:g}", self.highest_hz,
                                self.lowest_hz)  # fmt: skip
        check_number("tolerance_us", self.tolerance_us, 0, _LONGEST_US, whole=True)
        check_number("periods", self.periods, 1, 255, whole=True)

    def start(self, size: tuple[int, int]) -> Passes:
        shortest_us, longest_us = round(1e6 / self.highest_hz), round(1e6 / self.lowest_hz)
        return CoreFilter.flicker(size, shortest_us, longest_us, self.tolerance_us, self.periods).passes


@dataclass(frozen=True, eq=False)
class DropPixels(Filter):
    """Drops all events of some pixels, such as hot ones.

    Args:
        x, y: integers (n,), their columns and rows; those of ``measure_stream(...).hot_pixels`` fit.
    """

    x: npt.ArrayLike
    y: npt.ArrayLike

    def start(self, size: tuple[int, int]) -> Passes:
        kept = np.ones((size[1], size[0]), np.bool_)
        x, y = np.asarray(self.x, np.int64), np.asarray(self.y, np.int64)
        if x.shape != y.shape or x.ndim != 1:
            raise ArgumentError("{x} and {y} must be rows of one length, got the shapes {} and {}", x.shape, y.shape)
        if ((x < 0) | (x >= size[0]) | (y < 0) | (y >= size[1])).any():
            raise ArgumentError("{x} and {y} must lie on the sensor of {} x {} pixels", *size)
        kept[y, x] = False

        def passes(events: EventArray) -> npt.NDArray[np.bool_]:
            if len(events) and (events["x"].max() >= size[0] or events["y"].max() >= size[1]):
                raise ArgumentError("{size} is {} x {} px, and an event lies outside", *size)
            return kept[events["y"], events["x"]]

        return passes


class EventFilters:
    """Runs filters over a stream, packet by packet: the result does not depend on the cut into packets.

    Args:
        filters: in the order in which they act.
        size: (width, height) of the sensor in pixels.

    Attributes:
        taken, passed: how many events came so far, and how many passed.

    Raises:
        ValueError: for what is no filter, or a size out of range.
    """

    def __init__(self, filters: Iterable[Filter], size: tuple[int, int]) -> None:
        given = list(filters)
        for each in given:
            if not isinstance(each, Filter):
                raise ArgumentError("{filters} must be of davis_rs.filters, got {!r}", each)
        self._passes = [each.start(as_size(size)) for each in given]
        self.taken = self.passed = 0

    def take(self, events: npt.ArrayLike) -> EventArray:
        """Return the events of the next packet that pass, as :data:`~davis_rs.EVENT_DTYPE`.

        Raises:
            ValueError: for an event outside of the sensor, or one that is earlier than the one before.
        """
        taken = as_events(events)
        return np.ascontiguousarray(taken.view("V16")[self.passing(taken)]).view(EVENT_DTYPE)

    def passing(self, events: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """Return which events of the next packet pass: bool (n,).

        Raises:
            ValueError: as :meth:`take`.
        """
        left = as_events(events)
        passing = np.ones(len(left), np.bool_)
        for passes in self._passes:
            told = passes(left)
            left = np.ascontiguousarray(left.view("V16")[told]).view(EVENT_DTYPE)
            passing[passing] = told
        self.taken += len(passing)
        self.passed += len(left)
        return passing


@dataclass(frozen=True)
class FilterScore:
    """Says what filters do to events that are labelled as signal or noise.

    Attributes:
        signal, noise: how many events of either kind came.
        signal_passed, noise_passed: how many of them passed.
    """

    signal: int
    noise: int
    signal_passed: int
    noise_passed: int

    @classmethod
    def of(cls, signal: npt.NDArray[np.bool_], passing: npt.NDArray[np.bool_]) -> FilterScore:
        """Count events by their labels (n,), and by which of them pass (n,)."""
        counts = (signal, ~signal, signal & passing, ~signal & passing)
        return cls(*(int(np.count_nonzero(each)) for each in counts))

    def __add__(self, other: FilterScore) -> FilterScore:
        pairs = zip(astuple(self), astuple(other), strict=True)
        return FilterScore(*(mine + others for mine, others in pairs))

    @property
    def signal_kept(self) -> float:
        """Return the share of the signal that passes; NaN without signal."""
        return self.signal_passed / self.signal if self.signal else math.nan

    @property
    def noise_removed(self) -> float:
        """Return the share of the noise that does not pass; NaN without noise."""
        return 1 - self.noise_passed / self.noise if self.noise else math.nan

    def __str__(self) -> str:
        kept = f"{self.signal_kept:.1%} are kept" if self.signal else "nothing to keep"
        removed = f"{self.noise_removed:.1%} are removed" if self.noise else "nothing to remove"
        return f"of {self.signal:,} events of signal {kept}, of {self.noise:,} events of noise {removed}"


def score_filters(
    events: npt.ArrayLike,
    signal: npt.ArrayLike,
    filters: Filter | Sequence[Filter],
    size: tuple[int, int],
) -> FilterScore:
    """Judge filters by events that are labelled as signal or noise.

    >>> dataset = davis_rs.Dataset("labelled")
    >>> print(score_filters(dataset.events, dataset.signal, BackgroundActivity(2000), dataset.size))

    Args:
        events, filters, size: as of :func:`filter_events`.
        signal: (n,) of truth values, one for each event: True for signal, False for noise.

    Raises:
        ValueError: as :class:`EventFilters`, and for another number of labels than of events.
    """
    taken, labels = as_events(events), np.asarray(signal, np.bool_)
    if labels.shape != taken.shape:
        raise ArgumentError("{signal} must have a label for each of {} events, got the shape {}", len(taken),
                            labels.shape)  # fmt: skip
    return FilterScore.of(labels, EventFilters(_listed(filters), size).passing(taken))


def _listed(filters: Filter | Sequence[Filter]) -> Sequence[Filter]:
    return [filters] if isinstance(filters, Filter) else filters


def filter_events(events: npt.ArrayLike, filters: Filter | Sequence[Filter], size: tuple[int, int]) -> EventArray:
    """Return the events that pass filters; the input is not changed.

    Args:
        events: anything that :func:`~davis_rs.as_events` takes, in the order of time.
        filters: one, or several in the order in which they act.
        size: (width, height) of the sensor in pixels.

    Raises:
        ValueError: as :class:`EventFilters`.
    """
    return EventFilters(_listed(filters), size).take(events)
