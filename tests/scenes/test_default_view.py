"""A world without a camera is looked at from within a room, or from around; a camera at rest gets a small motion."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

import davis_rs
from davis_rs.cli import main
from davis_rs.geometry.pose import FloatArray
from davis_rs.scene.default_motion import with_default_motion
from davis_rs.scene.default_paths import CAMERA, Turn, circle_around, sway, within
from davis_rs.scene.files import sight, subject
from davis_rs.scene.files.default_view import DefaultView, _outermost, default_view
from davis_rs.scene.files.mesh_scene import usual_light
from davis_rs.scene.files.rooms import VoxelGrid
from davis_rs.scene.files.sight import Sight
from davis_rs.scene.files.subject import Surfaces, _connected
from davis_rs.scene.load import load_scene
from gltf_files import Gltf

POINTS = subject._POINTS


@pytest.fixture(autouse=True)
def all_points(monkeypatch: pytest.MonkeyPatch) -> None:
    """Here, as many decide as without tests."""
    monkeypatch.setattr(subject, "_POINTS", POINTS)


SIDES = list(itertools.product(range(3), (-1, 1)))
SIDES_BUT_TOP = tuple(side for side in SIDES if side != (2, 1))
SIDES_BUT_FRONT = tuple(side for side in SIDES if side != (1, -1))


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
    assert view.room is not None
    positions = view.trajectory.positions(np.linspace(0, view.trajectory.duration_s, 50))
    assert (positions > [0.3, 0.3, 1.4]).all()
    assert (positions < [4.7, 3.7, 1.8]).all()
    assert view.room.free_m > 0.6
    radius = min(0.5, view.room.free_m / 2)
    assert np.allclose(np.linalg.norm(positions - view.room.centre, axis=1), radius)
    # No place stands on the table.
    surfaces = Surfaces.of(room)
    assert all(1.4 < place.centre[2] < 1.8 for place in VoxelGrid.of(surfaces).places(surfaces))
    # The camera is out of its reach.
    assert np.linalg.norm(positions[:, :2] - [0.7, 0.6], axis=1).min() > 0.7


@pytest.mark.parametrize(("width", "height"), [(5.0, 2.6), (14.0, 2.6), (5.0, 9.0)], ids=["usual", "hall", "tower"])
def test_the_lamp_of_a_room_hangs_in_it(width: float, height: float) -> None:
    """Half-way to the ceiling or to the nearest wall: a wide and low room is not lit from above its ceiling."""
    view = default_view(box([0, 0, 0], [width, width, height], inward=True))
    assert view.room is not None
    cell = width / 20
    assert view.room.above_m == pytest.approx(height - view.room.centre[2], abs=cell)
    lamp = usual_light(view)["lamp"]["position"]
    np.testing.assert_allclose(lamp[:2], view.room.centre[:2])
    expected = min(view.room.free_m, view.room.above_m) / 2
    assert lamp[2] - view.room.centre[2] == pytest.approx(expected)
    assert view.room.centre[2] < lamp[2] < height


def test_it_looks_to_where_there_is_most_to_see() -> None:
    """In a long room along its length."""
    view = default_view(box([0, 0, 0], [9, 3, 2.6], inward=True))
    forward = view.trajectory.pose(0.0).rotation[:, 2]
    assert abs(forward[0]) > 0.98
    assert forward[0] * (4.5 - view.trajectory.pose(0.0).position[0]) > 0
    assert forward[2] == pytest.approx(-np.sin(np.radians(10)))


def test_walls_may_have_two_sides() -> None:
    walls = np.concatenate([box([0, 0, 0], [5, 4, 2.6], inward=inward) for inward in (True, False)])
    assert default_view(walls).room is not None


def test_a_jar_of_glass_is_no_room() -> None:
    """Of clear glass alone, or with something opaque in it; a room with windows of glass is one."""
    jar = np.concatenate([box([0, 0, 0], [2, 2, 3], inward=inward) for inward in (True, False)])
    content = box([0.5, 0.5, 0], [1.5, 1.5, 0.5], inward=False)
    both, clear = np.concatenate([jar, content]), np.arange(len(jar) + len(content)) < len(jar)
    assert default_view(jar).room is not None
    assert default_view(jar, clear=np.ones(len(jar), np.bool_)).note == "one that goes around"
    assert default_view(both, clear=clear).note == "one that goes around"
    room = np.concatenate([ROOM, box([0, 1, 1], [0.1, 2, 2], inward=False)])
    assert default_view(room, clear=np.arange(len(room)) >= len(ROOM)).room is not None


def hidden(detail: int, size: float = 1.0) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    """A small box of many triangles in the middle of a hollow one without a lid, whose fronts are outside, and the
    numbers of both shapes."""
    shell = box([-9, -9, 0], [9, 9, 20], inward=False, without=((2, 1),))
    thing = np.tile(box([-size, -size, 0], [size, size, size], inward=False), (detail, 1, 1))
    return np.concatenate([shell, thing]), np.repeat([0, 1], [len(shell), len(thing)])


def test_what_a_backdrop_hides_is_seen_from_within() -> None:
    """A camera around everything would see nothing but the outside of the walls."""
    view = default_view(*hidden(30))
    assert view.note == "one that goes around, within what hides it from farther off"
    positions = view.trajectory.positions(np.linspace(0, 10, 7))
    assert (np.abs(positions[:, :2]) < 9).all()
    assert np.linalg.norm(positions, axis=1).max() < 9
    np.testing.assert_allclose(view.size, [2, 2, 1])


@pytest.mark.parametrize(("detail", "size"), [(1, 1.0), (30, 8.0)], ids=["little within", "no space for the camera"])
def test_what_is_hidden_does_not_always_decide(detail: int, size: float) -> None:
    """A hollow thing with a bulb in it is a thing; and walls close to a thing hide it from near, too."""
    assert default_view(*hidden(detail, size)).note == "one that goes around"


def test_a_file_of_glass_is_seen_from_around(tmp_path: Path) -> None:
    """A jar of KHR_materials_transmission; of the same jar without it, the camera stands within."""
    notes = []
    for more in ({"extensions": {"KHR_materials_transmission": {"transmissionFactor": 1.0}}}, {}):
        gltf = Gltf()
        corners = box([-1, 0, -1], [1, 3, 1], inward=True).reshape(-1, 3)
        paint = gltf.material(more=more)
        gltf.node(mesh=gltf.mesh(corners, np.arange(len(corners)).reshape(-1, 3), material=paint))
        notes.append(load_scene(gltf.save(tmp_path / "jar.glb")).note)
    assert "no camera, so one that goes around;" in notes[0]
    assert "no camera, so one that turns in the room" in notes[1]


def test_the_largest_of_two_rooms_is_taken() -> None:
    """A closet next to a hall; in a narrow one the circle takes half of what is free."""
    closet = box([0, 0, 0], [1.2, 1.2, 2.6], inward=True)
    for hall in (box([1.3, 0, 0], [6, 4, 2.6], inward=True), box([-6, 0, 0], [-0.1, 0.9, 2.6], inward=True)):
        view = default_view(np.concatenate([closet, hall]))
        assert view.room is not None
        assert (view.room.centre > hall.reshape(-1, 3).min(0)).all()
        assert (view.room.centre < hall.reshape(-1, 3).max(0)).all()
        radius = np.linalg.norm(view.trajectory.pose(0.0).position - view.room.centre)
        assert radius == pytest.approx(min(0.5, view.room.free_m / 2))


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
    assert view.room is None
    assert view.note == "one that goes around"
    times = np.linspace(0, 10, 7)
    assert np.allclose(view.trajectory.positions(times), circle_around(world.reshape(-1, 3)).path().positions(times))


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
    expected = circle_around(block.reshape(-1, 3)).path().pose(0.0).position
    assert np.linalg.norm(view.trajectory.pose(0.0).position - expected) < 0.1
    assert "which lie far off" in view.note


def test_an_unusual_size_is_asked_about() -> None:
    """A room by its height, other worlds by what is looked at, and any by its name."""

    def asked(world: FloatArray) -> str:
        return default_view(world).unit_question("flat", 1.0)

    told = " (5,000 m: is the file in millimetres, which makes 5 m? then give it 0.001 m to a unit, --scale)"
    assert asked(ROOM * 1000) == told
    # A hall of 15 m in centimetres is no smaller than a room in millimetres.
    assert "centimetres, which makes 15 m? then give it 0.01 m" in asked(ROOM * [300, 100, 100])
    assert asked(ROOM) == ""
    outside = box([0, 0, 0], [5, 4, 2.6], inward=False)
    assert asked(outside * 100) == ""
    assert "millimetres" in asked(outside * 1000)
    assert asked(outside * 1e6) == "", "a globe of 5 km in millimetres is no likelier"
    assert asked(town_on_a_plane()) == ""
    view = default_view(outside)
    told = "its name says millimetres: is that its unit? then give it 0.001 m"
    assert told in view.unit_question("bolt_M8-mm", 1.0)
    assert view.unit_question("bolt_mm", 0.001) == ""
    assert view.unit_question("hammer", 1.0) == ""


def test_a_landscape_may_be_kilometres_wide() -> None:
    """It has no underside, upright or tilted, unlike a part drawn in millimetres, however flat."""
    hills = box([0, 0, 0], [3000, 4000, 300], inward=False, without=((2, -1),))
    tilted = hills[..., [2, 0, 1]]
    for land in (hills, tilted):
        assert default_view(land).unit_question("tile", 1.0) == ""
    assert "millimetres" in default_view(box([0, 0, 0], [3000, 4000, 300], inward=False)).unit_question("tile", 1.0)


def test_a_landscape_that_stands_upright_is_asked_about(tmp_path: Path) -> None:
    """Files of maps have z up, also such whose format has y up."""
    heights = "".join(f"v {x} {y} {(x * y) % 70}\n" for y in range(0, 3000, 500) for x in range(0, 3000, 500))
    corners = [
        (6 * row + column + 1, 6 * row + column + 2, 6 * row + column + 7) for row in range(5) for column in range(5)
    ]
    mesh = tmp_path / "tile.obj"
    mesh.write_text(heights + "".join(f"f {a} {b} {c + 1} {c}\n" for a, b, c in corners))
    assert "(its ground stands upright: does z point up? then give it --up z)" in load_scene(mesh).note
    assert "upright" not in load_scene(mesh, up="z").note
    small = tmp_path / "small.obj"
    small.write_text(mesh.read_text())
    assert "upright" not in load_scene(small, scale=0.01).note, "a relief on a wall"


def test_sizes_are_told_without_exponents(tmp_path: Path) -> None:
    mesh = tmp_path / "wide.obj"
    mesh.write_text("v 0 0 0\nv 12345 0 0\nv 0 6484 0\nf 1 2 3\n")
    assert "wide.obj is 12,345 m x 0 m wide and 6,484 m high" in load_scene(mesh).note
    assert default_view(ROOM * 1000).note.startswith("one that turns in the room, 1,")


def town_on_a_plane() -> FloatArray:
    """Make 24 houses within 100 m, on a plane of 2 km, off its middle, that has low walls at its ends."""
    random = np.random.default_rng(2)
    plane = box([-1000, -1000, -2], [1000, 1000, 0], inward=False)
    houses = []
    for x, y in itertools.product(np.arange(6) * 18.0 - 300, np.arange(4) * 25.0 + 200):
        x, y, height = np.array([x, y, 6]) + random.random(3) * [3, 3, 5]
        houses.append(box([x, y, 0], [x + 9, y + 9, height], inward=False))
    return np.concatenate([plane, *houses])


def spread(world: FloatArray, view: DefaultView, t: float) -> FloatArray:
    """Return the extents (2) of a world in the image, as fractions of its width and height."""
    pose = view.trajectory.pose(t)
    seen = (world.reshape(-1, 3) - pose.position) @ pose.rotation
    assert (seen[:, 2] > 0).all()
    place = seen[:, :2] / seen[:, 2:] * [CAMERA.fx, CAMERA.fy] / [CAMERA.width, CAMERA.height]
    assert (np.abs(place) < 0.5).all()
    return np.asarray(np.ptp(place, axis=0))


def test_a_wide_plane_does_not_decide() -> None:
    """The houses fill the image, and all of them stay in it."""
    world = town_on_a_plane()
    view = default_view(world)
    assert view.room is None
    assert "without the wide ground around it" in view.note
    for t in (0.0, 3.0, 6.0):
        assert spread(world[12:], view, t).max() > 0.6


def test_what_stands_on_a_plane_is_seen_whole() -> None:
    """A thin part that sticks out of it, too; a post far off does not count."""
    plane = box([-60, -60, -1], [60, 60, 0], inward=False)
    tower = [box([i, k, 0], [i + 0.9, k + 0.9, 3.0], inward=False) for i, k in itertools.product(range(7), range(7))]
    beam = box([6.9, 3.0, 1.0], [10, 3.02, 1.02], inward=False)
    post = box([50.0, 50, 0], [50.1, 50.1, 1], inward=False, without=SIDES_BUT_FRONT)
    subject = np.concatenate([*tower, beam])
    view = default_view(np.concatenate([plane, subject, post]))
    for t in (0.0, 3.0, 6.0):
        assert spread(subject, view, t).max() > 0.5


def test_blades_and_wings_are_no_ground() -> None:
    """A flat surface that lies high, or goes on to two sides alone, belongs to what is looked at."""
    body = np.concatenate([box([-1, -0.2 * k, 0], [1, 0.2 * k, 1.0 + 0.1 * k], inward=False) for k in range(1, 6)])
    for flat in (
        box([-4, -4, 1.5], [4, 4, 1.6], inward=False, without=SIDES_BUT_TOP),
        box([-0.3, -6, 0.0], [0.3, 6, 0.1], inward=False, without=SIDES_BUT_TOP),
    ):
        world = np.concatenate([body, flat])
        view = default_view(world)
        assert view.note == "one that goes around"
        spread(world, view, 1.0)


def test_corridors_are_rooms() -> None:
    """Those that fill little of the space around them, with a ceiling: a ring and a shaft."""
    corridors = [
        box([0, 0, 0], [40, 2.5, 3], inward=True, without=((0, -1), (0, 1))),
        box([0, 37.5, 0], [40, 40, 3], inward=True, without=((0, -1), (0, 1))),
        box([-2.5, 0, 0], [0, 40, 3], inward=True, without=((0, 1),)),
        box([40, 0, 0], [42.5, 40, 3], inward=True, without=((0, -1),)),
        box([-2.5, 0, 3], [0, 2.5, 30], inward=True, without=((2, -1),)),
    ]
    view = default_view(np.concatenate(corridors))
    assert view.room is not None
    assert 0.5 < view.room.centre[2] < 29


def test_valleys_are_no_rooms() -> None:
    x, y = np.meshgrid(np.linspace(0, 60, 41), np.linspace(0, 60, 41), indexing="ij")
    points = np.stack([x, y, 4 * np.sin(x / 3) * np.sin(y / 3)], -1)
    first = np.stack([points[:-1, :-1], points[1:, :-1], points[1:, 1:]], 2).reshape(-1, 3, 3)
    second = np.stack([points[:-1, :-1], points[1:, 1:], points[:-1, 1:]], 2).reshape(-1, 3, 3)
    assert default_view(np.concatenate([first, second])).room is None


def test_a_thin_thing_is_seen_from_its_broad_side_first() -> None:
    """One that shows nearly as much from its front is seen from there, as files usually face."""
    sheet = box([0, 0, 0], [0.02, 3, 2], inward=False)
    assert abs(default_view(sheet).trajectory.pose(0.0).rotation[0, 2]) > 0.7
    assert default_view(box([0, 0, 0], [2, 3, 2], inward=False)).start_rad == 0.0


def shelf(x: float, y: float) -> FloatArray:
    """Make a shelf of 12 boxes along x, that faces -y."""
    boxes = [
        box([x + 0.4 * i, y, 0.5 * k], [x + 0.3 + 0.4 * i, y + 0.3, 0.3 + 0.5 * k], inward=False)
        for i, k in itertools.product(range(4), range(3))
    ]
    return np.concatenate(boxes)


def test_a_room_is_seen_where_there_is_something_to_see() -> None:
    """The longest free way ends at a bare wall; a shelf stands at a side, and the camera keeps it in view."""
    room = np.concatenate([box([0, 0, 0], [10, 5, 2.6], inward=True), shelf(1.5, 4.6)])
    view = default_view(room)
    assert view.room is not None
    for t in np.linspace(0, view.trajectory.duration_s, 9):
        pose = view.trajectory.pose(t)
        seen = (shelf(1.5, 4.6).reshape(-1, 3) - pose.position) @ pose.rotation
        inside = (seen[:, 2] > 0) & (np.abs(seen[:, 0] / seen[:, 2]) < CAMERA.width / 2 / CAMERA.fx)
        assert inside.any()
        assert inside.mean() > 0.5 or t > 0


def test_a_room_full_of_things_has_a_place_at_another_height() -> None:
    """Posts leave no free place at the eye's height; above them there is one."""
    posts = [
        box([x, y, 0], [x + 0.2, y + 0.2, 2.0], inward=False)
        for x, y in itertools.product(np.arange(0.2, 4.8, 0.6), np.arange(0.2, 3.8, 0.6))
    ]
    view = default_view(np.concatenate([box([0, 0, 0], [5, 4, 4.0], inward=True), *posts]))
    assert view.room is not None
    assert view.room.centre[2] > 2.2


