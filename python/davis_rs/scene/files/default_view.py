"""Finds a view of a world whose file has no camera: from within a room at eye height, or around what stands there.

Points are drawn on all surfaces, and counted into a grid of cubes (voxels). From an empty cube, the cubes in 17
directions are looked through: level ones, and those that go down. Where most looks end at the front of a surface, the
cube lies in a room, with or without a ceiling. If enough of the empty space does, the camera stands in the largest
room, where it is freest. Otherwise it goes around what there is.

What must not break: the view is a function of the triangles alone, the same at every run.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...geometry.pose import FloatArray
from ...geometry.trajectory.trajectory import Trajectory
from ..default_paths import around, within

_POINTS, _SEED = 400_000, 1
_CELLS = 64
"""Voxels along the longest side of the grid."""
_STRAY = 0.01
"""Fraction of the points, at each end of each axis, that may lie far off without deciding what is looked at."""
_FAR = 0.5
"""Points farther out than this many times the extent of the others are stray."""

_ENCLOSED = 0.75
"""Fraction of the looks from a place in a room that must end at the front of a surface; doors and windows are open."""
_ROOM = 0.22
"""Fraction of the empty space that must be enclosed. Measured: a flat without a ceiling 0.28, a terrain 0.17, a street
0.10, a car, trees and statues 0.07 or less."""
_BOTH_WAYS = 0.5
"""A cube faces away from a look where the mean of its normals along it is larger. Two-sided walls have a small one."""
_LEAST_HEIGHT_M = 1.5
"""A room that is lower is no room: the inside of a hollow object, for example."""
_LOOKS = np.array([step for step in product((-1, 0, 1), (-1, 0, 1), (-1, 0)) if any(step)])

_EYE_M, _ROOM_HEIGHT_M = 1.6, (2.0, 20.0)
"""Height of the eye above the floor, in rooms of such heights. In others it is a fraction of the height."""
_EYE_FRACTION = 0.55
_STANDS = 0.6
"""Things that end lower than this fraction below the eye may stand near the camera, such as a carpet."""

_LARGEST_ROOM_M, _LARGEST_M = 100.0, 1000.0
"""A room that is larger may be in centimetres; any world that is larger, in millimetres."""

_MOST_OUTERMOST = 1000
"""So many points, or a few more, stand for all when it is found out how large they look."""
_BLOCK = 256
"""Points that are looked at together: their products stay in the cache."""


class DefaultView(NamedTuple):
    """Holds a camera path through a world without a camera."""

    trajectory: Trajectory
    note: str
    """What it shows, in a few words."""
    room_centre: FloatArray | None
    """The middle (3) of the camera's circle in a room, in metres; None around an object."""
    room_radius: float = 0.0
    """The level distance from there to what stands around, in metres."""
    room_above: float = 0.0
    """The free height above there, in metres."""

    def unit_question(self, size: FloatArray) -> str:
        """Ask about the unit of a world of a size (3) in metres that is unusual; "" for other sizes."""
        largest = float(size.max())
        if largest <= (_LARGEST_M if self.room_centre is None else _LARGEST_ROOM_M):
            return ""
        unit, factor = ("millimetres", 0.001) if largest > _LARGEST_M else ("centimetres", 0.01)
        return f" ({largest:,.0f} m: is the file in {unit}? then give it {factor:g} m to a unit, --scale)"


def default_view(corners: FloatArray) -> DefaultView:
    """Find a view of triangles in the world, z up.

    Args:
        corners: (n, 3, 3), metres, n >= 1.
    """
    points, normals = _on_surfaces(corners)
    kept = _near(points)
    low, high = points[kept].min(0), points[kept].max(0)
    stray = f", without {100 * (1 - kept.mean()):.2g} % of the surfaces, which lie far off" if not kept.all() else ""
    grid = _VoxelGrid.of(points[kept], normals[kept], low, high)
    room = grid.room()
    if room is not None:
        centre, radius, angle, above = room
        note = f"one that turns in the room, {radius:.2g} m from what stands around it"
        return DefaultView(within(centre, radius, angle), f"{note}{stray}", centre, radius, above)
    # The ends of what is kept, not only the points on it, so that a small mesh fits exactly.
    inside = corners.reshape(-1, 3) if kept.all() else points[kept]
    return DefaultView(around(_outermost(inside)), f"one that goes around{stray}", None)


