"""Defines the effect of events from noise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from ..._util.argument_error import ArgumentError
from .effect import EngineEffect, Where
from .threshold_mismatch import ThresholdMismatch

_MOST_RATIO = 100.0
"""The largest ratio of the pole that is proportional to light to the other pole. The engine has the same limit."""


@dataclass(frozen=True)
class ShotNoise(EngineEffect):
    """Events of noise alone: in each pixel as many as a Gaussian process has crossings of that pixel's thresholds.

    Photons make white noise, whose density in log intensity is as one over light. It passes two poles: the
    photoreceptor's, which is proportional to light, and the source follower's, which is not. They are at x *
    bandwidth_hz and at bandwidth_hz, where x is (luma + log_eps) / half_luma, at each instant with its own luma. Then
    the variance is rms^2 / (1 + x): constant in the dark, as one over light where it is bright. By Rice noise behind
    two poles f1 and f2 crosses a level at a distance d from its mean

        sqrt(f1 f2) * exp(-d^2 / (2 variance)) = bandwidth_hz * sqrt(x) * exp(-d^2 (1 + x) / (2 rms^2))

    times a second, upwards. So often a pixel makes a pair that begins with an ON event (d = C_on), and one that begins
    with an OFF event (d = C_off), both Poisson processes. In the dark noise is slow and makes few events, in bright
    light it is small and makes few; most come at x = rms^2 / C^2. The thresholds are the pixel's own, so with
    ``threshold_mismatch`` some pixels are far noisier than others. :meth:`rate_hz` is the formula.

    Events come in pairs. The pixel is reset as after any event, and a reset memorises the noise with the signal, so the
    reference moves by a threshold. After a time that is exponential with the mean of both poles' time constants, (1 /
    f1 + 1 / f2) / (4 pi), the noise has gone back. Then the opposite level is crossed, or is within half a threshold,
    which noise on its way back soon reaches: the event of the opposite polarity, and the reference is back as well. So
    noise does not hide slow contrast: ON events less OFF events are still those of the signal, but for the pair under
    way.

    A refractory period T follows each of the two, and none falls into one. What is memorised at its end is the signal
    there, and what is left of the noise, by the autocorrelation of noise behind two poles: nearly all while T is much
    shorter than the time constants, nothing after a much longer T, so that slow contrast is then lost.

    The two poles are told here once more, apart from ``photoreceptor_bandwidth_hz``, because noise may be simulated
    without that. A sensor derives them from its photoreceptor (:class:`~davis_rs.SensorParameters`).

    Where the formula ends: there is one pair at a time, so rates are lower where pairs would overlap (with poles alike
    by 1 % at a rate of bandwidth_hz / 16). A pixel whose thresholds differ from each other makes some events without a
    second one. The distance d is that of a pixel that has just been reset: a signal between two levels does not change
    the rate. Noise followed step by step makes fewer events than the formula where C is not far above the noise,
    and where one pole is far slower than the other (docs/effects.md). The photoreceptor's pole
    counts as at most 100 times the other one.

    Args:
        rms: standard deviation of log intensity in the dark, 0..1e6; 0 is neutral.
        half_luma: the luma (more precisely, luma + log_eps) at which the variance has halved and both poles are alike,
            > 0; inf for noise that is the same in any light: variance rms^2, both poles at bandwidth_hz.
        bandwidth_hz: the pole that does not depend on light, 1e-3..1e7 Hz.

    Raises:
        ValueError: for values out of range.

    Source: Rice, "Mathematical analysis of random noise", Bell System Technical Journal 24, 1945, section 3.3
    (crossings); Graca and Delbruck, "Unraveling the paradox of intensity-dependent DVS pixel noise", IISW 2021 (noise
    of constant power in the dark, which falls once the photoreceptor is faster than the source follower); Graca,
    McReynolds and Delbruck, "Exploiting alternating DVS shot noise event pair statistics to reduce background
    activity", IISW 2023 (pairs, because a reset memorises the noise). The time to the way back and the half of a
    threshold are assumptions: noise that gets to a whole threshold is often at half of one.
    """

    rms: float
    half_luma: float = 1.0
    bandwidth_hz: float = 300.0

    name: ClassVar[str] = "shot_noise_rms"
    acts_on: ClassVar[Where] = "pixel"

    @classmethod
    def of_rate(
        cls, rate_hz: float, contrast_threshold: float, *, light: float | None = None, **parameters: Any
    ) -> ShotNoise:
        """Return the noise that makes ``rate_hz`` events a second, both polarities together, at ``contrast_threshold``.

        Args:
            rate_hz: events per second and pixel, 0 for none.
            contrast_threshold: C_on and C_off.
            light: luma + log_eps at which it does; None for the light in which there are most.
            parameters: the others of this class.

        Raises:
            ValueError: for a rate that no noise has in that light; values out of range.
        """
        made = cls(0.0, **parameters)
        if not 0 < contrast_threshold < math.inf:
            raise ArgumentError("{contrast_threshold} must be finite and > 0, got {!r}", contrast_threshold)
        if not (light is None or 0 < light < math.inf):
            raise ArgumentError("{light} must be finite and > 0, or None, got {!r}", light)
        if not 0 <= rate_hz < math.inf:
            raise ArgumentError("{rate_hz} must be finite and >= 0 Hz, got {!r}", rate_hz)
        if rate_hz == 0:
            return made
        in_any_light = math.isinf(made.half_luma)
        if light is None and not in_any_light:
            return cls(contrast_threshold / math.sqrt(_steepness(4 * made.bandwidth_hz / rate_hz)), **parameters)
        # rate = 4 f sqrt(x) exp(-C^2 (1 + x) / 2 rms^2), without x in any light.
        x = 0.0 if in_any_light or light is None else light / made.half_luma
        most_hz = 4 * made.bandwidth_hz * (1.0 if in_any_light else math.sqrt(min(x, _MOST_RATIO)))
        if rate_hz >= most_hz:
            raise ValueError(f"rate_hz must lie below {most_hz:g} Hz, 4 times the root of both poles, got {rate_hz}")
        return cls(contrast_threshold * math.sqrt((1 + x) / (2 * math.log(most_hz / rate_hz))), **parameters)

    def rate_hz(
        self, contrast_threshold: npt.ArrayLike, contrast_threshold_off: npt.ArrayLike, light: npt.ArrayLike = 0.0
    ) -> npt.NDArray[np.float64]:
        """Return events per second of a pixel, of both polarities together, by Rice's formula; arguments are broadcast.

        ``light`` is luma + log_eps.
        """
        on, off, light = (
            np.asarray(value, np.float64) for value in (contrast_threshold, contrast_threshold_off, light)
        )
        if self.neutral:
            return np.zeros(np.broadcast_shapes(on.shape, off.shape, light.shape))
        x = light / self.half_luma
        twice_variance = 2 * self.rms**2 / (1 + x)
        ratio = np.minimum(x, _MOST_RATIO) if math.isfinite(self.half_luma) else 1.0
        rate: npt.NDArray[np.float64] = np.exp(-(on**2) / twice_variance) + np.exp(-(off**2) / twice_variance)
        return 2 * self.bandwidth_hz * np.sqrt(ratio) * rate

    def mean_rate_hz(
        self, contrast_threshold: float, contrast_threshold_off: float, mismatch: ThresholdMismatch, light: float
    ) -> float:
        """Return :meth:`rate_hz` in the mean over pixels whose thresholds differ; most of it may come from few
        pixels."""
        factors, weights = mismatch.nodes()
        rates = self.rate_hz(contrast_threshold * factors, contrast_threshold_off * factors, light)
        return float((rates * weights).sum())

    @property
    def neutral(self) -> bool:
        """Whether there is no noise."""
        return self.rms == 0


def _steepness(ratio: float) -> float:
    """Return (C / rms)^2 where 4 bandwidth_hz is ``ratio`` times the event rate in the light with most events.

    That light is x = 1 / u with u = (C / rms)^2, so ratio^2 = u exp(u + 1), which Lambert's W inverts.

    Raises:
        ValueError: where that light is beyond the ratio of poles that the law takes.
    """
    from scipy.special import lambertw

    least = math.sqrt(math.exp(1 + 1 / _MOST_RATIO) / _MOST_RATIO)
    if not ratio > least:
        raise ValueError(f"rate_hz must lie below {4 / least:.3g} bandwidth_hz, got {4 / ratio:.3g} bandwidth_hz")
    return float(lambertw(ratio**2 / math.e).real)
