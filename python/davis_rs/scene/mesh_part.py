"""What a reader of mesh files hands on: triangles of one material, and what the file's images and colours are."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from .._util.budget import Budget
from ..geometry.pose import FloatArray
from .repairs import Repairs
from .texture_file import EncodedTexture

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
        lost: what the file says of how it looks, and is not shown: kinds of looks.
    """

    corners: FloatArray
    uv: FloatArray | None
    normals: FloatArray | None
    reflectance: EncodedTexture | FloatArray
    colours: FloatArray | None
    material: str
    files: tuple[Path, ...] = ()
    wrap: str = "repeat"
    lost: tuple[str, ...] = ()


def charge_triangles(budget: Budget, triangles: int, numbers: int, where: str) -> None:
    """Charge triangles that have so many numbers at each corner, float64.

    Raises:
        DecodeError: if there is not so much left.
    """
    budget.take(3 * 8 * numbers * triangles, f"{where}: {triangles} triangles of {numbers} numbers at a corner")


def unit_normals(normals: FloatArray, corners: FloatArray, what: str, repairs: Repairs) -> FloatArray:
    """Return normals (m, 3, 3) of unit length; one without a direction becomes that of its triangle.

    Args:
        corners: (m, 3, 3), where they are.
        what: how messages call what they belong to.
        repairs: takes note of those without a direction.
    """
    length = np.linalg.norm(normals, axis=2, keepdims=True)
    useless = ~((length > 0) & (length < np.inf))[..., 0]  # True for NaN too
    unit = np.divide(normals, length, out=np.zeros_like(normals), where=~useless[..., None])
    if useless.any():
        of = np.flatnonzero(useless.any(1))
        own = np.cross(corners[of, 1] - corners[of, 0], corners[of, 2] - corners[of, 0])
        size = np.linalg.norm(own, axis=1, keepdims=True)
        own = np.divide(own, size, out=np.zeros_like(own), where=size > 0)
        own *= np.where(np.einsum("mij,mj->m", unit[of], own) < 0, -1, 1)[:, None]  # the side of its other corners
        unit[of] = np.where(useless[of][..., None], own[:, None], unit[of])
        repairs.add("corners whose normal has no direction take that of their triangle", int(useless.sum()), what)
    return unit


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
