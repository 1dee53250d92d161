"""Reads the clear coat that an opaque glTF material has above its base.

Mitsuba's ``principled`` has a coat by another law. What that shows differently is noted.

Source: Khronos Group, KHR_materials_clearcoat.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..mesh_part import Coat
from ..principled import COAT_ALPHAS
from .gltf_file import GltfFile, Item, dictionary
from .gltf_highlights import ImageOf

COAT = "KHR_materials_clearcoat"

_MEANS = "coats that differ from place to place (their means are taken)"
_SLANT = "coats seen at a slant (they reflect less, and take no light from what is below)"
_ROUGH = "roughness of coats above {:.2f} (that is taken)"
_NORMALS = "normals of coats (they are those of what is below)"


class ClearCoat(NamedTuple):
    """The coat of a material.

    Attributes:
        coat: None where there is none.
        lost: what of it is not shown.
    """

    coat: Coat | None = None
    lost: tuple[str, ...] = ()


def clear_coat_of(item: Item, file: GltfFile, where: str, image_of: ImageOf) -> ClearCoat:
    """Return the coat of a material."""
    extensions = dictionary(item.extensions)
    if COAT not in extensions:
        return ClearCoat()
    given, where = dictionary(extensions[COAT]), f"{where}: {COAT}"
    values, lost = list[float](), dict[str, None]()
    for name, channel in (("clearcoat", 0), ("clearcoatRoughness", 1)):
        factor = file.numbers(given.get(f"{name}Factor", 0.0), f"{where}.{name}Factor", 1, low=0, high=1)[0]
        if factor > 0 and (texture := given.get(f"{name}Texture")) is not None:
            factor *= image_of(texture, f"{where}.{name}Texture").texels[..., channel].mean() / 255
            lost[_MEANS] = None
        values.append(float(factor))
    strength, roughness = values
    if strength == 0:
        return ClearCoat()
    rough, smooth = COAT_ALPHAS
    lost[_SLANT] = None
    alpha = roughness**2
    if alpha > rough:
        lost[_ROUGH.format(np.sqrt(rough))] = None
    own, below = (
        dictionary(normals).get("index") for normals in (given.get("clearcoatNormalTexture"), item.normalTexture)
    )
    if own != below:
        lost[_NORMALS] = None
    return ClearCoat(Coat(strength, float(np.clip((rough - alpha) / (rough - smooth), 0, 1))), tuple(lost))
