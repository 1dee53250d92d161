"""Makes the points at which irradiance is known on surfaces: a lattice on each triangle, dense where the light bends.

A triangle is divided into four by the middles of its edges, and each part again where that is needed. Between the
points of the densest division everything is linear along edges. A point on an edge belongs to all triangles at the
edge, as long as these have one normal there, so that what is interpolated has no seam.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ...events.luma import LUMA_WEIGHTS

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

MOST_DIVISIONS = 10
"""A triangle's edge has 2 to the power of that many parts at most."""

INWARDS = 0.02
"""Points are moved by that share of the way to the middle of the triangles around them, so that those in a corner of a
room are not within its wall."""

_NORMAL_DIGITS = 4
_SHARED_NORMALS = 4.0
"""Normals share a place if their components lie between the same multiples of 1 / 4."""
_GRIDS_AT_ONCE = 1 << 16
"""Grids that are made together, so that millions of triangles do not fill the memory."""
_BURIED_SPACING = 4.0
"""How many times as far apart points are where no light comes."""

_BEAM_SPACING, _BEAM = 0.5, 0.25
"""The same on triangles less high than this fraction of their longest edge: the ends of a beam may lie in posts."""

_SEEN_WEIGHT = 3.0
"""How much more all that a camera sees counts than all surfaces by their area."""

_DARK = 1e-3
"""What is darker than this share of the median is held to the error of that share."""


class SurfaceLattice:
    """Holds the sides of a scene's triangles that reflect, over common vertices.

    Args:
        corners: float64 (t, 3, 3), of the triangles, metres.
        normals: float64 (t, 3, 3), unit shading normals of the front at the corners.
        two_sided: (t), whether the back reflects too.
        frames: (t), the frame that each is in: 0 for the world, 1, 2, ... for bodies that move.
        shared: the side of cubes, metres: corners within one that have similar normals are one vertex. If 0, corners
            are one vertex where they and their normals are the same.
        apart: (t), triangles whose corners share vertices among each other alone, and only where they are the same.

    Attributes:
        positions, normals: (v, 3), of the vertices.
        frames: (v), of the vertices.
        faces: (f, 3), the vertices of each side: the fronts of all triangles, then the backs of those that have one.
        triangles: (f), the triangle of each side.
    """

    def __init__(
        self,
        corners: FloatArray,
        normals: FloatArray,
        two_sided: npt.NDArray[np.bool_],
        frames: IntArray,
        shared: float = 0.0,
        apart: BoolArray | None = None,
    ) -> None:
        backs = np.flatnonzero(two_sided)
        self.triangles = np.concatenate([np.arange(len(corners)), backs])
        positions = corners[self.triangles].reshape(-1, 3)
        facing = np.concatenate([normals, -normals[backs]]).reshape(-1, 3)
        owners = np.repeat(frames[self.triangles], 3)
        exact, places = np.ones(len(positions), bool), positions
        if shared > 0:
            exact[:] = False if apart is None else np.repeat(apart[self.triangles], 3)
            places = np.where(exact[:, None], positions, np.floor(positions / shared))
        # Not at a multiple of what normals are rounded to: those of flat walls lie there.
        steps = np.where(exact, 10.0**_NORMAL_DIGITS, _SHARED_NORMALS)[:, None]
        rounded = np.floor(facing * steps + 0.377).astype(np.int16)
        first, vertex = _distinct_rows([*places.T, *rounded.T, owners, exact])
        self.positions, self.normals, self.frames = positions[first], facing[first], owners[first]
        self.faces = vertex.reshape(-1, 3)


def _distinct_rows(columns: Sequence[npt.NDArray[Any]]) -> tuple[IntArray, IntArray]:
    """Find rows that are alike: the first of each kind, in sorted order, and the kind of every row.

    This is :func:`numpy.unique` along an axis, without its copies of all columns, which fill the memory for millions of
    triangles.
    """
    order = np.lexsort(columns[::-1])
    differs = np.ones(len(order), bool)
    differs[1:] = False
    for column in columns:
        in_order = column[order]
        differs[1:] |= in_order[1:] != in_order[:-1]
    kind = np.empty(len(order), np.int64)
    kind[order] = np.cumsum(differs) - 1
    return order[differs], kind


