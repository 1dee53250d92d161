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
from .outlines import simplified
from .rounding import ROUNDING
from .triangulation import doubled_area

BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]

TOLERANCE_TEXELS = 0.0625
"""How far an outline may move where corners are left out."""
_COARSEST_TEXELS, _AREA_OFF = 8.0, 0.1
"""An outline that would have to move farther, or that would lose or gain more of its area, is not followed."""
_MOST_CELLS, _MOST_TEXELS = 1 << 17, 1 << 24
"""The most cells of a texture that outlines pass, and its most texels; of larger ones 2 x 2 are taken together."""
_MOST_PIECES = 300_000
"""The most pieces of a part: outlines get coarser until there are no more."""
_MOST_TILES = 1 << 22
"""The most tiles of a repeated texture that the triangles of a part may touch."""
_FEW = 0.05
"""Edges of leaves are soft, too: more than this fraction of texels that let some light through is noted."""
_PARTS, _MOST_NODES = 4, 1 << 22
"""Into how many parts a cell's side is divided, because bilinear alpha has curved outlines; fewer where that would make
more nodes than this."""
_RAMP = 1e-3
"""Half the width of a hard edge between texels, in texels."""
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


class _Contours(NamedTuple):
    """Holds the outlines of what is seen of a texture.

    Attributes:
        polygons: the rings of each, (n, 2): its outer outline, then its holes.
        low, high: (2,), the ends of the texture along u and v.
        cells: (2,), how many cells the texture has along u and v.
        cell_texels: how many texels a side of a cell has.
    """

    polygons: list[list[FloatArray]]
    low: FloatArray
    high: FloatArray
    cells: FloatArray
    cell_texels: int


