"""Brings what shapes emit, a constant or a texture, to the texels of their reflectance."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...scene.texel_lookup import bilinear
from ..obstacles import Unsuitable
from ..texels import Texels

FloatArray = npt.NDArray[np.float64]

_ROWS_AT_ONCE = 64


class TextureImage(NamedTuple):
    """Holds what is looked up on a surface.

    Attributes:
        texels: one texel for what is the same everywhere.
        wrap: index into :data:`~davis_rs.scene.texel_lookup.WRAP_MODES`.
        uv_map: (3, 3), the transform of texture coordinates.
    """

    texels: Texels
    wrap: int
    uv_map: FloatArray

    @property
    def is_constant(self) -> bool:
        return self.texels.shape[:2] == (1, 1)


def alike(reflectance: TextureImage, emission: TextureImage, named: str) -> tuple[TextureImage, Texels]:
    """Bring a shape's reflectance and emission to as many texels, so that one lookup finds both.

    The one with fewer texels along an axis is looked up at the texels of the other.

    Args:
        named: what reflects, for messages.

    Raises:
        Unsuitable: if both are textures, at different texture coordinates.
    """
    _, wrap, uv_map = emission if reflectance.is_constant else reflectance
    elsewhere = reflectance.wrap != emission.wrap or not np.allclose(reflectance.uv_map, emission.uv_map)
    if elsewhere and not (reflectance.is_constant or emission.is_constant):
        rule = "emits by a texture at other texture coordinates than those of its reflectance"
        raise Unsuitable(rule, "give both the same transform and wrap mode", named)
    height, width = np.maximum(reflectance.texels.shape[:2], emission.texels.shape[:2]).tolist()
    first, second = (_resized(image.texels, wrap, height, width) for image in (reflectance, emission))
    return TextureImage(first, wrap, uv_map), second


def _resized(texels: Texels, wrap: int, height: int, width: int) -> Texels:
    """Return texels (height, width, 3) that are looked up bilinearly."""
    if texels.shape[:2] == (height, width):
        return texels
    at_x = (np.arange(width) + 0.5) / width
    made = np.empty((height, width, 3), np.float32)
    for first in range(0, height, _ROWS_AT_ONCE):
        rows = made[first : first + _ROWS_AT_ONCE]
        at_y = (np.arange(first, first + len(rows)) + 0.5) / height
        x, y = np.meshgrid(at_x, at_y)
        rows[:] = bilinear(texels, np.stack([x.ravel(), y.ravel()]), wrap).reshape(rows.shape)
    return Texels(made)
