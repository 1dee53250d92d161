"""Finds what a camera around a world should show: all of it but for surfaces that lie far off, and wide flat ground."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...geometry.pose import FloatArray

_POINTS, _SEED = 400_000, 1
_BLOCK = 1 << 13
"""Points that are made at a time: what is computed for them stays in the cache."""
_STRAY = 0.01
"""Fraction of the points, at each end of each axis, that may lie far off without deciding what is looked at."""
_FAR = 0.5
"""Points farther out than this many times the extent of the others are stray."""

_STEEP = 0.7
"""A surface is steep where the vertical part of its normal is smaller."""
_MAP, _ABOVE = 64, 0.001
"""Cells of the ground's map along the world's longest side. Things stand higher above it than this fraction of the
side."""
_FEW = 0.002
"""Fraction of the points that must be on things that stand, so that these decide."""
_AROUND, _AROUND_CELLS = 1 / 32, 2
"""Ground is shown so many cells around what stands, of this fraction of its longest side. What stands farther off than
twice that is stray."""
_MOST_CELLS = 2000
"""Along the world's longest side there are no more cells."""
_WIDE = 1.1
"""Ground that is wider than all that by less than this factor is shown whole."""

_MOST, _LOW = 0.9, 0.25
"""So much of the ground must lie lower than this fraction of the height of what stands on it. Rotor blades do not, nor
do hills."""
_SIDE, _SIDES = 0.01, 3
"""The ground must go on for this fraction of its width on so many sides. Wings go on to two sides."""


class Surfaces(NamedTuple):
    """Holds points on all surfaces of a world, each axis by itself in memory: then to look at all points is fast.

    Attributes:
        points: (n, 3), metres.
        normals: (n, 3), unit vectors.
    """

    points: FloatArray
    normals: FloatArray

    @classmethod
    def of(cls, corners: FloatArray) -> Surfaces:
        """Draw points on triangles (m, 3, 3): half by their areas and half by their number, so that small ones
        count."""
        random = np.random.Generator(np.random.PCG64(_SEED))
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        doubled = np.linalg.norm(normal, axis=1)
        weight = np.cumsum(doubled + doubled.mean())
        weight = weight if weight[-1] > 0 else np.arange(1.0, len(corners) + 1)
        which = np.searchsorted(weight, random.random(_POINTS) * weight[-1]).clip(max=len(corners) - 1)
        u, v = np.sqrt(random.random(_POINTS)), random.random(_POINTS)
        points, normals = (np.empty((_POINTS, 3), order="F") for _ in range(2))
        for first in range(0, _POINTS, _BLOCK):
            rows = slice(first, first + _BLOCK)
            some, along, across = which[rows], u[rows], v[rows]
            barycentric = np.stack([1 - along, along * (1 - across), along * across], 1)
            points[rows] = np.einsum("nk,nkc->nc", barycentric, corners[some])
            normals[rows] = normal[some] / np.maximum(doubled[some], 1e-300)[:, None]
        return cls(points, normals)

    def only(self, kept: npt.NDArray[np.bool_]) -> Surfaces:
        """Return some of the points."""
        if kept.all():
            return self
        return Surfaces(_chosen(self.points, kept), _chosen(self.normals, kept))

    def near(self) -> npt.NDArray[np.bool_]:
        """Return which points decide what is looked at: all but a few that lie far off."""
        low, high = _ends(self.points)
        margin = _FAR * float((high - low).max())
        return _within(self.points, low - margin, high + margin)

    def with_little_ground(self) -> npt.NDArray[np.bool_]:
        """Return which points are left without wide flat ground around what stands on it; all where there is none."""
        low, high = self.points.min(0), self.points.max(0)
        side, everything = float((high - low)[:2].max()), np.ones(len(self.points), np.bool_)
        things = self._things(low, side)
        if np.count_nonzero(things) < _FEW * len(things):
            return everything
        first, last = _ends(_chosen(self.points[:, :2], things))
        cell = max(_AROUND * float((last - first).max()), side / _MOST_CELLS) or 1.0
        place = tuple(np.floor((self.points[:, k] - low[k]) / cell).astype(int) + _AROUND_CELLS for k in (0, 1))
        inner = things & _within(self.points[:, :2], first, last)
        stands = np.zeros([along.max() + 1 + _AROUND_CELLS for along in place], np.bool_)
        stands[tuple(along[things] for along in place)] = True
        for _ in range(_AROUND_CELLS):
            stands = _with_next(stands)
        first_cells = np.zeros_like(stands)
        first_cells[tuple(along[inner] for along in place)] = True
        stands = _connected(stands, first_cells)
        shown = (stands | _between(stands))[place]
        if shown.all() or _reach(self.points) < _WIDE * _reach(_chosen(self.points[:, :2], shown)):
            return everything
        if not self._lies_around(shown):
            return everything
        return shown

    def _lies_around(self, shown: npt.NDArray[np.bool_]) -> bool:
        """Return whether the other points are ground: low, and on three sides at least of those that are shown."""
        bottom, top = np.quantile(self.points[shown, 2], [_STRAY, 1 - _STRAY])
        if np.quantile(self.points[~shown, 2], _MOST) > bottom + _LOW * (top - bottom):
            return False
        flat = self.points[:, :2]
        inner = _chosen(flat, shown)
        low, high, first, last = flat.min(0), flat.max(0), inner.min(0), inner.max(0)
        sides = np.concatenate([first - low, high - last])
        return int(np.count_nonzero(sides > _SIDE * float((high - low).max()))) >= _SIDES

    def _things(self, low: FloatArray, side: float) -> npt.NDArray[np.bool_]:
        """Return which points are on steep surfaces above the ground: next to them, the lowest flat surface of those
        that are seen from above."""
        steep = np.abs(self.normals[:, 2]) < _STEEP
        cell = side / _MAP or 1.0
        x, y = (np.floor((self.points[:, k] - low[k]) / cell).astype(int).clip(0, _MAP - 1) for k in (0, 1))
        ground = np.full((_MAP + 2, _MAP + 2), -np.inf)
        flat = ~steep
        np.maximum.at(ground.reshape(-1), (x[flat] + 1) * (_MAP + 2) + y[flat] + 1, self.points[flat, 2])
        ground[np.isinf(ground)] = np.inf
        rows = np.minimum(np.minimum(ground[:-2], ground[1:-1]), ground[2:])
        lowest = np.minimum(np.minimum(rows[:, :-2], rows[:, 1:-1]), rows[:, 2:])
        lowest[np.isinf(lowest)] = -np.inf
        return steep & (self.points[:, 2] > lowest[x, y] + _ABOVE * side)


