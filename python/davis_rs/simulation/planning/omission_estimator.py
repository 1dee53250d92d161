"""Estimates what leaving an effect out does to a sequence, and says what was seen of it, effect by effect."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any

import numpy as np

from ...events.arrays import EventArray
from ...geometry.pose import FloatArray
from ...sensor.effects import (
    Effect,
    Effects,
    HotPixels,
    LeakRate,
    LensBlur,
    PhotoreceptorBandwidth,
    Readout,
    RefractoryPeriod,
    ShotNoise,
    ThresholdMismatch,
    Vignetting,
)
from ...sensor.effects.optics import Optics
from .bus import through_bus
from .luma_sample import LumaSample, event_intervals_us
from .omission_error import OmissionError, TimeScale, omission_error, omission_error_of_added
from .sequence_sample import SequenceSample

FLOOD = 3_000_000
"""Above this count the known rate is used instead of simulating."""

_FEW = 30
"""Below this count of events of leak or noise the known rate says more than the sample."""

_LIGHTS, _LEAST_HZ, _RARE_HZ = 256, 1e-30, 1e-9
"""Points of the table of noise over light, the least rate that it holds, and one that counts as none."""

_PIXELS = 256
"""Pixels, each with a leak of its own, over which the events of a leak are averaged."""


@dataclass(frozen=True)
class OmissionEstimator:
    """Estimates what leaving effects out does to the events of a sampled sequence."""

    sequence: SequenceSample
    scale: TimeScale

    def __call__(self, effect: Effect) -> tuple[OmissionError, str]:
        """Estimate what leaving out an effect on events does, and say what was seen of the sequence."""
        estimator = ESTIMATORS[type(effect)]
        return estimator(self, effect)

    def compare(self, sample: LumaSample, without: EventArray, with_effect: EventArray) -> OmissionError:
        return omission_error(without, with_effect, size=sample.size, scale=self.scale)[0]

    def in_engine(self, effect: Effect) -> OmissionError:
        """Return the omission error, from the engine's run on the scattered pixels."""
        sample = self.sequence.pixels
        return self.compare(sample, sample.ideal, sample.events(Effects.of([effect])))

    @property
    def scene_events(self) -> float:
        """Return the number of events of ideal pixels on the whole sensor and sequence. It is scaled by keyframes,
        because
        both follow the motion."""
        return self.whole(len(self.sequence.pixels.ideal))

    def whole(self, events: float) -> float:
        """Scales a number of events of the sampled pixels up to the whole sensor and sequence."""
        sample = self.sequence.pixels
        seen = sum(len(segment.t_us) - 1 for segment in sample.segments)
        return events / sample.sensor_share * ((len(self.sequence.t_us) - 1) / seen)

    def of_rate(self, hz: float) -> float:
        """Return the number of events in the whole sequence at ``hz`` events per pixel and second."""
        return hz * self.sequence.camera.width * self.sequence.camera.height * self.sequence.duration_us * 1e-6

    def added(self, hz: float) -> OmissionError:
        """Return the omission error of events that come on top of the scene's, at a rate for each pixel."""
        return omission_error_of_added(self.of_rate(hz), self.scene_events)


def _vignetting(estimator: OmissionEstimator, effect: Vignetting) -> tuple[OmissionError, str]:
    sample, sequence = estimator.sequence.pixels, estimator.sequence
    gain = effect.gain(sequence.camera).ravel()
    shaded = sample.through(lambda luma: luma * gain[sequence.pixel])
    darkest = float(np.percentile(np.concatenate([segment.luma.ravel() for segment in shaded.segments]), 1))
    seen = (
        f"corners get {100 * gain.min():.3g} % of the light; then 1 % of all pixels see less than luma {darkest:.3g}, "
        f"against a dark level of {sample.log_eps:g}"
    )
    return estimator.compare(sample, sample.ideal, shaded.ideal), seen


def _lens_blur(estimator: OmissionEstimator, effect: LensBlur) -> tuple[OmissionError, str]:
    sample = estimator.sequence.frames
    blurred = sample.through(Optics(estimator.sequence.camera, Effects.of([effect])).frames)
    eps = np.float32(sample.log_eps)
    pairs = zip(sample.segments, blurred.segments, strict=True)
    squares = [np.mean(np.log((a.luma + eps) / (b.luma + eps)) ** 2, dtype=np.float64) for a, b in pairs]
    rms = math.sqrt(np.mean(squares)) / sample.contrast_threshold
    seen = f"a spot of {effect.sigma_px:g} px takes {rms:.2g} C (rms) from log luma: detail as fine as that"
    return estimator.compare(sample, sample.ideal, blurred.ideal), seen


