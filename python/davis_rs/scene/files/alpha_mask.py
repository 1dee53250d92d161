"""Cuts triangles along the outlines of an alpha mask: leaves, fences and hair that are drawn on flat cards.

What the mask hides is no surface then, so edges, shadows, depth and flow are those of the leaf, in every renderer.
The outline is where the bilinear alpha reaches the cutoff (glTF 2.0 Specification, section 3.9.4). It is followed by
straight lines through parts of the texture's cells (Lorensen and Cline, Marching Cubes, 1987, in two dimensions), with
fewer corners where that moves it by less than a tolerance (Douglas and Peucker 1973).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..._util.budget import Budget
from ...geometry.pose import FloatArray
from ..lost_looks import SOFT, TRANSPARENCY
from ..mesh_part import MeshPart, charge_triangles
from .rounding import ROUNDING

BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]

TOLERANCE_TEXELS = 0.0625
"""How far an outline may move where corners are left out."""
_COARSEST_TEXELS = 8.0
"""An outline that needs more than this is not followed."""
_MOST_CELLS = 1 << 17
"""The most cells of a texture that outlines pass; of finer masks 2 x 2 texels are taken together."""
_MOST_PIECES = 500_000
"""The most pieces of a part: outlines get coarser until there are no more."""
_FEW = 0.05
"""Edges of leaves are soft, too: more than this fraction of texels that let some light through is noted."""
_PARTS, _MOST_NODES = 4, 1 << 22
"""Lines follow the curves of bilinear alpha in so many parts of a cell's side, if the texture has no more texels."""
_CHUNK = 1 << 16
"""How many pieces are cut at a time."""
_FLAT = 1e-12
"""A triangle has no area among texture coordinates below this fraction of its longest side's square."""
_SLIVER = 1e-10
"""The least area of a piece, as a fraction of its triangle's."""


class Pieces(NamedTuple):
    """Holds what is left of triangles.

    Attributes:
        source: (p,), the triangle that each piece is of, in ascending order.
        weights: (p, 3, 3), of the triangle's three corners at each corner of the piece.
        tolerance_texels: by how much outlines may have moved.
    """

    source: IntArray
    weights: FloatArray
    tolerance_texels: float

    def of(self, values: FloatArray) -> FloatArray:
        """Interpolate values (m, 3, n) at the corners of the triangles to those of the pieces (p, 3, n)."""
        return np.einsum("pij,pjk->pik", self.weights, values[self.source])

    def normals(self, values: FloatArray) -> FloatArray:
        """Interpolate unit normals (m, 3, 3), and make them unit again; opposite ones give that of the first corner."""
        found = self.of(values)
        length = np.linalg.norm(found, axis=2, keepdims=True)
        return np.where(length > 1e-6, found / np.maximum(length, 1e-6), values[self.source][:, :1])