@pytest.mark.parametrize(("height", "room"), [(1.2, False), (1.9, True)])
def test_what_is_low_inside_is_no_room(height: float, room: bool) -> None:
    """Such as the inside of a car, however high the car is."""
    roof = box([0, 0, height + 0.1], [1.5, 4, height + 0.6], inward=False)
    inside = box([0, 0, 0], [1.5, 4, height], inward=True)
    assert (default_view(np.concatenate([inside, roof])).room is not None) == room


def test_a_place_is_not_near_what_stands_there() -> None:
    """Of a shallow box of 0.9 m, most is in a narrow part; the camera stands in the free one, which shows less."""
    narrow = box([0, 0, 0], [3, 0.36, 2.6], inward=True, without=((0, 1),))
    wide = box([3, 0, 0], [3.8, 0.8, 2.6], inward=True, without=((0, -1),))
    end = np.array([[[3, 0.36, 0], [3, 0.8, 0], [3, 0.8, 2.6]], [[3, 0.36, 0], [3, 0.8, 2.6], [3, 0.36, 2.6]]])
    surfaces = Surfaces.of(np.concatenate([narrow, wide, end]))
    places = VoxelGrid.of(surfaces).places(surfaces)
    assert places
    assert all(place.centre[0] > 3 for place in places)


