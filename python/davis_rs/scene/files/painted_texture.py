"""Multiplies the textures of a part by colours at the corners of its triangles.

Colours are linear over a triangle, and a texture may be looked up at the same texels by many triangles, so no single
texture has their product. In a new one each triangle has a patch of its own, with the texels that it looks up times its
colour there. Triangles that are alike share a patch. What else is looked up at the same coordinates (metal, normals,
emission) gets a new texture with the same patches.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..._util.budget import Budget
from ...geometry.pose import FloatArray
from ..mesh_part import MeshPart
from ..texel_lookup import WRAP_MODES, bilinear
from ..texture_file import EncodedTexture
from ..textures import Texture
from .triangulation import doubled_area

IntArray = npt.NDArray[np.int64]
Image = npt.NDArray[np.float32] | npt.NDArray[np.uint8]

MOST_TEXELS, MOST_PATCHES = 1 << 24, 300_000
"""The most texels of a new texture, about 200 MB, which a texture that repeats a thousand times exceeds; and the most
patches, which take some ten seconds."""

_TEXEL_BYTES = 12

_TOGETHER = 1 << 18
"""How many texels are made at once."""

_ERROR = 1 / 64
"""What the product may be off between texels that change from black to white; usual textures change by a tenth of that
from one texel to the next. Texels are divided until a line between them is so close."""

_FINEST = 15
"""The most parts of a texel along each axis, an odd number, so that the texels' own centres are among the new ones."""

_FEWEST = 4
"""Into so many parts a triangle is divided that is smaller than a texel."""

_FLATTEST, _LONGEST = 1e-3, 64
"""A triangle of less area for its length, or of hardly any length, gets a patch along its edges, because its texture
coordinates do not tell where on it a point is. And the most texels on a side of that patch."""

_FARTHEST = 1 << 40
"""No part of a texel has a larger number: the smallest steps of float64 must lie between them."""

_UNTURNED = np.array([0.5, 0.5, 1.0])
"""A texel of a normal texture that turns nothing."""