def _bandwidth(estimator: OmissionEstimator, effect: PhotoreceptorBandwidth) -> tuple[OmissionError, str]:
    sample = estimator.sequence.pixels
    steps = sample.steps()
    # Of both low-passes together: slow signals are late by the sum of their time constants.
    corner_hz = 1 / (np.exp(-steps.log) / effect.hz + 1 / effect.source_follower_hz)
    slope = np.abs(steps.change) / steps.length_s[:, None].astype(np.float32)
    quick = slope > 2 * np.pi * corner_hz * sample.contrast_threshold
    moved = float(np.abs(steps.change).sum(dtype=np.float64))
    fraction = float(np.abs(steps.change)[quick].sum(dtype=np.float64)) / moved if moved else 0.0
    seen = (
        f"corner {corner_hz.min():.3g}..{corner_hz.max():.3g} Hz (median {np.median(corner_hz):.3g}); dL/dt up to "
        f"{slope.max():.3g} /s: {100 * fraction:.3g} % of the change is faster than C in a time constant"
    )
    return estimator.in_engine(effect), seen


def _mismatch(estimator: OmissionEstimator, effect: ThresholdMismatch) -> tuple[OmissionError, str]:
    gaps_us = event_intervals_us(estimator.sequence.pixels.ideal)
    gap = f"events of a pixel follow each other after {np.median(gaps_us):.3g} us (median)" if len(gaps_us) else ""
    seen = f"thresholds scatter by {100 * effect.sigma:.3g} %; " + (gap or "no pixel has two events")
    return estimator.in_engine(effect), seen


def _refractory(estimator: OmissionEstimator, effect: RefractoryPeriod) -> tuple[OmissionError, str]:
    gaps_us = event_intervals_us(estimator.sequence.pixels.ideal)
    seen = f"held for {effect.period_us:.3g} us; no pixel has two events"
    if len(gaps_us):
        held = 100 * float((gaps_us < effect.period_us).mean())
        seen = (
            f"held for {effect.period_us:.3g} us; events of a pixel are at least {gaps_us.min():.3g} us apart, half of "
            f"them less than {np.median(gaps_us):.3g} us, {held:.3g} % less than the period"
        )
    return estimator.in_engine(effect), seen


def _leak(estimator: OmissionEstimator, effect: LeakRate) -> tuple[OmissionError, str]:
    sample, duration_s = estimator.sequence.pixels, estimator.sequence.duration_us * 1e-6
    steps = sample.steps()
    hz = float(np.average(effect.mean_rate_hz(steps.luma + sample.log_eps).mean(1), weights=steps.length_s))
    of_a_pixel = static_leak_events(hz * duration_s, effect, sample)
    seen = (
        f"{estimator.of_rate(of_a_pixel / duration_s):.3g} events expected of {hz:.3g} Hz a pixel, next to "
        f"{estimator.scene_events:.3g} of the scene; levels drift by {hz * duration_s:.2g} C"
    )
    return _seen_or_known(estimator, effect, of_a_pixel), seen


def _seen_or_known(estimator: OmissionEstimator, effect: Effect, of_a_pixel: float) -> OmissionError:
    """Return the omission error of an effect that adds so many events of a pixel to those that it moves.

    What little the sample shows of few events is left to the rate, and so is what falls between the sample's parts.
    """
    counted = estimator.added(of_a_pixel / (estimator.sequence.duration_us * 1e-6))
    made = of_a_pixel * estimator.sequence.pixels.pixels
    if made > FLOOD:
        return counted
    error = estimator.in_engine(effect)
    return replace(
        error,
        missing_percent=max(error.missing_percent, counted.missing_percent),
        rate_percent=max(error.rate_percent, counted.rate_percent),
        count_percent=min(counted.count_percent, error.count_percent) if made < _FEW else error.count_percent,
    )


