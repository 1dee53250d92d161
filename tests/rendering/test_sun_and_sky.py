"""Mitsuba's sunsky without noise, next to its path tracer."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from davis_rs import Camera, Pose, Scene
from davis_rs._mitsuba.variants import SCALAR, variant
from davis_rs._util.last_used import keep_last
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.render.sun_and_sky import as_known_lights

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


def sky_of(**sky: Any) -> npt.NDArray[np.float32]:
    with variant(SCALAR) as (mi, _):
        environment, *_ = as_known_lights(mi.load_dict({**SKY, **sky}), mi)
        return np.array(mi.traverse(environment)["data"])


def luma_of(scene: Scene, **options: Any) -> npt.NDArray[np.float64]:
    renderer = make_renderer(scene, CAMERA, blur=False, bake_error=0.05, **options)
    return renderer.luma(VIEWS)[0].astype(np.float64)


@pytest.mark.few(1)
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
    renderers = [make_renderer(scene, CAMERA, blur=False, bake_error=0.05, rays_per_pixel=8) for scene in scenes]
    sharp, soft = (renderer.luma(VIEWS)[0] for renderer in renderers)
    levels = [np.unique(np.round(luma / luma.max(), 2)).size for luma in (sharp, soft)]
    assert levels[1] > levels[0]
    for renderer, suns in zip(renderers, ("1 directional light", "16 directional lights"), strict=True):
        assert renderer.reason.endswith(f"; its sunsky made an environment map and {suns}")
    assert soft.sum() == pytest.approx(sharp.sum(), rel=0.02)


@pytest.mark.few(1)
@pytest.mark.parametrize("other", [{"sun_direction": [0.6, 0.3, 0.62]}, {"turbidity": 6.0}, {"albedo": 0.9}])
def test_each_sky_has_its_own_map(other: dict[str, Any]) -> None:
    """Maps of skies are kept, because a run makes several renderers."""
    sky, same, changed = (sky_of(**sky) for sky in ({}, {}, other))
    assert np.array_equal(sky, same)
    assert not np.allclose(sky, changed, rtol=0.01)


def test_the_results_that_were_used_last_are_kept() -> None:
    known: dict[str, int] = {}
    for key in "abcaad":  # what is used again drops nothing, and is the last one
        keep_last(known, key, ord(key), 3)
    assert known == {"c": ord("c"), "a": ord("a"), "d": ord("d")}
