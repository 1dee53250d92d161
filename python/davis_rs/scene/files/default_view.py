"""Finds a view of a world whose file has no camera: from within a room at eye height, or around what stands there.

``subject`` says which surfaces decide: not those that lie far off, nor wide flat ground. ``rooms`` finds rooms, and
places in them. ``sight`` casts rays from some places in several directions, and counts in how many parts of the image
there are edges. In a room the camera stands where it sees the most, and turns as far as there is something to see.
Otherwise it goes around what there is, from the usual front unless far less is seen from there.

What must not break: the view is a function of the triangles alone, the same at every run.
"""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..._util.quantities import metres
from ...geometry.lattice import sphere_lattice
from ...geometry.pose import FloatArray
from ...geometry.trajectory.trajectory import Trajectory
from ..default_paths import Circle, Turn, circle_around, within
from .rooms import Place, VoxelGrid
from .sight import Sight
from .subject import Surfaces

_LARGEST_M, _HIGHEST_ROOM_M = 1000.0, 20.0
"""A world around which the camera goes, and that is larger, may be in millimetres if they make it no larger than that.
A room that is higher may be in the unit in which it would be as high as a room."""
_OPEN = 0.3
"""Normals of a closed thing, weighted by area, cancel out; those of ground do not. Measured: the length of their sum
is 0.4 or more of the whole area in landscapes and towns, and 0.25 or less in things and buildings."""
_UPRIGHT = 0.9
"""Ground stands upright if so much of the direction in which it faces is level, along the file's other axis."""
_LEAST_ROOM_M = 2.0
_UNITS = {"millimetres": 0.001, "centimetres": 0.01}
_NAMED = {
    f"{first}{last}": f"{first}metres"
    for first in ("milli", "centi")
    for last in ("meter", "meters", "metre", "metres")
} | {"mm": "millimetres", "cm": "centimetres"}
"""Words of a file's name that say its unit."""

_DIRECTIONS = 12
"""So many looks around are compared."""
_WORTH = 0.5
"""In a room, the camera turns to where it sees at least this fraction of what it sees at best."""
_FRONT = 0.7
"""A world is seen from its usual front first if that shows at least this fraction of what its best side shows."""
_HIDDEN, _SHOWN = 0.002, 0.05
"""A shape hides all others if they have at most this fraction of the image from all around. Nearer to them, they must
have at least so much from everywhere."""
_DETAIL = 10
"""A backdrop is plain: the others have at least so many times as many triangles."""
_FREEDOM, _BEST = 0.5, 0.6
"""How much a free place counts in a room; how much the best look counts there, the rest is the mean of all."""

_MOST_OUTERMOST = 1000
"""So many points, or a few more, stand for all when it is found out how large they look."""
_BLOCK = 256
"""Points that are looked at together: their products stay in the cache."""
_ROUNDING = 1e-12
"""By less than this fraction of their coordinates, products of points are rounded."""


class DefaultView(NamedTuple):
    """Holds a camera path through a world without a camera."""

    trajectory: Trajectory
    note: str
    """What it shows, in a few words."""
    start_rad: float
    """The direction in which the camera stands at the start of a path around, from -y towards x."""
    size: FloatArray
    """The extents (3) of what decides the view, in metres."""
    room: Place | None = None
    """Where the camera stands in a room; None around an object."""
    ground: FloatArray | None = None
    """Which way (3) the surfaces of a landscape face on the whole: what is so large, and open below. None of others."""

    def unit_question(self, name: str, scale: float) -> str:
        """Ask about the unit of a world that its file's name says, or that its size makes likely; "" for others.

        Args:
            name: of the file, without its suffix.
            scale: metres to a unit, as the file is read.
        """
        named = [_NAMED[word] for word in re.split("[^a-z]+", name.lower()) if word in _NAMED]
        if named and scale == 1.0:
            of_unit = _UNITS[named[0]]
            return f" (its name says {named[0]}: is that its unit? then give it {of_unit:g} m to a unit, --scale)"
        largest = float(self.size.max())
        if self.room is None:
            fits = _LARGEST_M < largest <= _LARGEST_M / _UNITS["millimetres"]
            likely = ["millimetres"] if fits and self.ground is None else []
        else:
            high = self.room.height_m
            likely = [
                unit for unit, of_unit in _UNITS.items() if high > _HIGHEST_ROOM_M and high * of_unit >= _LEAST_ROOM_M
            ]
        if not likely:
            return ""
        unit, of_unit = likely[0], _UNITS[likely[0]]
        makes = f"is the file in {unit}, which makes {metres(largest * of_unit)}?"
        return f" ({metres(largest)}: {makes} then give it {of_unit:g} m to a unit, --scale)"

    def up_question(self, up: str) -> str:
        """Ask about the axis that points up where a landscape stands upright; "" for others.

        Args:
            up: the axis that is taken, ``y`` or ``z``.
        """
        if self.ground is None or abs(self.ground[1]) < _UPRIGHT:
            return ""
        other = "z" if up == "y" else "y"
        return f" (its ground stands upright: does {other} point up? then give it --up {other})"


