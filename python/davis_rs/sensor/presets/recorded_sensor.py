"""Derives the sensor that the public dataset was recorded with."""

from __future__ import annotations

import math
from dataclasses import replace

from ..effects import ThresholdMismatch
from ..parameters import SensorParameters
from .presets import SENSORS

RECORDED = "recorded"
"""The name of the sensor of a recording, for a sequence of the dataset."""


def recorded_sensor(biases: str) -> SensorParameters:
    """Return the DAVIS240C with the biases of the dataset's recordings.

    Both thresholds, the source follower's corner and the refractory period follow from the biases
    (:meth:`~davis_rs.SensorParameters.from_biases`), all else is that of the preset ``davis240c``. Two values do not
    follow from them:

    - outdoors, OffBn 4/0 has no nominal current: the OFF threshold is taken to be the ON threshold;
    - shot noise: its rms is the one that makes as many noise events at 200 lux as that of the preset does, in the mean
      over pixels. The preset's own rms would make thousands of events a second in each pixel with the indoor biases,
      whose source follower is 400 times as fast, and the recordings do not have them.

    Args:
        biases: ``indoors`` or ``outdoors``, a key of :data:`~davis_rs.BIAS_SETS`.

    Raises:
        ValueError: for another one.

    Source: Mueggler et al., IJRR 2017, the table of bias settings.
    """
    known = {"contrast_threshold_off": None} if biases == "outdoors" else {}
    derived = SensorParameters.from_biases(biases, **known)
    preset = SENSORS["davis240c"]
    sensor = replace(
        preset,
        contrast_threshold=derived.contrast_threshold,
        contrast_threshold_off=derived.contrast_threshold_off,
        source_follower_bandwidth_hz=derived.source_follower_bandwidth_hz,
        refractory_period_us=derived.refractory_period_us,
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