@dataclass(frozen=True, eq=False)
class AlphaMask:
    """Says where a texture is to be seen.

    Attributes:
        alpha: uint8 (H, W); row 0 is at v = 0.
        cutoff: alpha / 255 from which on the texture is seen.
        wrap: how the texels continue beyond their edges: repeat, clamp or mirror.
        nearest: the texels have hard edges; others are bilinear.
    """

    alpha: npt.NDArray[np.uint8]
    cutoff: float
    wrap: str
    nearest: bool = False

    @property
    def is_divided(self) -> bool:
        """Whether some texels are seen, and some are not."""
        return bool(self.alpha.min() < 255 * self.cutoff <= self.alpha.max())

    @property
    def is_soft(self) -> bool:
        """Whether more than a few texels are neither clear nor opaque to a tenth."""
        return bool(self._partial.mean() > _FEW)

    @property
    def is_haze(self) -> bool:
        """Whether most of what is seen is neither clear nor opaque: smoke, not a leaf with soft edges."""
        return bool(2 * self._partial.sum() > (self.alpha > 25).sum())

    @property
    def _partial(self) -> BoolArray:
        """Which texels are neither clear nor opaque to a tenth."""
        return np.asarray((self.alpha > 25) & (self.alpha < 230))

    def cut(self, uv: FloatArray) -> Pieces | None:
        """Cut triangles with texture coordinates (m, 3, 2), v downwards.

        Returns:
            None if there would be too many pieces, or if outlines so coarse that there are fewer lose too much area.
        """
        low, high = np.zeros(2), np.ones(2)
        if self.wrap == "clamp" and len(uv):
            low, high = np.minimum(low, uv.min((0, 1))), np.maximum(high, uv.max((0, 1)))
        flat = np.abs(doubled_area(uv)) <= _FLAT * _size(uv) ** 2
        contours = self._contours(low, high)
        tolerance, full = TOLERANCE_TEXELS, None
        while tolerance <= _COARSEST_TEXELS:
            outline = _triangulated(contours, tolerance)
            seen = doubled_area(outline).sum()
            full = seen if full is None else full
            if abs(seen - full) > _AREA_OFF * full:
                return None
            cut = _cut(uv, np.flatnonzero(~flat), outline, self.wrap)
            if cut is not None:
                source, weights = _whole(*cut, len(uv))
                shown = np.flatnonzero(flat)[self._seen(uv[flat].mean(1))]
                source = np.concatenate([source, shown])
                weights = np.concatenate([weights, np.broadcast_to(np.eye(3), (len(shown), 3, 3))])
                order = np.argsort(source, kind="stable")
                return Pieces(source[order], weights[order], tolerance * contours.cell_texels)
            tolerance *= 2
        return None

    def _seen(self, uv: FloatArray) -> BoolArray:
        """Return whether the texels at coordinates (n, 2) are seen."""
        if self.wrap == "clamp":
            uv = np.clip(uv, 0, 1)
        elif self.wrap == "mirror":
            uv = np.minimum(uv % 2, 2 - uv % 2)
        else:
            uv = uv % 1
        height, width = self.alpha.shape
        column, row = np.minimum(np.floor(uv * (width, height)), (width - 1, height - 1)).astype(np.int64).T
        return self.alpha[row, column] >= 255 * self.cutoff

    def _contours(self, low: FloatArray, high: FloatArray) -> _Contours:
        """Return the outlines of what is seen of a texture from ``low`` to ``high``."""
        import contourpy

        alpha, cell_texels = self.alpha, 1
        while alpha.size > _MOST_TEXELS or _crossed_cells(alpha >= 255 * self.cutoff) > _MOST_CELLS:
            alpha, cell_texels = _halved(alpha), 2 * cell_texels
        grid = self._grid(alpha, low, high)
        x, y, values = grid if self.nearest else _finer(*grid)
        # What lies on the cutoff is seen.
        level = 255 * self.cutoff - 1e-6
        generator = contourpy.contour_generator(x, y, values, fill_type=contourpy.FillType.OuterOffset)
        polygons = [
            [points[start : end - 1] for start, end in itertools.pairwise(offsets)]  # the last corner is the first
            for points, offsets in zip(*generator.filled(level, 256.0), strict=True)
        ]
        return _Contours(polygons, low, high, np.array(alpha.shape[::-1], np.float64), cell_texels)

    def _grid(
        self, alpha: npt.NDArray[np.uint8], low: FloatArray, high: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return coordinates along u and v, with both ends, and the alpha between which it is linear."""
        if self.nearest:
            edges = [
                np.concatenate([[start], np.repeat(np.arange(1, count), 2) / count + ramp, [end]])
                for count, start, end in zip(alpha.shape[::-1], low, high, strict=True)
                for ramp in [_RAMP / count * np.resize([-1, 1], 2 * count - 2)]
            ]
            return edges[0], edges[1], alpha.repeat(2, 0).repeat(2, 1).astype(np.float64)
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
    alpha: npt.NDArray[np.uint8] | None, *, factor: float = 1.0, wrap: str = "repeat", nearest: bool = False
) -> tuple[AlphaMask | None, tuple[str, ...]]:
    """Return the mask that shows best how an alpha blends, and the kinds of looks that are lost.

    Args:
        alpha: uint8 (H, W); None where it is 1 everywhere.
        factor: by which it is multiplied, 0 to 1.
        wrap, nearest: as in :class:`AlphaMask`.
    """
    if alpha is not None and factor > 0:
        mask = AlphaMask(alpha, 0.5 / factor, wrap, nearest)
        if mask.is_divided:
            return mask, (SOFT,) if mask.is_soft else ()
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
        colours=None if part.colours is None else pieces.of(part.colours),
        normals=None if part.normals is None else pieces.normals(part.normals),
        lost=lost,
    )


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


def _triangulated(contours: _Contours, tolerance: float) -> FloatArray:
    """Return triangles (k, 3, 2), counterclockwise, that fill contours whose lines move by at most ``tolerance``
    cells."""
    import mapbox_earcut

    found = [np.zeros((0, 3, 2))]
    every = [ring for polygon in contours.polygons for ring in polygon]
    simple = iter(simplified(every, contours.low, contours.high, contours.cells, tolerance))
    for polygon in contours.polygons:
        outer, *holes = itertools.islice(simple, len(polygon))
        if len(outer) < 3:
            continue
        rings = [outer, *(hole for hole in holes if len(hole) >= 3)]
        corners = np.concatenate(rings)
        ends = np.cumsum([len(ring) for ring in rings]).astype(np.uint32)
        found.append(corners[mapbox_earcut.triangulate_float64(corners, ends).astype(np.int64)].reshape(-1, 3, 2))
    triangles = np.concatenate(found)
    turned = doubled_area(triangles) < 0
    triangles[turned] = triangles[turned, ::-1]
    return triangles


def _cut(uv: FloatArray, triangles: IntArray, outline: FloatArray, wrap: str) -> tuple[IntArray, FloatArray] | None:
    """Return the pieces (p,), (p, 3, 3) of triangles that lie in any triangle of an outline; None for too many."""
    if wrap != "clamp" and _tiles(uv[triangles])[1].prod(1).sum() > _MOST_TILES:
        return None
    pairs, count = [], 0
    low, high = outline.min(1), outline.max(1)
    for rows, local in _in_tiles(uv, triangles, wrap):
        for numbers, others in _overlapping(local, outline, low, high):
            count += len(numbers)
            if count > _MOST_PIECES:
                return None
            pairs.append((rows[numbers], local[numbers], others))
    source, weights = [np.zeros(0, np.int64)], [np.zeros((0, 3, 3))]
    for row, corners, others in pairs:
        piece, found = _clipped(corners, outline[others])
        source.append(row[piece])
        weights.append(found)
    return np.concatenate(source), np.concatenate(weights)


def _in_tiles(uv: FloatArray, triangles: IntArray, wrap: str) -> Iterator[tuple[IntArray, FloatArray]]:
    """Yield triangles, by their numbers, once for each tile of the texture that they may touch, with their
    coordinates (m, 3, 2) in that tile."""
    if wrap == "clamp":
        yield triangles, uv[triangles]
        return
    first, count = _tiles(uv[triangles])
    tiles = count.prod(1)
    for start, end in _runs(tiles, _CHUNK):
        number = np.repeat(np.arange(start, end), tiles[start:end])
        index = np.arange(len(number)) - np.repeat(np.cumsum(tiles[start:end]) - tiles[start:end], tiles[start:end])
        tile = first[number] + np.stack([index % count[number, 0], index // count[number, 0]], 1)
        local = uv[triangles[number]] - tile[:, None]
        if wrap == "mirror":
            local = np.where(tile[:, None] % 2 == 1, 1 - local, local)
        yield triangles[number], local


def _tiles(uv: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return the first tile (m, 2) that each triangle may touch, and how many along both axes."""
    first = np.floor(uv.min(1))
    return first, np.clip(np.ceil(uv.max(1)) - first, 1, _MOST_TILES).astype(np.int64)


def _runs(sizes: IntArray, most: int) -> Iterator[tuple[int, int]]:
    """Yield runs of neighbours whose sizes add up to ``most`` or less, or which are one alone."""
    total, start = np.cumsum(sizes), 0
    while start < len(sizes):
        before = total[start - 1] if start else 0
        end = max(start + 1, int(np.searchsorted(total, before + most, "right")))
        yield start, end
        start = end


def _overlapping(
    local: FloatArray, outline: FloatArray, low: FloatArray, high: FloatArray
) -> Iterator[tuple[IntArray, IntArray]]:
    """Yield pairs of triangles that may overlap, by their numbers; ``low`` and ``high`` (k, 2) bound the outline's."""
    step = max(1, (1 << 22) // max(1, len(low)))
    for start in range(0, len(local), step):
        part = local[start : start + step]
        least, most = part.min(1)[:, None], part.max(1)[:, None]
        numbers, others = np.nonzero(((least < high) & (most > low)).all(2))
        for at in range(0, len(numbers), _CHUNK):
            number, other = numbers[at : at + _CHUNK], others[at : at + _CHUNK]
            apart = np.any(np.all(_weights(part[number], outline[other]) <= 0, 1), 1)
            yield start + number[~apart], other[~apart]


def _weights(uv: FloatArray, points: FloatArray) -> FloatArray:
    """Return the weights (p, n, 3) of the corners of triangles (p, 3, 2) at points (p, n, 2)."""
    base = uv[:, 0]
    a, b = uv[:, 1] - base, uv[:, 2] - base
    twice = doubled_area(uv)[:, None]
    offset = points - base[:, None]
    second = (offset[..., 0] * b[:, None, 1] - offset[..., 1] * b[:, None, 0]) / twice
    third = (a[:, None, 0] * offset[..., 1] - a[:, None, 1] * offset[..., 0]) / twice
    return np.stack([1 - second - third, second, third], 2)


def _clipped(uv: FloatArray, others: FloatArray) -> tuple[IntArray, FloatArray]:
    """Cut triangles ``others`` (p, 3, 2) by the sides of the triangles uv (p, 3, 2).

    Returns:
        the numbers (q,) of the pairs that each piece is of, and the weights (q, 3, 3) of the corners of uv at its own.
    """
    polygon = _weights(uv, others)
    polygon = np.where((doubled_area(uv) < 0)[:, None, None], polygon[:, ::-1], polygon)
    corners = np.full(len(polygon), 3)
    for side in range(3):
        polygon, corners = _behind(polygon, corners, side)
    pair, corner = np.nonzero(np.arange(polygon.shape[1] - 2) < corners[:, None] - 2)
    fans = np.stack([polygon[pair, 0], polygon[pair, corner + 1], polygon[pair, corner + 2]], 1)
    large = doubled_area(fans[..., 1:]) > _SLIVER
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
    left = np.bincount(source, doubled_area(weights[..., 1:]), count)
    whole = left > 1 - 1e-9
    others = ~whole[source]
    number = np.flatnonzero(whole)
    return (
        np.concatenate([source[others], number]),
        np.concatenate([weights[others], np.broadcast_to(np.eye(3), (len(number), 3, 3))]),
    )
