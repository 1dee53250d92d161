"""Defines the effect of a reference that leaks."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from .effect import EngineEffect, Where

REFERENCE_C = 25.0
"""The temperature at which a leak's rate is the given one."""


def warmth(temperature_c: float, doubling_c: float) -> float:
    """Return how much more a junction leaks than at 25 degrees."""
    return float(2 ** ((temperature_c - REFERENCE_C) / doubling_c))


@dataclass(frozen=True)
class LeakRate(EngineEffect):
    """The memorised reference drifts down, so that a static scene makes ON events.

    It drifts by C_on times the rate, which is, on the mean of all pixels,

        rate_hz * (2^((temperature_c - 25) / doubling_c) + (luma + log_eps) / double_luma).

    Each pixel has its own factor, log-normal with mean 1: ``spread``. How much leaks from one of its events to the next
    is uncertain by a normal fraction of it: ``jitter``. It is added when the pixel is reset, so it moves the next
    event, and events of a moving scene hardly feel it, because little leaks between them.

    In the dark the drift is a function of time, R - rate C_on t, not a sum, and so does not depend on frames. What
    light adds is a sum over the intervals between frames, each with the mean light of its ends: exact where luma runs
    straight. Where a reference begins is not set here but by ``start_phase``: at the signal its first event takes
    1 / rate. No pixel leaks faster than 1e6 Hz.

    Args:
        rate_hz: events per second of a pixel in a static scene in the dark at 25 degrees, the mean of all pixels,
            0..1e6 Hz; 0 is neutral.
        spread: standard deviation of the rate from pixel to pixel, as a fraction of its mean, 0..1.
        jitter: standard deviation of a pixel's intervals, as a fraction of their mean, 0..1; values are cut off at half
            a threshold.
        temperature_c: of the sensor, -100..200 degrees Celsius.
        doubling_c: the warming in degrees that doubles the rate, 1..1e6.
        double_luma: the luma whose parasitic photocurrent doubles the rate, > 0; inf for none.

    Raises:
        ValueError: for a value out of range.

    Source: Nozaki and Delbruck, "Temperature and parasitic photocurrent effects in dynamic vision sensors", IEEE Trans.
    Electron Devices 64(8), 2017, doi:10.1109/TED.2017.2717848 (junction leakage in the reset switch, which follows
    Arrhenius' law, and the parasitic photocurrent, which is proportional to light). Spread and jitter are those of
    v2e's code (0.1 decades, a fraction of 0.1; Hu, Liu and Delbruck, CVPR Workshops 2021). Doubling in 8 degrees is an
    assumption: the rule of thumb for silicon junctions is 8 to 10.
    """

    rate_hz: float
    spread: float = 0.23
    jitter: float = 0.1
    temperature_c: float = REFERENCE_C
    doubling_c: float = 8.0
    double_luma: float = math.inf

    name: ClassVar[str] = "leak_rate_hz"
    acts_on: ClassVar[Where] = "pixel"

    def mean_rate_hz(self, light: npt.ArrayLike = 0.0) -> npt.NDArray[np.float64]:
        """Return the mean rate of all pixels at this sensor's temperature, in light of this luma + log_eps."""
        dark = warmth(self.temperature_c, self.doubling_c)
        return np.asarray(self.rate_hz * (dark + np.asarray(light, np.float64) / self.double_luma))

    @property
    def neutral(self) -> bool:
        """Whether nothing leaks."""
        return self.rate_hz == 0
