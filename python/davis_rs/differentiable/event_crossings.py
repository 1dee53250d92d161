"""Finds where log luma of single pixels crosses levels, by following it from instants nearby."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .log_luma import LogLuma, LogLumaField

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

_FIRST_US, _LONGEST_US = 2.0, 2000.0
"""The shortest first step, and the longest step: a rise and fall within a step is missed."""

_FOUND_US = 0.02
_ITERATIONS = 60
_BISECTION = 3
"""Every third iteration halves the interval instead of following the slope."""

_US = 1e6


class Crossings(NamedTuple):
    """Crossings of n levels.

    Attributes:
        t_us: (n,) when they are; the given instant where there is no crossing.
        known: (n,) whether there is a crossing.
        smooth: (n,) whether log luma reaches the level there without jumping over it.
        here: log luma at ``t_us``; at smooth crossings within 0.02 us of it.
    """

    t_us: FloatArray
    known: Flags
    smooth: Flags
    here: LogLuma


class _CrossingSearch:
    """Narrows intervals in which log luma crosses levels: below the level at ``low``, not below at ``high``."""

    def __init__(
        self, field: LogLumaField, t_us: FloatArray, pixel: IntArray, sign: FloatArray, level: FloatArray
    ) -> None:
        self._field, self._pixel, self._sign, self._level = field, pixel, sign, level
        self.at_us, self.here = t_us.copy(), field.at(t_us, pixel)
        self.low, self.high = np.full(len(t_us), np.nan), np.full(len(t_us), np.nan)
        self._put(np.arange(len(t_us)))

    def look(self, which: IntArray, t_us: FloatArray) -> None:
        """Evaluate the crossings ``which`` at new instants, and narrow their intervals."""
        self.at_us[which] = t_us
        self.here.put(which, self._field.at(t_us, self._pixel[which]))
        self._put(which)

    def step_us(self, which: IntArray) -> FloatArray:
        """Return the time to the crossing along the slope; NaN where log luma does not move towards the level."""
        rising = self._sign[which] * self.here.rate[which]
        ahead = self._sign[which] * (self._level[which] - self.here.value[which])
        return np.where(rising > 0, _US * ahead / np.where(rising > 0, rising, 1.0), np.nan)

    def _put(self, which: IntArray) -> None:
        above = self._sign[which] * (self.here.value[which] - self._level[which]) >= 0
        self.high[which[above]] = self.at_us[which[above]]
        self.low[which[~above]] = self.at_us[which[~above]]


def find_crossings(
    field: LogLumaField,
    t_us: FloatArray,
    pixel: IntArray,
    sign: FloatArray,
    level: FloatArray,
    *,
    within_us: float,
) -> Crossings:
    """Find the crossings of levels (n,) by log luma of pixels (n,) next to instants (n,), microseconds.

    If the level is not reached at the instant, the crossing lies later, else before. Steps that double bracket it;
    then Newton steps and bisection find it to within 0.02 us.

    Args:
        sign: (n,) 1 where log luma rises through the level, -1 where it falls.
        within_us: how far from its instant a crossing is searched.
    """
    search = _CrossingSearch(field, t_us, pixel, sign, level)
    first = np.maximum(t_us - within_us, 0.0)
    last = np.minimum(t_us + within_us, field.duration_s * _US)
    step = 1.2 * np.abs(search.step_us(np.arange(len(t_us))))
    step = np.clip(np.nan_to_num(step, nan=50.0), _FIRST_US, 0.5 * _LONGEST_US)
    active = np.arange(len(t_us))
    while True:
        open_ended = np.isnan(search.low[active]) | np.isnan(search.high[active])
        later = np.isnan(search.high[active])
        at = search.at_us[active]
        open_ended &= np.where(later, at < last[active], at > first[active])
        active, later, at = active[open_ended], later[open_ended], at[open_ended]
        if len(active) == 0:
            break
        search.look(active, np.clip(at + np.where(later, 1, -1) * step[active], first[active], last[active]))
        step[active] = np.minimum(2 * step[active], _LONGEST_US)
    crossed = np.isfinite(search.low) & np.isfinite(search.high)
    smooth = np.zeros(len(crossed), np.bool_)
    active = np.flatnonzero(crossed)
    for iteration in range(_ITERATIONS):
        step_us = search.step_us(active)
        near = np.abs(step_us) <= _FOUND_US
        smooth[active[near]] = True
        search.at_us[active[near]] += step_us[near]
        wide = ~near & (np.abs(search.high[active] - search.low[active]) > _FOUND_US)
        active, step_us = active[wide], step_us[wide]
        if len(active) == 0:
            break
        low, high = search.low[active], search.high[active]
        begin, end = np.minimum(low, high), np.maximum(low, high)
        target = search.at_us[active] + step_us
        inside = (target > begin) & (target < end) & (iteration % _BISECTION != _BISECTION - 1)
        search.look(active, np.where(inside, target, (begin + end) / 2))
    jumps = crossed & ~smooth
    search.at_us[jumps] = (search.low[jumps] + search.high[jumps]) / 2
    search.at_us[~crossed] = t_us[~crossed]
    return Crossings(search.at_us, crossed, smooth, search.here)
