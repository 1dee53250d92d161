"""A scene of meshes that is loaded without what Mitsuba traces rays by has all that is asked of a scene."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from davis_rs import Flicker, load_scene, start_pose
from davis_rs._mitsuba.scene_contents import SceneContents
from davis_rs._mitsuba.variants import SCALAR, load_scene_contents, load_scene_source, variant
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.scene.scene import Scene
from gltf_files import Gltf, quad


def lit_world(tmp_path: Path) -> Scene:
    """Two meshes, one of which shines, a lamp and a sky."""
    gltf = Gltf()
    gltf.node(mesh=quad(gltf))
    shining = gltf.material("shining", more={"emissiveFactor": [1, 0.5, 0]})
    gltf.node(mesh=quad(gltf, material=shining), translation=[0, 3, 1])
    gltf.light({"type": "point", "intensity": 100.0}, translation=[0, 0, 2])
    return load_scene(gltf.save(tmp_path / "world.glb"))


def test_contents_are_those_of_the_scene(tmp_path: Path) -> None:
    scene = lit_world(tmp_path)
    with variant(SCALAR) as (mi, _):
        contents, whole = load_scene_contents(scene.source(), mi), load_scene_source(scene.source(), mi)
        assert isinstance(contents, SceneContents)
        assert isinstance(whole, mi.Scene)
        told = [
            (
                [(shape.id(), shape.class_name(), shape.face_count(), shape.is_emitter()) for shape in one.shapes()],
                [(emitter.id(), emitter.class_name()) for emitter in one.emitters()],
                len(one.sensors()),
                str(one.integrator()),
                np.array([one.bbox().min, one.bbox().max]).tolist(),
            )
            for one in (contents, whole)
        ]
        assert told[0] == told[1]
        assert [kind for _, kind in told[0][1]] == ["PointLight", "AreaLight"]
        own, others = (set(mi.traverse(one).keys()) for one in (contents, whole))
        assert {name for name in others if "." in name} <= own


def test_other_scenes_are_loaded_whole() -> None:
    """Where a shape is described, and where Mitsuba is to trace rays."""
    scene = load_scene("three_planes")
    with variant(SCALAR) as (mi, _):
        assert isinstance(load_scene_contents(scene.source(), mi), mi.Scene)


def test_a_light_of_contents_flickers(tmp_path: Path) -> None:
    """It is found by its name, and a name that is not there is told with those that are."""
    scene = lit_world(tmp_path)
    [lamp] = [name for name in scene.source() if name.startswith("light_")]
    flickering = replace(scene, lights={lamp: Flicker(100.0, modulation=1.0)})
    renderer = make_renderer(flickering, scene.own_camera, kind="native", rays_per_pixel=1)
    bright, dark = renderer.luma(Views.at_rest([start_pose(scene)] * 2, [0.0025, 0.0075]))
    assert bright.sum() > dark.sum() + 1
    with pytest.raises(ValueError, match=rf"has no light 'lamp'; it has .*{lamp}"):
        make_renderer(replace(scene, lights={"lamp": Flicker(100.0, modulation=1.0)}), scene.own_camera, kind="native")
