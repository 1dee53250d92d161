"""Forecasts how many events two frames call for, before anything is made of them."""

from __future__ import annotations

import numpy as np

from ..._util.argument_error import ArgumentError
from .interpolation import SensorFrame
from .light import LumaFrame

MOST_EVENTS = 1 << 27
"""Between two frames: 2 GiB of events. It is what the core makes of one frame at the most."""

_PIECE = 1 << 20
"""Pixels that are looked at together."""


class EventForecast:
    """Refuses frames whose events would fill memory, from the change of light between them alone.

    Pixels are taken as ideal; between two frames light may go further than from the one to the other. So there are
    about as many events, or more.

    Args:
        threshold: the smaller of C_on and C_off.
        log_eps: dark level in units of luma.
        dead_us: after an event a pixel makes none for so long.
    """

    def __init__(self, threshold: float, log_eps: float, dead_us: float) -> None:
        self._threshold, self._log_eps, self._dead_us = threshold, np.float32(log_eps), dead_us

    def check(self, before: SensorFrame, after: SensorFrame) -> None:
        """Refuse to go on where memory does not hold the events between two frames.

        Raises:
            ValueError: with their number.
        """
        most_each = np.inf if self._dead_us <= 0 else (after.t_us - before.t_us) / self._dead_us + 1
        brightest = max(float(before.luma.max()), float(after.luma.max()))
        steps = np.log1p(brightest / self._log_eps) / self._threshold
        if min(steps, most_each) * after.luma.size <= MOST_EVENTS:
            return  # as for all sensors that there are
        events = self._between(before.luma, after.luma, most_each)
        if events > MOST_EVENTS:
            height, width = after.luma.shape
            raise ArgumentError(
                "{}: from the frame before it to this one {} x {} pixels would make about {:.3g} events: there may be "
                "{:.3g}; raise {contrast_threshold}, give a smaller {size}, or frames that are closer in time",
                *(after.where, width, height, events, MOST_EVENTS),
            )

    def _between(self, before: LumaFrame, after: LumaFrame, most_each: float) -> float:
        rows, events = max(1, _PIECE // before.shape[1]), 0.0
        for start in range(0, len(before), rows):
            first, last = (np.log(luma[start : start + rows] + self._log_eps) for luma in (before, after))
            steps = np.floor(np.abs(last - first) / np.float32(self._threshold))
            events += float(np.minimum(steps, most_each).sum(dtype=np.float64))
        return events
