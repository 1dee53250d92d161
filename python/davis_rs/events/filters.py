"""Filters event streams: background activity, refractory period, flicker, and pixels that are dropped.

>>> quiet = filter_events(events, [BackgroundActivity(2000), Refractory(500)], size=(346, 260))

A filter is a description; :class:`EventFilters` runs several of them over a stream, packet by packet, each on what the
one before let pass. Events are never changed, only left out. What decides is in ``rust/src/filter.rs``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

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
        left = as_events(events)
        self.taken += len(left)
        for passes in self._passes:
            left = np.ascontiguousarray(left.view("V16")[passes(left)]).view(EVENT_DTYPE)
        self.passed += len(left)
        return left


def filter_events(events: npt.ArrayLike, filters: Filter | Sequence[Filter], size: tuple[int, int]) -> EventArray:
    """Return the events that pass filters; the input is not changed.

    Args:
        events: anything that :func:`~davis_rs.as_events` takes, in the order of time.
        filters: one, or several in the order in which they act.
        size: (width, height) of the sensor in pixels.

    Raises:
        ValueError: as :class:`EventFilters`.
    """
    return EventFilters([filters] if isinstance(filters, Filter) else filters, size).take(events)