def default_view(
    corners: FloatArray,
    shapes: npt.NDArray[np.int64] | None = None,
    one_sided: npt.NDArray[np.bool_] | None = None,
    clear: npt.NDArray[np.bool_] | None = None,
) -> DefaultView:
    """Find a view of triangles in the world, z up.

    Args:
        corners: (n, 3, 3), metres, n >= 1.
        shapes: (n,) the number of each triangle's shape; None: all are one.
        one_sided: (n,) whether the back of each is seen through; None: of none.
        clear: (n,) which are of clear glass: what is a room by these alone, such as a jar, is none; None: none are.
    """
    everything = Surfaces.of(corners)
    kept = everything.near()
    surfaces = everything.only(kept)
    stray = f", without {100 * (1 - kept.mean()):.2g} % of the surfaces, which lie far off" if not kept.all() else ""
    del everything
    shapes = np.zeros(len(corners), np.int64) if shapes is None else shapes
    one_sided = np.zeros(len(corners), np.bool_) if one_sided is None else one_sided
    places = VoxelGrid.of(surfaces).places(surfaces)
    if places and clear is not None and clear.any() and not _is_room(corners[~clear]):
        places = []
    if places:
        size = np.ptp(surfaces.points, axis=0)
        del surfaces  # what casts rays is as large, and comes in its place
        place, turn = _best_place(places, Sight(corners, shapes, one_sided))
        note = f"one that turns in the room, {metres(place.free_m)} from what stands around it"
        path = within(place.centre, place.free_m, turn)
        return DefaultView(path, f"{note}{stray}", turn.start_rad, size, place)
    shown = surfaces.with_little_ground()
    ground = "" if shown.all() else ", without the wide ground around it"
    # The ends of what is kept, not only the points on it, so that a small mesh fits exactly.
    inside = corners.reshape(-1, 3) if kept.all() and shown.all() else surfaces.points[shown]
    circle, size = circle_around(_outermost(inside)), np.ptp(inside, axis=0)
    del surfaces, inside, shown
    sight = Sight(corners, shapes, one_sided)
    if (within_backdrop := _within_backdrop(circle, sight, corners, shapes)) is not None:
        circle, size = within_backdrop
        ground, stray = ", within what hides it from farther off", ""
    start = _best_side(circle, sight)
    facing = _open_side(corners) if size.max() > _LARGEST_M else None
    return DefaultView(circle.path(start), f"one that goes around{ground}{stray}", start, size, ground=facing)


def _within_backdrop(
    circle: Circle, sight: Sight, corners: FloatArray, shapes: npt.NDArray[np.int64]
) -> tuple[Circle, FloatArray] | None:
    """Return a circle around all but one shape, and their extents, where this shape hides all others from the circle
    around everything, as a backdrop around a car does; None elsewhere."""
    count = int(shapes.max()) + 1
    seen = _looks_around(circle, sight, count)
    backdrop = int(seen.sum(0).argmax())
    others = corners[shapes != backdrop].reshape(-1, 3)
    if len(others) // 3 < _DETAIL * np.count_nonzero(shapes == backdrop) or _others(seen, backdrop).max() > _HIDDEN:
        return None
    inner = circle_around(_outermost(others))
    if _others(_looks_around(inner, sight, count), backdrop).min() < _SHOWN:
        return None
    return inner, np.ptp(others, axis=0)


def _looks_around(circle: Circle, sight: Sight, count: int) -> FloatArray:
    """Return the fraction of the image (n, count) that each of so many shapes has from all around a circle."""
    path = circle.path()
    times = np.linspace(0.0, path.duration_s, _DIRECTIONS, endpoint=False)
    return sight.shapes_seen(path.positions(times), path.rotations(times), count)