@dataclass(frozen=True)
class RefinementRule:
    """Says how densely a lattice is sampled.

    Attributes:
        spacing: edges longer than this are always divided, metres.
        finest: edges shorter than this never, metres.
        tolerance: an edge whose middle is off by more than this share of the light is divided.
        most_points: so many points are added to the corners of triangles at most. Where more are wanted, they go where
            light errs on the largest areas.
        inwards: by which share of the way to the middle of the triangles around them points are moved.
    """

    spacing: float
    finest: float
    tolerance: float
    most_points: int
    inwards: float = INWARDS


class CellHits:
    """Holds places that a camera sees, each in one of the cells of a lattice, while these are divided.

    Args:
        cells: int64 (h), the number of the cell of each; those of a :class:`SurfaceLattice` are its sides.
        weights: float64 (h, 3), barycentric coordinates in it.
    """

    def __init__(self, cells: IntArray, weights: FloatArray) -> None:
        self.cells, self.weights = cells, weights

    def counts(self, cells: int) -> IntArray:
        """Return how many hits each of so many cells has."""
        return np.bincount(self.cells, minlength=cells)

    def among(self, chosen: npt.NDArray[np.bool_]) -> CellHits:
        """Return the hits of some of the cells, which are numbered anew."""
        number = np.where(chosen, np.cumsum(chosen) - 1, -1)[self.cells]
        return CellHits(number[number >= 0], self.weights[number >= 0])

    def divided(self, cells: int) -> CellHits:
        """Return the hits of the parts of so many cells, in the order of :func:`_parts`."""
        corner = self.weights.argmax(1)
        in_middle = self.weights[np.arange(len(corner)), corner] < 0.5
        part = np.where(in_middle, 3, corner)
        # The part in the middle has the corners 01, 12 and 20: each is opposite to a corner of the whole.
        middle = 1 - 2 * self.weights[:, [2, 0, 1]]
        outer = 2 * self.weights
        outer[np.arange(len(corner)), corner] -= 1
        return CellHits(part * cells + self.cells, np.where(in_middle[:, None], middle, outer))


