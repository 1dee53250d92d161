"""Defines what readers of mesh files return: triangles of one material, with its colours and textures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np
import numpy.typing as npt

from .._util.budget import Budget
from ..geometry.pose import FloatArray
from .repairs import Repairs
from .texture_file import EncodedTexture
from .textures import Texture

if TYPE_CHECKING:
    from .files.painted_texture import Patches

GREY = 0.5
"""Reflectance of surfaces without a material."""


USUAL_INDEX = 1.5
"""The index of refraction of what glTF files say nothing of."""


class Coat(NamedTuple):
    """A clear coat above a part, as Mitsuba's ``principled`` has it.

    Attributes:
        strength: 0 to 1.
        gloss: 0 (rough) to 1 (nearly a mirror).
    """

    strength: float
    gloss: float


class MetalRoughness(NamedTuple):
    """How a part reflects besides its base colour, as glTF says it: as a metal to some fraction, more or less rough.

    Attributes:
        metal: the fraction of metal, 0 to 1.
        roughness: 0 to 1.
        texels: uint8 (H, W, 3), looked up as the base colour: green / 255 is a factor on the roughness, blue / 255 one
            on the metal; None where both are the same everywhere.
        wrap: how the texels continue beyond their edges: repeat, clamp or mirror.
        refraction: the index of what is no metal, above 1.
        coat: above all; None where there is none.
        anisotropic: how much rougher it is along u than across, as Mitsuba's ``principled`` has it; below 0 it is
            smoother. Not with ``texels``.
    """

    metal: float
    roughness: float
    texels: npt.NDArray[np.uint8] | None = None
    wrap: str = "repeat"
    refraction: float = USUAL_INDEX
    coat: Coat | None = None
    anisotropic: float = 0.0

    @property
    def shows_index(self) -> bool:
        """Whether any of it is no metal."""
        return self.metal < 1 or self.texels is not None


class Blend(NamedTuple):
    """How much of its area a part covers; the rest is seen through.

    Attributes:
        opacity: the fraction, 0 to 1.
        alpha: uint8 (H, W), looked up as the base colour: 1 / 255 of it is a factor on the opacity; None for 1.
    """

    opacity: float
    alpha: npt.NDArray[np.uint8] | None = None


class Glass(NamedTuple):
    """What a part of glass does to light, which it reflects by Fresnel's equations.

    Attributes:
        refraction: its index, other than 1.
        tint: (3,), factors on red, green and blue that pass.
        is_solid: it is the surface of a solid, which bends light; else a thin sheet, which does not.
        roughness: of the surface of a solid, 0 to 1.
        absorption: (3,), how much light a solid absorbs inside per metre (Beer's law), RGB; None for none.
    """

    refraction: float
    tint: FloatArray
    is_solid: bool
    roughness: float = 0.0
    absorption: FloatArray | None = None


class NormalTexture(NamedTuple):
    """Which way a part's normal is turned, in the tangent space of its texture coordinates.

    Attributes:
        texels: uint8 or float32 (H, W, 3), looked up where the base colour is: components along the tangent (to the
            right in the picture), the second tangent (upwards in it) and the normal, from -1 (0) to 1 (255 of uint8, 1
            of float32).
        wrap: how the texels continue beyond their edges: repeat, clamp or mirror.
    """

    texels: npt.NDArray[np.uint8] | npt.NDArray[np.float32]
    wrap: str = "repeat"


class MeshPart(NamedTuple):
    """Holds triangles of one material.

    Attributes:
        corners: (m, 3, 3) positions of each triangle's three corners, in the file's own axes and unit, float64 until
            the part is :meth:`rounded`.
        uv: (m, 3, 2) texture coordinates there, v upwards from the lower edge of the image; None without.
        normals: (m, 3, 3) of a smooth surface, likewise; None where every triangle is flat.
        reflectance: a texture (H, W, 3), or a colour (3,), linear RGB.
        colours: (m, 3, 3), a colour at each corner in linear RGB: a factor on ``reflectance`` where that is a texture,
            else instead of it; None without.
        material: its name in the file, for messages and names of shapes.
        files: other files that were read: of materials, of the texture.
        wrap: how the texture continues beyond its edges: repeat, clamp or mirror.
        lost: the kinds of its looks that are not shown.
        metal: how it reflects besides its base colour; None where it is diffuse.
        nearest: the texture's texels have hard edges; others are bilinear.
        emission: radiance that it emits, a texture or a colour (3,), linear RGB; None for none. As a texture it is
            looked up as ``reflectance`` is.
        unlit: it reflects nothing, and emits what ``reflectance`` or ``colours`` say.
        blend: how much of its area it covers; None where it is opaque. A part that blends is diffuse.
        glass: what it does to light; None where it is opaque. Then ``reflectance`` does not count.
        one_sided: its back is culled, which is the side on which a triangle's corners run clockwise: from behind, one
            sees through it.
        normal_texture: what turns its normals; None where nothing does.
        patches: where its triangles lie in the new textures that have its ``colours`` in them; None where it has no
            colours, or no textures.
    """

    corners: FloatArray
    uv: FloatArray | None
    normals: FloatArray | None
    reflectance: EncodedTexture | Texture | FloatArray
    colours: FloatArray | None
    material: str
    files: tuple[Path, ...] = ()
    wrap: str = "repeat"
    lost: tuple[str, ...] = ()
    metal: MetalRoughness | None = None
    nearest: bool = False
    emission: EncodedTexture | Texture | FloatArray | None = None
    unlit: bool = False
    blend: Blend | None = None
    glass: Glass | None = None
    one_sided: bool = False
    normal_texture: NormalTexture | None = None
    patches: Patches | None = None

    def rounded(self) -> MeshPart:
        """Return the part with corners and normals in float32, in which renderers take them, once nothing more is
        computed of them: that is half of the memory of a part without textures."""

        def single(values: FloatArray) -> FloatArray:
            # Only what takes any floating-point numbers sees them.
            return cast(FloatArray, values.astype(np.float32))

        normals = None if self.normals is None else single(self.normals)
        return self._replace(corners=single(self.corners), normals=normals)

    def turned(self) -> MeshPart:
        """Return the part with the corners of each triangle in the opposite order, so that its other side is the
        front. It has no patches yet."""

        def reverse(values: FloatArray | None) -> FloatArray | None:
            return None if values is None else values[:, ::-1]

        return self._replace(
            corners=self.corners[:, ::-1],
            uv=reverse(self.uv),
            normals=reverse(self.normals),
            colours=reverse(self.colours),
        )


def charge_triangles(budget: Budget, triangles: int, numbers: int, where: str) -> None:
    """Charge a budget for triangles with this many float64 numbers at each corner.

    Raises:
        DecodeError: if the budget has not enough left.
    """
    budget.take(3 * 8 * numbers * triangles, f"{where}: {triangles} triangles of {numbers} numbers at a corner")


def unit_normals(normals: FloatArray, corners: FloatArray, name: str, repairs: Repairs) -> FloatArray:
    """Return normals (m, 3, 3) of unit length; one without a direction is replaced by the normal of its triangle.

    Args:
        corners: (m, 3, 3), the positions of the normals.
        name: the name in messages of what they belong to.
        repairs: gets a note of those without a direction.
    """
    length = np.linalg.norm(normals, axis=2, keepdims=True)
    useless = ~((length > 0) & (length < np.inf))[..., 0]  # True for NaN too
    unit = np.divide(normals, length, out=np.zeros_like(normals), where=~useless[..., None])
    if useless.any():
        rows = np.flatnonzero(useless.any(1))
        own = np.cross(corners[rows, 1] - corners[rows, 0], corners[rows, 2] - corners[rows, 0])
        size = np.linalg.norm(own, axis=1, keepdims=True)
        own = np.divide(own, size, out=np.zeros_like(own), where=size > 0)
        own *= np.where(np.einsum("mij,mj->m", unit[rows], own) < 0, -1, 1)[:, None]  # the side of its other corners
        unit[rows] = np.where(useless[rows][..., None], own[:, None], unit[rows])
        repairs.add("corners whose normal has no direction take that of their triangle", int(useless.sum()), name)
    return unit


def check_finite(values: FloatArray, name: str, where: str) -> None:
    """Refuse numbers that are not finite, or too large for the renderer's float32.

    Raises:
        ValueError: naming what the numbers are, the file and the first wrong one.
    """
    bad = ~(np.abs(values) < 1e18).all(-1)  # False for NaN too; squares of lengths must fit in float32
    if bad.any():
        index = int(bad.argmax())
        shown = ", ".join(f"{value:g}" for value in values[index])
        raise ValueError(f"{where}: {name} {index + 1} must be finite, got ({shown})")
