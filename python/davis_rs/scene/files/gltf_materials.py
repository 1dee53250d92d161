"""Reads the materials of a glTF file: base colours, metal and roughness, emission, and their textures.

What is lost, is noted.

Source: Khronos Group, glTF 2.0 Specification, section 3.9; extensions KHR_texture_transform, EXT_texture_webp,
KHR_texture_basisu, KHR_materials_pbrSpecularGlossiness, KHR_materials_emissive_strength, KHR_materials_unlit,
KHR_materials_transmission and KHR_materials_volume.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...geometry.pose import FloatArray
from ..image_textures import ChargedImages, ImageTexture
from ..ktx2_file import KTX2_START, texture_of_ktx2
from ..lost_looks import BUMPS, HIGHLIGHTS, MEAN_EMISSION, METAL, SHEEN
from ..mesh_part import Blend, Glass, MetalRoughness, NormalTexture
from ..repairs import Repairs
from ..texture_file import EncodedTexture, texture_of_bytes
from .alpha_mask import AlphaMask, blended
from .gltf_anisotropy import ANISOTROPY, brushed
from .gltf_coat import COAT, ClearCoat, clear_coat_of
from .gltf_file import GltfFile, Item, dictionary, plain
from .gltf_highlights import IOR, LEAST_INDEX, SPECULAR, Highlights, highlights_of, index_of
from .gltf_missing import without_missing
from .rounding import within

_WRAPS = {10497: "repeat", 33071: "clamp", 33648: "mirror"}
_NEAREST = 9728
_GLOSS = "KHR_materials_pbrSpecularGlossiness"
_OTHER_IMAGES = ("EXT_texture_webp", "KHR_texture_basisu")
"""Extensions of textures with images of other kinds, where there is none of the standard's own."""
_TRANSFERS = {
    "srgb": "colours that a KTX2 file calls linear (they are taken as sRGB, as glTF says)",
    "linear": "numbers that a KTX2 file calls sRGB (they are taken as they are, as glTF says)",
}
"""What is told of a texture whose file says another transfer function than glTF has for its use."""
_SHINY = 0.7
"""Surfaces without metal that are no rougher show their highlights. On a rougher one, seen from above, the sun adds at
most a tenth to what a middle grey reflects. That is not worth following each of its rays to what it mirrors."""
_STRONG_INDEX = 2.0
"""Highlights of an index of refraction above this are seen on surfaces of any roughness."""
_SHINY_PART = 0.01
"""So much of a texture is that smooth, where any of it counts."""
_MEAN_METAL = "metal and roughness that differ from place to place (their means are taken)"
_IMAGES = ("PNG", "JPEG", "WEBP")
_EMISSIVE_STRENGTH = "KHR_materials_emissive_strength"
_UNLIT = "KHR_materials_unlit"
_TRANSMISSION = "KHR_materials_transmission"
_VOLUME = "KHR_materials_volume"
_SHEEN = "KHR_materials_sheen"
_UNTOLD = {ANISOTROPY, COAT, _GLOSS, _EMISSIVE_STRENGTH, IOR, _SHEEN, SPECULAR, _TRANSMISSION, _UNLIT, _VOLUME}
"""Extensions of materials that lose nothing, or whose loss is noted elsewhere."""
_CLEAR = 0.5
"""The fraction of light that passes from which on a material is glass."""
_CLEAR_WITHIN = 0.1
"""How far glass may be from clear and smooth without a word."""
_DARKEST = 1e-6
"""The least fraction of light that a volume leaves at its attenuation distance."""
_NORMAL_TEXEL = 24
"""About how many bytes a texel of normals takes until it is in the core."""


