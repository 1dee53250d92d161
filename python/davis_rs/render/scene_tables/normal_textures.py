"""Holds the normal textures and bump maps of a scene's shapes, and puts them into the core's tables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..._mitsuba.types import MitsubaBsdf
from ..diffuse_materials import NormalTexture
from ..obstacles import Unsuitable
from ..texels import Texels, laid_out
from .emissive_textures import TextureImage

CoreNormalTextures = tuple[
    npt.NDArray[np.uint32], list[list[int]], npt.NDArray[np.uint16], list[bool], list[bool], bool
]
"""What the core takes, see :class:`davis_rs._core.SceneRenderer`."""

_NONE = 2**32 - 1
"""The number of its normal texture of a texture whose surfaces have none."""


class _Image(NamedTuple):
    texels: Texels
    wrap: int
    fades: bool
    height: float | None


class NormalTextures:
    """The normal textures of a scene, by the textures of reflectance on the same shapes.

    Args:
        of_materials: Mitsuba's own objects, by the materials of shapes.
        like_gltf: they follow mirrored texture coordinates, and turn round on the back; in Mitsuba they do not.

    Attributes:
        like_gltf: as given.
    """

    def __init__(self, of_materials: Mapping[MitsubaBsdf, NormalTexture], *, like_gltf: bool) -> None:
        self._of_materials, self.like_gltf = of_materials, like_gltf
        self._images: dict[int, _Image] = {}

    def of(self, material: MitsubaBsdf) -> NormalTexture | None:
        """Return the normal texture of a material; None where it has none."""
        return self._of_materials.get(material)

    @property
    def numbers(self) -> list[int]:
        """The numbers of the textures of reflectance on whose shapes there are any."""
        return list(self._images)

    def __contains__(self, texture: int) -> bool:
        """Return whether the shape with a texture of reflectance has a normal texture."""
        return texture in self._images

    def add(
        self, texture: int, image: TextureImage, reflectance: TextureImage, named: str, turned: NormalTexture
    ) -> TextureImage:
        """Put a normal texture on the shape with a texture of reflectance, and return that reflectance.

        Args:
            texture: number of the texture of reflectance.
            image: texels of the normal texture; of a bump map grey ones.
            named: what has both, for messages.
            turned: the normal texture.

        Raises:
            Unsuitable: where both are looked up at different texture coordinates, or a normal map's are turned.
        """
        turn, kind = image.uv_map[:2, :2], "normal" if turned.height is None else "bump"
        if kind == "normal" and ((turn != np.diag(np.diag(turn))).any() or (np.diag(turn) <= 0).any()):
            rule = "has a normal map whose texture coordinates are turned or mirrored"
            raise Unsuitable(rule, "give it a to_uv that only scales and shifts", named)
        if not reflectance.is_constant and not np.allclose(reflectance.uv_map, image.uv_map):
            rule = f"has a {kind} map at other texture coordinates than those of its reflectance"
            raise Unsuitable(rule, "give both the same to_uv", named)
        self._images[texture] = _Image(image.texels, image.wrap, turned.fades, turned.height)
        return reflectance._replace(uv_map=image.uv_map)

    def core(self, sizes: npt.NDArray[np.int32]) -> CoreNormalTextures | None:
        """Return them as the core takes them; None where there are none.

        Args:
            sizes: (textures, 4), of the textures of reflectance.
        """
        if not self._images:
            return None
        of_texture = np.full(len(sizes), _NONE, np.uint32)
        of_texture[list(self._images)] = np.arange(len(self._images))
        images = self._images.values()
        layouts, texels = laid_out(((_encoded(image), image.wrap) for image in images), np.uint16)
        heights = [image.height is not None for image in images]
        return of_texture, layouts, texels, heights, [image.fades for image in images], self.like_gltf


def _encoded(image: _Image) -> npt.NDArray[np.uint16]:
    """Return texels (H, W, 3) from 0 to 1 as numbers of 16 bits, or heights in metres as the halves of a float32."""
    texels = image.texels
    if image.height is not None:
        heights = np.empty(texels.shape[0] * texels.shape[1], "<f4")
        for start, piece in texels.pieces():
            heights[start : start + len(piece)] = image.height * piece[:, 0]
        halves = np.zeros((len(heights), 3), np.uint16)
        halves[:, :2] = heights.view("<u2").reshape(-1, 2)
        return halves.reshape(texels.shape)
    flat = np.empty((texels.shape[0] * texels.shape[1], 3), np.uint16)
    for start, piece in texels.pieces():
        flat[start : start + len(piece)] = np.round(np.clip(piece, 0, 1) * 65535)
    return flat.reshape(texels.shape)
