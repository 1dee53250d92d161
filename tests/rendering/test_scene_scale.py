"""Very small and very large scenes through Mitsuba's integrators: scaled, and nothing else about them changes."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from davis_rs import Camera, Pose, SegmentTrajectory, Simulator
from davis_rs._mitsuba.variants import FAST, SCALAR, load_scene_source, variant
from davis_rs.accuracy.hard_case_scenes import room, sideways
from davis_rs.events.arrays import concatenate_events
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.integrator.base import SceneRenderer
from davis_rs.render.integrator.renderer import IntegratorRenderer
from davis_rs.render.integrator.scalar import ScalarRenderer
from davis_rs.render.motion.scene_motion import STILL, SceneMotion
from davis_rs.scene.light_profile import Flicker

CAMERA = Camera(15, 11, 18.0, 18.0, 7.0, 5.0)
POSE = Pose([0.5, -0.9, 1.8], [0.965061, 0.0517277, -0.1125492, -0.2308985])
SMALL, LARGE = 2.0**-12, 2.0**12
"""Of scenes 4 m wide."""
WHITE = {"type": "diffuse", "reflectance": 0.7}
BUMPS = np.random.RandomState(0).random_sample((8, 8, 3)).astype(np.float32)
DIRECT = {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}


def placed(scale: float, size: float, x: float, y: float, z: float) -> np.ndarray:
    matrix = np.diag([size * scale] * 3 + [1.0])
    matrix[:3, 3] = np.array([x, y, z]) * scale
    return matrix


def lamp(scale: float) -> dict[str, Any]:
    return {"type": "point", "position": [0.4 * scale, -0.5 * scale, 2.5 * scale], "intensity": 9.0 * scale**2}


def floor(scale: float) -> dict[str, Any]:
    return {"type": "rectangle", "to_world": placed(scale, 1.5, 0, 0, 0), "bsdf": WHITE}


def built(
    source: dict[str, Any], *, name: str = FAST, motion: SceneMotion | None = None, rays_per_pixel: int = 2
) -> SceneRenderer:
    with variant(name) as (mi, _):
        loaded = load_scene_source({"type": "scene", "integrator": DIRECT, **source}, mi)
    kind = IntegratorRenderer if name == FAST else ScalarRenderer
    motion = STILL if motion is None else motion
    return kind(loaded, CAMERA, rays_per_pixel=rays_per_pixel, blur=False, seed=0, reason="", motion=motion)


def views(scale: float, t_s: float = 0.0) -> Views:
    """One that moves."""
    still = Views.at_rest([Pose(POSE.position * scale, POSE.quaternion)], t_s)
    return Views(
        still.t_s,
        still.positions,
        still.rotations,
        np.array([[0.3 * scale, 0.1 * scale, 0.0]]),
        np.array([[0.1, 0.2, 0.3]]),
    )


def assert_same(parts: Callable[[float], dict[str, Any]], name: str = FAST) -> None:
    """Luma, its rates, depth and flow of a scene, small and large, are those of its own size."""
    own = built(parts(1.0), name=name)
    luma, rate = own.luma_and_rate(views(1.0))
    assert luma.std() > 0.01 * luma.mean()
    for scale in (SMALL, LARGE):
        renderer = built(parts(scale), name=name)
        assert (renderer.scale > 1.0) == (scale < 1.0)
        assert renderer.scale != 1.0
        scaled, scaled_rate = renderer.luma_and_rate(views(scale))
        # A pixel or two see a shadow's or a shape's edge.
        assert np.mean(np.abs(scaled - luma) > 1e-4 * luma.max()) < 0.03
        assert np.mean(np.abs(scaled_rate - rate) > 0.02 * np.abs(rate).max()) < 0.05
        np.testing.assert_allclose(renderer.depth(views(scale)), scale * own.depth(views(1.0)), rtol=1e-5)
        np.testing.assert_allclose(renderer.flow(views(scale)), own.flow(views(1.0)), rtol=1e-4)


@pytest.fixture(scope="module")
def events_at_its_own_size() -> int:
    return count(1.0)


def count(scale: float) -> int:
    scene = room(sideways(0.024, 1.0, scale=scale), scale=scale)
    made = Simulator(scene, accuracy="paper", renderer="integrator", rays_per_pixel=2, frame_rate_hz=0, depth_rate_hz=0)
    return len(concatenate_events([packet.events for packet in made.run()]))


@pytest.mark.parametrize("scale", [1e-4, 1e-3, 1e-2, 0.1, 10.0, 1e3, 1e5])
@pytest.mark.usefixtures("llvm")
def test_a_scaled_scene_gives_the_same_events(scale: float, events_at_its_own_size: int) -> None:
    """A box and its shadow on a floor of 4 m, larger and smaller, make as many events, within 0.1 %."""
    assert events_at_its_own_size > 2000
    assert count(scale) == pytest.approx(events_at_its_own_size, rel=1e-3)


def sphere(scale: float) -> dict[str, Any]:
    return {"type": "sphere", "center": [0.2 * scale, 0.1 * scale, 0.5 * scale], "radius": 0.3 * scale, "bsdf": WHITE}


def shape(kind: str, scale: float, folder: Path) -> dict[str, Any]:
    if kind == "linearcurve":
        points = np.array([[0, -0.5, 0.3, 0.2], [0.3, 0, 0.5, 0.1], [0.2, 0.5, 0.4, 0.2]]) * scale
        file = folder / f"{scale}.txt"
        np.savetxt(file, points)
        return {"curve": {"type": kind, "filename": str(file), "bsdf": WHITE}}
    if kind == "sphere":
        return {"ball": sphere(scale)}
    return {"thing": {"type": kind, "to_world": placed(scale, 0.3, 0.2, 0.1, 0.5), "bsdf": WHITE}}


@pytest.mark.few(1)
@pytest.mark.parametrize("kind", ["cube", "sphere", "disk", "cylinder", "linearcurve"])
@pytest.mark.usefixtures("llvm")
def test_shapes(kind: str, tmp_path: Path) -> None:
    """Of every kind, with what they throw in shadow."""
    assert_same(lambda scale: {"lamp": lamp(scale), "floor": floor(scale), **shape(kind, scale, tmp_path)})


@pytest.mark.long
@pytest.mark.usefixtures("llvm")
def test_instances() -> None:
    """What they repeat keeps its size; their places are scaled."""

    def parts(scale: float) -> dict[str, Any]:
        group = {"type": "shapegroup", "cube": {"type": "cube", "bsdf": WHITE}}
        places = [placed(scale, 0.2, x, 0.1, 0.4) for x in (-0.3, 0.4)]
        own = {f"copy{i}": {"type": "instance", "to_world": place, "g": {"type": "ref", "id": "group"}}
               for i, place in enumerate(places)}  # fmt: skip
        return {"lamp": lamp(scale), "floor": floor(scale), "group": group, **own}

    assert_same(parts)


def light(kind: str, scale: float) -> dict[str, Any]:
    above = placed(scale, 1.0, 0.1, -0.2, 2.2)
    above[:3, :3] = np.diag([1.0, -1.0, -1.0])  # shines down
    if kind == "spot":
        return {"type": kind, "to_world": above, "intensity": 9.0 * scale**2, "cutoff_angle": 35.0}
    if kind == "projector":
        pattern = np.random.RandomState(1).random_sample((4, 4, 3)).astype(np.float32)
        picture = {"type": "bitmap", "raw": True, "filter_type": "nearest", "data": pattern}
        return {"type": kind, "to_world": above, "irradiance": picture, "scale": 9.0 * scale**2, "fov": 60.0}
    if kind == "directional":
        return {"type": kind, "direction": [0.3, 0.2, -1.0], "irradiance": 2.0}
    if kind == "area":
        above[:3, :3] *= 0.2 * scale
        return {"type": "rectangle", "to_world": above, "emitter": {"type": "area", "radiance": 20.0}}
    return {"type": "constant", "radiance": 0.5}


@pytest.mark.long
@pytest.mark.parametrize("kind", ["spot", "projector", "directional", "area", "constant"])
@pytest.mark.usefixtures("llvm")
def test_lights(kind: str) -> None:
    """Of every kind, as bright as before."""
    assert_same(lambda scale: {"light": light(kind, scale), "floor": floor(scale), "ball": sphere(scale)})


@pytest.mark.long
@pytest.mark.usefixtures("llvm")
def test_the_suns_shadows_reach_as_far_as_the_scene() -> None:
    """Also in its middle, where Mitsuba looks as far as the sun's light knows the scene to be large."""

    def parts(scale: float) -> dict[str, Any]:
        high, deep = ({**sphere(scale), "center": [x * scale, y * scale, z * scale]}
                      for x, y, z in ((-0.45, -0.3, 1.5), (0.45, 0.3, -1.5)))  # fmt: skip
        return {"sun": light("directional", scale), "floor": floor(scale), "high": high, "deep": deep}

    assert (built(parts(1.0)).luma(views(1.0)) == 0).any()
    assert_same(parts)