class GltfMaterial(NamedTuple):
    """A material: its base colour, and how it reflects besides.

    Attributes:
        name: its name in the file, or its number.
        reflectance: a texture, or a colour (3,), linear RGB.
        factor: (3,), by which colours of vertices are multiplied.
        uv_set: which texture coordinates the texture takes; None without one.
        uv_transform: (2, 3), the transform of these coordinates, v downwards.
        wrap: repeat, clamp or mirror.
        files: those that the texture was read from.
        transparent: whether alpha makes it transparent.
        mask: where it is to be seen; None where its alpha is not looked up.
        hidden: whether its alpha hides all of it.
        nearest: whether the texture's texels have hard edges.
        emission: radiance, a texture or a colour (3,); None where it is dark.
        unlit: it reflects nothing, and emits its base colour.
        blend: how much of its area it covers; None where it is opaque, or cut along a mask.
        glass: what it does to light as clear glass; None where it is opaque.
        lost: the kinds of its looks that are not shown.
        metal: how it reflects besides; None where it is diffuse.
        one_sided: its back is culled.
        normal_texture: what turns the surface's normal; None where nothing does.
    """

    name: str
    reflectance: EncodedTexture | FloatArray
    factor: FloatArray
    uv_set: int | None
    uv_transform: FloatArray
    wrap: str
    files: tuple[Path, ...]
    transparent: bool = False
    lost: tuple[str, ...] = ()
    metal: MetalRoughness | None = None
    mask: AlphaMask | None = None
    hidden: bool = False
    nearest: bool = False
    emission: EncodedTexture | FloatArray | None = None
    unlit: bool = False
    blend: Blend | None = None
    glass: Glass | None = None
    one_sided: bool = False
    normal_texture: NormalTexture | None = None

    @property
    def looks_up(self) -> bool:
        """Whether anything but the normal is looked up at texture coordinates."""
        by_metal = self.metal is not None and self.metal.texels is not None
        return by_metal or any(isinstance(what, EncodedTexture) for what in (self.reflectance, self.emission))

    @property
    def is_textured(self) -> bool:
        """Whether its base colour is a texture."""
        return isinstance(self.reflectance, EncodedTexture)

    @property
    def is_paintable(self) -> bool:
        """Whether different colours of vertices can be shown: not in glass, nor on texels with hard edges."""
        return self.glass is None and not (self.nearest and self.looks_up)