def _others(seen: FloatArray, shape: int) -> FloatArray:
    """Return the fraction of the image that all shapes but one have in each look."""
    return np.asarray(np.delete(seen, shape, axis=1).sum(1))


def _is_room(corners: FloatArray) -> bool:
    """Return whether triangles (n, 3, 3) make a room."""
    if not len(corners):
        return False
    everything = Surfaces.of(corners)
    surfaces = everything.only(everything.near())
    return bool(VoxelGrid.of(surfaces).places(surfaces))


def _open_side(corners: FloatArray) -> FloatArray | None:
    """Return which way (3) triangles (n, 3, 3) face on the whole that are open on the other side, as ground is below;
    None for closed things."""
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(areas.sum(0))
    return np.asarray(areas.sum(0) / length) if length > _OPEN * np.linalg.norm(areas, axis=1).sum() else None


def _best_place(places: list[Place], sight: Sight) -> tuple[Place, Turn]:
    """Return the place from which most is seen, all around and where most is, and how the camera turns there."""
    angles = np.linspace(0.0, 2 * np.pi, _DIRECTIONS, endpoint=False)
    looks = [within(place.centre, place.free_m, Turn(0.0)) for place in places]
    times = angles / (2 * np.pi) * looks[0].duration_s
    positions = np.concatenate([look.positions(times) for look in looks])
    rotations = np.concatenate([look.rotations(times) for look in looks])
    seen = sight.interest(positions, rotations).reshape(len(places), -1)
    freedom = np.array([place.freedom for place in places])
    worth = (_BEST * seen.max(1) + (1 - _BEST) * seen.mean(1)) * (1 - _FREEDOM + _FREEDOM * freedom)
    best = int(np.round(worth, 2).argmax())
    return places[best], _turn(angles, seen[best])


def _turn(angles: FloatArray, seen: FloatArray) -> Turn:
    """Return how a camera turns that sees so much at angles all around: as far as it is worth it, from the best."""
    best = int(seen.argmax())
    worth = np.roll(seen >= _WORTH * seen[best], -best)
    if worth.all():
        return Turn(float(angles[best]))
    step = float(angles[1])
    ahead = int(np.argmin(worth)) - 1
    behind = int(np.argmin(worth[::-1]))
    return Turn(float(angles[best]), (behind * step, ahead * step))


def _best_side(circle: Circle, sight: Sight) -> float:
    """Return where a path on a circle around a world starts, radians from -y."""
    angles = np.linspace(0.0, 2 * np.pi, _DIRECTIONS, endpoint=False)
    path = circle.path()
    times = angles / (2 * np.pi) * path.duration_s
    seen = sight.interest(path.positions(times), path.rotations(times))
    best = int(seen.argmax())
    return 0.0 if seen[0] >= _FRONT * seen[best] else float(angles[best])


def _outermost(points: FloatArray) -> FloatArray:
    """Return those of many points (n, 3) that lie farthest out in some of many directions; few points as they are."""
    if len(points) <= _MOST_OUTERMOST:
        return points
    directions = np.concatenate([sphere_lattice(_MOST_OUTERMOST // 2), np.eye(3), -np.eye(3)])
    farthest, which = np.full(len(directions), -np.inf), np.zeros(len(directions), np.int64)
    for start in _outer_blocks(points, directions):
        along = directions @ points[start : start + _BLOCK].T
        ahead = along.argmax(1)
        most = along[np.arange(len(directions)), ahead]
        which[most > farthest] = start + ahead[most > farthest]
        farthest = np.maximum(farthest, most)
    return points[np.unique(which)]


def _outer_blocks(points: FloatArray, directions: FloatArray) -> list[int]:
    """Return where the blocks of points begin that may lie farthest out in some direction, by the boxes around them."""
    starts = np.arange(0, len(points), _BLOCK)
    low, high = np.minimum.reduceat(points, starts), np.maximum.reduceat(points, starts)
    at_most = np.maximum(directions, 0.0) @ high.T + np.minimum(directions, 0.0) @ low.T
    # Some of the points already lie so far out.
    known = (directions @ points[:: _BLOCK // 2].T).max(1, keepdims=True)
    rounding = _ROUNDING * float(np.abs(points).max())
    return starts[(at_most >= known - rounding).any(0)].tolist()
