"""Mitsuba's sunsky without noise, next to its path tracer."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from davis_rs import Camera, Pose, Scene
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer

CAMERA = Camera(24, 18, 24.0, 24.0, 11.5, 8.5)
VIEWS = Views.at_rest([Pose([0.0, 0.0, 3.0], [1.0, 0.0, 0.0, 0.0])])
SKY: dict[str, Any] = {"type": "sunsky", "id": "sky", "sun_direction": [0.6, 0.5, 0.62]}
PARTS: dict[str, Any] = {
    "type": "scene",
    "integrator": {"type": "path", "max_depth": 2},
    "floor": {"type": "rectangle", "bsdf": {"type": "diffuse"}, "to_world": np.diag([4.0, 4.0, 1.0, 1.0])},
    "box": {
        "type": "cube",
        "bsdf": {"type": "diffuse"},
        "to_world": np.array([[0.4, 0, 0, 0], [0, 0.4, 0, 0], [0, 0, 0.4, 0.4], [0, 0, 0, 1.0]]),
    },
}


def scene_of(**sky: Any) -> Scene:
    return Scene("sky", lambda: {**PARTS, "sky": {**SKY, **sky}})


def luma_of(scene: Scene, **options: Any) -> npt.NDArray[np.float64]:
    renderer = make_renderer(scene, CAMERA, blur=False, bake_error=0.05, **options)
    return renderer.luma(VIEWS)[0].astype(np.float64)


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("sky", [{}, {"complex_sun": True, "sun_aperture": 2.0}, {"sun_scale": 0.0}])
def test_a_sunsky_is_mitsubas(sky: dict[str, Any]) -> None:
    """In the mean, and in each pixel as far as the path tracer's noise allows: half of its runs differ as much."""
    scene = scene_of(**sky)
    ours = luma_of(scene, rays_per_pixel=32)
    one, two = (luma_of(scene, kind="integrator", rays_per_pixel=1024, seed=seed) for seed in (1, 2))
    theirs = (one + two) / 2
    assert ours.mean() == pytest.approx(theirs.mean(), rel=0.005)
    noise, off = np.std(np.log(one / two)) / 2, np.sqrt(np.mean(np.log(ours / theirs) ** 2))
    assert off < 1.2 * noise + 0.01


def test_a_large_sun_has_soft_shadows() -> None:
    """Between light and shadow lie steps, and the run says that it is several lights."""
    scenes = [scene_of(sun_aperture=aperture) for aperture in (0.5, 12.0)]
    sharp, soft = (luma_of(scene, rays_per_pixel=8) for scene in scenes)
    levels = [np.unique(np.round(luma / luma.max(), 2)).size for luma in (sharp, soft)]
    assert levels[1] > levels[0]
    reasons = [make_renderer(scene, CAMERA, bake_error=0.05).reason for scene in scenes]
    for reason, suns in zip(reasons, ("1 directional light", "16 directional lights"), strict=True):
        assert reason.endswith(f"; its sunsky made an environment map and {suns}")
    assert soft.sum() == pytest.approx(sharp.sum(), rel=0.02)