class GltfMaterials:
    """The materials of a file, each read on first use. Its texture is charged for one shape that shows it.

    Args:
        repairs: gets what is mended.
        scale: metres in the file's unit.
        grey_unknown: textures whose files are missing are left out, and their colours are grey; else they are refused.
    """

    def __init__(self, file: GltfFile, repairs: Repairs, scale: float, *, grey_unknown: bool = False) -> None:
        self._file, self._repairs, self._scale = file, repairs, scale
        self._grey_unknown = grey_unknown
        self._known: dict[int | None, GltfMaterial] = {}
        self._images: dict[int, tuple[EncodedTexture, tuple[Path, ...]]] = {}
        self._charged = ChargedImages(file.budget)

    def __getitem__(self, index: int | None) -> GltfMaterial:
        """Return the material of this number; for None the material of surfaces without one."""
        if index not in self._known:
            self._known[index] = self._default() if index is None else self._read(index)
        return self._known[index]

    def _default(self) -> GltfMaterial:
        return GltfMaterial("material", np.ones(3), np.ones(3), None, np.eye(2, 3), "repeat", (), one_sided=True)

    def _read(self, index: int) -> GltfMaterial:
        file, where = self._file, f"materials[{index}]"
        item = file.item("materials", index, "a primitive's material")
        name = plain(item.name)[1:-1] if isinstance(item.name, str) and item.name else f"material_{index}"
        missing = dict[str, None]()
        if self._grey_unknown:
            item = without_missing(item, self._is_missing, missing)
        kind, given, info = _diffuse(item)
        where = f"{where}: {kind}"
        lost = missing | dict.fromkeys(self._lost(item))
        factor = file.numbers([1.0] * 4 if given is None else given, f"{where}Factor", 4, low=0, high=1)
        transparent = item.alphaMode in ("MASK", "BLEND")
        colour = factor[:3]
        unlit = _UNLIT in dictionary(item.extensions)
        made = GltfMaterial(name, colour, colour, None, np.eye(2, 3), "repeat", (), transparent, unlit=unlit)
        if info is not None:
            made = self._textured(made, info, f"{where}Texture", lost)
        if not unlit:
            highlights = highlights_of(dictionary(item.extensions), file, f"materials[{index}]", self._texture_image)
            clear_coat = clear_coat_of(item, file, f"materials[{index}]", self._texture_image)
            made = self._metallic(made, item, (highlights, clear_coat), f"materials[{index}]", lost)
            made = self._emissive(made, item, f"materials[{index}]", lost)
            made = self._transmissive(made, item, f"materials[{index}]", lost)
            made = self._with_looks_told(made, item, (highlights, clear_coat), f"materials[{index}]", lost)
            made = self._bumpy(made, item, f"materials[{index}]", lost)
        if transparent:
            made = self._masked(made, item, factor[3], lost)
        # Through glass one sees its other side.
        return made._replace(lost=tuple(lost), one_sided=item.doubleSided is not True and made.glass is None)

    def _masked(self, made: GltfMaterial, item: Item, factor: float, lost: dict[str, None]) -> GltfMaterial:
        """Return a material with the mask that its alpha is, times a factor, and note what that does not show."""
        alpha = made.reflectance.alpha if isinstance(made.reflectance, EncodedTexture) else None
        if item.alphaMode == "BLEND":
            if made.glass is not None and alpha is None:
                return made  # its factor stands for glass where glass is not shown
            mask, looks = blended(alpha, factor=factor, wrap=made.wrap, nearest=made.nearest)
            if factor == 0:
                return made._replace(hidden=True)
            if looks and (mask is None or mask.is_haze) and (alpha is None or not made.nearest):
                if made.metal is not None:
                    lost[METAL if made.metal.metal > 0 else HIGHLIGHTS] = None
                return made._replace(blend=Blend(float(factor), alpha), metal=None, glass=None)
            lost.update(dict.fromkeys(looks))
            return made._replace(mask=mask)
        cutoff = 0.5
        if item.alphaCutoff is not None:
            cutoff = self._file.numbers(item.alphaCutoff, f"the material {made.name}: alphaCutoff", 1, low=0)[0]
        if alpha is not None and factor > 0:
            mask = AlphaMask(alpha, cutoff / factor, made.wrap, made.nearest)
            if mask.is_divided:
                return made._replace(mask=mask)
        most = factor if alpha is None else factor * float(alpha.max()) / 255
        return made._replace(hidden=most < cutoff)

    def _textured(self, made: GltfMaterial, given: object, where: str, lost: dict[str, None]) -> GltfMaterial:
        """Return a material with its texture."""
        image, files, wrap, nearest = self._texture(given, where, lost, "srgb")
        uv_set, transform = self._coordinates(given, where)
        tinted = image.tinted(made.factor)
        if made.unlit:
            tinted.charge(self._file.budget, where)
        else:
            self._charged.charge(ImageTexture(tinted, wrap, nearest), where)
        made = made._replace(reflectance=tinted, wrap=wrap, nearest=nearest, files=files)
        return made._replace(uv_set=uv_set, uv_transform=transform)

    def _metallic(
        self,
        made: GltfMaterial,
        item: Item,
        above: tuple[Highlights, ClearCoat],
        where: str,
        lost: dict[str, None],
    ) -> GltfMaterial:
        """Return a material with its metal and roughness, where it has any metal, a coat, or highlights that are
        seen."""
        file, surface = self._file, dictionary(item.pbrMetallicRoughness)
        if _GLOSS in dictionary(item.extensions):
            return made
        factors = {}
        for name in ("metallicFactor", "roughnessFactor"):
            given = surface.get(name)
            factors[name] = file.numbers(1.0 if given is None else given, f"{where}: {name}", 1, low=0, high=1)[0]
        metal, rough = factors.values()
        highlights, clear_coat = above
        dull, coated = highlights.refraction <= 1, clear_coat.coat is not None
        if metal == 0 and dull and not coated:
            return made
        plain_metal = MetalRoughness(
            metal, rough, refraction=max(highlights.refraction, LEAST_INDEX), coat=clear_coat.coat
        )
        most = 1.0 if highlights.refraction > _STRONG_INDEX else _SHINY
        given, where = surface.get("metallicRoughnessTexture"), f"{where}: metallicRoughnessTexture"
        if given is None:
            return made._replace(metal=plain_metal) if metal > 0 or coated or rough <= most else made
        image, files, wrap, nearest = self._texture(given, where, lost, "linear")
        if not image.texels[..., 2].any():
            metal = 0.0
        shiny = (rough * image.texels[..., 1] <= 255 * most).mean() > _SHINY_PART
        if metal == 0 and not coated and (dull or not shiny):
            return made
        made = made._replace(files=tuple(dict.fromkeys(made.files + files)))
        uv_set, transform = self._coordinates(given, where)
        if made.uv_set is None:
            made = made._replace(uv_set=uv_set, uv_transform=transform, wrap=wrap)
        if made.uv_set != uv_set or not np.array_equal(made.uv_transform, transform):
            lost[_MEAN_METAL] = None
            roughness, metals = (float(image.texels[..., channel].mean()) / 255 for channel in (1, 2))
            return made._replace(metal=plain_metal._replace(metal=metal * metals, roughness=rough * roughness))
        image.charge(file.budget, where)
        if nearest:
            lost["hard edges of texels of metal and roughness (they are taken as bilinear)"] = None
        return made._replace(metal=plain_metal._replace(metal=metal, texels=image.texels, wrap=wrap))

    def _with_looks_told(
        self,
        made: GltfMaterial,
        item: Item,
        above: tuple[Highlights, ClearCoat],
        where: str,
        lost: dict[str, None],
    ) -> GltfMaterial:
        """Return a material with its anisotropy; note what is lost of that, of its highlights and of its coat."""
        highlights, clear_coat = above
        metal = made.metal
        if metal is None:
            of_glass = made.glass is not None and ANISOTROPY in dictionary(item.extensions)
            kinds = (COAT, clear_coat.coat is not None), (ANISOTROPY, of_glass)
            lost.update(dict.fromkeys(kind for kind, is_lost in kinds if is_lost))
            return made
        turned = bool(made.uv_transform[[0, 1], [1, 0]].any())
        metal = brushed(metal, item, self._file, where, lost, turned=turned)
        if metal.shows_index:
            lost.update(dict.fromkeys(highlights.lost))
            if highlights.refraction > _STRONG_INDEX:
                lost["what strong highlights take from the light below them"] = None
        lost.update(dict.fromkeys(clear_coat.lost))
        uv_set = 0 if made.uv_set is None and metal.anisotropic != 0 else made.uv_set
        return made._replace(metal=metal, uv_set=uv_set)

    def _emissive(self, made: GltfMaterial, item: Item, where: str, lost: dict[str, None]) -> GltfMaterial:
        """Return a material with the radiance that it emits, if any."""
        file, extensions = self._file, dictionary(item.extensions)
        given = [0.0] * 3 if item.emissiveFactor is None else item.emissiveFactor
        factor = file.numbers(given, f"{where}: emissiveFactor", 3, low=0)
        usual = within(factor, 0, 1)
        self._repairs.add("emissiveFactor above 1, which glTF does not allow, is taken as it is", usual is None, where)
        factor = factor if usual is None else usual
        strength = dictionary(extensions.get(_EMISSIVE_STRENGTH)).get("emissiveStrength")
        if strength is not None:
            factor = factor * file.numbers(strength, f"{where}: {_EMISSIVE_STRENGTH}.emissiveStrength", 1, low=0)[0]
        if not factor.any():
            return made
        if item.emissiveTexture is None:
            return made._replace(emission=factor)
        where = f"{where}: emissiveTexture"
        image, files, wrap, nearest = self._texture(item.emissiveTexture, where, lost, "srgb")
        if not image.texels.any():
            return made
        made = made._replace(files=tuple(dict.fromkeys(made.files + files)))
        uv_set, transform = self._coordinates(item.emissiveTexture, where)
        if made.uv_set is None:
            made = made._replace(uv_set=uv_set, uv_transform=transform, wrap=wrap, nearest=nearest)
        alike = made.uv_set == uv_set and np.array_equal(made.uv_transform, transform) and made.wrap == wrap
        image = image.tinted(factor)
        if not alike:
            lost[MEAN_EMISSION] = None
            return made._replace(emission=image.mean())
        if made.nearest != nearest:
            lost["how texels of their own light are filtered (as those of the base colour are)"] = None
        image.charge(file.budget, where)
        return made._replace(emission=image)

    def _transmissive(self, made: GltfMaterial, item: Item, where: str, lost: dict[str, None]) -> GltfMaterial:
        """Return a material as glass, if most light passes it: a clear thin sheet, or a solid where it has a volume."""
        file, extensions = self._file, dictionary(item.extensions)
        given = dictionary(extensions.get(_TRANSMISSION))
        fraction = given.get("transmissionFactor", 0.0)
        fraction = file.numbers(fraction, f"{where}: transmissionFactor", 1, low=0, high=1)[0]
        if fraction == 0:
            return made
        if fraction < _CLEAR or given.get("transmissionTexture") is not None:
            lost[_TRANSMISSION] = None
            return made
        volume = dictionary(extensions.get(_VOLUME))
        thickness = volume.get("thicknessFactor", 0.0)
        thickness = file.numbers(thickness, f"{where}: {_VOLUME}.thicknessFactor", 1, low=0)[0]
        tint = made.reflectance
        if isinstance(tint, EncodedTexture):
            lost["colours of glass that differ from place to place (their mean is taken)"] = None
            tint = tint.mean()
        if fraction < 1 - _CLEAR_WITHIN or (made.metal is not None and made.metal.metal > 0):
            lost["what glass does not let through (it is clear)"] = None
        roughness = dictionary(item.pbrMetallicRoughness).get("roughnessFactor", 1.0)
        roughness = float(file.numbers(roughness, f"{where}: roughnessFactor", 1, low=0, high=1)[0])
        is_solid = bool(thickness > 0)
        if roughness > _CLEAR_WITHIN and not is_solid:
            lost["roughness of sheets of glass (they are clear)"] = None
        rough = roughness if roughness > _CLEAR_WITHIN and is_solid else 0.0
        if SPECULAR in extensions:
            lost[f"{SPECULAR} of glass"] = None
        index = max(index_of(extensions, file, where), LEAST_INDEX)
        absorption = self._absorption(volume, f"{where}: {_VOLUME}") if is_solid else None
        return made._replace(glass=Glass(index, tint, is_solid, rough, absorption), metal=None)

    def _absorption(self, volume: Mapping[str, object], where: str) -> FloatArray | None:
        """Return how much light a volume absorbs per metre, RGB; None for nothing."""
        colour = volume.get("attenuationColor", [1.0] * 3)
        colour = self._file.numbers(colour, f"{where}.attenuationColor", 3, low=0, high=1)
        if volume.get("attenuationDistance") is None or (colour == 1).all():
            return None
        distance = self._file.numbers(volume["attenuationDistance"], f"{where}.attenuationDistance", 1, low=0)[0]
        if distance == 0:
            raise self._file.error(f"{where}.attenuationDistance", "must be more than 0")
        return np.asarray(-np.log(np.maximum(colour, _DARKEST)) / (distance * self._scale))

    def _bumpy(self, made: GltfMaterial, item: Item, where: str, lost: dict[str, None]) -> GltfMaterial:
        """Return a material with its normal texture, if it has one that turns anything."""
        file, given, where = self._file, item.normalTexture, f"{where}: normalTexture"
        if given is None:
            return made
        scale = dictionary(given).get("scale")
        factor = 1.0 if scale is None else float(file.numbers(scale, f"{where}: scale", 1)[0])
        image, files, wrap, nearest = self._texture(given, where, lost, "linear")
        uv_set, transform = self._coordinates(given, where)
        elsewhere = made.looks_up and (made.uv_set != uv_set or not np.array_equal(made.uv_transform, transform))
        if elsewhere or made.glass is not None:
            lost[BUMPS] = None
            return made
        if factor == 0 or (np.abs(image.texels[..., :2] - 127.5) < 1).all():
            return made
        if nearest:
            lost["hard edges of texels of normals (they are taken as bilinear)"] = None
        image.charge(file.budget, where)
        texels = image.texels if factor == 1 else _steeper(image.texels, factor)
        made = made._replace(files=tuple(dict.fromkeys(made.files + files)), uv_set=uv_set, uv_transform=transform)
        return made._replace(normal_texture=NormalTexture(texels, wrap))

    def charge(self, material: GltfMaterial, where: str) -> None:
        """Charge the file's budget for what one more shape that shows a material has of its own. All shapes share the
        texture of a base colour, unless they emit it.

        Raises:
            DecodeError: if the budget has not enough left.
        """
        if material.unlit and isinstance(material.reflectance, EncodedTexture):
            material.reflectance.charge(self._file.budget, where)
        if isinstance(material.emission, EncodedTexture):
            material.emission.charge(self._file.budget, where)
        if material.metal is not None and material.metal.texels is not None:
            EncodedTexture(material.metal.texels, None, np.ones(3)).charge(self._file.budget, where)
        if material.normal_texture is not None:
            height, width = material.normal_texture.texels.shape[:2]
            self._file.budget.take(_NORMAL_TEXEL * height * width, f"{where}: {width} x {height} texels of normals")

    def _texture(
        self, given: object, where: str, lost: dict[str, None], transfer: str
    ) -> tuple[EncodedTexture, tuple[Path, ...], str, bool]:
        """Return the image of a texture, the files that it is from, its wrap mode, and whether texels have hard
        edges; ``transfer`` is how glTF encodes textures of such a use."""
        texture = self._file.item("textures", dictionary(given).get("index"), where)
        source = _source(texture)
        if source is None:
            message = "has no image of a kind that is read (PNG, JPEG, WebP, KTX2): export with such textures"
            raise self._file.error(where, message)
        image, files = self._image(source, where)
        if image.transfer not in ("", transfer):
            lost[_TRANSFERS[transfer]] = None
        return image, files, *self._sampler(texture, lost)

    def _is_missing(self, given: Item) -> bool:
        """Return whether the image of a texture is in a file that is not there."""
        source = _source(self._file.item("textures", given.index, "a material's texture"))
        where = f"images[{source}]"
        return source is not None and self._file.lacks_image(self._file.item("images", source, where), where)

    def _texture_image(self, given: object, where: str) -> EncodedTexture:
        return self._texture(given, where, {}, "linear")[0]

    def _coordinates(self, given: object, where: str) -> tuple[int, FloatArray]:
        """Return which texture coordinates a texture takes, and their transform (2, 3)."""
        info = dictionary(given)
        uv_set = self._file.whole(info.get("texCoord") or 0, f"{where}.texCoord", "of texture coordinates", 15)
        return self._transform(info.get("extensions"), uv_set, where)

    def _image(self, index: object, where: str) -> tuple[EncodedTexture, tuple[Path, ...]]:
        file, item = self._file, self._file.item("images", index, where)
        assert isinstance(index, int)
        if index not in self._images:
            where = f"images[{index}]"
            data, own = file.image(item, where)
            name = f"{file.path}, {where}" if own is None else str(own)
            if data[: len(KTX2_START)] == KTX2_START:
                texture = texture_of_ktx2(data, name, file.budget)
            else:
                texture = texture_of_bytes(data, name, file.budget, _IMAGES)
            if item.bufferView is None:  # nobody else needs its bytes
                file.budget.give_back(len(data))
            self._images[index] = texture, () if own is None else (own,)
        return self._images[index]

    def _transform(self, extensions: object, uv_set: int, where: str) -> tuple[int, FloatArray]:
        """Return the set and the transform of texture coordinates: uv' = T R S uv, R by the angle from u towards -v."""
        given = dictionary(extensions).get("KHR_texture_transform")
        if given is None:
            return uv_set, np.eye(2, 3)
        where = f"{where}: KHR_texture_transform"
        if not isinstance(given, dict):
            raise self._file.error(where, f"must be an object, got {plain(given)}")
        offset = self._file.numbers(given.get("offset", [0, 0]), f"{where}.offset", 2)
        scale = self._file.numbers(given.get("scale", [1, 1]), f"{where}.scale", 2)
        angle = self._file.numbers(given.get("rotation", 0), f"{where}.rotation", 1)[0]
        cos, sin = np.cos(angle), np.sin(angle)
        turn = np.array([[cos, sin], [-sin, cos]])
        uv_set = self._file.whole(given.get("texCoord", uv_set), f"{where}.texCoord", "of texture coordinates", 15)
        return uv_set, np.concatenate([turn * scale, offset[:, None]], 1)

    def _sampler(self, texture: Item, lost: dict[str, None]) -> tuple[str, bool]:
        """Return a texture's wrap mode, and whether its texels have hard edges where they are larger than pixels.

        Filters for smaller texels are approximations of what a pixel sees, which is computed here.
        """
        if texture.sampler is None:
            return "repeat", False
        sampler = self._file.item("samplers", texture.sampler, "a texture's sampler")
        wraps = []
        for value in (sampler.wrapS, sampler.wrapT):
            value = 10497 if value is None else value
            if value not in _WRAPS:
                raise self._file.error(f"samplers[{texture.sampler}]", f"there is no wrap mode {plain(value)}")
            wraps.append(_WRAPS[value])
        if wraps[0] != wraps[1]:
            lost[f"the wrap mode {wraps[1]} along v ({wraps[0]} is taken both ways)"] = None
        return wraps[0], sampler.magFilter == _NEAREST

    def _lost(self, item: Item) -> Iterator[str]:
        """Yield the kinds of looks of a material that are not shown."""
        extensions = dictionary(item.extensions)
        if _UNLIT not in extensions:
            if _GLOSS in extensions:
                yield "gloss"
            if item.occlusionTexture is not None:
                yield "occlusion maps"
        if _SHEEN in extensions:
            yield SHEEN
        yield from (plain(name)[1:-1] for name in extensions if name not in _UNTOLD)


