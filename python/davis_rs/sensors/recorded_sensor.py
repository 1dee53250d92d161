"""The sensor that the public dataset was recorded with."""

from __future__ import annotations

from dataclasses import replace

from ..sensor_parameters import SensorParameters
from .presets import SENSORS

RECORDED = "recorded"
"""Names, for a sequence of the dataset, the sensor of its recording."""


def recorded_sensor(biases: str) -> SensorParameters:
    """The DAVIS240C with the biases of the dataset's recordings.

    Both thresholds, the source follower's corner and the refractory period follow from the biases
    (:meth:`~davis_rs.SensorParameters.from_biases`), all else is that of the preset ``davis240c``. One value does not
    follow from them: outdoors, OffBn 4/0 has no nominal current, and the OFF threshold is taken to be the ON threshold.

    Args:
        biases: ``indoors`` or ``outdoors``, a key of :data:`~davis_rs.BIAS_SETS`.

    Raises:
        ValueError: for another one.

    Source: Mueggler et al., IJRR 2017, the table of bias settings.
    """
    known = {"contrast_threshold_off": None} if biases == "outdoors" else {}
    derived = SensorParameters.from_biases(biases, **known)
    return replace(
        SENSORS["davis240c"],
        contrast_threshold=derived.contrast_threshold,
        contrast_threshold_off=derived.contrast_threshold_off,
        source_follower_bandwidth_hz=derived.source_follower_bandwidth_hz,
        refractory_period_us=derived.refractory_period_us,
    )
