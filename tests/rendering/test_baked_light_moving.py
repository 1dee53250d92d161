"""Baked light of bodies that move: against the path tracer at and between its instants, its rates and its cache."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from davis_rs import Pose, Scene, SegmentTrajectory
from davis_rs.accuracy.light_accuracy import LightComparison, light_cost
from davis_rs.geometry.trajectory.trajectory import CallableTrajectory
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.baked import baked_scene
from davis_rs.render.baked.baked_scene import BakedLight
from davis_rs.render.baked.instants import MOST_INSTANTS, chosen, hats, motion_times
from davis_rs.render.baked.irradiance import Irradiance
from davis_rs.render.base import Renderer
from davis_rs.render.motion.scene_motion import SceneMotion, held
from davis_rs.render.native.renderer import NativeRenderer
from davis_rs.sampling.breaks import find_breaks
from lit_scenes import CAMERA, DOWN, PATH, FloatArray, Parts, build, diffuse, lamp, make_scene, plate, shift

DURATION_S = 0.4
UPRIGHT = [0.0, 0.0, 0.0, 1.0]


@pytest.fixture
def folder(light_cache: Path) -> Path:
    """Of tests of the cache itself; the others share the session's, so that a scene is baked once."""
    return light_cache


def block(half: float, height: float) -> Parts:
    to_world = np.diag([half, half, half, 1.0]) + shift(0, 0, height)
    return {"type": "cube", "to_world": to_world, "bsdf": diffuse([0.7, 0.5, 0.3])}


def crossing(
    way: float = 0.3, *, turn: float = 0.6, duration_s: float = DURATION_S, max_depth: int = 2, **parts: Parts
) -> Scene:
    """A block that turns, and crosses the floor under a lamp, next to a red wall; the camera looks down.

    Args:
        max_depth: 2 for direct light alone, which is baked in a second.
    """
    wall = {"type": "rectangle", "bsdf": diffuse([0.8, 0.2, 0.1])}
    wall["to_world"] = np.array([[0, 0, 1, -1.0], [1, 0, 0, 0], [0, 1, 0, 1], [0, 0, 0, 1]])
    first = Pose([-way / 2, 0.1, 0.0], UPRIGHT)
    last = Pose([way / 2, 0.1 + way / 3, way / 3], Rotation.from_rotvec([0.0, 0.0, turn]).as_quat())
    own = {"floor": plate(0, 0, 0, (1, 1)), "wall": wall, "block": block(0.15, 0.35), "panel": lamp(1.6)}
    return replace(
        make_scene(PATH | {"max_depth": max_depth}, **{**own, **parts}),
        camera=CAMERA,
        trajectory=SegmentTrajectory(DOWN, DOWN, duration_s),
        objects={"block": SegmentTrajectory(first, last, DURATION_S)},
    )


def light_of(renderer: Renderer) -> BakedLight:
    assert isinstance(renderer, NativeRenderer)
    assert renderer.baked is not None
    return renderer.baked


def at(scene: Scene, t_s: FloatArray) -> Views:
    return Views.along(scene.path, t_s)


def off_path_tracer(scene: Scene, renderer: Renderer, t_s: FloatArray) -> tuple[FloatArray, float]:
    """How far baked luma (n, H, W) is from the mean of path tracers, relative, and the median of that mean's own
    standard error."""
    views = at(scene, t_s)
    runs = [build(scene, kind="integrator", rays_per_pixel=512, seed=seed).luma(views) for seed in range(4)]
    mean = np.mean(runs, axis=0, dtype=np.float64)
    noise = np.std(runs, axis=0, ddof=1) / 2 / mean
    return renderer.luma(views) / mean - 1, float(np.median(noise))


@pytest.mark.long
@pytest.mark.usefixtures("llvm")
def test_a_body_that_moves_is_lit_as_by_the_path_tracer(long: bool) -> None:
    """At the bake's instants only edges and noise differ; between them as much as is told, where light changes."""
    scene = crossing(max_depth=4 if long else 3)
    renderer = build(scene, 0.05, rays_per_pixel=64)
    light = light_of(renderer)
    instants = light.maps.instants
    assert 3 <= len(instants) <= 6
    off, noise = off_path_tracer(scene, renderer, instants)
    assert noise < 0.01
    assert np.abs(np.median(off, axis=(1, 2))).max() < 0.004
    assert np.quantile(np.abs(off), 0.68) < 0.01
    assert np.quantile(np.abs(off), 0.95) < 0.03

    middles = (instants[1:] + instants[:-1]) / 2
    between, _ = off_path_tracer(scene, renderer, middles)
    assert np.abs(np.median(between)) < 0.005
    luma = renderer.luma(at(scene, instants))
    changes = np.abs(np.diff(np.log(luma), axis=0)) > 0.05
    # The edges of the block are not the light's.
    changes &= np.abs(between) < 0.3
    found = np.sqrt((between[changes] ** 2).mean())
    assert changes.sum() > 30
    assert 0.25 * light.maps.motion_error < found < 1.5 * light.maps.motion_error
    assert f"between its {len(instants)} instants where bodies change it" in renderer.reason