def test_what_is_outside_is_said_by_normals(tmp_path: Path) -> None:
    """A mesh whose triangles face inwards and whose normals face outwards is no room."""
    corners = box([0, 0, 0], [4, 4, 4], inward=True)
    normals = -np.repeat(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), 3, axis=0)
    lines = ["v {:g} {:g} {:g}".format(*corner) for corner in corners.reshape(-1, 3)]
    lines += ["vn {:g} {:g} {:g}".format(*normal) for normal in normals]
    lines += ["f " + " ".join(f"{k}//{k}" for k in range(i, i + 3)) for i in range(1, 1 + len(normals), 3)]
    path = tmp_path / "box.obj"
    path.write_text("\n".join(lines))
    assert load_scene(path).note.endswith("one that goes around")
    path.write_text(re.sub(r"//\d+", "", "\n".join(lines)))
    assert "turns in the room" in load_scene(path).note


def test_an_edge_between_two_shapes_is_something_to_see() -> None:
    """Pictures on a wall, which have no depth."""
    room = box([0, 0, 0], [6, 6, 2.6], inward=True)
    pictures = [
        box([1 + 0.8 * i, 5.999, 1.0], [1.5 + 0.8 * i, 6, 1.8], inward=False, without=SIDES_BUT_FRONT) for i in range(5)
    ]
    corners = np.concatenate([room, *pictures])
    view = default_view(corners, np.repeat([0, 1], [len(room), len(corners) - len(room)]))
    assert view.trajectory.pose(0.0).rotation[1, 2] > 0.8


