"""Leaves out textures of a glTF material whose image files are missing, and takes its colour as grey."""

from __future__ import annotations

from collections.abc import Callable

from ..lost_looks import MISSING, MISSING_NUMBERS
from ..mesh_part import GREY
from .gltf_file import Item

_COLOURS = {"baseColorTexture": "baseColorFactor", "diffuseTexture": "diffuseFactor"}
_IN_PLACE: dict[str, dict[str, object]] = {
    "emissiveTexture": {"emissiveFactor": [0.0, 0.0, 0.0]},
    "metallicRoughnessTexture": {"metallicFactor": 0.0, "roughnessFactor": 1.0},
}
"""What stands for other textures, whose factors alone would be bright or a mirror."""


def without_missing(material: Item, is_missing: Callable[[Item], bool], lost: dict[str, None]) -> Item:
    """Return a material, or a part of it, without the textures that are missing.

    Args:
        is_missing: of a texture, as materials refer to one.
        lost: gets what is lost by that.
    """
    kept, in_place = Item(), Item()
    for key, value in material.items():
        if not isinstance(value, Item) or key == "extras":
            kept[key] = value
        elif not key.endswith("Texture"):
            kept[key] = without_missing(value, is_missing, lost)
        elif not is_missing(value):
            kept[key] = value
        elif key in _COLOURS:
            factor = material.get(_COLOURS[key])
            alpha = factor[3:] if isinstance(factor, list) else [1.0]
            in_place[_COLOURS[key]] = [GREY, GREY, GREY, *alpha]
            lost[MISSING] = None
        else:
            in_place.update(_IN_PLACE.get(key, {}))
            lost[MISSING_NUMBERS] = None
    kept.update(in_place)
    return kept
