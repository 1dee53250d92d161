"""Counts what the grey levels of integer frames do to log intensity, and how many events they may have made."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ...events.arrays import EventArray

_BELOW = 0.99
"""A step of one grey level is at most this share of C, so that it is below C whatever rounding does."""


def dark_level(levels: npt.NDArray[np.float64] | None, contrast_threshold: float, least: float) -> float:
    """Return the least log_eps, and at least ``least``, at which no step of one grey level comes to C in log intensity.

    From ln((Y_k+1 + e) / (Y_k + e)) <= c follows e >= (Y_k+1 - Y_k exp(c)) / (exp(c) - 1), for each step k. The
    largest is nearly always that above black. A pixel that flickers between two levels then makes no events.

    Args:
        levels: luma of the grey levels; None for floating point.
        contrast_threshold: the smaller of C_on and C_off.
        least: the dark level of a simulation, which frames without visible grey levels have too.
    """
    if levels is None:
        return least
    c = _BELOW * contrast_threshold
    if c > 700:
        return least
    needed = float(np.max((levels[1:] - levels[:-1] * math.exp(c)) / math.expm1(c)))
    return max(least, needed)


class QuantisationCount:
    """Counts the events of pixels whose frame value changed by no more than one grey level from a frame to the next.

    Rounding alone may have made them, or may have moved them by up to the time between two frames. Some are real: slow
    changes pass level by level. So the count is an upper bound of the harm, not a verdict on single events.

    Args:
        levels: luma of the grey levels, increasing; None counts nothing.

    Attributes:
        counts: whether there are grey levels at all.
        suspect: how many such events there were.
        total: how many events there were in all.
    """

    def __init__(self, levels: npt.NDArray[np.float64] | None) -> None:
        self.suspect = self.total = 0
        self._levels = levels
        self.counts = levels is not None
        if levels is not None:
            self._steps = np.append(np.diff(levels), levels[-1] - levels[-2])
            self._largest_step = self._steps.max()

    def add(self, events: EventArray, before: npt.NDArray[np.float32], after: npt.NDArray[np.float32]) -> None:
        """Take the events between two frames of luma (H, W)."""
        self.total += len(events)
        if self._levels is None or not len(events):
            return
        was, now = before.ravel(), after.ravel()
        change = np.abs(now - was)
        # First by the largest step, which leaves few pixels where much moves.
        few = np.flatnonzero(change <= 1.01 * self._largest_step)
        brighter = np.maximum(was[few], now[few])
        # The step that leads up to the brighter of the two.
        below = np.clip(np.searchsorted(self._levels, brighter * (1 - 1e-5)) - 1, 0, len(self._steps) - 1)
        of_a_step = np.zeros(len(was), np.bool_)
        of_a_step[few] = change[few] <= 1.01 * self._steps[below]
        self.suspect += int(np.count_nonzero(of_a_step.reshape(before.shape)[events["y"], events["x"]]))

    def __str__(self) -> str:
        percent = 100 * self.suspect / self.total if self.total else 0.0
        return (
            f"{self.suspect:,} of {self.total:,} events ({percent:.2g} %) came where the pixel changed by one "
            "grey level or less between two frames: rounding alone may have made them"
        )
