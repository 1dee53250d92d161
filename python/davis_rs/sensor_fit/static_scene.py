"""What a sensor makes of a scene in which nothing moves: leak, noise and hot pixels alone."""

from __future__ import annotations

import numpy as np

from .._core import CrossingEngine
from ..argument_error import ArgumentError
from ..events import EventArray, concatenate_events
from ..sensor_parameters import SensorParameters

_LUMA, _STEP_S = 0.2, 5.0
_THRESHOLD = 0.15


def static_events(
    sensor: SensorParameters,
    size: tuple[int, int],
    duration_s: float,
    *,
    settled_s: float = 60.0,
    lux: float = 200.0,
    seed: int = 0,
) -> EventArray:
    """Events of a static scene, from 0 to ``duration_s``.

    Args:
        sensor: thresholds that it does not give are 0.15.
        size: (width, height) in pixels.
        lux: illuminance of the scene.
        settled_s: what comes before is left out: at first, noise and leak make more events, because references begin
            anywhere between two levels.

    Raises:
        ValueError: for a duration that is not > 0, or a size that no engine takes.
    """
    if not duration_s > 0:
        raise ArgumentError("{duration_s} must be > 0, got {!r}", duration_s)
    width, height = size
    engine = CrossingEngine(
        width,
        height,
        contrast_threshold=sensor.contrast_threshold or _THRESHOLD,
        contrast_threshold_off=sensor.contrast_threshold_off,
        effects=sensor.effects(lux / _LUMA).engine_settings(),
        seed=seed,
    )
    frame = np.full((height, width), _LUMA, np.float32)
    steps = int(np.ceil((settled_s + duration_s) / _STEP_S)) + 1
    instants = np.unique(np.linspace(0, (settled_s + duration_s) * 1e6, steps).astype(np.int64))
    pieces = []
    for t_us in instants.tolist():
        events = engine.push(t_us, frame)
        pieces.append(events[events["t"] > settled_s * 1e6])
    found = concatenate_events([*pieces, engine.flush()])
    found["t"] -= round(settled_s * 1e6)
    return found
