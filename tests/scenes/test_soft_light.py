"""The sky of worlds whose files name no light of their own: what hides it, where it is not baked, and what is said."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from davis_rs import Pose, Scene, SegmentTrajectory, Trajectory, load_scene
from davis_rs.geometry.camera import Camera
from davis_rs.geometry.trajectory.steered import SteeredPath
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.baked import bake, baked_scene
from davis_rs.render.choice import make_renderer
from gltf_files import CORNERS, FACES, Gltf

pytestmark = pytest.mark.without_llvm

SKY, ALBEDO, HEIGHT = 0.3, 0.5, 1.0
HERE = Pose([0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])
FROM_ABOVE = Pose([0.55, 0.0, 0.5], [1.0, 0.0, 0.0, 0.0])
CAMERA = Camera(width=40, height=4, fx=40.0, fy=40.0, cx=19.5, cy=1.5)


def floor_and_wall(folder: Path) -> Scene:
    """A grey floor (z = 0) and a black wall (x = 0), 10 m wide, under a sky alone: no light bounces."""
    rows = np.linspace(0.0, 2.0, 41)
    strips = [f"v {x} {y} 0" for x in rows for y in (-5, 5)]
    strips += [f"v 0 {y} {z}" for z in (0, HEIGHT) for y in (-5, 5)]
    first = 2 * len(rows) + 1
    faces = [f"f {2 * i + 1} {2 * i + 2} {2 * i + 4} {2 * i + 3}" for i in range(len(rows) - 1)]
    (folder / "corner.mtl").write_text(f"newmtl grey\nKd {ALBEDO} {ALBEDO} {ALBEDO}\nnewmtl black\nKd 0 0 0\n")
    path = folder / "corner.obj"
    wall = f"f {first} {first + 1} {first + 3} {first + 2}"
    path.write_text("\n".join(["mtllib corner.mtl", *strips, "usemtl grey", *faces, "usemtl black", wall, ""]))
    return without(load_scene(path, up="z"), "sun")


def without(scene: Scene, light: str) -> Scene:
    """The scene with one light less than the usual ones."""

    def source() -> dict[str, Any]:
        parts = scene.source()
        assert isinstance(parts, dict)
        del parts[light]
        return parts

    return replace(scene, source=source)


def floor_luma(scene: Scene, kind: str = "auto", error: float = 0.01) -> tuple[npt.NDArray[np.float64], str]:
    """Luma of the floor along x, from 0.06 m to 1.04 m, and why this renderer is taken."""
    renderer = make_renderer(
        scene, CAMERA, kind=kind, bake_error=error, rays_per_pixel=1, lattice_rays_per_pixel=1, blur=False
    )
    return np.asarray(renderer.luma(Views.at_rest([FROM_ABOVE]))[0, 1], np.float64), renderer.reason


def hidden_sky() -> npt.NDArray[np.float64]:
    """What the wall takes from the floor's luma: view factor of a wall without end, at its foot's distance."""
    x = 0.55 + 0.5 * (np.arange(CAMERA.width) - CAMERA.cx) / CAMERA.fx
    return ALBEDO * SKY * (1 - x / np.hypot(x, HEIGHT)) / 2


@pytest.mark.long
@pytest.mark.parametrize(("most_corners", "error"), [(None, 0.05), (90, 0.15)], ids=["every corner", "corners share"])
def test_a_wall_hides_as_much_of_the_sky_as_its_view_factor_says(
    most_corners: int | None, error: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    effort = replace(bake.QUICK_EFFORT, most_corners=most_corners)
    monkeypatch.setattr(baked_scene, "QUICK_EFFORT", effort)
    scene = floor_and_wall(tmp_path)
    (soft, reason), (flat, _) = floor_luma(scene), floor_luma(scene, "native")
    assert "quick bake" in reason
    np.testing.assert_allclose(flat, ALBEDO * SKY, rtol=1e-6)
    np.testing.assert_allclose(soft, flat - hidden_sky(), rtol=error)


def test_a_bake_that_runs_out_of_points_says_so_plainly(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(baked_scene, "QUICK_EFFORT", replace(bake.QUICK_EFFORT, most_points=100))
    _, reason = floor_luma(floor_and_wall(tmp_path))
    told = "because the light of lamps, of the sky and of bounces has at most 100 points each"
    assert f"; it is coarser than asked for, {told} besides the corners of triangles; it is a quick bake" in reason


@pytest.mark.long
def test_a_bake_that_was_asked_for_is_not_a_quick_one(tmp_path: Path) -> None:
    scene = floor_and_wall(tmp_path)
    asked, reason = floor_luma(scene, "baked", 0.2)
    assert "quick bake" not in reason
    np.testing.assert_allclose(asked, ALBEDO * SKY - hidden_sky(), rtol=0.2)


def test_large_meshes_keep_the_even_sky_and_it_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(baked_scene, "MOST_QUICK_SIDES", 10)
    scene = floor_and_wall(tmp_path)
    luma, reason = floor_luma(scene)
    np.testing.assert_array_equal(luma, floor_luma(scene, "native")[0])
    assert "its soft light is not baked: it has 164 sides of triangles, and the limit of a quick bake is 10" in reason
    assert "--renderer baked" in reason


@pytest.mark.parametrize(
    ("object_path", "leaves"),
    [
        (SegmentTrajectory(HERE, HERE, 1.0), False),
        (SegmentTrajectory(HERE, Pose([0.0, 4.0, 0.0], HERE.quaternion), 1.0), False),
        (SegmentTrajectory(HERE, Pose([0.0, 40.0, 0.0], HERE.quaternion), 1.0), True),
        (SteeredPath(), True),
    ],
    ids=["rests", "moves a little", "leaves", "a caller decides"],
)
def test_light_is_that_of_the_start_without_what_leaves(object_path: Trajectory, leaves: bool, tmp_path: Path) -> None:
    """A wall hides the sky from the floor; once it is gone, no trace of it must be left."""
    still = floor_and_wall(tmp_path)
    scene = replace(still, objects={"mesh_black": object_path}, trajectory=SegmentTrajectory(HERE, HERE, 1.0))
    soft, reason = floor_luma(scene)
    assert "it is that of the start, and stays on surfaces that move" in reason
    np.testing.assert_allclose(soft, ALBEDO * SKY - (0 if leaves else hidden_sky()), rtol=0.05)


def test_triangles_that_run_the_wrong_way_round_have_the_light_of_the_side_that_is_seen(tmp_path: Path) -> None:
    """Their vertex normals point up. A black ground below keeps nearly all light from the other side."""
    shown = list[float]()
    for faces in (FACES, FACES[:, ::-1]):
        gltf = Gltf()
        grey = gltf.material("grey", baseColorFactor=[0.5, 0.5, 0.5, 1], more={"doubleSided": True})
        up = np.tile([0, 1, 0], (4, 1))
        gltf.node(mesh=gltf.mesh(CORNERS[:, [0, 2, 1]] * [1, 1, -1], faces, material=grey, normals=up))
        black = gltf.material("black", baseColorFactor=[0, 0, 0, 1], more={"doubleSided": True})
        gltf.node(mesh=gltf.mesh(CORNERS[:, [0, 2, 1]] * [9, 1, -9], FACES, material=black), translation=[0, -0.1, 0])
        scene = without(load_scene(gltf.save(tmp_path / "plate.glb")), "sun")
        renderer = make_renderer(scene, CAMERA, rays_per_pixel=1, lattice_rays_per_pixel=1, blur=False)
        assert "quick bake" in renderer.reason
        shown.append(float(renderer.luma(Views.at_rest([FROM_ABOVE]))[0, 1].mean()))
    assert shown[0] == pytest.approx(ALBEDO * SKY, rel=0.02)
    assert shown[1] == pytest.approx(shown[0], rel=0.02)


def test_a_closed_room_under_a_sky_keeps_its_light(tmp_path: Path) -> None:
    """The true light of such a room is none at all."""
    room = tmp_path / "room.obj"
    corners = [(x, y, z) for x in (-2, 2) for y in (-2, 2) for z in (0, 3)]
    faces = ["1 3 4 2", "5 6 8 7", "1 2 6 5", "3 7 8 4", "1 5 7 3", "2 4 8 6"]
    room.write_text("".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "".join(f"f {face}\n" for face in faces))
    world = without(load_scene(room, up="z"), "lamp")
    renderer = make_renderer(world, CAMERA, rays_per_pixel=1, lattice_rays_per_pixel=1, blur=False)
    assert "no light reaches its camera, which is in a closed room under a sky" in renderer.reason
    assert renderer.luma(Views.at_rest([world.path.pose(0.0)])).min() > 0.1