def test_the_back_of_one_sided_surfaces_is_seen_through() -> None:
    """A shelf behind a sheet is something to see if the sheet turns its back."""
    sheet = box([-1, 0, 0], [4, 0.01, 2], inward=True, without=SIDES_BUT_FRONT)
    corners = np.concatenate([sheet, shelf(0, 1)])
    ahead = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    two_sided, one_sided = np.zeros(len(corners), np.bool_), np.arange(len(corners)) < len(sheet)
    seen = [
        Sight(corners, np.zeros(len(corners), np.int64), flags).interest(np.array([[0.8, -2, 0.8]]), ahead[None])[0]
        for flags in (two_sided, one_sided)
    ]
    assert seen[1] > 1.5 * seen[0]


@pytest.mark.parametrize("one_sided", [False, True])
def test_a_view_goes_through_the_backs_of_a_files_surfaces(one_sided: bool, tmp_path: Path) -> None:
    """A shelf in a room stands behind a sheet that turns its back: the camera looks there if it sees through."""
    gltf = Gltf()
    room = np.concatenate([box([0, 0, 0], [10, 5, 2.6], inward=True), shelf(1.5, 4.6)])
    sheet = box([1.0, 4.5, 0], [4, 4.51, 2.5], inward=True, without=SIDES_BUT_FRONT)
    for world, double_sided in ((room, True), (sheet, not one_sided)):
        corners = world.reshape(-1, 3)[:, [0, 2, 1]] * [1, 1, -1]  # y points up
        material = gltf.material(double_sided=double_sided)
        gltf.node(mesh=gltf.mesh(corners, np.arange(len(corners)), material=material))
    forward = load_scene(gltf.save(tmp_path / "room.glb")).path.pose(0.0).rotation[:, 2]
    assert (forward[1] > 0.4) == one_sided


