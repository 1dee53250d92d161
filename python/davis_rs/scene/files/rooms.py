"""Finds the rooms of a world, and where in them a camera may stand.

Points on all surfaces are counted into a grid of cubes (voxels). From an empty cube, the cubes in 17 directions are
looked through: level ones, and those that go down. Where most looks end at the front of a surface, the cube lies in a
room, with or without a ceiling. A world is one of rooms if enough of the empty space lies in them, or if most surfaces
face rooms with a ceiling: corridors fill little of the space around them.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...geometry.pose import FloatArray
from .subject import Surfaces

_CELLS = 64
"""Voxels along the longest side of the grid."""

_ENCLOSED = 0.75
"""Fraction of the looks from a place in a room that must end at the front of a surface; doors and windows are open."""
_ROOM = 0.22
"""Fraction of the empty space that must be enclosed. Measured: a flat without a ceiling 0.28, a terrain 0.19, a street
0.11, trees, statues and most cars 0.07 or less."""
_COVERED = 0.6
"""Or fraction of the surfaces that must face enclosed space with a ceiling. Measured: dungeons 0.84, rooms 0.6 or more,
a street 0.45, a car 0.25, a terrain 0."""
_WALLS, _STEEP = 0.15, 0.5
"""Fraction of the surfaces that must be walls, with normals whose vertical part is smaller: valleys are no rooms."""
_BOTH_WAYS = 0.5
"""A cube faces away from a look where the mean of its normals along it is larger. Two-sided walls have a small one."""
_LEAST_HEIGHT_M = 1.5
"""A room that is lower is no room: the inside of a hollow object or of a car, for example."""
_LOOKS = np.array([step for step in product((-1, 0, 1), (-1, 0, 1), (-1, 0)) if any(step)])
_UP = np.array([[0, 0, 1], [1, 0, 1], [-1, 0, 1], [0, 1, 1], [0, -1, 1]])
_STEPS_AHEAD = 3
"""A surface faces the first empty one of so many cubes before it."""

_EYE_M, _ROOM_HEIGHT_M = 1.6, (2.0, 20.0)
"""Height of the eye above the floor, in rooms of such heights."""
_EYE_FRACTIONS = (0.55, 0.3, 0.12)
"""In others it is one of these fractions of the height."""
_STANDS = 0.6
"""Things that end lower than this fraction below the eye may stand near the camera, such as a carpet."""
_NARROW = 0.25
"""Where less than this fraction of the eye's height is free around it, the camera stands at any height."""
_FREE_ENOUGH = 0.4
"""The camera may stand where the free distance is at least this fraction of the largest one."""
_NEAREST_M = 0.3
"""The camera is not nearer to what stands around it, unless there is no such place."""
_MOST_PLACES = 12
"""So many places are compared, as many at each height."""


class Place(NamedTuple):
    """Holds a place in a room where a camera may stand.

    Attributes:
        centre: (3), metres.
        free_m: the level distance to what stands around it.
        above_m: the free height above it.
        freedom: the free distance as a fraction of the largest at that height.
        height_m: of the room.
    """

    centre: FloatArray
    free_m: float
    above_m: float
    freedom: float
    height_m: float