def test_bumps_of_a_body_that_moves_lean_with_it() -> None:
    """Where it stands turned at the end of its way, it looks as one that was built so."""
    heights = np.random.default_rng(3).uniform(0, 0.02, (6, 6, 1)).astype(np.float32)
    bumps = {"type": "bumpmap", "heights": {"type": "bitmap", "raw": True, "data": heights}, "bsdf": diffuse([0.7] * 3)}
    moving = crossing(block={**block(0.15, 0.35), "bsdf": bumps})
    last = moving.objects["block"].pose(DURATION_S)
    turned = Rotation.from_quat(last.quaternion).as_matrix()
    to_world = np.eye(4)
    to_world[:3, :3], to_world[:3, 3] = turned, last.position
    built = {**block(0.15, 0.35), "bsdf": bumps}
    still = replace(
        crossing(block={**built, "to_world": to_world @ built["to_world"]}), objects={}, trajectory=moving.trajectory
    )
    flat = replace(crossing(), objects=moving.objects)
    views = at(moving, np.array([DURATION_S]))
    ours, theirs, plain = (build(scene).luma(views)[0] for scene in (moving, still, flat))
    assert np.abs(ours - theirs).mean() < 0.2 * np.abs(plain - theirs).mean()


def test_rates_between_instants_are_the_changes_of_luma() -> None:
    """And light bends at the instants, so that luma is not interpolated across them."""
    scene = crossing()
    renderer = build(scene, 0.1, rays_per_pixel=1)
    instants = light_of(renderer).maps.instants
    assert len(instants) > 2
    middle = (instants[0] + instants[1]) / 2
    step = 2e-3
    luma = renderer.luma(at(scene, np.array([middle - step, middle + step])))
    _, rate = renderer.luma_and_rate(at(scene, np.array([middle])))
    off = np.abs(rate[0] - (luma[1] - luma[0]) / (2 * step))
    assert np.quantile(off, 0.8) < 0.02 * np.quantile(np.abs(rate), 0.95)
    found = {item.before_us for item in find_breaks(scene.path, renderer.motion, 0, 400_000)}
    assert {int(np.ceil(t_s * 1e6 - 1e-3)) - 1 for t_s in instants[1:-1]} <= found


def test_a_body_that_stands_still_is_baked_once(folder: Path) -> None:
    """An object whose path goes nowhere has the light of the same scene without objects."""
    scene = crossing(0.0, turn=0.0)
    renderer = build(scene, 0.2)
    assert len(light_of(renderer).maps.instants) == 1
    placed = crossing(0.0, block=block(0.15, 0.35) | {"to_world": block(0.15, 0.35)["to_world"] + shift(0, 0.1, 0)})
    still = build(replace(placed, objects={}), 0.2)
    views = at(scene, np.array([0.0, 0.3]))
    assert renderer.luma(views) == pytest.approx(still.luma(views), rel=0.02)


@pytest.mark.long
def test_the_same_bits_with_and_without_cache(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], long: bool
) -> None:
    """A cached bake is used, also after one that was stopped. Another motion is baked anew."""
    max_depth = 4 if long else 2
    scene = crossing(max_depth=max_depth)
    views = at(scene, np.array([0.0, 0.11, 0.4]))
    first = build(scene, 0.2).luma(views)
    monkeypatch.setattr(baked_scene, "_known", {})
    capsys.readouterr()
    assert np.array_equal(build(scene, 0.2, threads=1).luma(views), first)
    assert "baked before" in capsys.readouterr().err
    (file,) = folder.iterdir()
    file.unlink()
    made, count = Irradiance._computed, [0]

    def stopped(self: Irradiance, *arguments: Any) -> FloatArray:
        count[0] += 1
        if count[0] == 60:
            raise KeyboardInterrupt
        return made(self, *arguments)

    monkeypatch.setattr(baked_scene, "_known", {})
    with monkeypatch.context() as patch:
        patch.setattr(Irradiance, "_computed", stopped)
        with pytest.raises(KeyboardInterrupt):
            build(scene, 0.2)
    assert [file.suffix for file in folder.iterdir()] == [".partial"]
    assert np.array_equal(build(scene, 0.2).luma(views), first)
    build(crossing(0.2, max_depth=max_depth), 0.2)
    assert [file.suffix for file in folder.iterdir()] == [".light", ".light"]


@pytest.mark.long
def test_times_that_are_not_baked_are_refused() -> None:
    """A camera path that ends while the block still moves: what is beyond it has no light; with a longer one it has."""
    short, long = crossing(duration_s=0.1), crossing(duration_s=0.8)
    later = Views.at_rest([DOWN]).moved(np.array([0.2]))
    with pytest.raises(ValueError, match=r"time of its camera path, 0 to 0\.1 s, .* asked for at 0\.2 s"):
        build(short, 0.2).luma(later)
    renderer = build(long, 0.2, rays_per_pixel=1)
    assert np.array_equal(renderer.luma(at(long, np.array([0.5]))), renderer.luma(at(long, np.array([0.8]))))


