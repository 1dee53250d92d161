"""Reads how strongly an opaque glTF material reflects in its highlights, as an index of refraction says it.

Source: Khronos Group, KHR_materials_specular and KHR_materials_ior.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ...events.luma import LUMA_WEIGHTS
from ..mesh_part import USUAL_INDEX
from ..texture_file import EncodedTexture
from .gltf_file import GltfFile, Item, dictionary

SPECULAR = "KHR_materials_specular"
IOR = "KHR_materials_ior"
LEAST_INDEX = 1.001
"""Of refraction: at 1 there would be no surface."""

_MOST_REFLECTED = 0.99
"""At normal incidence: an index of refraction has no more."""

_MEAN = "highlights that differ from place to place (their mean is taken)"

ImageOf = Callable[[object, str], EncodedTexture]
"""Takes a texture of a material and where it is in the file, and returns its image."""


class Highlights(NamedTuple):
    """How strong the highlights of what is no metal are.

    Attributes:
        refraction: the index of refraction, 1 where there are none.
        lost: what an index does not say.
    """

    refraction: float
    lost: tuple[str, ...] = ()


def index_of(extensions: Item, file: GltfFile, where: str) -> float:
    """Return a material's index of refraction; 0 is a mirror, as the file format says."""
    given = dictionary(extensions.get(IOR)).get("ior", USUAL_INDEX)
    return float(file.numbers(given, f"{where}: {IOR}.ior", 1, low=0)[0])


def highlights_of(extensions: Item, file: GltfFile, where: str, image_of: ImageOf) -> Highlights:
    """Return a material's highlights: as bright at normal incidence as its extensions say."""
    index = index_of(extensions, file, where)
    if SPECULAR not in extensions:
        return Highlights(index if index >= 1 else _index_for(_reflected(index)))
    given, where = dictionary(extensions.get(SPECULAR)), f"{where}: {SPECULAR}"
    factor = float(file.numbers(given.get("specularFactor", 1.0), f"{where}.specularFactor", 1, low=0, high=1)[0])
    colour = file.numbers(given.get("specularColorFactor", [1.0] * 3), f"{where}.specularColorFactor", 3, low=0)
    if factor == 0 or not colour.any():
        return Highlights(1.0)
    lost = dict[str, None]()
    if (texture := given.get("specularTexture")) is not None:
        alpha = image_of(texture, f"{where}.specularTexture").alpha
        factor *= 1.0 if alpha is None else float(alpha.mean()) / 255
        lost[_MEAN] = None
    if (texture := given.get("specularColorTexture")) is not None:
        colour = colour * image_of(texture, f"{where}.specularColorTexture").mean()
        lost[_MEAN] = None
    reflected = np.minimum(_reflected(index) * colour, 1.0) * factor
    if np.ptp(reflected) > 0:
        lost["colours of highlights (they are white, and as bright)"] = None
    if factor < 1:
        lost["how specularFactor weakens highlights at a grazing angle (there they are whole)"] = None
    refraction = _index_for(float(np.array(LUMA_WEIGHTS) @ reflected))
    return Highlights(refraction, tuple(lost)) if refraction > 1 else Highlights(1.0)


def _reflected(index: float) -> float:
    """Return what is reflected at normal incidence."""
    return float(((index - 1) / (index + 1)) ** 2)


def _index_for(reflected: float) -> float:
    """Return the index of refraction of what reflects so much at normal incidence."""
    root = float(np.sqrt(min(reflected, _MOST_REFLECTED)))
    return (1 + root) / (1 - root)
