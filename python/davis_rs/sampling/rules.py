"""Defines rules of sampling in time: at which instants a sequence is rendered."""

from __future__ import annotations

import heapq
import math
import time
import warnings
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby, islice, repeat

from .._util.argument_checks import check_number
from ..geometry.trajectory.trajectory import Trajectory
from ..render.base import Launched, Renderer
from .displacement import LARGEST_BEND, DisplacementClock, path_bound
from .keyframes import Keyframe, Stretch
from .plausibility import probed


def periodic_instants(rate_hz: float, start_us: int, end_us: int) -> Iterator[int]:
    """Return instants round(k 1e6 / rate) us, k = 0, 1, ..., that lie in [start_us, end_us]; none for rate 0.

    They are rounded half up in exact arithmetic, so that no rate drifts.

    Raises:
        ValueError: for a rate that is negative, not finite or above 1e6 Hz (two instants in one microsecond).
    """
    check_number("rate_hz", rate_hz, 0, 1e6, unit="Hz")
    return _periodic_instants(float(rate_hz), start_us, end_us)


def _periodic_instants(rate_hz: float, start_us: int, end_us: int) -> Iterator[int]:
    if rate_hz == 0:
        return
    # The period is over / under microseconds; whole numbers are faster than fractions, which matters to short steps.
    under, of_seconds = rate_hz.as_integer_ratio()
    over = 1_000_000 * of_seconds
    k = max(0, start_us * under // over - 1)
    while (t_us := (2 * k * over + under) // (2 * under)) <= end_us:
        if t_us >= start_us:
            yield t_us
        k += 1


_FINE_PX, _MANY_RENDERS = 0.01, 1e5
"""For displacements finer than the first the number of renders is estimated; a warning says if it exceeds the
second."""


_CALL_S = 5.0
"""The renderer is asked for so many keyframes at once that this takes about so long at most: then one soon sees how far
a run is, and it ends soon after Ctrl-C."""
_GROWTH = 4
"""The first call takes one keyframe, any other at most so many times as many as the call before."""


class ManyRendersWarning(UserWarning):
    """Warns that a simulation will render very often, and so take very long."""


class TimeSampling(ABC):
    """Decides when luma is rendered, and how log luma runs in between.

    Whatever the rule, there are keyframes where motion or light breaks (``davis_rs.sampling.breaks``).
    """

    edges: bool = False
    """Whether the rule needs the edges of the geometry."""

    @property
    @abstractmethod
    def interpolation(self) -> str:
        """Return how log luma runs between keyframes: ``linear``, or ``hermite`` if keyframes have rates."""

    @abstractmethod
    def keyframes(self, stretch: Stretch) -> Iterator[Keyframe]:
        """Yield the keyframes of a stretch, in order, with one at each required instant."""


class ScheduledSampling(TimeSampling):
    """A rule that knows its instants in advance.

    Attributes:
        hermite: interpolate log luma by cubics, through the renderer's own rates of change; else by lines.
    """

    hermite: bool

    @abstractmethod
    def instants(self, renderer: Renderer, trajectory: Trajectory, end_us: int, *, start_us: int = 0) -> Iterator[int]:
        """Yield strictly increasing instants in (0, end_us], in microseconds of the trajectory; perhaps not the end.

        The trajectory begins at ``start_us`` of the sequence, by whose time other things move.
        """

    @property
    def interpolation(self) -> str:
        return "hermite" if self.hermite else "linear"

    def keyframes(self, stretch: Stretch) -> Iterator[Keyframe]:
        renderer, start_us = stretch.renderer, stretch.start_us
        planned = self.instants(renderer, stretch.trajectory, stretch.end_us - start_us, start_us=start_us)
        merged = heapq.merge((start_us + t_us for t_us in planned), stretch.required(both=self.hermite))
        times = _with_probed(stretch, (t_us for t_us, _ in groupby(merged)))
        begin = renderer.begin_luma_and_rate if self.hermite else renderer.begin_luma
        launched: tuple[list[int], Launched] | None = None
        count = 1
        while batch := list(islice(times, count)):
            began = time.monotonic()
            # The next batch renders while the crossing engine works on the one before.
            ahead = (batch, begin(stretch.views(batch)))
            count = next_count(count, len(batch), time.monotonic() - began, stretch.batch)
            if launched is not None:
                yield from _keyframes(*launched)
            launched = ahead
        if launched is not None:
            yield from _keyframes(*launched)


def next_count(asked: int, done: int, seconds: float, most: int) -> int:
    """Return how many keyframes the next call of the renderer may take.

    Args:
        asked, done: how many the last call might take, and took.
        seconds: how long that took.
        most: the renderer's own bound.
    """
    in_time = int(done * _CALL_S / max(seconds, 1e-9))
    return min(max(in_time, 1), _GROWTH * asked, most)


def _with_probed(stretch: Stretch, times: Iterator[int]) -> Iterator[int]:
    """Yield the times of keyframes, and those that probes of long spans add."""
    last_us = stretch.start_us
    for t_us in times:
        yield from probed(stretch, last_us, t_us)
        yield t_us
        last_us = t_us


def _keyframes(times: list[int], launched: Launched) -> Iterator[Keyframe]:
    luma, rates = launched()
    return map(Keyframe, times, luma, repeat(None) if rates is None else rates)


@dataclass(frozen=True)
class FixedRate(ScheduledSampling):
    """Render at a fixed rate in Hz, whatever moves; 1000 is the dataset's own.

    Raises:
        ValueError: for a rate outside of (0, 1e6] Hz.
    """

    rate_hz: float
    hermite: bool = False

    def __post_init__(self) -> None:
        check_number("rate_hz", self.rate_hz, 0, 1e6, above_low=True, unit="Hz")

    def instants(self, renderer: Renderer, trajectory: Trajectory, end_us: int, *, start_us: int = 0) -> Iterator[int]:
        return periodic_instants(self.rate_hz, 1, end_us)


@dataclass(frozen=True)
class MaxDisplacement(ScheduledSampling):
    """Render whenever the fastest pixel has moved by ``pixels``.

    See ``davis_rs.sampling.displacement.DisplacementClock``: the camera's motion counts, moving objects, and
    light that changes. Where nothing changes, there are no instants. It renders more often where something starts or
    stops changing, and where the displacement between two renders would not grow evenly in time.

    Raises:
        ValueError: for a displacement that is not positive and finite.

    Warns:
        ManyRendersWarning: where so small a displacement needs very many renders.

    Source: Mueggler et al., IJRR 2017, section 6; Rebecq, Gehrig, Scaramuzza, ESIM, CoRL 2018 (sampling by flow).
    """

    pixels: float = 1 / 3
    hermite: bool = False

    def __post_init__(self) -> None:
        check_number("pixels", self.pixels, 0, above_low=True)

    def instants(self, renderer: Renderer, trajectory: Trajectory, end_us: int, *, start_us: int = 0) -> Iterator[int]:
        if path_bound(renderer, trajectory, end_us) < self.pixels:
            return
        clock = DisplacementClock(renderer, trajectory, end_us, start_us=start_us)
        if self.pixels < _FINE_PX and end_us > 0:
            self._warn(clock, end_us)
        last_us, count = 0, 1
        while (end := clock.span_end(last_us, count * self.pixels, LARGEST_BEND * self.pixels)) is not None:
            if end.t_us > last_us:
                last_us = end.t_us
                yield last_us
                count += end.reached
            else:  # several fall in one microsecond: continue after it
                count = max(count + end.reached, math.ceil(clock.path_at(last_us + 1) / self.pixels))

    def _warn(self, clock: DisplacementClock, end_us: int) -> None:
        renders = clock.estimated_renders(self.pixels)
        if renders > _MANY_RENDERS:
            warnings.warn(
                f"a displacement of {self.pixels:g} px between renders (max_displacement_px) asks for about "
                f"{renders:.2g} renders of {end_us * 1e-6:g} s; 1/3 px is usual",
                ManyRendersWarning,
                stacklevel=2,
            )
