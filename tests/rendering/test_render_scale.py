"""No rule of the renderers has a length in it: a scene in other units makes the same events."""

from __future__ import annotations

import numpy as np
import pytest

from davis_rs import Scene, Simulator, compare_events
from davis_rs.accuracy.brute_force import dense_probe
from davis_rs.accuracy.hard_case_scenes import room, sideways
from davis_rs.events.arrays import EventArray, concatenate_events
from davis_rs.render.base import Renderer
from davis_rs.render.choice import make_renderer
from exact_scene import ExactRenderer

SCALES = (1e-4, 1e-2, 1.0, 1e3, 1e5)


def scaled(scale: float) -> Scene:
    """A box on a floor and its shadow, scaled; the camera's speed is too."""
    return room(sideways(0.024, 1.0, scale=scale), scale=scale)


def events_of(renderer: Renderer, scene: Scene) -> EventArray:
    return dense_probe(renderer, scene.path, step_us=400, contrast_threshold=0.15).events


@pytest.fixture(scope="module")
def truth() -> EventArray:
    """The events of the scene in metres, by a float64 ray caster with the written rule for shadows."""
    scene = scaled(1.0)
    return events_of(ExactRenderer(scene, scene.own_camera, rays_per_pixel=4), scene)


@pytest.mark.few(5)
@pytest.mark.parametrize("scale", SCALES)
def test_events_are_those_of_float64_at_any_scale(kind: str, scale: float, truth: EventArray) -> None:
    """From a ten-thousandth of the size to a hundred thousand times it: as many events to 1e-3, and the same ones."""
    scene = scaled(scale)
    found = events_of(make_renderer(scene, scene.own_camera, rays_per_pixel=4, kind=kind), scene)
    assert len(truth) > 1000
    assert abs(len(found) - len(truth)) <= 1e-3 * len(truth)
    compared = compare_events(found, truth, size=(32, 24), window_us=100)
    assert compared.missing_percent + compared.spurious_percent < 0.2


@pytest.mark.few(1)
def test_a_simulation_at_any_scale_makes_as_many_events(kind: str) -> None:
    """The sampling in time asks in pixels, so it does not see the scale either."""

    def count(scale: float) -> int:
        made = Simulator(scaled(scale), renderer=kind, accuracy="balanced", frame_rate_hz=0, depth_rate_hz=0)
        return len(concatenate_events([packet.events for packet in made.run()]))

    counts = np.array([count(scale) for scale in SCALES])
    reference = counts[SCALES.index(1.0)]
    assert reference > 900
    assert (np.abs(counts - reference) <= 1e-3 * reference).all(), counts