def _chosen(points: FloatArray, kept: npt.NDArray[np.bool_]) -> FloatArray:
    """Return some of the points (n, c), each axis by itself in memory."""
    return np.stack([along[kept] for along in points.T]).T


def _ends(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return where points (n, c) begin and end along each axis, without those that may lie far off."""
    low, high = np.transpose([np.quantile(along, [_STRAY, 1 - _STRAY]) for along in points.T])
    return low, high


def _within(points: FloatArray, low: FloatArray, high: FloatArray) -> npt.NDArray[np.bool_]:
    """Return which points (n, c) lie between two ends (c)."""
    inside = [(along >= least) & (along <= most) for along, least, most in zip(points.T, low, high, strict=True)]
    return np.asarray(np.logical_and.reduce(inside))


def _with_next(cells: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Return which cells of a map are marked, or lie next to one that is."""
    padded = np.pad(cells, 1)
    rows = padded[:-2] | padded[1:-1] | padded[2:]
    return rows[:, :-2] | rows[:, 1:-1] | rows[:, 2:]


def _connected(cells: npt.NDArray[np.bool_], first: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Return which marked cells of a map one comes to from the first ones, along both axes and by marked cells alone.

    SciPy's ``label`` finds this too, but to import it takes longer than all the rest of a view.
    """
    across = _runs(cells)
    down = 1 + across.max() + _runs(cells.T).T
    # Each cell joins a run across with one down; of runs that are joined, all take the least name.
    first_run, second_run = across[cells], down[cells]
    names, joined = np.empty(0, np.int64), np.arange(1 + down.max())
    while not np.array_equal(names, joined):
        names = joined
        ours, theirs = names[first_run], names[second_run]
        joined = names.copy()
        np.minimum.at(joined, np.maximum(ours, theirs), np.minimum(ours, theirs))
        while not np.array_equal(joined, joined[joined]):
            joined = joined[joined]
    reached = np.zeros(len(names), np.bool_)
    reached[names[across[first & cells]]] = True
    return cells & reached[names[across]]


def _runs(cells: npt.NDArray[np.bool_]) -> npt.NDArray[np.int64]:
    """Number the runs of marked cells in the rows of a map; other cells have any number."""
    ends = np.pad(~cells, ((0, 0), (0, 1)), constant_values=True)  # no run goes on in the next row
    return np.cumsum(ends, dtype=np.int64).reshape(ends.shape)[:, :-1]


def _between(cells: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Return which cells of a map lie between marked ones along both of its axes, such as the middle of a roof."""
    sides = [
        np.flip(np.logical_or.accumulate(np.flip(cells, flipped), axis), flipped)
        for axis in (0, 1)
        for flipped in ((), axis)
    ]
    return np.asarray(np.logical_and.reduce(sides))


def _reach(points: FloatArray) -> float:
    """Return how far points (n, 3) reach in the plane from the middle of their extent."""
    x, y = (along - (along.min() + along.max()) / 2 for along in points[:, :2].T)
    return float(np.sqrt((x * x + y * y).max()))
