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


class _Brackets(NamedTuple):
    """Where events lie: after ``low_us``, at which log luma has not reached the level, until ``high_us``, where it has.

    ``below`` and ``above`` are log luma minus the level there, times the event's sign: < 0 and >= 0.
    """

    low_us: IntArray
    high_us: IntArray
    below: FloatArray
    above: FloatArray


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
    all events at once, by turns where the line through the bracket's ends meets the level and in its middle, until the
    bracket is a microsecond. At a jump (an edge that passes) that is the microsecond of the jump. Which events there
    are is not changed; one whose level the samples around it do not enclose keeps its time.

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
    _solve(brackets, pixel, sign, level, stretch)
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
    if new.sparse is not None and len(new.sparse.pixel):
        before, after = new.sparse.beside(pixel, t_us, after="at")
        for times, luma, (sample, own) in ((low_us, low, before), (high_us, high, after)):
            times[own], luma[own] = new.sparse.t_us[sample[own]], new.sparse.luma[sample[own]]
    excess = [sign * (exact_log_luma(luma, log_eps) - level) for luma in (low, high)]
    return _Brackets(low_us, high_us, *excess)


def _solve(brackets: _Brackets, pixel: IntArray, sign: FloatArray, level: FloatArray, stretch: Stretch) -> None:
    """Tighten, in place, every bracket that encloses its level until it is a microsecond."""
    low_us, high_us, below, above = brackets
    enclosed = (below < 0) & (above >= 0)
    for turn in range(_MOST_ROUNDS):
        active = np.flatnonzero(enclosed & (high_us - low_us > 1))
        if len(active) == 0:
            return
        start, stop = low_us[active], high_us[active]
        if turn % 2 == 0:
            share = below[active] / (below[active] - above[active])
            guess = start + np.rint(share * (stop - start)).astype(np.int64)
        else:
            guess = (start + stop) // 2
        t_us = np.clip(guess, start + 1, stop - 1)
        luma = stretch.renderer.samples(stretch.views(t_us), np.arange(len(active)), pixel[active])
        excess = sign[active] * (exact_log_luma(luma, stretch.log_eps) - level[active])
        reached = excess >= 0
        high_us[active[reached]], above[active[reached]] = t_us[reached], excess[reached]
        low_us[active[~reached]], below[active[~reached]] = t_us[~reached], excess[~reached]
