"""Defines the effect of noise on the signal."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from ..._util.argument_error import ArgumentError
from .effect import EngineEffect, Where
from .noise_rates import LEAST_RATIO, MOST_RATIO, event_rates_hz
from .threshold_mismatch import ThresholdMismatch


@dataclass(frozen=True)
class ShotNoise(EngineEffect):
    """Adds noise to what the comparators of each pixel see: a stationary Gaussian process.

    Photons make white noise, whose density in log intensity is as one over light. It passes two poles: the
    photoreceptor's, which is proportional to light, and the source follower's, which is not. They are at x *
    bandwidth_hz and at bandwidth_hz, where x is (luma + log_eps) / half_luma. The variance behind both is

        (rms^2 + floor^2 x) / (1 + x)

    which is constant in the dark, falls as one over light where it is bright, and comes to the square of ``floor``:
    that is white noise whose density does not depend on light.

    A pixel makes an event when signal and noise together reach a level for the first time, and the reference moves to
    that level. So noise makes events by itself where the signal stands near a level, moves the events of the signal in
    time, and has no say where the signal is far from both levels. Because a reset memorises the noise with the signal,
    an event of noise is often followed by one of the opposite polarity, and ON less OFF events are still those of the
    signal. At the end of a refractory period the signal and the noise of that instant are memorised.

    The two poles are told here once more, apart from ``photoreceptor_bandwidth_hz``, because noise may be simulated
    without that. A sensor derives them from its photoreceptor (:class:`~davis_rs.SensorParameters`).

    The path of the noise is drawn from its exact law, given the light at the starts of cells of one to two time
    constants of the source follower. It is refined until what is not known is half a percent of its standard deviation.
    Noise beyond 6 standard deviations is not looked for. :meth:`rate_hz` approximates how many events come of noise.

    Args:
        rms: standard deviation of log intensity in the dark, 0..1e6; neutral where ``floor`` is 0, too.
        half_luma: the luma (more precisely, luma + log_eps) at which the variance of what photons make has halved and
            both poles are alike, > 0; inf for noise that is the same in any light: variance rms^2, both poles at
            bandwidth_hz, and no floor. The photoreceptor's pole counts as at most 100 times the other one, and at least
            1 / 65,536 of it.
        bandwidth_hz: the pole that does not depend on light, 1e-3..1e7 Hz.
        floor: standard deviation that is left in bright light, 0..1e6.

    Raises:
        ValueError: for values out of range.

    Source: Graca and Delbruck, "Unraveling the paradox of intensity-dependent DVS pixel noise", IISW 2021 (noise
    of constant power in the dark, which falls once the photoreceptor is faster than the source follower); Graca,
    McReynolds and Delbruck, "Exploiting alternating DVS shot noise event pair statistics to reduce background
    activity", IISW 2023 (a reset memorises the noise, so events come in pairs); Lin, Ma, Guo and Wen, "DVS-Voltmeter",
    ECCV 2022 (events as first passages of signal and noise).
    """

    rms: float
    half_luma: float = 1.0
    bandwidth_hz: float = 300.0
    floor: float = 0.0

    name: ClassVar[str] = "shot_noise_rms"
    acts_on: ClassVar[Where] = "pixel"

    @classmethod
    def of_rate(
        cls, rate_hz: float, contrast_threshold: float, *, light: float | None = None, **parameters: Any
    ) -> ShotNoise:
        """Return the noise that makes ``rate_hz`` events a second, both polarities together, at ``contrast_threshold``.

        It is that of :meth:`rate_hz` in the mean over all phases.

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
        lights = made._lights() if light is None else np.array([light])

        def excess(log_rms: float) -> float:
            noise = replace(made, rms=contrast_threshold * math.exp(log_rms))
            made_hz = float(noise.rate_hz(contrast_threshold, contrast_threshold, lights).max())
            return math.log(max(made_hz, 1e-300) / rate_hz)

        # Where noise is as large as the threshold the law ends.
        least, most = math.log(0.01), float(np.log(1 + lights.max() / made.half_luma)) / 2
        if excess(most) <= 0:
            limit_hz = rate_hz * math.exp(excess(most))
            raise ValueError(
                f"rate_hz must lie below {limit_hz:.4g} Hz, that of noise as large as the threshold, got {rate_hz}"
            )
        if excess(least) > 0:
            raise ValueError(f"rate_hz must be that of noise above a hundredth of the threshold, got {rate_hz}")
        from scipy.optimize import brentq

        return replace(made, rms=contrast_threshold * math.exp(brentq(excess, least, most, xtol=1e-9)))

    def _lights(self) -> npt.NDArray[np.float64]:
        """Return lights from the least to the largest ratio of poles, evenly in their logarithm."""
        if math.isinf(self.half_luma):
            return np.ones(1)
        return self.half_luma * np.geomspace(LEAST_RATIO, MOST_RATIO, 200)

    def sigma(self, light: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return the standard deviation of the noise where luma + log_eps is ``light``."""
        x = np.asarray(light, np.float64) / self.half_luma
        return np.sqrt((self.rms**2 + self.floor**2 * x) / (1 + x))

    def rate_hz(
        self,
        contrast_threshold: npt.ArrayLike,
        contrast_threshold_off: npt.ArrayLike,
        light: npt.ArrayLike = 0.0,
        phase: npt.ArrayLike | None = None,
    ) -> npt.NDArray[np.float64]:
        """Return events per second that noise makes of a pixel that stands still, of both polarities together.

        An approximation, within a few percent where thresholds are alike and twice the noise or more
        (``event_rates_hz`` in ``noise_rates``). A pixel whose thresholds differ from each other
        drifts to where noise makes fewer events, and stays there until the signal moves.

        Args:
            contrast_threshold, contrast_threshold_off: C_on and C_off.
            light: luma + log_eps.
            phase: signal less reference, in units of the threshold ahead, -1..1; None for the mean over all phases.

        Returns:
            float64, the arguments broadcast.
        """
        values = [np.asarray(value, np.float64) for value in (contrast_threshold, contrast_threshold_off, light)]
        if self.neutral:
            shapes = [value.shape for value in values] + ([] if phase is None else [np.shape(phase)])
            return np.zeros(np.broadcast_shapes(*shapes))
        on, off, light = values
        ratio = light / self.half_luma if math.isfinite(self.half_luma) else np.ones_like(light)
        return event_rates_hz(on, off, self.sigma(light), ratio, self.bandwidth_hz, phase)

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
        """Return whether there is no noise."""
        return self.rms == 0 and self.floor == 0