def static_leak_events(drift: float, effect: LeakRate, sample: LumaSample) -> float:
    """Count the events that a leak makes in a pixel that sees a static scene, in the mean over pixels.

    Until the first one, a reference drifts from where it was at the start.

    Args:
        drift: what leaks in the whole time, in the mean over pixels, in units of C_on.
    """
    quantiles = (np.arange(_PIXELS) + 0.5) / _PIXELS
    deviation = math.sqrt(math.log1p(effect.spread**2))
    normal = np.array([NormalDist().inv_cdf(share) for share in quantiles.tolist()])
    drifts = drift * np.exp(deviation * normal - deviation**2 / 2)
    if sample.start_phase == "zero":
        return float(np.floor(drifts).mean())
    # Phases are even from -C_off to C_on: the mean of all whole numbers that are passed.
    below = sample.contrast_threshold_off / sample.contrast_threshold
    return float((_sum_of_floors(drifts + 1) - _sum_of_floors(drifts - below)).mean()) / (1 + below)


def _sum_of_floors(value: FloatArray) -> FloatArray:
    """Return the integral of floor(x) from 0 to a value; 0 below."""
    whole = np.floor(np.maximum(value, 0.0))
    return np.asarray(whole * (whole - 1) / 2 + whole * (np.maximum(value, 0.0) - whole))


def _shot_noise(estimator: OmissionEstimator, effect: ShotNoise) -> tuple[OmissionError, str]:
    sample = estimator.sequence.pixels
    steps = sample.steps()
    log_light = steps.log.astype(np.float64)
    rates = _noise_hz(effect, sample, log_light, None)
    if sample.start_phase == "zero":
        # Pixels that stand still stay where they began, at their reference.
        still = np.abs(steps.change).sum(0) < sample.contrast_threshold / 2
        rates[:, still] = _noise_hz(effect, sample, log_light[:, still], 0.0)
    hz = float(np.average(rates.mean(1), weights=steps.length_s))
    dark, bright = np.percentile(steps.luma, (1, 99))
    seen = (
        f"luma {dark:.3g}..{bright:.3g} (1 % to 99 %) against the {effect.half_luma:.3g} that halves the "
        f"noise's variance, which has rms {effect.rms / sample.contrast_threshold:.3g} C in the dark: "
        f"{hz:.3g} Hz a pixel, so {estimator.of_rate(hz):.3g} events next to {estimator.scene_events:.3g} of the scene"
    )
    return _seen_or_known(estimator, effect, hz * estimator.sequence.duration_us * 1e-6), seen


def _noise_hz(effect: ShotNoise, sample: LumaSample, log_light: FloatArray, phase: float | None) -> FloatArray:
    """Return events of noise per second in each light, at a phase or in the mean over all, from a table over light."""
    if not log_light.size:
        return log_light
    table = np.linspace(log_light.min(), log_light.max(), _LIGHTS)
    rates = effect.rate_hz(sample.contrast_threshold, sample.contrast_threshold_off, np.exp(table), phase)
    hz = np.exp(np.interp(log_light, table, np.log(np.maximum(rates, _LEAST_HZ))))
    return np.where(hz > _RARE_HZ, hz, 0.0)


def _hot_pixels(estimator: OmissionEstimator, effect: HotPixels) -> tuple[OmissionError, str]:
    camera, hz = estimator.sequence.camera, effect.fraction * effect.mean_rate_hz()
    seen = (
        f"{effect.fraction * camera.width * camera.height:.3g} pixels of {effect.mean_rate_hz():.3g} Hz: "
        f"{estimator.of_rate(hz):.3g} events next to {estimator.scene_events:.3g} of the scene"
    )
    return estimator.added(hz), seen


def _readout(estimator: OmissionEstimator, effect: Readout) -> tuple[OmissionError, str]:
    camera = estimator.sequence.camera
    return through_bus(estimator.sequence.pixels, effect, estimator.scale, effect.rows(camera.width, camera.height))


ESTIMATORS: dict[type[Effect], Callable[[OmissionEstimator, Any], tuple[OmissionError, str]]] = {
    Vignetting: _vignetting,
    LensBlur: _lens_blur,
    PhotoreceptorBandwidth: _bandwidth,
    ThresholdMismatch: _mismatch,
    RefractoryPeriod: _refractory,
    LeakRate: _leak,
    ShotNoise: _shot_noise,
    HotPixels: _hot_pixels,
    Readout: _readout,
}
"""What leaving an effect out does to events, for each that acts on them."""