class Patches(NamedTuple):
    """Holds where the patches of triangles lie in a new texture.

    Attributes:
        of_triangle: (m,), the patch of each triangle.
        corners: (p, 3, 2), where its corners look up the old textures, in texels of ``grid`` from their upper left.
        colours: (p, 3, 3), linear RGB there.
        parts: (p,), how many parts a texel is divided into; 0 for patches along the triangle's edges.
        first: (p, 2), the first column and row of parts in the old texture.
        size: (p, 2), columns and rows.
        at: (p, 2), where in the new texture it begins.
        grid: columns and rows of the old textures; of the finest along each axis where they differ.
        shape: rows and columns of the new texture.
    """

    of_triangle: IntArray
    corners: FloatArray
    colours: FloatArray
    parts: IntArray
    first: IntArray
    size: IntArray
    at: IntArray
    grid: tuple[int, int]
    shape: tuple[int, int]

    @classmethod
    def of(cls, grid: tuple[int, int], uv: FloatArray, colours: FloatArray) -> Patches | None:
        """Return the patches of triangles; None where they would be more than :data:`MOST_PATCHES`, have more than
        :data:`MOST_TEXELS`, or lie too far away in the texture.

        Args:
            grid: columns and rows.
            uv: (m, 3, 2), v upwards.
            colours: (m, 3, 3), 0 to 1.
        """
        corners = (uv * [1, -1] + [0, 1]) * grid
        alike, of_triangle = np.unique(
            np.concatenate([corners, colours], 2).reshape(-1, 15), axis=0, return_inverse=True
        )
        corners, colours = np.split(alike.reshape(-1, 3, 5), [2], 2)
        low, high = corners.min(1), corners.max(1)
        extent = (high - low).max(1)
        edges = corners[:, 1:] - corners[:, :1]
        flat = (np.abs(doubled_area(corners)) <= _FLATTEST * extent * np.minimum(extent, 1)) | (extent < 1e-4)
        edges[flat], extent[flat] = np.eye(2), np.maximum(extent[flat], 1)
        slope = np.linalg.norm(np.linalg.solve(edges, colours[:, 1:] - colours[:, :1]), axis=1).max(1)
        # Between texels the product of two lines is off by at most a quarter of both their changes there.
        parts = np.clip(np.ceil(np.sqrt(slope / (4 * _ERROR))), 1, _FINEST)
        parts = np.maximum(parts, np.where(extent < 1, np.ceil(_FEWEST / extent), 1)).astype(np.int64)
        parts = np.where(flat, 0, parts + (parts + 1) % 2)
        if (np.abs(corners).max((1, 2)) * np.maximum(parts, 1)).max(initial=0) > _FARTHEST:
            return None
        first = np.floor(low * parts[:, None] - 0.5).astype(np.int64)
        size = np.floor(high * parts[:, None] - 0.5).astype(np.int64) + 2 - first
        size[flat] = np.minimum(2 * np.ceil(extent[flat, None]) + 2, _LONGEST)
        if len(size) > MOST_PATCHES or size.astype(np.float64).prod(1).sum() > MOST_TEXELS:
            return None
        at, shape = _packed(size)
        return cls(of_triangle.reshape(-1), corners, colours, parts, first, size, at, grid, shape)

    @property
    def uv(self) -> FloatArray:
        """Return the texture coordinates (m, 3, 2) in the new texture, v upwards."""
        scaled = self.corners * self.parts[:, None, None] - self.first[:, None]
        along = np.array([[0, 0], [1, 0], [0, 1]]) * (self.size[:, None] - 1.0) + 0.5
        new = np.where(self.parts[:, None, None] > 0, scaled, along) + self.at[:, None]
        return np.asarray((new / self.shape[::-1] * [1, -1] + [0, 1])[self.of_triangle])

    def painted(
        self, texture: Image, wrap: str, *, coloured: bool = False, along_edges: FloatArray | None = None
    ) -> Texture:
        """Return the new texture (rows, columns, channels) of an old one.

        Args:
            texture: (H, W, channels).
            wrap: how it continues beyond its edges: repeat, clamp or mirror.
            coloured: whether it is multiplied by the colours.
            along_edges: (channels,), what patches along edges have instead; None for the same as others.
        """
        rows, columns = self.shape
        new = np.zeros((rows * columns, texture.shape[2]), np.float32)
        for patch, place in self._texels():
            points, weights = self._lookups(patch, place)
            values = bilinear(texture, (points / self.grid).T, WRAP_MODES.index(wrap))
            if coloured:
                origin, ways = self.colours[patch, 0], self.colours[patch, 1:] - self.colours[patch, :1]
                # Far outside of a small triangle the plane through its colours leaves what colours can be.
                values *= np.clip(origin + (weights[..., None] * ways).sum(1), -1, 2)
            if along_edges is not None:
                values[self.parts[patch] == 0] = along_edges
            x, y = (self.at[patch] + place).T
            new[y * columns + x] = values
        return new.reshape(rows, columns, -1)

    def _texels(self) -> Iterator[tuple[IntArray, IntArray]]:
        """Yield the patch (t,), and the column and row in it (t, 2), of some texels after the other."""
        counts = self.size.prod(1)
        ends = np.cumsum(counts)
        cuts = np.searchsorted(ends, np.arange(0, ends[-1], _TOGETHER)) if len(ends) else np.zeros(0, np.int64)
        for begin, end in pairwise(np.unique(np.append(cuts, len(ends)))):
            patch = np.repeat(np.arange(begin, end), counts[begin:end])
            number = np.arange(len(patch)) - np.repeat(ends[begin:end] - counts[begin:end], counts[begin:end])
            number += ends[begin] - counts[begin]
            row, column = np.divmod(number, self.size[patch, 0])
            yield patch, np.stack([column, row], 1)

    def _lookups(self, patch: IntArray, place: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return where texels look up (t, 2), and how far that is from the first corner towards the second and the
        third, as fractions (t, 2)."""
        # Texels come patch by patch.
        these = slice(patch[0], patch[-1] + 1)
        corners, flat, own = self.corners[these], self.parts[these] == 0, patch - patch[0]
        origin, edges = corners[:, 0], corners[:, 1:] - corners[:, :1]
        inverse = np.linalg.inv(np.where(flat[:, None, None], np.eye(2), edges))
        points = (self.first[patch] + place + 0.5) / np.maximum(self.parts[patch], 1)[:, None]
        weights = ((points - origin[own])[..., None] * inverse[own]).sum(1)
        along = flat[own]
        weights[along] = place[along] / (self.size[patch[along]] - 1)
        points[along] = origin[own[along]] + (weights[along][..., None] * edges[own[along]]).sum(1)
        return points, weights


def is_painted(part: MeshPart) -> bool:
    """Return whether a part has colours at its corners and textures, so that it needs patches."""
    return part.colours is not None and part.uv is not None and bool(_textures(part))


def patches_of(part: MeshPart) -> Patches | None:
    """Return the patches of a part that :func:`is_painted`; None where they would need too large a texture."""
    assert part.uv is not None
    assert part.colours is not None
    rows, columns = np.max([texture.shape[:2] for texture in _textures(part)], 0).tolist()
    return Patches.of((columns, rows), part.uv, part.colours)


def charge(part: MeshPart, patches: Patches, budget: Budget) -> None:
    """Charge a budget for the patches and the new textures of a part.

    Raises:
        DecodeError: if the budget has not enough left.
    """
    rows, columns = patches.shape
    size = _TEXEL_BYTES * rows * columns * (1 + len(_textures(part)))
    size += sum(array.nbytes for array in patches if isinstance(array, np.ndarray))
    budget.take(size, f"{part.material}: its textures times the colours of its vertices")


def painted(part: MeshPart) -> MeshPart:
    """Return a part that has patches with new textures in place of its colours."""
    patches = part.patches
    assert patches is not None
    reflectance, metal, normals, blend = part.reflectance, part.metal, part.normal_texture, part.blend
    emission = part.emission

    def whole(texture: npt.NDArray[np.uint8], wrap: str) -> npt.NDArray[np.uint8]:
        return np.round(patches.painted(texture, wrap)).astype(np.uint8)

    base = reflectance.linear() if isinstance(reflectance, EncodedTexture) else np.ones((1, 1, 3), np.float32)
    if isinstance(emission, EncodedTexture):
        emission = patches.painted(emission.linear(), part.wrap)
    if metal is not None and metal.texels is not None:
        metal = metal._replace(texels=whole(metal.texels, metal.wrap), wrap="clamp")
    if blend is not None and blend.alpha is not None:
        blend = blend._replace(alpha=whole(blend.alpha[..., None], part.wrap)[..., 0])
    if normals is not None:
        scale = 255 if normals.texels.dtype == np.uint8 else 1
        # Where texture coordinates have no directions, nothing is turned.
        texels = patches.painted(normals.texels, normals.wrap, along_edges=_UNTURNED * scale)
        normals = normals._replace(texels=texels / np.float32(scale), wrap="clamp")
    return part._replace(
        uv=patches.uv,
        colours=None,
        reflectance=patches.painted(base, part.wrap, coloured=True),
        emission=emission,
        metal=metal,
        blend=blend,
        normal_texture=normals,
        wrap="clamp",
        patches=None,
    )


def _textures(part: MeshPart) -> list[Image]:
    """Return all that a part looks up."""
    encoded = (what.texels for what in (part.reflectance, part.emission) if isinstance(what, EncodedTexture))
    others = (
        None if part.metal is None else part.metal.texels,
        None if part.blend is None else part.blend.alpha,
        None if part.normal_texture is None else part.normal_texture.texels,
    )
    return [*encoded, *(texture for texture in others if texture is not None)]


def _packed(size: IntArray) -> tuple[IntArray, tuple[int, int]]:
    """Return where patches (p, 2) of columns and rows lie, on shelves of a texture that is about square; and its rows
    and columns."""
    width = max(int(np.ceil(np.sqrt(size.prod(1).sum()))), int(size[:, 0].max(initial=1)))
    at = np.empty_like(size)
    x = y = shelf = 0
    order = np.lexsort((size[:, 0], size[:, 1]))[::-1]
    for number in order.tolist():
        columns, rows = size[number].tolist()
        if x + columns > width:
            x, y = 0, y + shelf
        if x == 0:
            shelf = rows
        at[number] = x, y
        x += columns
    return at, (max(y + shelf, 1), width)
