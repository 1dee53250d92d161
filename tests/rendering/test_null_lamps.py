"""Lamps of Mitsuba's material ``null``, as Blender's add-on writes area lights."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from davis_rs import Camera, Pose, Scene
from davis_rs.geometry.trajectory.trajectory import SegmentTrajectory
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.render.integrator.renderer import IntegratorRenderer
from davis_rs.render.native.renderer import NativeRenderer
from davis_rs.render.truth.scene_surfaces import SceneSurfaces

CAMERA = Camera(48, 36, 40.0, 40.0, 23.5, 17.5)
DOWN = Pose([0.0, 0.0, 3.0], [1.0, 0.0, 0.0, 0.0])
"""A camera three metres above the floor, looking down."""


def lamp(x: float, *, up: bool, flipped: bool, material: str = "null") -> dict[str, Any]:
    """Return a square lamp a metre above the floor that shines up or down, by its place or by turned normals."""
    placed = np.diag([0.3, 0.3, 0.3 if up != flipped else -0.3, 1.0])
    placed[:3, 3] = x, 0, 1
    emitter = {"type": "area", "radiance": 2.0}
    square = {"type": "rectangle", "to_world": placed, "flip_normals": flipped}
    return {**square, "emitter": emitter, "bsdf": {"type": material}}


def scene_of(*, flipped: bool, material: str = "null") -> Scene:
    """Return a floor below a lamp whose back is seen, and one whose front is."""
    content = {
        "type": "scene",
        "integrator": {"type": "path"},
        "floor": {"type": "rectangle", "to_world": np.diag([4.0, 4, 1, 1])},
        "back": lamp(-0.6, up=False, flipped=flipped, material=material),
        "front": lamp(0.6, up=True, flipped=flipped, material=material),
    }
    return Scene("lamps", lambda: content, camera=CAMERA, trajectory=SegmentTrajectory(DOWN, DOWN, 1.0))


def parts(image: npt.NDArray[np.float32]) -> npt.NDArray[np.float64]:
    """Return means over the middles of both lamps, and over floor next to them."""
    image = image.reshape(36, 48).astype(np.float64)
    return np.array([image[15:21, columns].mean() for columns in (slice(9, 14), slice(34, 39), slice(20, 28))])


@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("flipped", [False, True])
def test_a_lamp_without_a_surface_is_not_seen_from_behind(flipped: bool) -> None:
    """As by Mitsuba's path tracer: one sees the floor through its back."""
    scene = scene_of(flipped=flipped)
    renderer = make_renderer(scene, CAMERA)
    assert isinstance(renderer, NativeRenderer)
    assert "what is behind lamps of the material null is hidden" in renderer.reason
    paths = make_renderer(scene, CAMERA, kind="integrator", rays_per_pixel=512)
    assert isinstance(paths, IntegratorRenderer)
    views = Views.at_rest([DOWN])
    ours, theirs = parts(renderer.luma(views)[0]), parts(paths.luma(views)[0])
    np.testing.assert_allclose(ours, theirs, rtol=0.03)
    np.testing.assert_allclose(ours[1], 2.0, rtol=1e-5)
    assert ours[0] > 0.05
    np.testing.assert_allclose(parts(SceneSurfaces(scene, CAMERA).frame(views).depth), [3, 2, 3], rtol=1e-5)


def test_lamps_with_a_surface_are_seen_from_both_sides() -> None:
    views, scene = Views.at_rest([DOWN]), scene_of(flipped=True, material="diffuse")
    np.testing.assert_allclose(parts(SceneSurfaces(scene, CAMERA).frame(views).depth), [2, 2, 3], rtol=1e-5)
