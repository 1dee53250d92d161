"""Reads along which direction of an opaque glTF material its highlights are stretched.

Mitsuba's ``principled`` is rougher along one texture coordinate than along the other, and along no other direction.
What it does not have is noted.

Source: Khronos Group, KHR_materials_anisotropy.
"""

from __future__ import annotations

import numpy as np

from ..lost_looks import BRUSHED
from ..mesh_part import MetalRoughness
from ..principled import LEAST_ALPHA, parameters_of
from .gltf_file import GltfFile, Item, dictionary

ANISOTROPY = "KHR_materials_anisotropy"

_ALONG = 0.02
"""Directions that are off by less, in radians, are along a texture coordinate."""


def brushed(
    metal: MetalRoughness, item: Item, file: GltfFile, where: str, lost: dict[str, None], *, turned: bool
) -> MetalRoughness:
    """Return how a material reflects, with its anisotropy; note what of that is not shown.

    Args:
        turned: its texture coordinates are not those of the file but for a scale, so that they do not say along what.
    """
    given = dictionary(dictionary(item.extensions).get(ANISOTROPY))
    where = f"{where}: {ANISOTROPY}"
    strength = given.get("anisotropyStrength", 0.0)
    strength = float(file.numbers(strength, f"{where}.anisotropyStrength", 1, low=0, high=1)[0])
    angle = float(file.numbers(given.get("anisotropyRotation", 0.0), f"{where}.anisotropyRotation", 1)[0])
    if strength == 0:
        return metal
    crooked = abs(np.sin(2 * angle)) > 2 * _ALONG
    if crooked or turned or metal.texels is not None or given.get("anisotropyTexture") is not None:
        lost[BRUSHED] = None
        return metal
    least = max(metal.roughness**2, LEAST_ALPHA)
    most = least + (1 - least) * strength**2
    along, across = (most, least) if abs(np.cos(angle)) > 0.5 else (least, most)
    roughness, anisotropic = parameters_of(float(along), float(across))
    return metal._replace(roughness=roughness, anisotropic=anisotropic)