def test_many_triangles_are_taken_coarser_without_holes(monkeypatch: pytest.MonkeyPatch) -> None:
    """A sphere of 7,200 triangles is seen as one of far fewer, in which there are no holes."""
    rows = 60
    v, u = np.meshgrid(np.linspace(0, np.pi, rows + 1), np.linspace(0, 2 * np.pi, rows + 1), indexing="ij")
    points = np.stack([np.sin(v) * np.cos(u), np.sin(v) * np.sin(u), np.cos(v)], -1)
    corners = np.concatenate(
        [
            np.stack([points[:-1, :-1], points[1:, :-1], points[1:, 1:]], 2).reshape(-1, 3, 3),
            np.stack([points[:-1, :-1], points[1:, 1:], points[:-1, 1:]], 2).reshape(-1, 3, 3),
        ]
    )
    pose = circle_around(points.reshape(-1, 3)).path().pose(0.0)

    def hits() -> tuple[npt.NDArray[np.bool_], int]:
        seen = Sight(corners, np.zeros(len(corners), np.int64), np.zeros(len(corners), np.bool_))
        _, triangle = seen._look(pose.position[None], pose.rotation[None])
        return triangle[0] != 2**32 - 1, len(seen._normals)

    whole, all_of_them = hits()
    monkeypatch.setattr(sight, "_MANY", 1000)
    monkeypatch.setattr(sight, "_FINE", 1 / 24)
    coarse, few = hits()
    assert few < 0.7 * all_of_them
    # They differ at the outline alone.
    inside = whole[1:-1, 1:-1] & whole[2:, 1:-1] & whole[:-2, 1:-1] & whole[1:-1, 2:] & whole[1:-1, :-2]
    assert inside.sum() > 100
    assert coarse[1:-1, 1:-1][inside].mean() > 0.97


