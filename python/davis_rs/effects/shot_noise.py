"""Events from noise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from .effect import Where
from .engine_effect import EngineEffect


@dataclass(frozen=True)
class ShotNoise(EngineEffect):
    """Events of noise alone: in each pixel as many as a Gaussian process has crossings of that pixel's thresholds.

    Noise has the variance rms^2 / (1 + x) with x = (luma + log_eps) / half_luma, at each instant with its own luma, and
    is white behind two poles of bandwidth_hz. By Rice it crosses a level at a distance d from its mean
    bandwidth_hz * exp(-d^2 / (2 variance)) times a second, upwards. So often a pixel makes a pair that begins with an
    ON event (d = C_on), and one that begins with an OFF event (d = C_off), both Poisson processes. The thresholds are
    the pixel's own, so with ``threshold_mismatch`` some pixels are far noisier than others. :meth:`rate_hz` is the
    formula.

    Events come in pairs. The pixel is reset as after any event, and a reset memorises the noise with the signal, so the
    reference moves by a threshold. After a time that is exponential with mean 1 / (2 pi bandwidth_hz) the noise has
    gone back. Then the opposite level is crossed, or is within half a threshold, which noise on its way back soon
    reaches: the event of the opposite polarity, and the reference is back as well. So noise does not hide slow
    contrast: ON events less OFF events are still those of the signal, but for the pair under way.

    A refractory period T follows each of the two, and none falls into one. What is memorised at its end is the signal
    there, and what is left of the noise: nearly all while T is much shorter than 1 / (2 pi bandwidth_hz), nothing
    after a much longer T, so that slow contrast is then lost.

    Where the formula ends: there is one pair at a time, so rates are lower where pairs would overlap (by 1 % at a rate
    of bandwidth_hz / 16). A pixel whose thresholds differ from each other makes some events without a second one. The
    distance d is that of a pixel that has just been reset: a signal between two levels does not change the rate. Noise
    followed step by step makes 5 % less than the formula at C = 3.6 rms, 18 % less at 2.1 rms (docs/effects.md).

    Args:
        rms: standard deviation of log intensity in the dark, 0..1e6; 0 is neutral.
        half_luma: the luma (more precisely, luma + log_eps) at which the variance has halved, > 0.
        bandwidth_hz: of the noise, 1e-3..1e7 Hz: how often it may cross, and how soon the second event of a pair
        follows.

    Raises:
        ValueError: for values out of range.

    Source: Rice, "Mathematical analysis of random noise", Bell System Technical Journal 24, 1945, section 3.3
    (crossings); Graca and Delbruck, "Unraveling the paradox of intensity-dependent DVS pixel noise", IISW 2021 (noise
    of constant power in the dark, which falls once the photoreceptor is faster than what follows it: a pole that is
    proportional to light, before a fixed one, gives 1 / (1 + x)); Graca, McReynolds and Delbruck, "Exploiting
    alternating DVS shot noise event pair statistics to reduce background activity", IISW 2023 (pairs, because a reset
    memorises the noise). How much of the noise is left after T is (1 + x) exp(-x), x = 2 pi bandwidth_hz T, for two
    poles of one bandwidth. That and the half of a threshold are assumptions: noise that gets to a whole threshold is
    often at half of one.
    """

    rms: float
    half_luma: float = 1.0
    bandwidth_hz: float = 300.0

    name: ClassVar[str] = "shot_noise_rms"
    acts_on: ClassVar[Where] = "pixel"

    @classmethod
    def of_rate(cls, rate_hz: float, contrast_threshold: float, **parameters: Any) -> ShotNoise:
        """The noise that makes so many events a second, of both polarities together, in the dark at this threshold.

        ``parameters`` are the others of this class.

        Raises:
            ValueError: for a rate that is not below 4 bandwidth_hz, which no noise has; values out of range.
        """
        made = cls(0.0, **parameters)
        if not 0 <= rate_hz < 4 * made.bandwidth_hz:
            raise ValueError(
                f"rate_hz must lie in 0..{4 * made.bandwidth_hz:g} Hz, below 4 bandwidth_hz, got {rate_hz}"
            )
        if not 0 < contrast_threshold < math.inf:
            raise ValueError(f"contrast_threshold must be finite and > 0, got {contrast_threshold!r}")
        if rate_hz == 0:
            return made
        return cls(contrast_threshold / math.sqrt(2 * math.log(4 * made.bandwidth_hz / rate_hz)), **parameters)

    def rate_hz(
        self, contrast_threshold: npt.ArrayLike, contrast_threshold_off: npt.ArrayLike, light: npt.ArrayLike = 0.0
    ) -> npt.NDArray[np.float64]:
        """Events per second of a pixel, of both polarities together, by Rice's formula; arguments are broadcast.

        ``light`` is luma + log_eps.
        """
        on, off, light = (
            np.asarray(value, np.float64) for value in (contrast_threshold, contrast_threshold_off, light)
        )
        if self.neutral:
            return np.zeros(np.broadcast_shapes(on.shape, off.shape, light.shape))
        twice_variance = 2 * self.rms**2 / (1 + light / self.half_luma)
        rate: npt.NDArray[np.float64] = np.exp(-(on**2) / twice_variance) + np.exp(-(off**2) / twice_variance)
        return 2 * self.bandwidth_hz * rate

    @property
    def neutral(self) -> bool:
        """Whether there is no noise."""
        return self.rms == 0