@dataclass(frozen=True)
class SampledLight:
    """Holds light at the points of a :class:`SurfaceLattice` and of its divisions.

    Attributes:
        faces: (f, 3), vertices of the sides.
        values: (n, 3), RGB at the points; vertices come first.
        edges: int64 (e), sorted: divided edges, each the number of its one end times 2^32 plus that of the other,
            larger one.
        middles: (e), the points in their middles.
        error: root mean square of how far the last middles were off, over 4: what interpolation errs, relative.
        complete: whether all edges were divided that should be.
        positions, normals, frames: (n, 3) and (n), where the points' light was computed.
        buried: bool (n), points that no light reaches: theirs is that of their neighbours.
        levels: the cells before and after each division, vertices (c, 3) each.
    """

    faces: IntArray
    values: FloatArray
    edges: IntArray
    middles: IntArray
    error: float
    complete: bool
    positions: FloatArray
    normals: FloatArray
    frames: IntArray
    buried: npt.NDArray[np.bool_]
    levels: list[IntArray]

    def with_light(self, light_at: Callable[[FloatArray, FloatArray, IntArray], FloatArray]) -> SampledLight:
        """Return other light at the same points: RGB (k, 3) at positions (k, 3) with normals (k, 3) in frames (k)."""
        values = np.full_like(self.values, np.nan)
        seen = ~self.buried
        values[seen] = light_at(self.positions[seen], self.normals[seen], self.frames[seen])
        return replace(self, values=_without_buried(values, self.levels))

    def with_vectors(
        self, sides: npt.NDArray[np.bool_], vectors_at: Callable[[FloatArray, FloatArray, IntArray], FloatArray]
    ) -> list[SampledLight]:
        """Return the x, y and z of vectors at the points of some sides (f), and 0 elsewhere.

        Args:
            vectors_at: as that of :meth:`with_light`, (k, 3 axes, 3).
        """
        seen = self._on(sides) & ~self.buried
        values = np.zeros((len(self.values), 3, 3))
        values[self.buried] = np.nan
        values[seen] = vectors_at(self.positions[seen], self.normals[seen], self.frames[seen])
        return [replace(self, values=_without_buried(values[:, axis].copy(), self.levels)) for axis in range(3)]

    def _on(self, sides: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
        """Return which points (n) lie on some sides (f)."""
        on = np.zeros(len(self.values), bool)
        on[self.faces[sides]] = True
        first, second = self.edges >> 32, self.edges & 0xFFFFFFFF
        for _ in self.levels:  # an end may be a middle of the division before
            on[self.middles] = on[first] & on[second]
        return on

    def middle_of(self, a: IntArray, b: IntArray) -> IntArray:
        """Return the point in the middle of each edge, -1 where it was not divided or has an end of -1."""
        middles = np.full(a.shape, -1)
        known = (a >= 0) & (b >= 0)
        if not len(self.edges) or not known.any():
            return middles
        a, b = a[known], b[known]
        keys = _keys(np.minimum(a, b), np.maximum(a, b))
        at = np.searchsorted(self.edges, keys).clip(max=len(self.edges) - 1)
        middles[known] = np.where(self.edges[at] == keys, self.middles[at], -1)
        return middles

    def divisions(self) -> IntArray:
        """Return how often (f) each side is divided anywhere, its edges included."""
        depth = np.zeros(len(self.faces), np.int64)
        faces, ids = np.arange(len(self.faces)), _first_grid(self.faces)
        for level in range(1, MOST_DIVISIONS + 1):
            ids = _finer_ids(self, ids)
            grown = (ids[:, 1::2] >= 0).any((1, 2)) | (ids[:, ::2, 1::2] >= 0).any((1, 2))
            faces, ids = faces[grown], ids[grown]
            depth[faces] = level
            if not len(faces):
                break
        return depth

    def grids(self, depth: IntArray) -> Iterator[tuple[IntArray, FloatArray]]:
        """Yield sides that are divided equally often, by ``depth`` (f), and their values on grids (m, n + 1, n + 1, 3).

        Place [i, j] of a grid is corner 0 plus i / n of the edge to corner 1 and j / n of that to corner 2. Beyond the
        third edge the nearest places go on so that bilinear interpolation is linear on that edge.
        """
        faces, ids = np.arange(len(self.faces)), _first_grid(self.faces)
        values = np.where(ids[..., None] >= 0, self.values[ids], 0.0)
        for level in range(MOST_DIVISIONS + 1):
            done = depth[faces] == level
            if done.any():
                done_faces, done_values = faces[done], values[done]
                for start in range(0, len(done_faces), _GRIDS_AT_ONCE):
                    part = slice(start, start + _GRIDS_AT_ONCE)
                    yield done_faces[part], _beyond_third_edge(done_values[part])
            faces, ids, values = faces[~done], ids[~done], values[~done]
            if not len(faces):
                return
            ids, values = self._finer(ids, values)

    def _finer(self, ids: IntArray, values: FloatArray) -> tuple[IntArray, FloatArray]:
        ids = _finer_ids(self, ids)
        n = ids.shape[1] - 1
        finer = np.zeros((*ids.shape, 3))
        finer[:, ::2, ::2] = values
        finer[:, 1::2, ::2] = (values[:, :-1] + values[:, 1:]) / 2
        finer[:, ::2, 1::2] = (values[:, :, :-1] + values[:, :, 1:]) / 2
        finer[:, 1::2, 1::2] = (values[:, :-1, 1:] + values[:, 1:, :-1]) / 2
        inside = np.add.outer(np.arange(n + 1), np.arange(n + 1)) <= n
        known = (ids >= 0) & inside
        finer[known] = self.values[ids[known]]
        finer[:, ~inside] = 0.0
        return ids, finer


def refine(
    lattice: SurfaceLattice,
    light_at: Callable[[FloatArray, FloatArray, IntArray, BoolArray], tuple[FloatArray, FloatArray]],
    rule: RefinementRule,
    told: Callable[[int, int], None] = lambda *_: None,
    hits: CellHits | None = None,
) -> SampledLight:
    """Sample light on a lattice, and divide triangles where it bends.

    Args:
        light_at: RGB (k, 3) at positions (k, 3) with unit normals (k, 3) in frames (k), or NaN where no light can come:
            within a solid; and luma (k) of what other light there is: an error is small or large in relation to all of
            it. The last argument (k) says which of them are corners of a cell with hits.
        told: is told before each step how many points there are, and how many there will be.
        hits: what a camera sees. Where there is not room for all that should be divided, most of it is for that.
    """
    hits = CellHits(np.empty(0, np.int64), np.empty((0, 3))) if hits is None else hits
    positions, normals, frames, cells = lattice.positions, lattice.normals, lattice.frames, lattice.faces
    where = [_inside(positions, normals, cells, np.arange(len(positions)), cells, rule.inwards)]
    seen = np.zeros(len(positions), bool)
    seen[cells[hits.cells]] = True
    values, others = light_at(*where[0], frames, seen)
    whole_area, all_hits = float(np.sum(_longest_edges(positions, cells) ** 2)), max(len(hits.cells), 1)
    keys, middles = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    levels, errors, complete = [cells], [np.zeros(1)], True
    failed = np.zeros(len(cells), bool)
    for level in range(MOST_DIVISIONS):
        size = _longest_edges(positions, cells)
        spread = _bend(values, others, cells)
        first = failed if level else spread > rule.tolerance
        # What lies within a solid, or behind a wall, is only looked through for what does not.
        buried = np.isnan(values[cells, 0]).all(1)
        hidden = np.where(_doubled_areas(positions, cells) < _BEAM * size**2, _BEAM_SPACING, _BURIED_SPACING)
        spacing = np.where(buried, hidden, 1.0) * rule.spacing
        wanted = (size > rule.finest) & ((size > spacing) | first)
        cells, size, spread, long = cells[wanted], size[wanted], spread[wanted], (size > spacing)[wanted]
        hits = hits.among(wanted)
        room = (rule.most_points - (len(positions) - len(lattice.positions))) * 2 // 3
        if len(cells) > room:
            complete = False
            # Each gets a share of the room, and is divided if that is enough for itself. A quarter of a cell errs by
            # half as much on a quarter of the area, so shares of this power are what divisions would take until all
            # err alike. A test of all edges would cost what there is no room for.
            bend = np.nan_to_num(spread, nan=1.0)
            weight = size**2 / whole_area + _SEEN_WEIGHT * hits.counts(len(cells)) / all_hits
            share = (np.where(long, np.maximum(bend, 1.0), bend) * weight) ** (2 / 3)
            chosen = (room * share >= share.sum()) & (room > 0)
            cells, hits = cells[chosen], hits.among(chosen)
        if not len(cells):
            break
        ends = np.sort(np.stack([cells[:, [0, 1]], cells[:, [1, 2]], cells[:, [2, 0]]], 1), -1)
        key, of_cell = np.unique(_keys(ends[..., 0], ends[..., 1]), return_inverse=True)
        of_cell = of_cell.reshape(-1, 3)
        a, b = key >> 32, key & 0xFFFFFFFF
        told(len(positions), len(positions) + len(key))
        new = len(positions) + np.arange(len(key))
        positions = np.concatenate([positions, (positions[a] + positions[b]) / 2])
        sum_of_normals = normals[a] + normals[b]
        normals = np.concatenate([normals, _unit(sum_of_normals, normals[a])])
        middle = new[of_cell]
        frames = np.concatenate([frames, frames[a]])
        where.append(_inside(positions, normals, cells, new, middle, rule.inwards))
        seen = np.zeros(len(key), bool)
        seen[of_cell[hits.cells]] = True
        light, other = light_at(*where[-1], frames[new], seen)
        values, others = np.concatenate([values, light]), np.concatenate([others, other])
        keys.append(key)
        middles.append(new)
        off = _relative(values[new] - (values[a] + values[b]) / 2, values[new], others[new], values)
        buried = np.isnan(values[[a, b, new], 0])
        off = np.where(buried.all(0), 0.0, np.where(buried.any(0), np.inf, off))
        divided, hits = _parts(cells, middle), hits.divided(len(cells))
        levels.append(divided)
        failed_edge = off > rule.tolerance
        # A neighbour of what bends may bend where its own middles do not show it.
        near = np.zeros(len(positions), bool)
        near[np.concatenate([a[failed_edge], b[failed_edge], new[failed_edge]])] = True
        failed = np.tile(near[cells].any(1), 4)
        errors.append(off[~failed_edge])
        cells = divided
    buried = np.isnan(values[:, 0])
    order = np.argsort(every := np.concatenate(keys), kind="stable")
    return SampledLight(
        lattice.faces,
        _without_buried(values, levels),
        every[order],
        np.concatenate(middles)[order],
        float(np.sqrt(np.mean(np.concatenate(errors) ** 2)) / 4),
        complete,
        np.concatenate([positions for positions, _ in where]),
        np.concatenate([facing for _, facing in where]),
        frames,
        buried,
        levels,
    )


def _keys(low: IntArray, high: IntArray) -> IntArray:
    return np.asarray((low << 32) | high)


def _first_grid(faces: IntArray) -> IntArray:
    grid = np.full((len(faces), 2, 2), -1)
    grid[:, 0, 0], grid[:, 1, 0], grid[:, 0, 1] = faces.T
    return grid


def _finer_ids(light: SampledLight, ids: IntArray) -> IntArray:
    n = 2 * (ids.shape[1] - 1)
    finer = np.full((len(ids), n + 1, n + 1), -1)
    finer[:, ::2, ::2] = ids
    finer[:, 1::2, ::2] = light.middle_of(ids[:, :-1], ids[:, 1:])
    finer[:, ::2, 1::2] = light.middle_of(ids[:, :, :-1], ids[:, :, 1:])
    finer[:, 1::2, 1::2] = light.middle_of(ids[:, :-1, 1:], ids[:, 1:, :-1])
    return finer


def _beyond_third_edge(values: FloatArray) -> FloatArray:
    """Fill the places of grids beyond the third edge, in place, as :meth:`SampledLight.grids` has them."""
    n = values.shape[1] - 1
    i = np.arange(1, n + 1)
    j = n + 1 - i
    values[:, i, j] = values[:, i, j - 1] + values[:, i - 1, j] - values[:, i - 1, j - 1]
    return values


def _parts(cells: IntArray, middle: IntArray) -> IntArray:
    """Divide cells (c, 3) into four each, at the middles (c, 3) of their edges 01, 12 and 20."""
    a, b, c = cells.T
    ab, bc, ca = middle.T
    return np.concatenate([np.stack(corners, 1) for corners in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])


def _longest_edges(positions: FloatArray, cells: IntArray) -> FloatArray:
    corners = positions[cells]
    return np.asarray(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).max(1))


