"""Log luma's derivatives in light that is baked, under the sky and on smooth normals, and jumps of bodies that move."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation
from test_event_derivatives import check
from test_event_gradients import EXACT, PATH, SKY, events_of, moved, placed, scene_of

from davis_rs import Pose, Scene, SegmentTrajectory
from davis_rs.differentiable import event_time_derivatives, event_time_residuals
from davis_rs.differentiable import moved as moved_scene
from davis_rs.differentiable.log_luma import LogLumaField
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
from davis_rs.render.native.renderer import NativeRenderer
from lit_scenes import CAMERA, build, colourful, environment, make_scene, plate

FloatArray = npt.NDArray[np.float64]

START = Pose([0.05, -0.1, 1.4], Rotation.from_euler("xyz", [np.pi - 0.35, 0.25, 0.1]).as_quat())
END = Pose([0.07, -0.08, 1.37], Rotation.from_euler("xyz", [np.pi - 0.33, 0.27, 0.14]).as_quat())
ABOUT = SegmentTrajectory(START, END, 0.05)
STEP = 1e-7


def compare(renderer: NativeRenderer, *, kinks: int) -> None:
    """Log luma's derivatives by pose and time against differences of the renderer's own log luma, in float64."""
    count = renderer.camera.width * renderer.camera.height
    field, pixel = LogLumaField(renderer, ABOUT, 1e-3), np.arange(count)

    def value(views: Views) -> FloatArray:
        found = renderer.gradients(
            views, np.zeros(count, np.uint32), field.pixels.neighbours(pixel).astype(np.uint32), field.pixels.weights
        )
        return np.asarray(np.log(found[:, 0] + 1e-3))

    views = Views.along(ABOUT, [0.0213])
    found = field.at(np.full(count, 0.0213e6), pixel)
    np.testing.assert_allclose(np.log(renderer.luma(views).ravel() + 1e-3), found.value, atol=2e-2)
    shifts = [[moved(views, sign * STEP * row) for sign in (1, -1)] for row in np.eye(6)]
    shifts.append([Views.along(ABOUT, [0.0213 + sign * STEP]) for sign in (1, -1)])
    for (ahead, behind), own in zip(shifts, [*found.pose.T, found.rate], strict=True):
        off = np.abs((value(ahead) - value(behind)) / (2 * STEP) - own)
        assert np.abs(own).max() > 0.05
        assert np.count_nonzero(off > 1e-4 * np.abs(own).max()) <= kinks


@pytest.mark.few(1)
@pytest.mark.usefixtures("llvm")
@pytest.mark.parametrize("sky", ["constant", "map"])
def test_baked_light(light_cache: Path, sky: str) -> None:
    """Lamps, bounces and what rays see beyond all surfaces."""
    parts = colourful()
    if sky == "map":
        parts["sky"] = environment(np.random.RandomState(0).uniform(0.2, 1.0, (8, 16, 3)))
        parts["floor"] = plate(0.2, 0, 0, (0.5, 0.4))
    renderer = build(make_scene(**parts), 0.1)
    assert isinstance(renderer, NativeRenderer)
    assert renderer.baked is not None
    compare(renderer, kinks=2)


def test_smooth_normals(tmp_path: Path) -> None:
    """A coarse mesh with normals of its own at each corner, from both sides."""
    side = np.linspace(-1.5, 1.5, 5)
    x, y = (part.ravel() for part in np.meshgrid(side, side))
    z = 0.2 * np.sin(2 * x) * np.cos(1.5 * y)
    normals = np.stack([-0.4 * np.cos(2 * x) * np.cos(1.5 * y), 0.3 * np.sin(2 * x) * np.sin(1.5 * y), np.ones(25)], 1)
    lines = [f"v {a} {b} {c}" for a, b, c in zip(x, y, z, strict=True)]
    lines += ["vn {} {} {}".format(*row) for row in normals]
    for row in range(4):
        for column in range(4):
            a = 5 * row + column + 1
            lines += [f"f {a}//{a} {a + 1}//{a + 1} {a + 6}//{a + 6}", f"f {a}//{a} {a + 6}//{a + 6} {a + 5}//{a + 5}"]
    (tmp_path / "hills.obj").write_text("\n".join(lines))
    hills = {
        "type": "obj",
        "filename": str(tmp_path / "hills.obj"),
        "bsdf": {"type": "twosided", "inner": {"type": "diffuse", "reflectance": 0.6}},
    }
    lamp = {"type": "point", "position": [0.4, -0.5, 1.5], "intensity": 5.0}
    sun = {"type": "directional", "direction": [0.4, 0.3, -1.0], "irradiance": 3.0}
    scene = make_scene({"type": "direct"}, hills=hills, lamp=lamp, sun=sun)
    renderer = make_renderer(replace(scene, shadows=False), CAMERA, rays_per_pixel=4, kind="native")
    assert isinstance(renderer, NativeRenderer)
    assert renderer.table.normal_maps is not None
    compare(renderer, kinks=2)


def test_jumps_of_a_body_that_moves() -> None:
    """A bright tile flies past a dark floor while the camera flies too: its edges make events, of which the camera's
    pose decides when; and the clock moves them as a whole."""
    white = {"type": "twosided", "inner": {"type": "diffuse", "reflectance": 0.8}}
    black = {"type": "twosided", "inner": {"type": "diffuse", "reflectance": 0.1}}
    tile = placed("rectangle", [0.1, -0.3, 0.3], [0.3, 0.25, 1], white)
    turn = Rotation.from_euler("z", 0.2).as_quat()
    path = SegmentTrajectory(Pose([0, 0, 0], [0, 0, 0, 1]), Pose([0.12, 0.05, 0.04], turn), 0.05)
    parts: dict[str, dict[str, Any]] = {
        "sky": SKY,
        "floor": placed("rectangle", [0, 0, 0], [9, 9, 1], black),
        "tile": tile,
    }
    scene: Scene = replace(scene_of(parts, objects={"tile": path}), trajectory=PATH)
    events = events_of(scene, **EXACT)
    derivatives = event_time_derivatives(scene, events, **EXACT)
    assert derivatives.jump.sum() > 300
    assert not derivatives.jacobian(("contrast_threshold",))[derivatives.jump].any()
    np.testing.assert_allclose(derivatives.jacobian(("clock_offset",))[derivatives.jump], 1e6)
    direction, step = np.array([1.0, -0.7, 0.5, 0.4, -0.3, 0.8]), 1e-5
    times = []
    for sign in (1, -1):
        t_us = np.full(len(events), np.nan)
        for block in event_time_residuals(moved_scene(scene, sign * step * direction), events, within_us=50.0, **EXACT):
            t_us[block.index] = block.residual_us
        times.append(t_us)
    check(derivatives.jacobian(("pose",)) @ direction, times, step, derivatives.jump)
