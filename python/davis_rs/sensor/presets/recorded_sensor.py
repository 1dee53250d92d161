"""Derives the sensor that the public dataset was recorded with."""

from __future__ import annotations

import math
from dataclasses import replace

from ..effects import ThresholdMismatch
from ..parameters import SensorParameters
from .presets import SENSORS

RECORDED = "recorded"
"""The name of the sensor of a recording, for a sequence of the dataset."""


def recorded_sensor(biases: str, contrast_threshold: float) -> SensorParameters:
    """Return the DAVIS240C of the dataset's recordings: what follows from their biases, and all else of ``davis240c``.

    The refractory period follows from the biases, and outdoors the source follower's corner
    (:meth:`~davis_rs.SensorParameters.from_biases`). What does not:

    - thresholds: the formula's are refuted indoors, where they make up to 5 times the paper's events, four of five OFF.
      Both are the scene's, which is chosen for the paper's number of events;
    - the source follower indoors, where the photoreceptor limits it: it is left open, and noise keeps the poles of the
      preset;
    - shot noise: its rms is the one that makes as many noise events at 200 lux as that of the preset does, in the mean
      over pixels.

    Args:
        biases: ``indoors`` or ``outdoors``, a key of :data:`~davis_rs.BIAS_SETS`.
        contrast_threshold: of the scene, in natural-log units.

    Raises:
        ValueError: for other biases, or a threshold that is not > 0.

    Source: Mueggler et al., IJRR 2017, the table of bias settings.
    """
    preset = SENSORS["davis240c"]
    open_indoors = {"source_follower_bandwidth_hz": None} if biases == "indoors" else {}
    derived = SensorParameters.from_biases(
        biases, contrast_threshold=contrast_threshold, contrast_threshold_off=None, **open_indoors
    )
    sensor = replace(
        preset,
        contrast_threshold=contrast_threshold,
        contrast_threshold_off=None,
        source_follower_bandwidth_hz=derived.source_follower_bandwidth_hz,
        refractory_period_us=derived.refractory_period_us,
    )
    if sensor.source_follower_bandwidth_hz is None:
        sensor = replace(
            sensor,
            shot_noise_half_lux=preset.noise_half_lux,
            shot_noise_bandwidth_hz=preset.source_follower_bandwidth_hz,
        )
    return replace(sensor, shot_noise_rms=_rms_of_as_many_events(sensor, _noise_hz(preset)))


_LUX = 200.0


def _noise_hz(sensor: SensorParameters) -> float:
    """Return the noise events per second of a pixel, averaged over pixels."""
    effects = sensor.effects(1.0)
    noise, on = effects.shot_noise_rms, sensor.contrast_threshold
    assert noise is not None
    assert on is not None
    off = on if sensor.contrast_threshold_off is None else sensor.contrast_threshold_off
    return noise.mean_rate_hz(on, off, effects.threshold_mismatch or ThresholdMismatch(0.0), _LUX)


def _rms_of_as_many_events(sensor: SensorParameters, rate_hz: float) -> float:
    from scipy.optimize import brentq

    def excess(log_rms: float) -> float:
        rate = _noise_hz(replace(sensor, shot_noise_rms=math.exp(log_rms)))
        return math.log(max(rate, 1e-300) / rate_hz)

    return round(math.exp(brentq(excess, math.log(5e-3), math.log(0.5))), 5)