def _doubled_areas(positions: FloatArray, cells: IntArray) -> FloatArray:
    a, b, c = np.moveaxis(positions[cells], 1, 0)
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1))


def _inside(
    positions: FloatArray, normals: FloatArray, cells: IntArray, points: IntArray, of_cell: IntArray, inwards: float
) -> tuple[FloatArray, FloatArray]:
    """Return positions and normals of points (p), moved towards the middles of cells (c, 3) that have them (c, 3)."""
    centres = np.repeat(positions[cells].mean(1), 3, axis=0)
    at = of_cell.ravel() - points[0]
    count = np.bincount(at, minlength=len(points))
    sums = np.stack([np.bincount(at, centres[:, axis], len(points)) for axis in range(3)], 1)
    middle = sums / np.maximum(count, 1)[:, None]
    unmoved = positions[points]
    return unmoved + np.where(count[:, None] > 0, inwards, 0.0) * (middle - unmoved), normals[points]


def _unit(vectors: FloatArray, otherwise: FloatArray) -> FloatArray:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 1e-6, vectors / np.maximum(length, 1e-6), otherwise)


def _relative(difference: FloatArray, value: FloatArray, other: FloatArray, values: FloatArray) -> FloatArray:
    """Return differences (k, 3) as a fraction of light (k, 3) and other light (k), all channels weighted as luma is."""
    luma = values @ LUMA_WEIGHTS
    lit = luma[luma > 0]
    floor = _DARK * float(np.median(lit)) if len(lit) else 1.0
    return np.asarray((np.abs(difference) @ LUMA_WEIGHTS) / (np.nan_to_num(value) @ LUMA_WEIGHTS + other + floor))


def _bend(values: FloatArray, others: FloatArray, cells: IntArray) -> FloatArray:
    corners = values[cells]
    return _relative(np.ptp(corners, axis=1), corners.mean(1), others[cells].mean(1), values)


def _without_buried(values: FloatArray, levels: list[IntArray]) -> FloatArray:
    """Give points within solids the values of the nearest points that are not. Nobody sees them, yet what is seen next
    to them is interpolated from them too. Those that have no such neighbour become 0."""
    values = values.copy()
    for cells in reversed(levels):
        for _ in range(2):
            corners = values[cells]
            known = ~np.isnan(corners[..., 0])
            mixed = known.any(1) & ~known.all(1)
            if not mixed.any():
                break
            mean = np.nansum(corners[mixed], axis=1) / known[mixed].sum(1)[:, None]
            unknown = ~known[mixed]
            target = cells[mixed][unknown]
            means = np.repeat(mean, unknown.sum(1), axis=0)
            count = np.bincount(target, minlength=len(values))
            sums = np.stack([np.bincount(target, means[:, c], len(values)) for c in range(values.shape[1])], 1)
            fill = count > 0
            values[fill] = sums[fill] / count[fill, None]
    return np.nan_to_num(values, nan=0.0)
