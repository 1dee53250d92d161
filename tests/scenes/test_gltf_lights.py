"""Which unit the numbers of a glTF file's lights have."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from davis_rs import Scene, load_scene
from davis_rs.geometry.pose import FloatArray
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from gltf_files import Gltf, quad, with_camera

DIRECTIONAL: dict[str, Any] = {"type": "directional"}
TOLD = "too dim for lux and candela, so a white surface has luma 1 where it is lit best"


def white_wall(folder: Path, *lights: tuple[dict[str, Any], dict[str, Any]]) -> Scene:
    """A white square of 2 x 2 m, seen from 3 m by a camera in the middle, under lights and the parts of their nodes."""
    gltf = Gltf()
    white = gltf.material(baseColorFactor=[1, 1, 1, 1], roughnessFactor=1.0)
    gltf.node(mesh=quad(gltf, material=white))
    for light, node in lights:
        gltf.light(light, **node)
    with_camera(gltf)
    return load_scene(gltf.save(folder / "wall.glb"))


def luma_of(scene: Scene) -> FloatArray:
    assert scene.start is not None
    renderer = make_renderer(scene, scene.own_camera, kind="native", rays_per_pixel=1)
    return np.asarray(renderer.luma(Views.at_rest([scene.start]))[0], np.float64)


@pytest.mark.parametrize("intensity", [1.0, 3.14, 39.9])
def test_a_dim_sun_is_a_number_without_a_unit(tmp_path: Path, intensity: float) -> None:
    """As lux, these would be less than a street lamp; all make the white wall white, and the run says so."""
    scene = white_wall(tmp_path, (DIRECTIONAL | {"intensity": intensity}, {}))
    assert luma_of(scene)[90, 120] == pytest.approx(1.0, rel=1e-5)
    assert f"; 1 light, {TOLD};" in scene.note
    assert scene.lux_per_luma == 1000.0


def test_a_sun_in_lux_keeps_its_number(tmp_path: Path) -> None:
    """40 lux, a dim room, is the least that is taken as lux."""
    scene = white_wall(tmp_path, (DIRECTIONAL | {"intensity": 40.0}, {}))
    assert luma_of(scene)[90, 120] == pytest.approx(40 / 683 / np.pi, rel=1e-5)
    assert "; 1 light, 683 lux or candela as one unit;" in scene.note


def test_all_lights_of_a_dim_world_are_made_stronger_by_one_factor(tmp_path: Path) -> None:
    """Light falls off by distance and within a cone; what is lit best, straight below the lamp, has luma 1."""
    spot = {"type": "spot", "intensity": 0.02, "spot": {"innerConeAngle": 0.2, "outerConeAngle": 0.3}}
    point = {"type": "point", "intensity": 0.01}
    scene = white_wall(tmp_path, (spot, {"translation": [0, 0, 2]}), (point, {"translation": [0, 0, 2]}))
    luma = luma_of(scene)
    assert luma[90, 120] == pytest.approx(1.0, rel=0.02)
    aside_m = (147 - 119.5) / 90 * 3  # outside of the spot's cone: the point light alone
    assert luma[90, 120] / luma[90, 147] == pytest.approx(3 * (1 + (aside_m / 2) ** 2) ** 1.5, rel=0.01)
    assert f"; 2 lights, {TOLD};" in scene.note


def test_a_lamp_near_a_small_part_does_not_decide(tmp_path: Path) -> None:
    """A lamp of 1 candela, 5 cm above a wall of 20 x 20 m: 400 lux, but on hardly any of it."""
    gltf = Gltf()
    gltf.node(mesh=quad(gltf), scale=[10, 10, 1])
    gltf.light({"type": "point", "intensity": 1.0}, translation=[0, 0, 0.05])
    assert TOLD in load_scene(gltf.save(tmp_path / "wall.glb")).note


def test_lights_that_are_off_stay_so(tmp_path: Path) -> None:
    """Such as one of hardly any strength, by which a file has no sky, and is lit by its own surfaces alone."""
    scene = white_wall(tmp_path, (DIRECTIONAL | {"intensity": 1e-6}, {}), (DIRECTIONAL | {"intensity": 0}, {}))
    assert "; 2 lights, 683 lux or candela as one unit;" in scene.note
    assert luma_of(scene).max() < 1e-6


def test_lights_that_light_nothing_keep_lux_and_candela(tmp_path: Path) -> None:
    """A spot that shines away from the wall; there is nothing by which it could be made stronger."""
    spot = {"type": "spot", "intensity": 1.0, "spot": {"outerConeAngle": 0.3}}
    scene = white_wall(tmp_path, (spot, {"translation": [0, 0, 2], "rotation": [0, 1, 0, 0]}))
    assert "683 lux or candela as one unit" in scene.note
