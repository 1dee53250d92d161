"""Event times polished by asking the renderer itself, so that they no longer depend on when it was sampled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..events import EventArray
from .keyframes import Keyframe, Stretch, exact_log_luma

IntArray = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]

_MOST_ROUNDS = 60
"""Every other round halves the bracket: enough for an interval of a thousand seconds."""

_SMOOTH = 1.25
"""Light runs smoothly through a bracket where its slopes before and after an instant, and at it, differ by less than
this factor."""

_NEAR_US = 2.5
"""A step of the parabola that is no longer is taken as it is: its slope is far better than 40 %."""

_CUBIC_NEAR_US = 1 / 8
"""A step s along the cubic of an interval h is taken as it is where s^2 / h is no more. The step is the cubic's own
error. Such an error vanishes at both ends, so its slope is some 4 s / h of the cubic's, and the step is off by
4 s^2 / h: half a microsecond."""

_CUBIC_MOST_US = 5.0
"""No longer step is taken unasked: where a cubic is that far off, a ray may have jumped."""


class _Brackets(NamedTuple):
    """Where events lie: after ``low_us``, at which log luma has not reached the level, until ``high_us``, where it has.

    ``below`` and ``above`` are log luma minus the level there, times the event's sign: < 0 and >= 0. ``slope`` is how
    fast this rises at the event, per microsecond, along the cubic that the event was found on; NaN where it was found
    on none.
    """

    low_us: IntArray
    high_us: IntArray
    below: FloatArray
    above: FloatArray
    slope: FloatArray


def refine(
    events: EventArray,
    reference: FloatArray,
    last: Keyframe,
    new: Keyframe,
    stretch: Stretch,
    thresholds: tuple[float, float],
) -> EventArray:
    """The events between two keyframes, each at the first microsecond at which the renderer itself has its level.

    The samples around an event bracket its time; the renderer is asked for the pixel's luma in between, in batches of
    all events at once, until the bracket is a microsecond, or light runs so smoothly through it that its curve tells
    the microsecond. At a jump (an edge that passes) that is the microsecond of the jump. Which events there are is not
    changed; one whose level the samples around it do not enclose keeps its time.

    Args:
        events: in the order of a stream, all in (last.t_us, new.t_us].
        reference: R of each pixel (H, W) before them.
        thresholds: C_on and C_off.

    Returns:
        The events in the order of a stream.
    """
    if len(events) == 0:
        return events
    pixel = events["y"].astype(np.int64) * reference.shape[1] + events["x"]
    order = np.argsort(pixel, kind="stable")  # pixel by pixel, in the order of crossing
    events, pixel = events[order], pixel[order]
    first = np.concatenate([[True], pixel[1:] != pixel[:-1]])
    group = np.cumsum(first) - 1
    on = events["p"] == 1
    # Counted, as the engine does: sums of thresholds would carry the rounding of all pixels before.
    count_on, count_off = (np.cumsum(kind) - (np.cumsum(kind) - kind)[first][group] for kind in (on, ~on))
    level = reference.ravel()[pixel] + (count_on * thresholds[0] - count_off * thresholds[1])
    sign = np.where(on, 1.0, -1.0)

    t_us = events["t"].astype(np.int64)
    brackets = _brackets(t_us, pixel, sign, level, last, new, stretch.log_eps)
    _solve(brackets, t_us, pixel, sign, level, stretch)
    enclosed = (brackets.below < 0) & (brackets.above >= 0)
    stamps = np.where(enclosed, brackets.high_us, t_us) - last.t_us
    # A pixel crosses its levels one after the other, also where its luma wavers.
    span = new.t_us - last.t_us + 1
    stamps = np.maximum.accumulate(stamps + group * span) - group * span
    events["t"] = stamps + last.t_us
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
    """The samples before and after each event: the keyframes, or sparse samples of its pixel between them."""
    low_us, high_us = np.full(len(t_us), last.t_us), np.full(len(t_us), new.t_us)
    low, high = last.luma.ravel()[pixel], new.luma.ravel()[pixel]
    slope = sign * _cubic_slope(t_us, pixel, last, new, log_eps)
    if new.sparse is not None and len(new.sparse.pixel):
        before, after = new.sparse.beside(pixel, t_us, after="at")
        for times, luma, (sample, own) in ((low_us, low, before), (high_us, high, after)):
            times[own], luma[own] = new.sparse.t_us[sample[own]], new.sparse.luma[sample[own]]
            slope[own] = np.nan
    below, above = (sign * (exact_log_luma(luma, log_eps) - level) for luma in (low, high))
    return _Brackets(low_us, high_us, below, above, slope)


def _cubic_slope(t_us: IntArray, pixel: IntArray, last: Keyframe, new: Keyframe, log_eps: float) -> FloatArray:
    """The slope of log luma, per microsecond, of the cubics between two keyframes; NaN where there are none."""
    if last.rate is None or new.rate is None:
        return np.full(len(t_us), np.nan)
    luma = [keyframe.luma.ravel()[pixel] for keyframe in (last, new)]
    rates = [keyframe.rate.ravel()[pixel] for keyframe in (last, new) if keyframe.rate is not None]
    log = [exact_log_luma(one, log_eps) for one in luma]
    at_last, at_new = (1e-6 * rate / (one.astype(np.float64) + log_eps) for rate, one in zip(rates, luma, strict=True))
    span_us = new.t_us - last.t_us
    share = (t_us - last.t_us) / span_us
    chord = (log[1] - log[0]) / span_us
    between = 6 * share * (1 - share)
    return np.asarray(
        between * chord + (1 - share) * (1 - 3 * share) * at_last + share * (3 * share - 2) * at_new, np.float64
    )


def _solve(
    brackets: _Brackets, t_us: IntArray, pixel: IntArray, sign: FloatArray, level: FloatArray, stretch: Stretch
) -> None:
    """Tighten, in place, every bracket that encloses its level until it is a microsecond.

    The first instant that is asked for is the event's own, which the curve between the samples gave: it is mostly right
    to some microseconds. Where light runs smoothly through the bracket, the parabola through its ends and the instant
    between them then tells the crossing to less than a microsecond, and nothing more is asked. Where it does not (a ray
    jumps across an edge) the bracket is halved on, whatever the curve says.
    """
    low_us, high_us, below, above, _ = brackets
    active = np.flatnonzero((below < 0) & (above >= 0))
    guess = t_us[active]
    for turn in range(_MOST_ROUNDS):
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
        slopes = np.stack([before, after, slope])
        least = slopes.min(0)
        smooth = (least > 0) & (slopes.max(0) <= _SMOOTH * least)
        step = -excess / np.where(smooth, slope, 1.0)
        stamp = at_us + np.ceil(step).astype(np.int64)
        found = smooth & (np.abs(step) <= near_us) & (stamp > low_us[active]) & (stamp <= high_us[active])
        high_us[active[found]], low_us[active[found]] = stamp[found], stamp[found] - 1

        start, stop, at_start, at_stop = low_us[active], high_us[active], below[active], above[active]
        if turn % 2 == 0:
            by_line = start + np.rint(at_start / (at_start - at_stop) * (stop - start)).astype(np.int64)
            guess = np.where(smooth, stamp, by_line)
        else:
            guess = (start + stop) // 2
