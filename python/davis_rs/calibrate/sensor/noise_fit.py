"""Fits shot noise from how often pixels fire in known light."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...inspection.statistics import StreamStatistics
from ...inspection.statistics.stream_statistics import Measured
from ...sensor.effects import ShotNoise, ThresholdMismatch
from ...sensor.effects.noise_rates import drifting_rates_hz
from ...sensor.parameters import SensorParameters
from .finding import Finding, KnownParameters, combined
from .quiet_pixels import mean_rate, quiet_or_noisy, signal_in

_RMS, _HALF = ("shot noise", "shot_noise_rms"), ("noise over light", "shot_noise_half_lux")

_LIGHTS_APART = 1.5
"""By what factor the light of recordings must differ to tell how noise goes with it."""

_LEAST_EVENTS = 20
"""OFF events of quiet pixels in a recording, below which it does not count."""

_MOST_HZ = 50.0
"""Above this rate of noise its standard deviation is a third of a threshold or more."""

_LEAST_LEAK_HZ = 1e-4
"""A leak of less does not bring references anywhere in a recording."""

_NODES = 5
"""Thresholds of pixels that stand for all."""

_MODEL_SHARE, _LIGHT_SHARE = 0.2, 0.08
"""What the rate errs by on simulated streams, as shares: in all lights alike, and in each."""


def find_noise(
    recordings: Sequence[StreamStatistics],
    lux: Sequence[float | None],
    parameters: KnownParameters,
    leak: Measured | None = None,
    jitter: Measured | None = None,
) -> tuple[Finding, Finding]:
    """Return the rms of the noise, and the light in which its square is halved.

    OFF events are counted, because a leak makes none by itself. Quiet pixels have as many as ``drifting_rates_hz`` of
    ``davis_rs.sensor.effects.noise_rates`` says in the mean over their thresholds. Without a leak they have half of
    what :meth:`~davis_rs.sensor.effects.ShotNoise.rate_hz` says in the mean over phases.

    Args:
        recordings: of the sensor.
        lux: illuminance that the quiet pixels of each see; None where it is not known.
        parameters: thresholds, their mismatch, and the noise's bandwidth.
        leak: its rate; None if it is not known, which counts as none.
        jitter: that of the leak, likewise.
    """
    rates = [_off_rate(one) for one in recordings]
    known = [
        _Quiet(light, rate) for light, rate in zip(lux, rates, strict=True) if light is not None and rate is not None
    ]
    here = [rate for rate in rates if rate is not None]
    if not here:
        why = "; ".join(sorted({signal_in(one) or "quiet pixels have too few OFF events" for one in recordings}))
        return Finding(*_RMS, None, why), Finding(*_HALF, None, "it needs shot noise")
    off = combined(here)
    makes = f"it makes {Measured(2 * off.value, 2 * off.sigma)} Hz here"
    if not known:
        light = "the recordings' light is not known (--lux)"
        return Finding(*_RMS, None, f"{light}; {makes}"), Finding(*_HALF, None, "likewise")
    problem = _problem(known, parameters, leak, jitter)
    if isinstance(problem, str):
        return Finding(*_RMS, None, f"{problem}; {makes}"), Finding(*_HALF, None, "it needs shot noise")
    rms, half = problem.solve()
    note = f"{makes}; {problem.said}"
    if half is not None:
        return Finding(*_RMS, rms, note), Finding(*_HALF, half, f"from {len(known)} recordings of different light")
    lights = "recordings of different light are needed; it is taken from the base"
    return Finding(*_RMS, rms, note), Finding(*_HALF, None, lights)


_REFUTED = 5.0
"""Standard deviations by which there are fewer OFF events than noise would make."""


def refuted_noise(
    recordings: Sequence[StreamStatistics], lux: Sequence[float | None], parameters: KnownParameters
) -> dict[str, str]:
    """Return why the noise of the base contradicts the recordings, by its parameters; empty where it may be right.

    Args:
        recordings, lux, parameters: as of :func:`find_noise`.
    """
    on = parameters.get("contrast_threshold")
    noise = parameters.base.effects(1.0).shot_noise_rms
    if on is None or noise is None:
        return {}
    off = parameters.get("contrast_threshold_off") or on
    mismatch = parameters.get("threshold_mismatch") or Measured(0.0, 0.0)
    spread = ThresholdMismatch(min(max(mismatch.value, 0.0), 1.0))
    dark_lux = parameters.base.dark_luma(1.0) or 0.0
    for stream, light in zip(recordings, lux, strict=True):
        if light is None or not stream.quiet.any():
            continue
        area_s = float(stream.quiet.sum()) * stream.duration_s
        made = area_s * noise.mean_rate_hz(on.value, off.value, spread, light + dark_lux) / 2
        seen = int(stream.counts[0][stream.quiet].sum())
        if seen < made - _REFUTED * math.sqrt(made):
            why = f"at {light:.3g} lux quiet pixels would have {made:.3g} OFF events, and they have {seen}"
            return dict.fromkeys((_RMS[1], _HALF[1], "shot_noise_bandwidth_hz"), why)
    return {}


class _Quiet(NamedTuple):
    """Quiet pixels of a recording: their light, and OFF events of a pixel per second."""

    lux: float
    off: Measured


def _off_rate(stream: StreamStatistics) -> Measured | None:
    """Return OFF events of a quiet pixel per second; None where signal or too few events are seen.

    Pixels with low thresholds make most of the noise, and some of them look hot: they are counted.
    """
    if not stream.quiet.any() or signal_in(stream) is not None:
        return None
    quiet = quiet_or_noisy(stream, hot=True)
    off = stream.counts[0][quiet].astype(np.float64)
    if off.sum() < _LEAST_EVENTS:
        return None
    return mean_rate(off, stream.duration_s, 1 / (len(off) * stream.duration_s))


def noise_of_threshold(stream: StreamStatistics, *, least_events: int | None = None) -> float | None:
    """Return the standard deviation of the noise over the threshold, from OFF events of quiet pixels.

    Both poles are taken to be at their usual corner and thresholds to be alike, so it is a rough value. None where
    quiet pixels have too few OFF events, if ``least_events`` does not say what to take then.
    """
    off = _off_rate(stream)
    if off is not None:
        hz = off.value
    elif least_events is None or not stream.quiet.any():
        return None
    else:
        events = max(int(stream.counts[0][stream.quiet].sum()), least_events)
        hz = events / (float(stream.quiet.sum()) * stream.duration_s)
    return ShotNoise.of_rate(min(2 * hz, _MOST_HZ), 1.0, half_luma=math.inf).rms


@dataclass(frozen=True)
class _Problem:
    """Logarithms of rates against those of the noise.

    Attributes:
        lux: of each recording, dark current included.
        quiet: of each recording.
        given: ON and OFF threshold, their mismatch, the bandwidth, and the model's own error as a logarithm, each with
            its standard deviation or 0.
        parity: of columns' thresholds.
        half_lux: where the square of the noise is halved; None if it is to be found.
        leak_hz, jitter: of the leak, 0 for none.
        said: where all else comes from.
    """

    lux: npt.NDArray[np.float64]
    quiet: Sequence[_Quiet]
    given: Sequence[Measured]
    parity: float
    half_lux: float | None
    leak_hz: float
    jitter: float
    said: str

    def solve(self) -> tuple[Measured, Measured | None]:
        """Return the rms, and the half light if it is to be found."""
        from scipy.optimize import least_squares

        given = [one for one in self.given if one.sigma > 0]
        # A third or fourth of a threshold is noise that makes few events.
        start = [math.log(self.given[0].value / 3.5)]
        start += [] if self.half_lux is not None else [math.log(float(np.sqrt(self.lux.min() * self.lux.max())))]
        start += [one.value for one in given]
        solution = least_squares(self._residuals, start, x_scale="jac")
        covariance = np.linalg.pinv(solution.jac.T @ solution.jac)
        sigmas = np.sqrt(np.diag(covariance))
        # Rates that scatter by more than their errors say so.
        freedom = len(self.quiet) - (1 if self.half_lux is not None else 2)
        misfit = math.sqrt(max(2 * solution.cost / freedom, 1.0)) if freedom > 0 else 1.0
        rms, *rest = (
            Measured(math.exp(value), math.exp(value) * misfit * sigma)
            for value, sigma in zip(solution.x.tolist(), sigmas.tolist(), strict=True)
        )
        return rms, rest[0] if self.half_lux is None else None

    def _residuals(self, at: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        rms, rest = math.exp(at[0]), at[1:]
        half = self.half_lux
        if half is None:
            half, rest = math.exp(rest[0]), rest[1:]
        values, own, pulls = [], iter(rest.tolist()), []
        for measured in self.given:
            values.append(next(own) if measured.sigma > 0 else measured.value)
            if measured.sigma > 0:
                pulls.append((values[-1] - measured.value) / measured.sigma)
        on, off, mismatch, bandwidth, model = values
        factors, weights = ThresholdMismatch(min(max(mismatch, 0.0), 1.0), column_parity=self.parity).nodes(_NODES)
        # ON and OFF thresholds of a pixel are independent: each of one with each of the other.
        pixel_on, pixel_off = on * factors[:, :, None], off * factors[:, None]
        noise = ShotNoise(rms, half, bandwidth)
        weights = 2 * weights[:, None] * weights
        mean = [float((weights * self._off_hz(noise, pixel_on, pixel_off, light)).sum()) for light in self.lux]
        logs = model + np.log(np.maximum(mean, 1e-300) / [one.off.value for one in self.quiet])
        sigmas = np.hypot([one.off.sigma / one.off.value for one in self.quiet], _LIGHT_SHARE)
        return np.concatenate([logs / sigmas, pulls])

    def _off_hz(
        self, noise: ShotNoise, on: npt.NDArray[np.float64], off: npt.NDArray[np.float64], light: float
    ) -> npt.NDArray[np.float64]:
        """Return OFF events per second of pixels with these thresholds."""
        if self.leak_hz < _LEAST_LEAK_HZ:
            return noise.rate_hz(on, off, light) / 2
        sigma, ratio = float(noise.sigma(light)), light / noise.half_luma
        return drifting_rates_hz(on, off, sigma, ratio, noise.bandwidth_hz, self.leak_hz, self.jitter)[1]


def _problem(
    known: Sequence[_Quiet], parameters: KnownParameters, leak: Measured | None, jitter: Measured | None
) -> _Problem | str:
    on = parameters.get("contrast_threshold")
    if on is None:
        return "its rms needs thresholds (--base)"
    off = parameters.get("contrast_threshold_off") or on
    mismatch = parameters.get("threshold_mismatch") or Measured(0.0, 0.0)
    parity = parameters.get("threshold_column_parity") or Measured(0.0, 0.0)
    # A bandwidth that was found is that of both poles in the recordings' light.
    bandwidth = parameters.of_base("shot_noise_bandwidth_hz") or parameters.of_base("source_follower_bandwidth_hz")
    if bandwidth is None:
        bandwidth = Measured(ShotNoise.bandwidth_hz, 0.0)
    dark_lux = parameters.base.dark_luma(1.0) or 0.0
    lights = np.array([one.lux for one in known]) + dark_lux
    half = None
    if lights.max() < _LIGHTS_APART * lights.min():
        half = _half_lux(parameters.base)
        if half is None:
            return (
                "its rms needs the light in which its square is halved (shot_noise_half_lux of --base), or recordings "
                f"whose light differs by a factor of {_LIGHTS_APART:g}"
            )
    said = (
        f"thresholds {on.value:.3g}, {off.value:.3g}, mismatch {mismatch.value:.2g}, bandwidth {bandwidth.value:.3g} Hz"
    )
    return _Problem(
        lights,
        known,
        (on, off, mismatch, bandwidth, Measured(0.0, _MODEL_SHARE)),
        parity.value,
        half,
        0.0 if leak is None else leak.value,
        0.0 if jitter is None else jitter.value,
        said,
    )


def _half_lux(parameters: SensorParameters) -> float | None:
    """Return the half light as the sensor's own effects have it."""
    noise = SensorParameters.effects(parameters, 1.0).shot_noise_rms
    return None if noise is None or math.isinf(noise.half_luma) else noise.half_luma
