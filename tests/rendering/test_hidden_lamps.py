"""Lamps that the integrator hides from the camera (Mitsuba's ``hide_emitters``)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from davis_rs import Camera, Pose, Scene
from davis_rs._mitsuba.variants import SCALAR, load_scene_source, variant
from davis_rs.geometry.trajectory.trajectory import SegmentTrajectory
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer, why_not_noise_free
from davis_rs.render.integrator.renderer import IntegratorRenderer
from davis_rs.render.integrator.scalar import ScalarRenderer
from davis_rs.render.native.renderer import NativeRenderer
from davis_rs.render.truth.scene_surfaces import SceneSurfaces

CAMERA = Camera(48, 36, 40.0, 40.0, 23.5, 17.5)
DOWN = Pose([0.0, 0.0, 3.0], [1.0, 0.0, 0.0, 0.0])
"""A camera three metres above the floor, looking down."""

VIEWS = Views.at_rest([DOWN])
LAMP = (slice(15, 21), slice(9, 14))
"""The middle of the image of a lamp."""

MIRROR = (slice(15, 21), slice(34, 39))


def lamp(height: float, *, up: bool) -> dict[str, Any]:
    """Return a square lamp above the floor that shines up or down."""
    placed = np.diag([0.3, 0.3, 0.3 if up else -0.3, 1.0])
    placed[:3, 3] = -0.6, 0, height
    return {"type": "rectangle", "to_world": placed, "emitter": {"type": "area", "radiance": 2.0}}


def scene_of(*, hidden: bool = True, **more: dict[str, Any]) -> Scene:
    """Return two lamps above each other over a floor, and a mirror that shows them."""
    tilted = np.eye(4)
    tilted[:3, :3] = [[np.cos(0.7), 0, -np.sin(0.7)], [0, 1, 0], [np.sin(0.7), 0, np.cos(0.7)]]
    mirror = tilted @ np.diag([0.4, 0.4, 1, 1])
    mirror[:3, 3] = 0.6, 0, 0.5
    content = {
        "type": "scene",
        "integrator": {"type": "path", "hide_emitters": hidden},
        "floor": {"type": "rectangle", "to_world": np.diag([4.0, 4, 1, 1])},
        "mirror": {"type": "rectangle", "to_world": mirror, "bsdf": {"type": "conductor", "material": "none"}},
        "lower": lamp(1.0, up=False),
        "upper": lamp(1.4, up=True),
        "sky": {"type": "constant", "radiance": 0.2},
        **more,
    }
    return Scene("lamps", lambda: content, camera=CAMERA, trajectory=SegmentTrajectory(DOWN, DOWN, 1.0))


@pytest.mark.usefixtures("llvm")
def test_the_camera_sees_through_a_hidden_lamp_and_a_mirror_shows_it() -> None:
    """As by Mitsuba's path tracer."""
    scene = scene_of()
    renderer = make_renderer(scene, CAMERA, rays_per_pixel=128)
    assert isinstance(renderer, NativeRenderer)
    paths = make_renderer(scene, CAMERA, kind="integrator", rays_per_pixel=512)
    ours, theirs = renderer.luma(VIEWS)[0], paths.luma(VIEWS)[0]
    shown = make_renderer(scene_of(hidden=False), CAMERA, rays_per_pixel=128).luma(VIEWS)[0]
    for part in (LAMP, MIRROR):
        np.testing.assert_allclose(ours[part].mean(), theirs[part].mean(), rtol=0.03)
    assert ours[LAMP].mean() < 0.5 < 1.9 < shown[LAMP].mean()
    np.testing.assert_allclose(ours[MIRROR], shown[MIRROR], rtol=0.02)


@pytest.mark.usefixtures("llvm")
def test_depth_and_shapes_are_of_what_is_seen() -> None:
    """Of the floor, by every renderer and by the truth at events."""
    scene = scene_of()
    kinds = [make_renderer(scene, CAMERA), make_renderer(scene, CAMERA, kind="integrator")]
    assert isinstance(kinds[1], IntegratorRenderer)
    for renderer in kinds:
        np.testing.assert_allclose(renderer.depth(VIEWS)[0][LAMP], 3.0, rtol=1e-5)
    surfaces = SceneSurfaces(scene, CAMERA)
    frame = surfaces.frame(VIEWS)
    np.testing.assert_allclose(frame.depth.reshape(36, 48)[LAMP], 3.0, rtol=1e-6)
    assert set(frame.shape.reshape(36, 48)[LAMP].ravel()) == {1 + surfaces.names.index("floor")}


def test_depth_without_llvm_is_of_what_is_seen() -> None:
    with variant(SCALAR) as (mi, _):
        loaded = load_scene_source(scene_of().source(), mi)
        renderer = ScalarRenderer(loaded, CAMERA, rays_per_pixel=1, blur=False, seed=0, reason="")
    np.testing.assert_allclose(renderer.depth(VIEWS)[0][LAMP], 3.0, rtol=1e-5)


@pytest.mark.parametrize("pane", [{"type": "thindielectric"}, {"type": "mask", "opacity": 0.5}])
def test_what_is_seen_through_needs_mitsuba(pane: dict[str, Any]) -> None:
    """Mitsuba hides the sky behind it, too."""
    placed = np.diag([0.3, 0.3, 1, 1.0])
    placed[:3, 3] = 0, 0.6, 1
    bsdf = pane if pane["type"] == "thindielectric" else pane | {"bsdf": {"type": "diffuse"}}
    more = {"pane": {"type": "rectangle", "to_world": placed, "bsdf": bsdf}}
    assert not why_not_noise_free(scene_of(hidden=False, **more))
    (obstacle,) = why_not_noise_free(scene_of(**more))
    assert "hide_emitters" in obstacle.rule
