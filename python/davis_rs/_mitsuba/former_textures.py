"""Writes textures of older versions of Mitsuba as those of Mitsuba 3, and says what a texture is on average.

Mitsuba 3 has no ``scale`` texture, a factor on another one. Factors on images are kept as a property that Mitsuba does
not know, until ``take_factor`` gives it the image times the factor.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import numpy.typing as npt

from .elements import Element
from .files import SceneFile
from .former_plugin import FormerPlugin
from .types import Mitsuba, MitsubaObject

FloatArray = npt.NDArray[np.float64]

_FACTOR = "davis_rs_factor"
_SQUARES = {"color0": 0.4, "color1": 0.2}
"""Colours of a checkerboard, with those that it has if none are given."""


def translate_textures(file: SceneFile, notes: list[str]) -> None:
    """Write the textures of a scene as Mitsuba 3 reads them; those that are not known stay.

    Args:
        notes: gets a line for each kind of texture that looks otherwise now.
    """
    textures = [element for element in file.root.walk() if element.tag == "texture"]
    for element in textures:
        _one_scale(FormerPlugin(element, file))
        if element.attributes.get("type") == "bitmap":
            notes.extend(_encoding(FormerPlugin(element, file)))
    for element in reversed(textures):  # those within others first
        if element.attributes.get("type") == "scale":
            _multiply(FormerPlugin(element, file))


def take_factor(node: MitsubaObject, mi: Mitsuba) -> None:
    """Give a parsed bitmap the image times its factor, if it has one."""
    properties = node.props
    if _FACTOR not in properties:
        return
    factor, raw = float(properties[_FACTOR]), bool(properties.get("raw", False))
    texels = _texels(mi.file_resolver().resolve(str(properties["filename"])), raw, mi)
    for name in (_FACTOR, "filename", "raw"):
        if name in properties:
            del properties[name]
    properties["bitmap"], properties["raw"] = mi.Bitmap((texels * factor).astype(np.float32)), True


def mean_of(texture: Element, file: SceneFile) -> FloatArray | None:
    """Return the mean (3,) of a texture of images or of a checkerboard of numbers; None of others.

    Raises:
        RuntimeError: if the image cannot be read.
    """
    plugin = FormerPlugin(texture, file)
    if plugin.kind == "checkerboard":
        colours = [plugin.numbers(name, value) for name, value in _SQUARES.items()]
        known = [colour for colour in colours if colour is not None]
        return None if len(known) < len(colours) else np.mean(known, 0)
    named, factor = plugin.get("filename"), plugin.number(_FACTOR, 1.0)
    if plugin.kind != "bitmap" or named is None or factor is None:
        return None
    import mitsuba as mi

    name, raw = file.with_values(named.attributes.get("value", "")), plugin.get("raw")
    places = (folder / name for folder in (named.file.parent, file.root.file.parent))
    path = next((place for place in places if os.path.isfile(place)), name)
    texels = _texels(path, raw is not None and raw.attributes.get("value") == "true", mi)
    return factor * texels.mean((0, 1), np.float64)


def _texels(path: str | Path, raw: bool, mi: Mitsuba) -> npt.NDArray[np.float32]:
    """Return the texels (height, width, 3) of an image as linear numbers.

    Args:
        raw: they are numbers already, whatever the file says.
    """
    bitmap = mi.Bitmap(str(path))
    if raw:
        bitmap.set_srgb_gamma(False)
    return np.array(bitmap.convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False))


def _multiply(scale: FormerPlugin) -> None:
    """Write a factor on an image or a checkerboard, or a factor on such a factor, as that texture with a factor."""
    factor, inside, passed = 1.0, scale, set[int]()
    while inside.kind == "scale":
        nested = [child for child in inside.element.children if child.tag in ("texture", "ref")]
        own = inside.number("scale", 1.0)
        if len(nested) != 1 or len(inside.element.children) > 2 or own is None or id(inside.element) in passed:
            return
        passed.add(id(inside.element))
        factor, inside = factor * own, FormerPlugin(scale.file.resolved(nested[0]), scale.file)
    colours = {name: inside.numbers(name, value) for name, value in _SQUARES.items()}
    numbers: dict[str, float | FloatArray]
    if inside.kind == "bitmap":
        numbers = {_FACTOR: factor * (inside.number(_FACTOR, 1.0) or 0.0)}
    elif inside.kind == "checkerboard" and all(colour is not None for colour in colours.values()):
        numbers = {name: factor * colour for name, colour in colours.items() if colour is not None}
    else:
        return
    scale.element.attributes["type"] = inside.kind
    scale.element.children = inside.element.copied().children
    scale.put(**numbers)


def _one_scale(texture: FormerPlugin) -> None:
    """Write one scale for both texture coordinates as two."""
    both = texture.number("uvscale", 1.0)
    if texture.get("uvscale") is None or both is None:
        return
    texture.becomes(texture.kind, ("uvscale",))
    texture.put(**{name: both for name in ("uscale", "vscale") if texture.get(name) is None})


def _encoding(bitmap: FormerPlugin) -> list[str]:
    """Write how an image is encoded as Mitsuba 3 says it: as numbers, or as sRGB, which is nearly a power of 2.2."""
    gamma = bitmap.number("gamma", -1.0)
    if bitmap.get("gamma") is None or gamma not in (-1.0, 1.0, 2.2):
        return []
    bitmap.becomes("bitmap", ("gamma",))
    if gamma == 1:
        bitmap.element.children.append(bitmap.element.child("boolean", name="raw", value="true"))
    return ["its images with a gamma of 2.2 are read as sRGB"] if gamma == 2.2 else []