@dataclass(frozen=True, eq=False)
class AlphaMask:
    """Says where a texture is to be seen.

    Attributes:
        alpha: uint8 (H, W); row 0 is at v = 0.
        cutoff: alpha / 255 from which on the texture is seen.
        wrap: how the texels continue beyond their edges: repeat, clamp or mirror.
    """

    alpha: npt.NDArray[np.uint8]
    cutoff: float
    wrap: str

    @property
    def is_divided(self) -> bool:
        """Whether some texels are seen, and some are not."""
        return bool(self.alpha.min() < 255 * self.cutoff <= self.alpha.max())

    @property
    def soft_fraction(self) -> float:
        """The fraction of texels that are neither clear nor opaque to a tenth."""
        return float(((self.alpha > 25) & (self.alpha < 230)).mean())

    def cut(self, uv: FloatArray) -> Pieces | None:
        """Cut triangles with texture coordinates (m, 3, 2), v downwards; None if there would be too many pieces."""
        wrapped = self.wrap != "clamp"
        low, high = np.zeros(2), np.ones(2)
        if not wrapped and len(uv):
            low, high = np.minimum(low, uv.min((0, 1))), np.maximum(high, uv.max((0, 1)))
        size = _size(uv)
        area = _area(uv)
        flat = np.abs(area) <= _FLAT * size**2
        tolerance = TOLERANCE_TEXELS
        while tolerance <= _COARSEST_TEXELS:
            outline, cell_texels = self._outline(low, high, tolerance)
            cut = _cut(uv, np.flatnonzero(~flat), outline, self.wrap)
            if cut is not None:
                source, weights = _whole(*cut, len(uv))
                seen = np.flatnonzero(flat)[self._seen(uv[flat].mean(1))]
                source = np.concatenate([source, seen])
                weights = np.concatenate([weights, np.broadcast_to(np.eye(3), (len(seen), 3, 3))])
                order = np.argsort(source, kind="stable")
                return Pieces(source[order], weights[order], tolerance * cell_texels)
            tolerance *= 2
        return None

    def _seen(self, uv: FloatArray) -> BoolArray:
        """Return whether the texels at coordinates (n, 2) are seen."""
        height, width = self.alpha.shape
        texel = np.floor(uv * (width, height)).astype(np.int64)
        sides = np.array([width, height])
        if self.wrap == "clamp":
            texel = np.clip(texel, 0, sides - 1)
        elif self.wrap == "mirror":
            texel = texel % (2 * sides)
            texel = np.minimum(texel, 2 * sides - 1 - texel)
        column, row = (texel % sides).T
        return self.alpha[row, column] >= 255 * self.cutoff

    def _outline(self, low: FloatArray, high: FloatArray, tolerance: float) -> tuple[FloatArray, int]:
        """Return triangles (k, 3, 2) of what is seen of a texture from ``low`` to ``high``, counterclockwise, and how
        many texels a side of a cell has."""
        import contourpy
        import mapbox_earcut

        alpha, cell_texels = self.alpha, 1
        grid = self._grid(alpha, low, high)
        while _crossed_cells(grid[2] >= 255 * self.cutoff) > _MOST_CELLS:
            alpha, cell_texels = _halved(alpha), 2 * cell_texels
            grid = self._grid(alpha, low, high)
        x, y, values = _finer(*grid)
        # What lies on the cutoff is seen.
        level = 255 * self.cutoff - 1e-6
        generator = contourpy.contour_generator(x, y, values, fill_type=contourpy.FillType.OuterOffset)
        cells = np.array(alpha.shape[::-1], np.float64)
        found = []
        for points, offsets in zip(*generator.filled(level, 256.0), strict=True):
            rings = [points[start:end][:-1] for start, end in itertools.pairwise(offsets)]
            rings = [_simplified(ring, cells, (x[0], x[-1], y[0], y[-1]), tolerance) for ring in rings]
            rings = [rings[0], *(ring for ring in rings[1:] if len(ring) >= 3)]
            if len(rings[0]) < 3:
                continue
            corners = np.concatenate(rings)
            ends = np.cumsum([len(ring) for ring in rings]).astype(np.uint32)
            found.append(corners[mapbox_earcut.triangulate_float64(corners, ends).astype(np.int64)].reshape(-1, 3, 2))
        triangles = np.concatenate([np.zeros((0, 3, 2)), *found])
        turned = _area(triangles) < 0
        triangles[turned] = triangles[turned, ::-1]
        return triangles, cell_texels

    def _grid(
        self, alpha: npt.NDArray[np.uint8], low: FloatArray, high: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the coordinates of texels along u and v, with both ends, and alpha there."""
        values = alpha.astype(np.float64)
        axes = []
        for axis, count in ((1, alpha.shape[1]), (0, alpha.shape[0])):
            first, last = (np.take(values, [index], axis) for index in (0, -1))
            if self.wrap == "repeat":
                first = last = (first + last) / 2
            values = np.concatenate([first, values, last], axis)
            along = 1 - axis
            axes.append(np.concatenate([[low[along]], (np.arange(count) + 0.5) / count, [high[along]]]))
        return axes[0], axes[1], values


def _finer(x: FloatArray, y: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Divide the cells of a lattice by bilinear interpolation, as far as there are not too many nodes."""
    parts = _PARTS
    while parts > 1 and values.size * parts**2 > _MOST_NODES:
        parts //= 2
    values = _divided(_divided(values, parts).T, parts).T
    return _divided(x, parts), _divided(y, parts), values


def _divided(values: FloatArray, parts: int) -> FloatArray:
    """Interpolate values (n, ...) at parts of the steps between them, ((n - 1) parts + 1, ...)."""
    index = np.arange((len(values) - 1) * parts + 1)
    first = np.minimum(index // parts, len(values) - 2)
    ahead = ((index - first * parts) / parts).reshape(-1, *[1] * (values.ndim - 1))
    return values[first] * (1 - ahead) + values[first + 1] * ahead


def blended(
    alpha: npt.NDArray[np.uint8] | None, *, factor: float = 1.0, wrap: str = "repeat"
) -> tuple[AlphaMask | None, tuple[str, ...]]:
    """Return the mask that shows best how an alpha blends, and the kinds of looks that are lost.

    Args:
        alpha: uint8 (H, W); None where it is 1 everywhere.
        factor: by which it is multiplied, 0 to 1.
        wrap: as in :class:`AlphaMask`.
    """
    if alpha is not None and factor > 0:
        mask = AlphaMask(alpha, 0.5 / factor, wrap)
        if mask.is_divided:
            return mask, (SOFT,) if mask.soft_fraction > _FEW else ()
    least = factor if alpha is None else factor * float(alpha.min()) / 255
    return None, () if least >= 1 - ROUNDING else (TRANSPARENCY,)


def masked(part: MeshPart, mask: AlphaMask | None, budget: Budget) -> MeshPart:
    """Return what a mask shows of a part that has texture coordinates; of one that would have too many pieces, all.

    Raises:
        DecodeError: if the budget does not allow for the pieces.
    """
    if mask is None or part.uv is None:
        return part
    pieces = mask.cut(part.uv * [1, -1] + [0, 1])
    if pieces is None:
        return part._replace(lost=(*part.lost, TRANSPARENCY))
    budget.count(len(pieces.source), "pieces of triangles that a mask cuts")
    charge_triangles(budget, len(pieces.source), 3 + 3 + 2 + 3, part.material)
    lost = part.lost
    if pieces.tolerance_texels > TOLERANCE_TEXELS:
        lost = (*lost, f"outlines of the alpha mask to less than {pieces.tolerance_texels:g} texels")
    return part._replace(
        corners=pieces.of(part.corners),
        uv=pieces.of(part.uv),
        normals=None if part.normals is None else pieces.normals(part.normals),
        lost=lost,
    )


def _area(triangles: FloatArray) -> FloatArray:
    """Return twice the signed area of triangles (k, 3, 2)."""
    a, b = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def _size(triangles: FloatArray) -> FloatArray:
    """Return the longest side of triangles (k, 3, 2)."""
    return np.asarray(np.linalg.norm(triangles - np.roll(triangles, 1, 1), axis=2).max(1, initial=0.0))


def _crossed_cells(seen: BoolArray) -> int:
    """Count the cells of a lattice with corners of both kinds."""
    corners = [seen[:-1, :-1], seen[:-1, 1:], seen[1:, :-1], seen[1:, 1:]]
    return int((np.logical_or.reduce(corners) & ~np.logical_and.reduce(corners)).sum())


def _halved(alpha: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Return the means of 2 x 2 texels each."""
    height, width = alpha.shape
    even = np.pad(alpha, ((0, height % 2), (0, width % 2)), "edge").astype(np.uint16)
    return ((even[::2, ::2] + even[::2, 1::2] + even[1::2, ::2] + even[1::2, 1::2] + 2) // 4).astype(np.uint8)


def _simplified(
    ring: FloatArray, cells: FloatArray, borders: tuple[float, float, float, float], tolerance: float
) -> FloatArray:
    """Return a ring (n, 2) with fewer corners, none of which moves; lines move by at most ``tolerance`` cells.

    Where the ring meets a border of the texture (left, right, upper, lower), it keeps its corner, because the
    neighbouring tile has the same.
    """
    points = ring * cells
    on = np.stack(
        [ring[:, 0] == borders[0], ring[:, 0] == borders[1], ring[:, 1] == borders[2], ring[:, 1] == borders[3]]
    )
    inside = (on & np.roll(on, 1, 1) & np.roll(on, -1, 1)).any(0)
    kept = on.any(0) & ~inside
    if kept.sum() < 2:
        first = int(kept.argmax())
        far = int(np.linalg.norm(points - points[first], axis=1).argmax())
        kept[[first, far]] = True
    start = int(kept.argmax())
    points, kept, ring = (np.roll(values, -start, 0) for values in (points, kept, ring))
    anchors = [*np.flatnonzero(kept).tolist(), len(points)]
    points = np.concatenate([points, points[:1]])
    chains = list(itertools.pairwise(anchors))
    while chains:
        begin, end = chains.pop()
        if end - begin < 2:
            continue
        between, along = points[begin + 1 : end] - points[begin], points[end] - points[begin]
        square = along @ along
        place = np.clip(between @ along / square, 0, 1)[:, None] if square > 0 else 0.0
        distance = np.linalg.norm(between - place * along, axis=1)
        far = int(distance.argmax())
        if distance[far] > tolerance:
            middle = begin + 1 + far
            kept[middle] = True
            chains += [(begin, middle), (middle, end)]
    return ring[kept]


def _cut(uv: FloatArray, triangles: IntArray, outline: FloatArray, wrap: str) -> tuple[IntArray, FloatArray] | None:
    """Return the pieces (p,), (p, 3, 3) of triangles that lie in any triangle of an outline; None for too many."""
    source, weights, count = [np.zeros(0, np.int64)], [np.zeros((0, 3, 3))], 0
    low, high = outline.min(1), outline.max(1)
    for rows, local in _in_tiles(uv, triangles, wrap):
        for numbers, others in _overlapping(local, low, high):
            count += len(numbers)
            if count > _MOST_PIECES:
                return None
            for start in range(0, len(numbers), _CHUNK):
                pairs = slice(start, start + _CHUNK)
                piece, corners = _clipped(local[numbers[pairs]], outline[others[pairs]])
                source.append(rows[numbers[pairs]][piece])
                weights.append(corners)
    return np.concatenate(source), np.concatenate(weights)


def _in_tiles(uv: FloatArray, triangles: IntArray, wrap: str) -> Iterator[tuple[IntArray, FloatArray]]:
    """Yield triangles, by their numbers, once for each tile of the texture that they may touch, with their
    coordinates (m, 3, 2) in that tile."""
    if wrap == "clamp":
        yield triangles, uv[triangles]
        return
    first = np.floor(uv[triangles].min(1)).astype(np.int64)
    count = np.maximum(np.ceil(uv[triangles].max(1)).astype(np.int64) - first, 1)
    tiles = count.prod(1)
    for start, end in _runs(tiles, _CHUNK):
        number = np.repeat(np.arange(start, end), tiles[start:end])
        index = np.arange(len(number)) - np.repeat(np.cumsum(tiles[start:end]) - tiles[start:end], tiles[start:end])
        tile = first[number] + np.stack([index % count[number, 0], index // count[number, 0]], 1)
        local = uv[triangles[number]] - tile[:, None]
        if wrap == "mirror":
            local = np.where(tile[:, None] % 2 == 1, 1 - local, local)
        yield triangles[number], local


def _runs(sizes: IntArray, most: int) -> Iterator[tuple[int, int]]:
    """Yield runs of neighbours whose sizes add up to ``most`` or less, or which are one alone."""
    total, start = np.cumsum(sizes), 0
    while start < len(sizes):
        before = total[start - 1] if start else 0
        end = max(start + 1, int(np.searchsorted(total, before + most, "right")))
        yield start, end
        start = end


def _overlapping(local: FloatArray, low: FloatArray, high: FloatArray) -> Iterator[tuple[IntArray, IntArray]]:
    """Yield pairs of triangles and of boxes (k, 2) that they may overlap, by their numbers."""
    step = max(1, (1 << 22) // max(1, len(low)))
    for start in range(0, len(local), step):
        part = local[start : start + step]
        least, most = part.min(1)[:, None], part.max(1)[:, None]
        numbers, others = np.nonzero(((least < high) & (most > low)).all(2))
        yield start + numbers, others


def _clipped(uv: FloatArray, others: FloatArray) -> tuple[IntArray, FloatArray]:
    """Cut triangles ``others`` (p, 3, 2) by the sides of the triangles uv (p, 3, 2).

    Returns:
        the numbers (q,) of the pairs that each piece is of, and the weights (q, 3, 3) of the corners of uv at its own.
    """
    base = uv[:, 0]
    a, b = uv[:, 1] - base, uv[:, 2] - base
    twice = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    offset = others - base[:, None]
    second = (offset[..., 0] * b[:, None, 1] - offset[..., 1] * b[:, None, 0]) / twice[:, None]
    third = (a[:, None, 0] * offset[..., 1] - a[:, None, 1] * offset[..., 0]) / twice[:, None]
    polygon = np.stack([1 - second - third, second, third], 2)
    polygon = np.where(twice[:, None, None] < 0, polygon[:, ::-1], polygon)
    corners = np.full(len(polygon), 3)
    for side in range(3):
        polygon, corners = _behind(polygon, corners, side)
    pair, corner = np.nonzero(np.arange(polygon.shape[1] - 2) < corners[:, None] - 2)
    fans = np.stack([polygon[pair, 0], polygon[pair, corner + 1], polygon[pair, corner + 2]], 1)
    large = _area(fans[..., 1:]) > _SLIVER
    return pair[large], fans[large]


def _behind(polygon: FloatArray, corners: IntArray, side: int) -> tuple[FloatArray, IntArray]:
    """Return what of convex polygons (p, n, 3) with so many corners (p,) has a weight ``side`` of 0 or more.

    Source: Sutherland and Hodgman, Reentrant Polygon Clipping, 1974.
    """
    rows, made = np.arange(len(polygon)), np.zeros(len(polygon), np.int64)
    out = np.zeros((len(polygon), polygon.shape[1] + 1, 3))
    for index in range(polygon.shape[1]):
        there = index < corners
        here, ahead = polygon[:, index], polygon[rows, np.where(index + 1 < corners, index + 1, 0)]
        now, then = here[:, side], ahead[:, side]
        kept = there & (now >= 0)
        out[rows[kept], made[kept]] = here[kept]
        made += kept
        crosses = there & ((now >= 0) != (then >= 0))
        fraction = now[crosses] / (now[crosses] - then[crosses])
        at = here[crosses] + fraction[:, None] * (ahead[crosses] - here[crosses])
        at[:, side] = 0.0
        out[rows[crosses], made[crosses]] = at
        made += crosses
    return out, made


def _whole(source: IntArray, weights: FloatArray, count: int) -> tuple[IntArray, FloatArray]:
    """Put triangles of which nothing is cut off together again."""
    left = np.bincount(source, _area(weights[..., 1:]), count)
    whole = left > 1 - 1e-9
    others = ~whole[source]
    number = np.flatnonzero(whole)
    return (
        np.concatenate([source[others], number]),
        np.concatenate([weights[others], np.broadcast_to(np.eye(3), (len(number), 3, 3))]),
    )