@pytest.mark.usefixtures("llvm")
def test_the_scalar_variant() -> None:
    """It scales as the other does."""
    assert_same(lambda scale: {"lamp": lamp(scale), "floor": floor(scale), "ball": sphere(scale)}, SCALAR)


@pytest.mark.usefixtures("llvm")
def test_what_moves_and_flickers() -> None:
    """An object's path is scaled with the scene; a light that runs a profile keeps to it; owners are found."""

    def seen(scale: float) -> list[np.ndarray]:
        quaternion = np.array([0.0, 0.0, 0.0, 1.0])
        path = SegmentTrajectory(
            Pose(np.array([-0.2, 0.0, 0.0]) * scale, quaternion),
            Pose(np.array([0.4, 0.1, 0.0]) * scale, quaternion),
            1.0,
        )
        box = np.array([[-1, -1, -1], [1, 1, 1]]) * scale
        motion = SceneMotion({"box": path}, {"lamp": Flicker(3.0, modulation=0.5)}, {"box": box})
        thing = {"type": "cube", "to_world": placed(scale, 0.25, 0.2, 0.1, 0.4), "bsdf": WHITE}
        source = {"lamp": lamp(scale), "floor": floor(scale), "box": thing}
        renderer = built(source, motion=motion)
        view = views(scale, 0.6)
        return [renderer.luma(view), renderer.depth(view) / scale, renderer.flow(view), renderer._owners(view)]

    own = seen(1.0)
    assert set(np.unique(own[3])) == {0, 1}
    for scale in (SMALL, LARGE):
        for expected, found in zip(own, seen(scale), strict=True):
            assert np.mean(~np.isclose(found, expected, rtol=1e-4)) < 0.02