@pytest.mark.long
def test_a_lamp_that_moves_takes_its_light_with_it() -> None:
    """It looks alike at all times, and the floor is brightest below it."""
    path = SegmentTrajectory(Pose([-0.4, 0.0, 0.0], UPRIGHT), Pose([0.4, 0.0, 0.0], UPRIGHT), DURATION_S)
    scene = crossing(panel=lamp(1.2, 3.0, (0.1, 0.1)) | {"bsdf": diffuse(0.0)})
    scene = replace(scene, objects={"panel": path})
    renderer = build(scene, 0.2)
    luma = renderer.luma(at(scene, np.array([0.0, 0.4])))
    assert luma[0, 3].argmax() < 7 < luma[1, 3].argmax()
    up = Pose([0.1, 0.2, 0.8], UPRIGHT)  # looks up
    seen = renderer.luma(Views.along(SegmentTrajectory(up, up, DURATION_S), np.array([0.1, 0.2, 0.23])))
    assert seen.max((1, 2)) == pytest.approx([3.0, 3.0, 3.0], rel=1e-5)


@pytest.mark.long
@pytest.mark.usefixtures("llvm")
def test_what_baking_saves_and_errs_with_bodies_that_move(folder: Path) -> None:
    scene = crossing(max_depth=4)
    line = light_cost(build(scene, 0.2), scene)
    assert line is not None
    assert "instants where bodies change it, baked in" in line
    settings: Any = {"runs": 2, "reference_samples": 64, "duration_s": 0.1, "bake_error": 0.2, "rays": 32}
    halves, baked = LightComparison(scene, CAMERA, folder=folder / "runs", **settings).measure(())
    assert baked.log_rms < 2 * halves.log_rms


def test_instants_are_where_light_bends() -> None:
    """Straight light needs none between its ends, light with a corner one there, and noise alone none."""
    t = np.linspace(0.0, 1.0, 17)
    noise = np.random.RandomState(0).normal(0.0, 0.02, (17, 2, 200))
    straight, bent = 1 + t, 1 + np.abs(t - 0.25)
    for light, expected in ((straight, [0, 16]), (bent, [0, 4, 16])):
        taken, error = chosen(lambda k, light=light: light[k] + noise[k], 17, 0.03)  # type: ignore[misc]
        assert taken == expected
        assert error < 0.03
    jagged = 1 + 0.5 * (np.arange(65) % 2)
    taken, error = chosen(lambda k: np.full((2, 5), jagged[k]), 65, 0.03)
    assert len(taken) == MOST_INSTANTS
    assert error > 0.1


def test_light_is_looked_at_where_bodies_go() -> None:
    """Evenly over the way, from when it begins to when it ends, however long a body rests."""
    size = np.array([[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0]])
    stamps, away = [0.0, 5.0, 5.01, 5.11, 8.0, 9.0, 20.0], [0.0, 0.0, 0.01, 3.0, 3.0, 4.0, 4.0]

    def unmoved(t_s: FloatArray) -> FloatArray:
        return np.zeros((len(t_s), 3))

    path = CallableTrajectory(
        20.0,
        position=lambda t_s: np.interp(t_s, stamps, away)[:, None] * [1.0, 0.0, 0.0],
        quaternion=lambda t_s: np.tile(UPRIGHT, (len(t_s), 1)),
        velocity=unmoved,
        angular_rate=unmoved,
        description={},
    )
    motion = SceneMotion({"body": path}, {}, {"body": size})
    times = motion_times(motion, 30.0)
    assert times.fine
    assert (np.diff(times.tests) > 0).all()
    assert times.tests[[0, -1]] == pytest.approx([5.0, 9.0], abs=0.03)
    steps = np.diff(held(path, times.tests).positions[:, 0])
    assert steps.max() < 0.2
    assert len(times.tests) in (33, 34)  # an eighth of a metre each, but for rounding
    assert not motion_times(motion, 8.5).rests_after
    assert len(motion_times(motion, 4.0).tests) == 1


def test_light_of_instants_adds_up() -> None:
    instants = np.array([0.0, 0.1, 0.4])
    t_s = np.array([-1.0, 0.0, 0.05, 0.1, 0.325, 0.4, 2.0])
    weights, rates = hats(instants, t_s)
    assert weights.sum(1) == pytest.approx(np.ones(7))
    assert weights[[2, 4]] == pytest.approx(np.array([[0.5, 0.5, 0.0], [0.0, 0.25, 0.75]]))
    steep, flat = [-10.0, 10.0, 0.0], [0.0, -1 / 0.3, 1 / 0.3]
    assert rates == pytest.approx(np.array([[0.0] * 3, steep, steep, flat, flat, [0.0] * 3, [0.0] * 3]))
