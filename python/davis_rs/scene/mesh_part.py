"""What a reader of mesh files hands on: triangles of one material, and what the file's images and colours are."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..pose import FloatArray
from .textures import Texture

GREY = 0.5
"""Reflectance of what has no material."""


class MeshPart(NamedTuple):
    """Triangles of one material.

    Attributes:
        corners: (m, 3, 3) positions of each triangle's three corners, in the file's own axes and unit.
        uv: (m, 3, 2) texture coordinates there, v upwards from the lower edge of the image; None: without.
        normals: (m, 3, 3) of a smooth surface; None: every triangle is flat.
        reflectance: a texture, or a colour (3,), linear RGB.
        colours: (m, 3, 3), a colour at each corner in linear RGB, in the place of ``reflectance``; None: without.
        material: how the file calls it, for messages and names of shapes.
        files: those that were read in addition to the mesh: of materials, of the texture.
        wrap: how the texture goes on beyond its edges: repeat, clamp or mirror.
    """

    corners: FloatArray
    uv: FloatArray | None
    normals: FloatArray | None
    reflectance: Texture | FloatArray
    colours: FloatArray | None
    material: str
    files: tuple[Path, ...] = ()
    wrap: str = "repeat"


def fan(
    corners: npt.NDArray[np.int64], positions: FloatArray, what: str, numbers: npt.NDArray[Any]
) -> npt.NDArray[np.int64]:
    """How to cut convex polygons into triangles: from the first corner to each edge that does not touch it.

    Args:
        corners: (m, n), the vertices of m polygons of n corners each.
        positions: (v, 3) of all vertices.
        what, numbers: how messages call a polygon: the file and what is numbered, and the (m,) numbers.

    Returns:
        (n - 2, 3), the triangles as places 0 to n - 1 in a row of ``corners``.

    Raises:
        ValueError: for a polygon that is not convex, which this would cut wrongly.
    """
    n = corners.shape[1]
    cut = np.stack([np.zeros(n - 2, np.int64), np.arange(1, n - 1), np.arange(2, n)], 1)
    if n > 3:
        first, second, third = np.moveaxis(positions[corners[:, cut]], 2, 0)
        normals = np.cross(second - first, third - first)
        along = np.einsum("mij,mj->mi", normals, normals.sum(1))
        wrong = (along < -1e-9 * (normals**2).sum((1, 2))[:, None]).any(1)
        if wrong.any():
            raise ValueError(
                f"{what} {int(numbers[wrong.argmax()])} has {n} corners and is not convex; export triangles "
                "(in Blender: Geometry, Triangulated Mesh)"
            )
    return cut


def check_finite(values: FloatArray, what: str, where: str) -> None:
    """Refuse numbers that are not finite, or too large for the renderer's float32.

    Raises:
        ValueError: naming what they are, the file and the first of them.
    """
    bad = ~(np.abs(values) < 1e18).all(-1)  # False for NaN too; squares of lengths must fit in float32
    if bad.any():
        index = int(bad.argmax())
        shown = ", ".join(f"{value:g}" for value in values[index])
        raise ValueError(f"{where}: {what} {index + 1} must be finite, got ({shown})")