class VoxelGrid:
    """Holds the voxels of a world: which have surfaces, and which way these face."""

    def __init__(self, facing: FloatArray, filled: npt.NDArray[np.bool_], origin: FloatArray, cell: float) -> None:
        self.facing, self.filled, self.origin, self.cell = facing, filled, origin, cell

    @classmethod
    def of(cls, surfaces: Surfaces) -> VoxelGrid:
        """Count points into cubes, with an empty cube around them all."""
        points, normals = surfaces
        low, high = points.min(0), points.max(0)
        cell = float((high - low).max()) / _CELLS or 1.0
        shape = tuple(np.floor((high - low) / cell).astype(int) + 3)
        index = np.ravel_multi_index(
            tuple(np.floor((points[:, k] - low[k]) / cell).astype(int) + 1 for k in range(3)), shape
        )
        count = int(np.prod(shape))
        points_in = np.bincount(index, minlength=count)
        sums = np.stack([np.bincount(index, normal, count) for normal in normals.T], 1)
        facing = sums / np.maximum(points_in, 1)[:, None]
        return cls(facing.reshape(*shape, 3), points_in.reshape(shape) > 0, low - cell, cell)

    def places(self, surfaces: Surfaces) -> list[Place]:
        """Return where a camera may stand in the largest room, the freest place first; none where there is no room."""
        if self.cell * self.filled.shape[2] < _LEAST_HEIGHT_M or not self._has_walls(surfaces):
            return []
        inner = (slice(1, -1),) * 3
        space = np.zeros_like(self.filled)
        space[inner] = self._enclosed()[inner]
        empty = np.count_nonzero(~self.filled[inner])
        large = empty and np.count_nonzero(space) >= _ROOM * empty
        if not large and not (space.any() and self._covered(space, surfaces) >= _COVERED):
            return []
        places = self._in_largest(space)
        # What is free may reach as far as one cube farther than is sure.
        return [place for place in places if place.free_m + self.cell >= _NEAREST_M] or places

    @staticmethod
    def _has_walls(surfaces: Surfaces) -> bool:
        return float(np.mean(np.abs(surfaces.normals[:, 2]) < _STEEP)) >= _WALLS

    def _covered(self, space: npt.NDArray[np.bool_], surfaces: Surfaces) -> float:
        """Return the fraction of the surfaces that face enclosed space with a ceiling, of those that face any."""
        ceilings = sum(self._ends_at_front(look).astype(np.int64) for look in _UP)
        covered = space & (ceilings >= len(_UP) - 1)
        faces = np.zeros(len(surfaces.points), np.int64)
        left = np.arange(len(faces))
        for steps in range(1, _STEPS_AHEAD + 1):
            points, normals = surfaces.points[left], surfaces.normals[left]
            ahead = np.floor((points + steps * self.cell * normals - self.origin) / self.cell)
            cube = tuple(ahead.astype(int).clip(0, np.array(self.filled.shape) - 1).T)
            now = ~self.filled[cube]
            faces[left[now]] = np.where(covered[cube][now], 1, 2)
            left = left[~now]
        return float(np.count_nonzero(faces == 1)) / max(int(np.count_nonzero(faces)), 1)

    def _in_largest(self, space: npt.NDArray[np.bool_]) -> list[Place]:
        # Most worlds are no rooms, and need none of this.
        from scipy.ndimage import label, minimum_filter

        names, count = label(space)
        largest = names == 1 + np.bincount(names.ravel(), minlength=count + 1)[1:].argmax()
        cells = np.argwhere(largest)
        floor = np.where(largest.any(2), largest.argmax(2), self.filled.shape[2])
        height_m = (np.ptp(cells[:, 2]) + 1) * self.cell
        if height_m < _LEAST_HEIGHT_M:
            return []
        usual = _ROOM_HEIGHT_M[0] <= height_m <= _ROOM_HEIGHT_M[1]
        eyes = [_EYE_M] if usual else [fraction * height_m for fraction in _EYE_FRACTIONS]
        places: list[Place] = []
        for eye in eyes:
            steps = int(eye / self.cell)
            # The floor next to a table, not its top.
            above_floor = cells[:, 2] - minimum_filter(floor, 2 * steps + 1)[tuple(cells[:, :2].T)]
            most = _MOST_PLACES // len(eyes)
            places += self._at(cells[above_floor == steps], eye, height_m)[:most]
        if max((place.free_m for place in places), default=0.0) >= _NARROW * min(eyes):
            return places
        return self._freest(cells, height_m)

    def _at(self, cells: npt.NDArray[np.int64], eye: float, height_m: float) -> list[Place]:
        """Return some of the cubes (n, 3) at the height of an eye as places."""
        from scipy.ndimage import distance_transform_edt

        free = np.zeros(len(cells))
        for level in np.unique(cells[:, 2]):
            # What stands on the floor counts too: it would be near the camera.
            low = level - int(_STANDS * eye / self.cell)
            space_around = distance_transform_edt(~self.filled[:, :, max(low, 0) : level + 1].any(2))
            here = cells[:, 2] == level
            free[here] = space_around[tuple(cells[here, :2].T)]
        return self._far_apart(cells, free, height_m)

    def _freest(self, cells: npt.NDArray[np.int64], height_m: float) -> list[Place]:
        """Return some of the cubes (n, 3) as places, at any height."""
        from scipy.ndimage import distance_transform_edt

        return self._far_apart(cells, distance_transform_edt(~self.filled)[tuple(cells.T)], height_m)

    def _far_apart(self, cells: npt.NDArray[np.int64], free: FloatArray, height_m: float) -> list[Place]:
        """Return some of the cubes (n, 3) with their free distances in cubes (n,), the freest first, all far apart."""
        if not len(cells):
            return []
        most = float(free.max())
        apart = np.where(free >= _FREE_ENOUGH * most, np.inf, -1.0)
        places: list[Place] = []
        best = int(free.argmax())
        while len(places) < _MOST_PLACES and apart[best] > 1.0:
            up = np.array([0, 0, 1])
            above = (self._free_steps(cells[best], up) - 0.5) * self.cell
            # The distance to the middle of a filled cube, less what may lie nearer in it.
            radius = max(float(free[best]) - 1.0, 0.25) * self.cell
            centre = self.origin + (cells[best] + 0.5) * self.cell
            places.append(Place(centre, radius, above, float(free[best]) / most, height_m))
            apart = np.minimum(apart, np.linalg.norm(cells - cells[best], axis=1))
            best = int(apart.argmax())
        return places

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