def _outermost(points: FloatArray) -> FloatArray:
    """Return those of many points (n, 3) that lie farthest out in some of many directions; few points as they are."""
    if len(points) <= _MOST_OUTERMOST:
        return points
    number = np.arange(_MOST_OUTERMOST // 2)
    z = 1 - (2 * number + 1) / len(number)
    turn = np.pi * (1 + np.sqrt(5)) * number
    flat = np.sqrt(1 - z * z)
    directions = np.concatenate([np.stack([flat * np.cos(turn), flat * np.sin(turn), z], 1), np.eye(3), -np.eye(3)])
    farthest, which = np.full(len(directions), -np.inf), np.zeros(len(directions), np.int64)
    for start in range(0, len(points), _BLOCK):
        along = directions @ points[start : start + _BLOCK].T
        ahead = along.argmax(1)
        most = along[np.arange(len(directions)), ahead]
        which[most > farthest] = start + ahead[most > farthest]
        farthest = np.maximum(farthest, most)
    return points[np.unique(which)]


def _on_surfaces(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Draw points (m, 3) on triangles, by the root of their areas so that small ones count, and return the unit normals
    there. Every triangle's middle is one of them, if there are not too many."""
    random = np.random.Generator(np.random.PCG64(_SEED))
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled = np.linalg.norm(normal, axis=1)
    weight = np.cumsum(doubled + doubled.mean())
    weight = weight if weight[-1] > 0 else np.arange(1.0, len(corners) + 1)
    which = np.searchsorted(weight, random.random(_POINTS) * weight[-1]).clip(max=len(corners) - 1)
    u, v = np.sqrt(random.random(_POINTS)), random.random(_POINTS)
    barycentric = np.stack([1 - u, u * (1 - v), u * v], 1)
    points = np.einsum("nk,nkc->nc", barycentric, corners[which])
    return points, normal[which] / np.maximum(doubled[which], 1e-300)[:, None]


def _near(points: FloatArray) -> npt.NDArray[np.bool_]:
    """Return which points decide what is looked at: all but a few that lie far off."""
    low, high = np.quantile(points, [_STRAY, 1 - _STRAY], axis=0)
    margin = _FAR * float((high - low).max())
    return np.all((points >= low - margin) & (points <= high + margin), axis=1)


class _VoxelGrid:
    """Holds the voxels of a world: which have surfaces, and which way these face."""

    def __init__(self, facing: FloatArray, filled: npt.NDArray[np.bool_], origin: FloatArray, cell: float) -> None:
        self.facing, self.filled, self.origin, self.cell = facing, filled, origin, cell

    @classmethod
    def of(cls, points: FloatArray, normals: FloatArray, low: FloatArray, high: FloatArray) -> _VoxelGrid:
        """Count points into cubes, with an empty cube around them all."""
        cell = float((high - low).max()) / _CELLS or 1.0
        shape = tuple(np.floor((high - low) / cell).astype(int) + 3)
        index = np.ravel_multi_index(tuple(np.floor((points - low) / cell).astype(int).T + 1), shape)
        count = int(np.prod(shape))
        points_in = np.bincount(index, minlength=count)
        sums = np.stack([np.bincount(index, normal, count) for normal in normals.T], 1)
        facing = sums / np.maximum(points_in, 1)[:, None]
        return cls(facing.reshape(*shape, 3), points_in.reshape(shape) > 0, low - cell, cell)

    def room(self) -> tuple[FloatArray, float, float, float] | None:
        """Return where a camera stands in a room (3), how far it is from surfaces there, the direction in the plane in
        which it sees farthest, radians from -y, and the free height above it; None where there is no room."""
        if self.cell * self.filled.shape[2] < _LEAST_HEIGHT_M:
            return None
        inner = (slice(1, -1),) * 3
        space = np.zeros_like(self.filled)
        space[inner] = self._enclosed()[inner]
        empty = np.count_nonzero(~self.filled[inner])
        if np.count_nonzero(space) < _ROOM * empty or not empty:
            return None
        # Most worlds are no rooms, and need none of this.
        from scipy.ndimage import distance_transform_edt, label

        names, count = label(space)
        largest = names == 1 + np.bincount(names.ravel(), minlength=count + 1)[1:].argmax()
        cells = np.argwhere(largest)
        column = cells[:, 0] * self.filled.shape[1] + cells[:, 1]
        floor = np.full(self.filled.shape[0] * self.filled.shape[1], np.iinfo(np.int64).max)
        np.minimum.at(floor, column, cells[:, 2])
        height_m = (np.ptp(cells[:, 2]) + 1) * self.cell
        usual = _ROOM_HEIGHT_M[0] <= height_m <= _ROOM_HEIGHT_M[1]
        eye = _EYE_M if usual else _EYE_FRACTION * height_m
        at_eye = cells[cells[:, 2] - floor[column] == int(eye / self.cell)]
        if not len(at_eye):
            return None
        free = np.zeros(len(at_eye))
        for level in np.unique(at_eye[:, 2]):
            # What stands on the floor counts too: it would be near the camera.
            low = level - int(_STANDS * eye / self.cell)
            space_around = distance_transform_edt(~self.filled[:, :, low : level + 1].any(2))
            here = at_eye[:, 2] == level
            free[here] = space_around[tuple(at_eye[here, :2].T)]
        best = at_eye[free.argmax()]
        directions = np.array([step for step in product((-1, 0, 1), repeat=2) if any(step)])
        directions = directions[np.argsort(np.arctan2(directions[:, 0], -directions[:, 1]))]
        steps = [self._free_steps(best, np.append(direction, 0)) for direction in directions]
        distance = steps * np.linalg.norm(directions, axis=1)
        # The image is as wide as three of the eight directions, nearly.
        seen = 2 * distance + np.roll(distance, 1) + np.roll(distance, -1)
        farthest = directions[seen.argmax()]
        angle = float(np.arctan2(farthest[0], -farthest[1]))
        # The distance to the middle of a filled cube, less what may lie nearer in it.
        radius = max(float(free.max()) - 1.0, 0.25) * self.cell
        above = (self._free_steps(best, np.array([0, 0, 1])) - 0.5) * self.cell
        return self.origin + (best + 0.5) * self.cell, radius, angle, above

    def _enclosed(self) -> npt.NDArray[np.bool_]:
        """Return which cubes are empty and lie in a room."""
        fronts = sum(self._ends_at_front(look).astype(np.int64) for look in _LOOKS)
        return ~self.filled & (fronts >= _ENCLOSED * len(_LOOKS))

    def _ends_at_front(self, look: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
        """Return for each empty cube whether a look from it ends at the front of a surface; layer by layer, because a
        look goes on as that of the next cube does."""
        front = self.facing @ look <= _BOTH_WAYS * np.linalg.norm(look)
        axis = int(np.flatnonzero(look)[0])
        layers = [np.moveaxis(values, axis, 0) for values in (self.filled, front)]
        step, (across, along) = look[axis], np.delete(look, axis)
        depth, rows, columns = layers[0].shape
        ends = np.zeros((depth + 2, rows + 2, columns + 2), np.bool_)
        for i in range(depth)[::-step]:
            following = ends[i + 1 + step, 1 + across : 1 + across + rows, 1 + along : 1 + along + columns]
            ends[i + 1, 1:-1, 1:-1] = np.where(layers[0][i], layers[1][i], following)
        return np.moveaxis(ends[1:-1, 1:-1, 1:-1], 0, axis)

    def _free_steps(self, cell: npt.NDArray[np.int64], direction: npt.NDArray[np.int64]) -> int:
        """Return after how many cubes a look from one ends, at a surface or at the last cube of the grid."""
        steps = 0
        while np.all(((cell := cell + direction) >= 0) & (cell < self.filled.shape)):
            steps += 1
            if self.filled[tuple(cell)]:
                break
        return steps
