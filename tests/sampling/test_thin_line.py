"""A bar thinner than a pixel that crosses pixels between two keyframes.

No estimate can see it where luma is a mean over rays. The geometry can, and so can lines through the pixels.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from davis_rs import FixedRate, Scene, Simulator
from davis_rs.events.arrays import EventArray
from davis_rs.sampling.rules import TimeSampling
from davis_rs.sampling.tolerance import Tolerance
from stretches import CAMERA, DOWN, LAMP, shift

pytestmark = pytest.mark.usefixtures("llvm")


def bar() -> Scene:
    """A white bar, a quarter of a pixel wide, over a dark floor."""
    floor, thin = np.diag([30.0, 30.0, 1.0, 1.0]), np.diag([0.01, 5.0, 1.0, 1.0])
    thin[:3, 3] = (0.3, 0.0, 0.5)
    parts: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0},
        "lamp": LAMP,
        "floor": {"type": "rectangle", "to_world": floor, "bsdf": {"type": "diffuse", "reflectance": 0.05}},
        "bar": {"type": "rectangle", "to_world": thin, "bsdf": {"type": "diffuse", "reflectance": 0.9}},
    }
    return Scene("bar", partial(dict, parts), shadows=False)


def events(sampling: TimeSampling, pixel: str = "rays") -> EventArray:
    """Of a camera that moves by some eight pixels of the bar's depth in 4 ms, with nothing due between.

    So short a span is not probed: see :mod:`davis_rs.sampling.plausibility`.
    """
    scene = bar().with_trajectory(shift([0.6, 0.0, 0.0], 0.004, DOWN))
    simulator = Simulator(
        scene, camera=CAMERA, rays_per_pixel=8, pixel=pixel, sampling=sampling, frame_rate_hz=0, depth_rate_hz=0
    )
    return np.concatenate([packet.events for packet in simulator.run()])


def test_a_thin_line_that_crosses_pixels_within_one_interval_makes_its_events() -> None:
    """With the edges of the geometry it makes the events of dense sampling, without them those at its ends."""
    truth = events(FixedRate(200_000))
    seeing = Tolerance(1.0, pixels=100.0, longest=100.0, halvings=10)
    seen, blind = events(seeing), events(replace(seeing, edges=False))
    columns = set(np.unique(truth["x"]).tolist())
    assert len(columns) >= 8
    assert len(set(np.unique(blind["x"]).tolist())) <= 4
    assert set(np.unique(seen["x"]).tolist()) >= columns - {min(columns), max(columns)}
    assert len(seen) == pytest.approx(len(truth), rel=1e-3)
    assert len(blind) < 0.4 * len(truth)


def test_lines_see_it_wherever_it_is() -> None:
    """Between keyframes half a pixel apart there is nothing that they do not show: no edge need be followed."""
    truth = events(FixedRate(200_000), "lines")
    seen = events(Tolerance(0.05, pixels=1 / 2, longest=1 / 2, halvings=6, edges=False), "lines")
    assert len(np.unique(truth["x"])) >= 8
    assert np.array_equal(np.unique(seen["x"]), np.unique(truth["x"]))
    assert len(seen) == pytest.approx(len(truth), rel=2e-3)
