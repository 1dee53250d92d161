"""Simulates a scene in which nothing moves: leak, noise and hot pixels alone."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..._core import CrossingEngine
from ..._util.argument_error import ArgumentError
from ...events.arrays import EventArray, concatenate_events
from ...sensor.parameters import SensorParameters

_LUMA, _STEP_S = 0.2, 0.5
"""Steps are short, so that Ctrl-C does not wait for long; events do not depend on them."""
_THRESHOLD = 0.15

SETTLED_S = 20.0
"""After so long, noise and leaks have moved the references of most pixels to where they stay."""


def static_events(
    sensor: SensorParameters,
    size: tuple[int, int],
    duration_s: float,
    *,
    settled_s: float = SETTLED_S,
    lux: float = 200.0,
    seed: int = 0,
) -> EventArray:
    """Return events of a static scene, from 0 to ``duration_s``.

    References begin at the signal, or where a leak leaves them (:func:`before_a_leak`).

    Args:
        sensor: thresholds that it does not give are 0.15.
        size: (width, height) in pixels.
        lux: illuminance of the scene.
        settled_s: what comes before is left out: noise moves the references from there.

    Raises:
        ValueError: for a duration that is not > 0, or a size that no engine takes.
    """
    if not duration_s > 0:
        raise ArgumentError("{duration_s} must be > 0, got {!r}", duration_s)
    width, height = size
    effects = sensor.effects(lux / _LUMA)
    engine = CrossingEngine(
        width,
        height,
        contrast_threshold=sensor.contrast_threshold or _THRESHOLD,
        contrast_threshold_off=sensor.contrast_threshold_off,
        effects=effects.engine_settings(),
        seed=seed,
    )
    frame = np.full((height, width), _LUMA, np.float32)
    steps = int(np.ceil((settled_s + duration_s) / _STEP_S)) + 1
    instants = np.unique(np.linspace(1, (settled_s + duration_s) * 1e6, steps).astype(np.int64))
    engine.push(0, frame if effects.leak_rate_hz is None else before_a_leak(frame, engine, seed))
    pieces = []
    for t_us in instants.tolist():
        events = engine.push(t_us, frame)
        pieces.append(events[events["t"] > settled_s * 1e6])
    stream = concatenate_events([*pieces, engine.flush()])
    stream["t"] -= round(settled_s * 1e6)
    return stream


def before_a_leak(luma: npt.NDArray[np.float32], engine: CrossingEngine, seed: int) -> npt.NDArray[np.float32]:
    """Return a first frame for an engine whose second one is ``luma`` (H, W), a microsecond later.

    It leaves the references where a leak has them in a static scene that has lasted: below the signal, by any part of
    C_on. So events come at the leak's rate from the beginning.
    """
    fraction = np.random.Generator(np.random.Philox(seed)).random(luma.shape)
    return np.asarray(luma * np.exp(-fraction * engine.contrast_threshold), np.float32)