def test_the_paths_move_as_their_derivatives_say() -> None:
    for path in (
        circle_around(np.array([[1.0, 2, 3], [2.0, 4, 3.5]])).path(),
        circle_around(np.array([[1.0, 2, 3], [2.0, 4, 3.5]])).path(2.0),
        within(np.array([1.0, 2, 3]), 0.6, Turn(0.7)),
        within(np.array([1.0, 2, 3]), 0.6, Turn(0.7, (1.0, 0.3))),
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
    told = "has a camera of 40 x 30 pixels (--size), but no path: it goes once around a small circle"
    assert told in capsys.readouterr().err


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


def test_cells_are_connected_along_axes_alone() -> None:
    """As SciPy labels them, in maps of any shape, with parts that wind."""
    from scipy.ndimage import label

    random = np.random.RandomState(3)
    for number in range(200):
        shape = (20, 20) if number % 4 == 0 else tuple(random.randint(1, 30, 2))
        cells = random.rand(*shape) < (0.3, 0.55, 0.65, 0.9)[number % 4]
        first = (random.rand(*shape) < 0.02) & cells
        names, count = label(cells)
        reached = np.isin(names, np.setdiff1d(names[first], [0]))
        assert np.array_equal(_connected(cells, first), reached), (number, count)
    spiral = np.zeros((41, 41), np.bool_)
    row, column, step, turn = 20, 20, 1, 0
    while 0 < row < 40 and 0 < column < 40:
        for _ in range(2 * step):
            spiral[row, column] = True
            row, column = row + (0, 1, 0, -1)[turn % 4], column + (1, 0, -1, 0)[turn % 4]
        turn += 1
        step += turn % 2 == 0
    first = np.zeros_like(spiral)
    first[20, 20] = True
    assert np.array_equal(_connected(spiral, first), spiral)


def test_blocks_that_are_left_out_have_no_outermost_points() -> None:
    """Points lie along a line that winds through a cube, so that most blocks are inside; some corners come twice."""
    from davis_rs.geometry.lattice import sphere_lattice

    t = np.linspace(0, 1, 20_000)[:, None]
    points = np.concatenate([np.sin([2, 3, 5] * t) + 1e4, np.sin([2, 3, 5] * t[::-1]) + 1e4])
    directions = np.concatenate([sphere_lattice(500), np.eye(3), -np.eye(3)])
    found, along = _outermost(points), directions @ points.T
    assert len(found) < 1000
    assert np.allclose((directions @ found.T).max(1), along.max(1), rtol=0, atol=1e-9)
    assert len(np.unique(found, axis=0)) == len(found)


def test_a_view_and_the_tables_need_no_scipy(tmp_path: Path, run_python: Callable[..., str]) -> None:
    """To import it takes longer than all the rest until the first frame of a small world."""
    corners = box([0, 0, 0], [1, 1, 2], inward=False).reshape(-1, 3)
    rows = [" ".join(map(str, corner)) for corner in corners]
    faces = [f"f {first} {first + 1} {first + 2}" for first in range(1, len(corners), 3)]
    path = tmp_path / "box.obj"
    path.write_text("\n".join([*(f"v {row}" for row in rows), *faces]))
    program = f"""
import sys
import numpy as np
import davis_rs
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.choice import make_renderer
scene = davis_rs.load_scene({str(path)!r}, up="z")
renderer = make_renderer(scene, scene.own_camera, kind="native", rays_per_pixel=1)
luma = renderer.luma(Views.along(scene.trajectory, np.zeros(1)))
print(bool(luma.any()), "goes around" in scene.note, "scipy" in sys.modules)
"""
    assert run_python(program) == "True True False\n"
