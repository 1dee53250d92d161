"""A world without a camera is looked at from within a room, or from around; a camera at rest gets a small motion."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

import davis_rs
from davis_rs.cli import main
from davis_rs.geometry.pose import FloatArray
from davis_rs.scene.default_motion import with_default_motion
from davis_rs.scene.default_paths import CAMERA, around, sway, within
from davis_rs.scene.files.default_view import default_view
from davis_rs.scene.files.mesh_scene import usual_light
from davis_rs.scene.load import load_scene

SIDES = list(itertools.product(range(3), (-1, 1)))


def box(low: list[float], high: list[float], *, inward: bool, without: tuple[tuple[int, int], ...] = ()) -> FloatArray:
    """Make the triangles (n, 3, 3) of a box whose fronts are on its inside or outside, without some sides."""
    centre, half = (np.array(low) + high) / 2, (np.array(high) - low) / 2
    triangles = []
    for axis, sign in SIDES:
        if (axis, sign) in without:
            continue
        u, v = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
        normal = sign * np.eye(3)[axis]
        square = [normal + a * u + b * v for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        if (sign > 0) == inward:
            square.reverse()
        triangles += [[square[0], square[1], square[2]], [square[0], square[2], square[3]]]
    return np.array(triangles) * half + centre


ROOM = np.concatenate([box([0, 0, 0], [5, 4, 2.6], inward=True), box([0.2, 0.2, 0.0], [1.2, 1.0, 0.8], inward=False)])
"""A room of 5 x 4 m with a table in a corner."""


@pytest.mark.parametrize("without", [(), ((2, 1),), ((0, 1),)], ids=["closed", "no ceiling", "no wall"])
def test_a_room_is_seen_from_within(without: tuple[tuple[int, int], ...]) -> None:
    room = np.concatenate([box([0, 0, 0], [5, 4, 2.6], inward=True, without=without), ROOM[12:]])
    view = default_view(room)
    assert view.room_centre is not None
    positions = view.trajectory.positions(np.linspace(0, view.trajectory.duration_s, 50))
    assert (positions > [0.3, 0.3, 1.4]).all()
    assert (positions < [4.7, 3.7, 1.8]).all()
    assert view.room_radius > 0.8
    assert np.allclose(np.linalg.norm(positions - view.room_centre, axis=1), 0.5)
    # Around its free middle, out of reach of the table.
    assert np.linalg.norm(positions[:, :2] - [0.7, 0.6], axis=1).min() > 0.7


@pytest.mark.parametrize(("width", "height"), [(5.0, 2.6), (14.0, 2.6), (5.0, 9.0)], ids=["usual", "hall", "tower"])
def test_the_lamp_of_a_room_hangs_in_it(width: float, height: float) -> None:
    """Half-way to the ceiling or to the nearest wall: a wide and low room is not lit from above its ceiling."""
    view = default_view(box([0, 0, 0], [width, width, height], inward=True))
    assert view.room_centre is not None
    cell = width / 20
    assert view.room_above == pytest.approx(height - view.room_centre[2], abs=cell)
    lamp = usual_light(view)["lamp"]["position"]
    np.testing.assert_allclose(lamp[:2], view.room_centre[:2])
    expected = min(view.room_radius, view.room_above) / 2
    assert lamp[2] - view.room_centre[2] == pytest.approx(expected)
    assert view.room_centre[2] < lamp[2] < height


def test_it_looks_to_where_there_is_most_to_see() -> None:
    """In a long room along its length."""
    view = default_view(box([0, 0, 0], [9, 3, 2.6], inward=True))
    forward = view.trajectory.pose(0.0).rotation[:, 2]
    assert abs(forward[0]) > 0.98
    assert forward[0] * (4.5 - view.trajectory.pose(0.0).position[0]) > 0
    assert forward[2] == pytest.approx(-np.sin(np.radians(10)))


def test_walls_may_have_two_sides() -> None:
    walls = np.concatenate([box([0, 0, 0], [5, 4, 2.6], inward=inward) for inward in (True, False)])
    assert default_view(walls).room_centre is not None


def test_the_largest_of_two_rooms_is_taken() -> None:
    """A closet next to a hall; in a narrow one the circle takes half of what is free."""
    closet = box([0, 0, 0], [1.2, 1.2, 2.6], inward=True)
    for hall in (box([1.3, 0, 0], [6, 4, 2.6], inward=True), box([-6, 0, 0], [-0.1, 0.9, 2.6], inward=True)):
        view = default_view(np.concatenate([closet, hall]))
        assert view.room_centre is not None
        assert (view.room_centre > hall.reshape(-1, 3).min(0)).all()
        assert (view.room_centre < hall.reshape(-1, 3).max(0)).all()
        radius = np.linalg.norm(view.trajectory.pose(0.0).position - view.room_centre)
        assert radius == pytest.approx(min(0.5, view.room_radius / 2))


@pytest.mark.parametrize(
    "world",
    [
        box([0, 0, 0], [5, 4, 2.6], inward=False),
        box([0, 0, 0], [5, 4, 2.6], inward=True) * 0.1,
        box([0, 0, 0], [50, 40, 0.2], inward=False),
        box([0, 0, 0], [5, 4, 2.6], inward=True, without=((0, 1), (0, -1), (1, 1), (1, -1), (2, 1))),
    ],
    ids=["a block", "a box for shoes", "a slab", "a floor"],
)
def test_what_is_no_room_is_seen_from_around(world: FloatArray) -> None:
    view = default_view(world)
    assert view.room_centre is None
    assert view.note == "one that goes around"
    times = np.linspace(0, 10, 7)
    assert np.allclose(view.trajectory.positions(times), around(world.reshape(-1, 3)).positions(times))


@pytest.mark.parametrize("size", [(2.0, 2.0, 2.0), (9.0, 1.0, 0.1), (1.0, 1.0, 7.0), (3.0, 3.0, 0.0)])
@pytest.mark.parametrize("many", [False, True])
def test_what_is_looked_at_from_around_fills_the_image(size: tuple[float, float, float], many: bool) -> None:
    """At every angle it lies within the image, and at one it reaches 90 % of its width or height."""
    world = box([4, 5, 6], [4 + size[0], 5 + size[1], 6 + size[2]], inward=False)
    corners = np.repeat(world, 1000, 0) if many else world
    path, camera = default_view(corners).trajectory, CAMERA
    reached = np.zeros(2)
    for t in np.linspace(0, 10, 36, endpoint=False):
        pose = path.pose(t)
        seen = (world.reshape(-1, 3) - pose.position) @ pose.rotation
        assert (seen[:, 2] > 0).all()
        off = np.abs(seen[:, :2] / seen[:, 2:]) * [camera.fx, camera.fy] / [camera.width / 2, camera.height / 2]
        reached = np.maximum(reached, off.max(0))
    assert reached.max() == pytest.approx(0.9, abs=1e-9) or np.linalg.norm(size) > 8
    assert 0.45 < reached.max() < 0.9 + 1e-9


def test_what_lies_far_off_does_not_decide() -> None:
    """A stray triangle, a kilometre away, moves the camera by less than a ten-thousandth of that."""
    block = box([0, 0, 0], [2, 2, 2], inward=False)
    far = np.array([[[1000.0, 0, 0], [1000, 0.01, 0], [1000, 0, 0.01]]])
    view = default_view(np.concatenate([np.repeat(block, 100, 0), far]))
    expected = around(block.reshape(-1, 3)).pose(0.0).position
    assert np.linalg.norm(view.trajectory.pose(0.0).position - expected) < 0.1
    assert "which lie far off" in view.note


def test_an_unusual_size_is_asked_about() -> None:
    view = default_view(ROOM * 1000)
    assert "is the file in millimetres? then give it 0.001 m to a unit, --scale" in view.unit_question(
        np.array([5000.0, 4000.0, 2600.0])
    )
    assert "centimetres? then give it 0.01" in view.unit_question(np.array([500.0, 400.0, 260.0]))
    assert view.unit_question(np.array([5.0, 4.0, 2.6])) == ""
    outside = default_view(box([0, 0, 0], [5, 4, 2.6], inward=False))
    assert outside.unit_question(np.array([500.0, 400.0, 260.0])) == ""


def test_the_paths_move_as_their_derivatives_say() -> None:
    for path in (
        around(np.array([[1.0, 2, 3], [2.0, 4, 3.5]])),
        within(np.array([1.0, 2, 3]), 0.6, 0.7),
        sway(load_scene("three_planes").path.pose(0.0), 2.0),
    ):
        t = np.linspace(0.1, path.duration_s - 0.1, 9)
        step = 1e-5
        moved = (path.positions(t + step) - path.positions(t - step)) / (2 * step)
        assert np.allclose(moved, path.velocities(t), atol=1e-6)
        turned = path.pose(1.0 + step).rotation @ path.pose(1.0 - step).rotation.T
        angle = np.array([turned[2, 1], turned[0, 2], turned[1, 0]]) / (2 * step)
        rate = path.pose(1.0).rotation @ path.angular_rates(np.array([1.0]))[0]
        assert np.allclose(angle, rate, atol=1e-6)


SCENE = """<scene version="3.0.0"><integrator type="direct"/>
<sensor type="perspective"><float name="fov" value="50"/>
<transform name="to_world"><lookat origin="0,0,4" target="0,0,0" up="0,1,0"/></transform>
<film type="hdrfilm"><integer name="width" value="40"/><integer name="height" value="30"/></film></sensor>
<emitter type="constant"/>
<shape type="rectangle"><bsdf type="diffuse"><texture type="checkerboard" name="reflectance">
<transform name="to_uv"><scale value="4"/></transform></texture></bsdf></shape></scene>"""


def test_a_camera_at_rest_gets_a_small_motion(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It ends where it began, and makes events; the command says so in one line."""
    path = tmp_path / "board.xml"
    path.write_text(SCENE)
    scene = load_scene(path)
    assert scene.start is not None
    assert scene.trajectory is None
    moving = with_default_motion(scene)
    assert with_default_motion(moving) is moving
    start, end = moving.path.pose(0.0), moving.path.pose(2.0)
    assert np.allclose(start.position, scene.start.position)
    assert np.allclose(end.position, start.position)
    half_way = moving.path.pose(1.0).position - scene.start.position
    assert np.linalg.norm(half_way) == pytest.approx(2 * 0.05 * 4.0)
    assert abs(half_way @ scene.start.rotation[:, 2]) < 1e-12
    assert sum(len(packet.events) for packet in davis_rs.simulate(moving, duration_s=0.05)) > 20
    assert main(["simulate", str(path), "-o", str(tmp_path / "out"), "--duration", "0.02"]) == 0
    assert "has a camera, but no path: it goes once around a small circle" in capsys.readouterr().err


@pytest.mark.long
def test_little_things_near_the_camera_do_not_make_the_motion_small(tmp_path: Path) -> None:
    near = (
        '<shape type="rectangle"><transform name="to_world"><scale value="0.05"/><translate z="2"/></transform></shape>'
    )
    path = tmp_path / "board.xml"
    path.write_text(SCENE.replace("</scene>", f"{near}</scene>"))
    scene = load_scene(path)
    assert scene.start is not None
    half_way = with_default_motion(scene).path.pose(1.0).position - scene.start.position
    assert np.linalg.norm(half_way) == pytest.approx(2 * 0.05 * 4.0)


def test_a_camera_that_sees_nothing_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "board.xml"
    path.write_text(SCENE.replace('target="0,0,0"', 'target="0,0,9"'))
    with pytest.raises(ValueError, match="the camera of scene 'board' sees nothing, and has no trajectory"):
        with_default_motion(load_scene(path))
