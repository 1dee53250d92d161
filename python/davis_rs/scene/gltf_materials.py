"""The materials of a glTF file, as matte ones: base colours and their textures. What else there is, is told.

Source: Khronos Group, glTF 2.0 Specification, section 3.9; extension KHR_texture_transform.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..pose import FloatArray
from .gltf_file import GltfFile, plain
from .texture_file import texture_of_bytes
from .textures import Texture

_WRAPS = {10497: "repeat", 33071: "clamp", 33648: "mirror"}
_NEAREST = {9728, 9984, 9986}
_UNTOLD = {"KHR_texture_transform", "KHR_lights_punctual", "KHR_mesh_quantization", "KHR_materials_unlit"}
_IMAGES = ("PNG", "JPEG")


class Matte(NamedTuple):
    """A material by its diffuse colour.

    Attributes:
        name: of the file, or its number.
        reflectance: a texture, or a colour (3,), linear RGB.
        factor: (3,), what colours of vertices are multiplied by.
        uv_set: which texture coordinates the texture takes; None without one.
        uv_transform: (2, 3), of them, v downwards.
        wrap: repeat, clamp or mirror.
        files: that the texture was read from.
    """

    name: str
    reflectance: Texture | FloatArray
    factor: FloatArray
    uv_set: int | None
    uv_transform: FloatArray
    wrap: str
    files: tuple[Path, ...]


class GltfMaterials:
    """The materials of a file, each read when it is asked for.

    Attributes:
        left_out: what of them is not taken: for each kind of thing the materials' names.
    """

    def __init__(self, file: GltfFile) -> None:
        self._file = file
        self._known: dict[int | None, Matte] = {}
        self._textures: dict[int, tuple[Texture, tuple[Path, ...]]] = {}
        self.left_out: dict[str, dict[str, None]] = {}

    def __getitem__(self, index: int | None) -> Matte:
        """The material of this number; that of surfaces without one for None."""
        if index not in self._known:
            self._known[index] = self._default() if index is None else self._read(index)
        return self._known[index]

    def _default(self) -> Matte:
        return Matte("material", np.ones(3), np.ones(3), None, np.eye(2, 3), "repeat", ())

    def _read(self, index: int) -> Matte:
        file, place = self._file, f"materials[{index}]"
        item = file.item("materials", index, "a primitive's material")
        name = plain(item.name)[1:-1] if isinstance(item.name, str) and item.name else f"material_{index}"
        self._tell(item, name)
        surface = item.pbrMetallicRoughness
        if surface is None:
            return self._default()._replace(name=name)
        factor = file.numbers(surface.baseColorFactor or [1.0] * 4, f"{place}: baseColorFactor", 4, low=0, high=1)
        if item.alphaMode in ("MASK", "BLEND") and factor[3] < 1:
            self._note("transparency", name)
        colour = factor[:3]
        if surface.baseColorTexture is None:
            return Matte(name, colour, colour, None, np.eye(2, 3), "repeat", ())
        info, place = surface.baseColorTexture, f"{place}: baseColorTexture"
        texture = file.item("textures", info.index, place)
        if texture.source is None:
            raise file.error(place, "has no image of glTF's own kinds (PNG, JPEG)")
        image, files = self._image(texture.source, place, item, name)
        uv_set = file.whole(info.texCoord or 0, f"{place}.texCoord", "of texture coordinates", 15)
        uv_set, transform = self._transform(info.extensions or {}, uv_set, place)
        wrap = self._wrap(texture, name)
        tinted = image if (colour == 1).all() else (image * colour).astype(np.float32)
        return Matte(name, tinted, colour, uv_set, transform, wrap, files)

    def _image(self, index: Any, place: str, item: Any, name: str) -> tuple[Texture, tuple[Path, ...]]:
        data, named, own = self._file.image(index, place)
        if index not in self._textures:
            texture, opaque = texture_of_bytes(data, named, formats=_IMAGES)
            self._textures[index] = texture, () if own is None else (own,)
            if not opaque and item.alphaMode in ("MASK", "BLEND"):
                self._note("transparency", name)
        return self._textures[index]

    def _transform(self, extensions: Any, uv_set: int, place: str) -> tuple[int, FloatArray]:
        """Set and transform of texture coordinates: uv' = T R S uv, R by the angle from u towards -v."""
        given = extensions.get("KHR_texture_transform") if isinstance(extensions, dict) else None
        if given is None:
            return uv_set, np.eye(2, 3)
        place = f"{place}: KHR_texture_transform"
        if not isinstance(given, dict):
            raise self._file.error(place, f"must be an object, got {plain(given)}")
        offset = self._file.numbers(given.get("offset", [0, 0]), f"{place}.offset", 2)
        scale = self._file.numbers(given.get("scale", [1, 1]), f"{place}.scale", 2)
        angle = self._file.numbers(given.get("rotation", 0), f"{place}.rotation", 1)[0]
        cos, sin = np.cos(angle), np.sin(angle)
        turn = np.array([[cos, sin], [-sin, cos]])
        uv_set = self._file.whole(given.get("texCoord", uv_set), f"{place}.texCoord", "of texture coordinates", 15)
        return uv_set, np.concatenate([turn * scale, offset[:, None]], 1)

    def _wrap(self, texture: Any, name: str) -> str:
        if texture.sampler is None:
            return "repeat"
        sampler = self._file.item("samplers", texture.sampler, "a texture's sampler")
        wraps = []
        for value in (sampler.wrapS, sampler.wrapT):
            value = 10497 if value is None else value
            if value not in _WRAPS:
                raise self._file.error(f"samplers[{texture.sampler}]", f"there is no wrap mode {plain(value)}")
            wraps.append(_WRAPS[value])
        if wraps[0] != wraps[1]:
            self._note(f"the wrap mode {wraps[1]} along v ({wraps[0]} is taken both ways)", name)
        if sampler.magFilter in _NEAREST or sampler.minFilter in _NEAREST:
            self._note("texels with hard edges (they are taken as bilinear)", name)
        return wraps[0]

    def _tell(self, item: Any, name: str) -> None:
        """Note what of a material is not taken."""
        surface = item.pbrMetallicRoughness
        metallic = 1.0 if surface is None or surface.metallicFactor is None else surface.metallicFactor
        extensions = item.extensions if isinstance(item.extensions, dict) else {}
        if "KHR_materials_unlit" in extensions:
            self._note("being unlit", name)
        elif metallic != 0:
            self._note("metal", name)
        if item.emissiveTexture is not None or any(item.emissiveFactor or []):
            self._note("light of their own", name)
        if item.normalTexture is not None:
            self._note("normal maps", name)
        if item.occlusionTexture is not None:
            self._note("occlusion maps", name)
        if item.doubleSided is not True:
            self._note("backs that cannot be seen (they are seen from both sides)", name)
        for extension in extensions:
            if extension not in _UNTOLD:
                self._note(plain(extension)[1:-1], name)

    def _note(self, what: str, name: str) -> None:
        self.left_out.setdefault(what, {})[name] = None