@pytest.mark.usefixtures("llvm")
def test_a_scene_of_usual_size_is_left_alone() -> None:
    """From 1 to 10,000 in diameter nothing is scaled."""
    for scale, factor in ((0.25, 1.0), (2000.0, 1.0), (0.2, 2.0**7), (3000.0, 0.5)):
        assert built({"lamp": lamp(scale), "floor": floor(scale)}).scale == factor


@pytest.mark.parametrize(
    ("parts", "reason"),
    [
        (
            {"integrator": {"type": "aov", "aovs": "z:depth", "inner": {"type": "path"}}},
            "the integrator, a AOVIntegrator",
        ),
        (
            {"fog": {"type": "sphere", "radius": 1e-4, "interior": {"type": "homogeneous"}, "bsdf": {"type": "null"}}},
            "the medium of shape 'fog'",
        ),
        (
            {
                "rough": {
                    "type": "sphere",
                    "radius": 1e-4,
                    "bsdf": {"type": "bumpmap", "bump": {"type": "bitmap", "raw": True, "data": BUMPS}, "bsdf": WHITE},
                }
            },
            "the BumpMap of shape 'rough'",
        ),
    ],
    ids=["integrator", "medium", "bump"],
)
@pytest.mark.usefixtures("llvm")
def test_what_cannot_be_scaled_is_said_once(parts: dict[str, Any], reason: str) -> None:
    """One warning that says why and what to do; the scene is rendered as it is, and none at a usual size."""
    with pytest.warns(UserWarning, match=f"It cannot be scaled, because of {reason}.*give it in other units") as said:
        renderer = built({"lamp": lamp(1e-4), "floor": floor(1e-4), **parts})
    assert len(said) == 1
    assert renderer.scale == 1.0
    assert np.isfinite(renderer.luma(views(1e-4))).all()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        built({"lamp": lamp(1.0), "floor": floor(1.0), **parts})
