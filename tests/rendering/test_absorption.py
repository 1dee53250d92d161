"""What is absorbed within glass: Beer's law, next to Mitsuba's path tracer for volumes."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from davis_rs import Camera, Pose, Scene
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer, why_not_noise_free

CAMERA = Camera(24, 18, 48.0, 48.0, 11.5, 8.5)
VIEWS = Views.at_rest([Pose([0.0, 0.0, 3.0], [1.0, 0.0, 0.0, 0.0])])
WINE: dict[str, Any] = {
    "type": "homogeneous",
    "albedo": 0.0,
    "sigma_t": {"type": "rgb", "value": [0.05, 0.4, 0.3]},
    "scale": 2.0,
}
MILK = {**WINE, "albedo": 0.5}
BALL = {"type": "sphere", "radius": 0.5, "bsdf": {"type": "dielectric", "int_ior": 1.3}}
CUBE = {"type": "cube", "bsdf": BALL["bsdf"], "to_world": np.diag([0.5, 0.5, 0.5, 1.0])}
SKY = {"type": "constant", "radiance": 1.0}
VOLPATH = {"type": "volpath", "max_depth": 16}


def scene_of(integrator: dict[str, Any] | None = VOLPATH, **parts: Any) -> Scene:
    content = {"type": "scene", "sky": SKY, **parts, **({} if integrator is None else {"integrator": integrator})}
    return Scene("absorbing", lambda: dict(content))


def luma_of(scene: Scene, kind: str = "native", rays: int = 16) -> npt.NDArray[np.float64]:
    """Nothing here is diffuse, so no light need be baked."""
    renderer = make_renderer(scene, CAMERA, kind=kind, rays_per_pixel=rays, blur=False)
    return renderer.luma(VIEWS)[0].astype(np.float64)


def rules_of(scene: Scene) -> str:
    return "; ".join(obstacle.rule for obstacle in why_not_noise_free(scene))


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize(
    "solid",
    [
        BALL,
        {**BALL, "bsdf": {"type": "roughdielectric", "int_ior": 1.3, "alpha": 0.03}},
        CUBE,
    ],
    ids=["ball", "rough ball", "cube"],
)
def test_a_solid_absorbs_as_mitsubas(solid: dict[str, Any]) -> None:
    """Mitsuba's own paths end at random within the medium, so the mean of what it leaves of light is compared."""
    scenes = [scene_of(solid=solid | {"interior": WINE}), scene_of(solid=solid)]
    ours, theirs = (
        np.divide(*(luma_of(scene, kind, rays) for scene in scenes))
        for kind, rays in (("native", 16), ("integrator", 1024))
    )
    within = ours < 0.99
    assert within.sum() > 60
    assert ours[9, 12] < 0.7
    np.testing.assert_allclose(ours[within].mean(), theirs[within].mean(), rtol=0.01)
    np.testing.assert_allclose(ours[6:12, 9:15], theirs[6:12, 9:15], rtol=0.06)


def test_what_shows_absorption() -> None:
    """Integrators for volumes do, and scenes that name none; surface integrators do not, and the run says so."""
    lit = {"solid": BALL | {"interior": WINE}}
    absorbed, named = (luma_of(scene_of(integrator, **lit)) for integrator in (VOLPATH, None))
    np.testing.assert_allclose(named, absorbed, rtol=1e-5)
    by_surfaces = scene_of({"type": "path"}, **lit)
    assert luma_of(by_surfaces)[9, 12] > 0.9
    told = [
        make_renderer(scene, CAMERA, kind="native").reason
        for scene in (by_surfaces, scene_of(None, **lit), scene_of(**lit))
    ]
    assert ["media (fog, milk) are not rendered" in reason for reason in told] == [True, False, False]


@pytest.mark.parametrize(
    ("parts", "rule"),
    [
        ({"ball": BALL | {"interior": MILK}}, "it has a medium (fog, milk)"),
        ({"ball": BALL | {"interior": WINE, "exterior": WINE}}, "it has a medium (fog, milk)"),
        ({"ball": BALL, "eye": {"type": "perspective", "around": MILK}}, "it has a medium (fog, milk)"),
        (
            {"ball": BALL | {"bsdf": {"type": "thindielectric"}, "interior": WINE}},
            "has a medium inside, and its surface is not that of a dielectric",
        ),
        (
            {"ball": BALL | {"bsdf": {"type": "principled", "spec_trans": 1.0}, "interior": WINE}},
            "has a medium inside, and its surface is not that of a dielectric",
        ),
    ],
    ids=["milk", "outside", "camera", "sheet", "principled"],
)
def test_other_media_are_mitsubas(parts: dict[str, Any], rule: str) -> None:
    """Also those of a ball, in whose place there are triangles, and of the camera."""
    assert rule in rules_of(scene_of(**parts))


def test_light_is_not_baked_where_all_is_glass() -> None:
    """Nothing would show it."""
    reason = make_renderer(scene_of(cube=CUBE), CAMERA).reason
    assert "baked light at 24 points, whose error is estimated at 0 %" in reason


def test_media_within_opaque_surfaces_do_not_count() -> None:
    floor = {"type": "rectangle", "bsdf": {"type": "diffuse"}, "interior": WINE}
    assert rules_of(scene_of(floor=floor)) == ""