def _steeper(texels: npt.NDArray[np.uint8], factor: float) -> npt.NDArray[np.float32]:
    """Return texels of normals (H, W, 3), as float32 from 0 to 1, whose components along the surface are scaled."""
    normals = texels.astype(np.float32) * np.float32(2 / 255) - 1
    normals[..., :2] *= np.float32(factor)
    length = np.linalg.norm(normals, axis=2, keepdims=True)
    np.divide(normals, length, out=normals, where=length > 0)
    return normals * np.float32(0.5) + np.float32(0.5)


def _source(texture: Item) -> object:
    """Return the number of a texture's image, of a kind that is read; None where it has none."""
    others = (dictionary(dictionary(texture.extensions).get(name)).get("source") for name in _OTHER_IMAGES)
    return next((source for source in (texture.source, *others) if source is not None), None)


def _diffuse(item: Item) -> tuple[str, object, object]:
    """Return the file's name for a material's diffuse colour, the factor, and the texture, both unchecked."""
    surface, gloss = item.pbrMetallicRoughness, dictionary(item.extensions).get(_GLOSS)
    if gloss is not None:
        gloss = dictionary(gloss)
        return f"{_GLOSS}: diffuse", gloss.get("diffuseFactor"), gloss.get("diffuseTexture")
    return "baseColor", getattr(surface, "baseColorFactor", None), getattr(surface, "baseColorTexture", None)
