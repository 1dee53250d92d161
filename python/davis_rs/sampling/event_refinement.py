"""Refines the times of events by asking the renderer itself, so that they do not depend on when it was sampled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..events.arrays import EventArray, concatenate_events
from .interpolate import end_slopes
from .keyframes import Keyframe, Stretch, exact_log_luma

IntArray = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]

_MOST_TURNS = 60
"""Brackets are as good as halved in each: enough for an interval of a thousand seconds."""

_MOST_SMOOTH_TURNS = 4
"""After this many steps along a curve, a bracket is tightened without regard to the curve."""

_SMOOTH = 1.25
"""Light runs smoothly through a bracket where its slope at an instant, and that towards the nearer end, differ by less
than this factor."""

_NEAR_US = 2.5
"""A step of the parabola that is no longer is taken as it is: its slope is far better than 40 %."""

_CUBIC_NEAR_US = 1 / 8
"""A step s along the cubic of an interval h is taken as it is where s^2 / h is no more. The step is the cubic's own
error. Such an error vanishes at both ends, so its slope is some 4 s / h of the cubic's, and the step is off by
4 s^2 / h: half a microsecond."""

_CUBIC_MOST_US = 5.0
"""No longer step is taken unasked: where a cubic is that far off, a ray may have jumped."""

_TOGETHER = 1 << 15
"""Events that are refined together: fewer would cost more calls of the renderer, more would cost memory."""


class _Brackets(NamedTuple):
    """Brackets events: after ``low_us``, at which log luma has not reached the level, until ``high_us``, where it has.

    ``below`` and ``above`` are log luma minus the level there, times the event's sign: < 0 and >= 0. ``slope`` is how
    fast this rises at the event, per microsecond, along the cubic that the event was found on; NaN where it was found
    on none.
    """

    low_us: IntArray
    high_us: IntArray
    below: FloatArray
    above: FloatArray
    slope: FloatArray


class _IntervalEvents(NamedTuple):
    """Holds the events between two keyframes, pixel by pixel in the order of crossing.

    Attributes:
        events: n of them.
        group: (n,) 0, 1, ...: which of the pixels that have events.
        pixel: (n,) y W + x.
        sign: (n,) 1 for ON, -1 for OFF.
        level: (n,) log luma at which the event is.
        brackets: of the events.
        start_us, end_us: times of the keyframes.
    """

    events: EventArray
    group: IntArray
    pixel: IntArray
    sign: FloatArray
    level: FloatArray
    brackets: _Brackets
    start_us: int
    end_us: int


class EventRefinement:
    """Moves each event to the first microsecond at which the renderer itself has its level.

    The samples around an event bracket its time; the renderer is asked for the pixel's luma in between, in batches of
    many events at once, until the bracket is a microsecond, or light runs so smoothly through it that its curve tells
    the microsecond. At a jump (an edge that passes) that is the microsecond of the jump. Which events there are is not
    changed; one whose level the samples around it do not enclose keeps its time.

    Args:
        stretch: what is rendered.
        thresholds: C_on and C_off.
    """

    def __init__(self, stretch: Stretch, thresholds: tuple[float, float]) -> None:
        self._stretch, self._thresholds = stretch, thresholds
        self._waiting, self._refined = list[_IntervalEvents](), list[EventArray]()

    def add(self, events: EventArray, reference: FloatArray, last: Keyframe, new: Keyframe) -> None:
        """Take up the events between two keyframes, which come after those of the call before.

        Args:
            events: in the order of a stream, all in (last.t_us, new.t_us].
            reference: R of each pixel (H, W) before them.
        """
        if len(events) == 0:
            return
        pixel = events["y"].astype(np.int64) * reference.shape[1] + events["x"]
        order = np.argsort(pixel, kind="stable")  # pixel by pixel, in the order of crossing
        events, pixel = events[order], pixel[order]
        first = np.concatenate([[True], pixel[1:] != pixel[:-1]])
        group = np.cumsum(first) - 1
        on = events["p"] == 1
        # Counted, as the engine does: sums of thresholds would carry the rounding of all pixels before.
        count_on, count_off = (np.cumsum(kind) - (np.cumsum(kind) - kind)[first][group] for kind in (on, ~on))
        level = reference.ravel()[pixel] + (count_on * self._thresholds[0] - count_off * self._thresholds[1])
        sign = np.where(on, 1.0, -1.0)
        brackets = _brackets(events["t"].astype(np.int64), pixel, sign, level, last, new, self._stretch.log_eps)
        self._waiting.append(_IntervalEvents(events, group, pixel, sign, level, brackets, last.t_us, new.t_us))
        if sum(len(interval.events) for interval in self._waiting) >= _TOGETHER:
            self._solve_waiting()

    def take(self) -> EventArray:
        """Return all events so far that were not taken before, refined, in the order of a stream."""
        self._solve_waiting()
        refined = concatenate_events(self._refined)
        self._refined.clear()
        return refined

    def _solve_waiting(self) -> None:
        waiting = self._waiting
        if not waiting:
            return
        t_us = np.concatenate([interval.events["t"].astype(np.int64) for interval in waiting])
        pixel, sign, level = (
            np.concatenate([getattr(interval, name) for interval in waiting]) for name in ("pixel", "sign", "level")
        )
        brackets = _Brackets(*(np.concatenate(c) for c in zip(*(i.brackets for i in waiting), strict=True)))
        _solve(brackets, t_us, pixel, sign, level, self._stretch)
        enclosed = (brackets.below < 0) & (brackets.above >= 0)
        stamps = np.where(enclosed, brackets.high_us, t_us)
        ends = np.cumsum([len(interval.events) for interval in waiting])
        self._refined += [
            _stamped(interval, own) for interval, own in zip(waiting, np.split(stamps, ends[:-1]), strict=True)
        ]
        waiting.clear()


def _stamped(interval: _IntervalEvents, t_us: IntArray) -> EventArray:
    """Return the events of an interval at their new times, in the order of a stream."""
    # A pixel crosses its levels one after the other, also where its luma wavers.
    after_others = interval.group * (interval.end_us - interval.start_us + 1)
    stamps = np.maximum.accumulate(t_us - interval.start_us + after_others) - after_others
    events = interval.events
    events["t"] = stamps + interval.start_us
    return events[np.lexsort((events["x"], events["y"], events["t"]))]


def _brackets(
    t_us: IntArray,
    pixel: IntArray,
    sign: FloatArray,
    level: FloatArray,
    last: Keyframe,
    new: Keyframe,
    log_eps: float,
) -> _Brackets:
    """Return the samples before and after each event: the keyframes, or sparse samples of its pixel between them."""
    low_us, high_us = np.full(len(t_us), last.t_us), np.full(len(t_us), new.t_us)
    low, high = (exact_log_luma(keyframe.luma.ravel()[pixel], log_eps) for keyframe in (last, new))
    slope = np.full(len(t_us), np.nan)
    if last.rate is not None and new.rate is not None:
        interval_us, chord = new.t_us - last.t_us, high - low
        p, q = end_slopes(last.rate.ravel()[pixel], new.rate.ravel()[pixel], low, high, interval_us)
        fraction = (t_us - last.t_us) / interval_us
        bend = (1 - fraction) * (1 - 3 * fraction) * (p - chord) - fraction * (2 - 3 * fraction) * (q - chord)
        slope = sign * (chord + bend) / interval_us
    if new.sparse is not None and len(new.sparse.pixel):
        before, after = new.sparse.neighbours(pixel, t_us, after="at")
        for times, log, (sample, own) in ((low_us, low, before), (high_us, high, after)):
            times[own] = new.sparse.t_us[sample[own]]
            log[own] = exact_log_luma(new.sparse.luma[sample[own]], log_eps)
            slope[own] = np.nan
    return _Brackets(low_us, high_us, sign * (low - level), sign * (high - level), slope)


def _solve(
    brackets: _Brackets, t_us: IntArray, pixel: IntArray, sign: FloatArray, level: FloatArray, stretch: Stretch
) -> None:
    """Tighten, in place, every bracket that encloses its level until it is a microsecond.

    The first instant that is asked for is the event's own, which the curve between the samples gave: it is mostly right
    to some microseconds. Where light runs smoothly through the bracket, the parabola through its ends and the instant
    between them then tells the crossing: a short step is taken as it is, at the end of a longer one the renderer is
    asked again. Where light does not run smoothly (a ray jumps across an edge) the bracket is tightened by the ITP
    method, which asks hardly more often than halving would, whatever the curve is.
    """
    low_us, high_us, below, above, _ = brackets
    active = np.flatnonzero((below < 0) & (above >= 0))
    guess = t_us[active]
    itp = _Itp(high_us - low_us)
    for turn in range(_MOST_TURNS):
        open_ = high_us[active] - low_us[active] > 1
        active, guess = active[open_], guess[open_]
        if len(active) == 0:
            return
        start, stop, at_start, at_stop = low_us[active], high_us[active], below[active], above[active]
        at_us = np.clip(guess, start + 1, stop - 1)
        luma = stretch.renderer.samples(stretch.views(at_us), np.arange(len(active)), pixel[active])
        excess = sign[active] * (exact_log_luma(luma, stretch.log_eps) - level[active])
        reached = excess >= 0
        high_us[active[reached]], above[active[reached]] = at_us[reached], excess[reached]
        low_us[active[~reached]], below[active[~reached]] = at_us[~reached], excess[~reached]

        before, after = (excess - at_start) / (at_us - start), (at_stop - excess) / (stop - at_us)
        slope = before + after - (at_stop - at_start) / (stop - start)  # of the parabola, there
        near_us = np.full(len(active), _NEAR_US)
        if turn == 0:
            by_cubic = brackets.slope[active]
            cubic = np.isfinite(by_cubic)
            slope = np.where(cubic, by_cubic, slope)
            near_us = np.where(cubic, np.minimum(np.sqrt(_CUBIC_NEAR_US * (stop - start)), _CUBIC_MOST_US), near_us)
        local = np.where(at_us - start <= stop - at_us, before, after)
        least = np.minimum(local, slope)
        smooth = (least > 0) & (np.maximum(local, slope) <= _SMOOTH * least)
        step = -excess / np.where(smooth, slope, 1.0)
        stamp = at_us + np.ceil(step).astype(np.int64)
        smooth &= (stamp > low_us[active]) & (stamp <= high_us[active])
        converged = smooth & (np.abs(step) <= near_us)
        high_us[active[converged]], low_us[active[converged]] = stamp[converged], stamp[converged] - 1
        guess = stamp
        other = np.flatnonzero(~smooth | (turn >= _MOST_SMOOTH_TURNS))
        guess[other] = itp.next(brackets, active[other])


class _Itp:
    """Narrows n brackets by the interpolate, truncate, project (ITP) method, on whole microseconds.

    It asks at most once more than halving would, and mostly far less often.

    Source: Oliveira, Takahashi, An Enhancement of the Bisection Method Average Performance Preserving Minmax
    Optimality, ACM Trans. Math. Softw. 47(1), 2020; kappa_1 = 0.2 / (b - a), kappa_2 = 2, n_0 = 1.
    """

    def __init__(self, length_us: IntArray) -> None:
        self._length_us = length_us
        # The method's epsilon, half the width that a bracket must come to, times 2 ** (turns that are left).
        self._reach_us = 2.0 ** np.ceil(np.log2(np.maximum(length_us, 1)))

    def next(self, brackets: _Brackets, which: IntArray) -> IntArray:
        """Return where to ask next in some of the brackets."""
        low_us, high_us = brackets.low_us[which], brackets.high_us[which]
        below, above = brackets.below[which], brackets.above[which]
        width_us, middle = high_us - low_us, (low_us + high_us) / 2
        by_line = (above * low_us - below * high_us) / (above - below)
        towards = np.sign(middle - by_line)
        truncated = 0.2 * width_us**2 / self._length_us[which]
        guess = np.where(truncated <= np.abs(middle - by_line), by_line + towards * truncated, middle)
        room_us = np.maximum(self._reach_us[which] - width_us / 2, 0.0)
        guess = np.where(np.abs(guess - middle) <= room_us, guess, middle - towards * room_us)
        self._reach_us[which] /= 2
        return np.rint(guess).astype(np.int64)
