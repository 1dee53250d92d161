"""Puts the textures of a diffuse scene into one flat buffer of texels, weighted to luma for each light colour."""

from __future__ import annotations

import copy
import hashlib
from collections.abc import Callable, Collection, Mapping
from typing import NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from ..._mitsuba.types import Mitsuba, MitsubaParameters, MitsubaShape, MitsubaTexture, MitsubaValue
from ...scene.files.mesh_scene import colours_as_texture
from ...scene.image_textures import ImageTexture, StandIns
from ...scene.texel_lookup import WRAP_MODES
from ..diffuse_materials import is_plain, is_two_sided, reflectance_of, surface_kind, surface_name, surface_remedy
from ..obstacles import Unsuitable, plugin_name
from ..texels import (
    LUMINANCE,
    TEXELS_AT_ONCE,
    CoreColours,
    CoreImage,
    Texels,
    bilinear_meaning,
    fill_border,
    laid_out,
    looked_up,
    lookup_positions,
    nearest_meaning,
    uv_map_of,
)
from .emissive_textures import TextureImage, alike
from .mesh_triangles import MeshTriangles
from .normal_textures import NormalTextures
from .sharp_textures import RAMP_PX, Ramp, checkerboard, divide, vertex_colours

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_DARK = 2**32 - 1
"""The number of its emissive texture of a texture whose surfaces emit nothing."""

_LARGE = 1 << 16
"""Textures of more texels than this are looked for among those that are there, see :meth:`TextureTable.shared`."""

_POLARISING = ("polarizer", "retarder")
"""In the names of surfaces that only a renderer with polarised light shows as they are."""

_Number = TypeVar("_Number", bound=np.generic)


class Added(NamedTuple):
    """What a shape's reflectance says about its records.

    Attributes:
        two_sided: both sides reflect.
        uv: (m, 3, 2), texture coordinates at the triangles' corners that replace the mesh's own; None to keep those.
    """

    two_sided: bool
    uv: FloatArray | None = None


PixelsPerUnit = Callable[[FloatArray], tuple[float, float]]
"""Gives how many pixels a unit of texture coordinates covers at most along each axis, after their transform (3, 3)."""


class TextureTable:
    """The diffuse reflectances of a scene's shapes: bitmaps with bilinear lookup, or constants (bitmaps of one texel).

    Other textures become bitmaps, see :mod:`sharp_textures`. What shapes emit is a colour group of its own: it lies in
    the same texels as their reflectance, and constant light of strength 1 shows it.

    Args:
        mi: Mitsuba, under the variant that loaded the scene.
        group_weights: for each light colour the weights (3,) that turn reflected RGB into luma.
        stand_ins: textures of Mitsuba that hold no texels, and the images that they stand for.

    Attributes:
        sizes: int32 (textures, 4): first texel, width, height, index into :data:`WRAP_MODES`.
        texture_of: uint32 (records): each record's texture.
        ramp_px: how wide the widest ramp in place of a hard edge is, pixels; 0 where all are narrow enough, NaN where
            no path is known.
        has_ramps: whether any texture has ramps in place of hard edges.
    """

    def __init__(self, mi: Mitsuba, group_weights: list[FloatArray], stand_ins: StandIns | None = None) -> None:
        self._mi, self.group_weights = mi, group_weights
        self._stand_ins = {} if stand_ins is None else stand_ins
        self._image_texels: dict[ImageTexture, Texels] = {}
        self._of_images: list[int] = []
        self._texels: list[Texels] = []
        self._sizes: list[tuple[int, int, int]] = []
        self._alike: list[int] = []
        self._large: dict[tuple[tuple[int, ...], int], list[int]] = {}
        self._is_shared = False
        self._uv_maps: list[FloatArray] = []
        self._texture_of: list[npt.NDArray[np.uint32]] = []
        self.ramp_px, self.has_ramps = 0.0, False
        self._emission_groups: dict[int, tuple[str, FloatArray]] = {}
        self._emissions: dict[int, tuple[str, Texels]] = {}

    @property
    def sizes(self) -> npt.NDArray[np.int32]:
        return self._placed(0)

    @property
    def has_alike(self) -> bool:
        """Whether any large texture is like another one."""
        return self._alike != list(range(len(self._alike)))

    def shared(self, kinds: Mapping[int, int] | None = None) -> TextureTable:
        """Return the same textures, of which large ones that are alike lie in the same texels.

        Worlds show one large bitmap on many materials. Derivatives by texels need a table that is not shared, because
        there each shape has texels of its own.

        Args:
            kinds: a number for textures: those of different numbers have texels of their own.
        """
        table, firsts = copy.copy(self), dict[tuple[int, int | None], int]()
        of_kind = (kinds or {}).get
        table._alike = [firsts.setdefault((first, of_kind(n)), n) for n, first in enumerate(self._alike)]
        table._is_shared = True
        return table

    def stored(self) -> list[int]:
        """Return the numbers of the textures that have texels of their own."""
        return [number for number, first in enumerate(self._alike) if first == number or not self._is_shared]

    def _placed(self, border: int) -> npt.NDArray[np.int32]:
        """Return first texel, width, height and wrap mode of each texture, where they follow each other in borders."""
        layout = np.array([(0, *size) for size in self._sizes], np.int32).reshape(-1, 4)
        stored = self.stored()
        counts = (layout[stored, 1].astype(np.int64) + 2 * border) * (layout[stored, 2] + 2 * border)
        layout[stored, 0] = np.cumsum([0, *counts])[:-1]
        if self._is_shared:
            layout[:, 0] = layout[self._alike, 0]
        return layout

    def _count(self, border: int) -> int:
        """Return how many texels there are with these borders."""
        sizes = np.array([self._sizes[number][:2] for number in self.stored()], np.int64).reshape(-1, 2)
        return int((sizes + 2 * border).prod(axis=1).sum())

    @property
    def is_grey(self) -> bool:
        """Whether no texel has a hue."""
        return all(texels.is_grey for texels in set(self._texels))

    @property
    def uv_maps(self) -> FloatArray:
        """Each texture's own affine map of (u, v, 1), (textures, 2, 3)."""
        return np.array(self._uv_maps, np.float64).reshape(-1, 2, 3)

    @property
    def texture_of(self) -> npt.NDArray[np.uint32]:
        return np.concatenate(self._texture_of)

    def texels(self, group: int) -> npt.NDArray[np.float32]:
        """Return all texels as luma under a light of the group's colour, float32."""
        luma = np.empty(self._count(0), np.float32)
        firsts = self.sizes[:, 0].tolist()
        for number in self.stored():
            for start, piece in self._texels[number].pieces():
                luma[firsts[number] + start :][: len(piece)] = piece @ self.group_weights[group]
        return luma

    def framed(self, group: int, unseen: Collection[int] = ()) -> npt.NDArray[np.float32]:
        """Return :meth:`texels` with a border of one texel around each texture, filled by its wrap mode.

        Args:
            unseen: numbers of textures whose luma nobody asks for; it stays 0, and takes no memory.
        """
        seen = {number for number in range(len(self._sizes)) if number not in unseen}
        seen = {self._alike[number] for number in seen} if self._is_shared else seen
        weights = self.group_weights[group]

        def image_of(number: int) -> npt.NDArray[np.float32] | None:
            if number not in seen:
                return None
            if group in self._emission_groups:
                return self._emitted(number, group)
            return self._products(self._texels[number], weights)

        return self._framed(image_of, np.float32)

    def colours(self, seen: Callable[[int, FloatArray], FloatArray] | None = None) -> CoreColours:
        """Return red, green and blue of all texels, as the core takes them: what the file has in 8 bits stays so.

        Args:
            seen: returns what colours (n, 3) become on the surfaces with a texture, by its number and theirs. Each
                channel must depend on itself alone, because of texels of 8 bits it is asked for 256 values. None
                leaves colours as they are.
        """
        stored = self.stored()
        image_of = {number: image for image, number in enumerate(stored)}
        numbers = self._alike if self._is_shared else stored
        of_texture = np.array([image_of[number] for number in numbers], np.uint32)
        images: list[CoreImage] = []
        for number in stored:
            texels, (width, height, wrap) = self._texels[number], self._sizes[number]
            image, values = texels.coded or (self._products(texels, np.eye(3)), None)
            if seen is not None:
                colours = image.reshape(-1, 3) if values is None else values
                # Some at a time: in float64, all of a large texture would take a gigabyte.
                for start in range(0, len(colours), TEXELS_AT_ONCE):
                    piece = colours[start : start + TEXELS_AT_ONCE]
                    piece[:] = seen(number, piece.astype(np.float64))
            images.append(((width, height, wrap), image.ravel(), None if values is None else values.ravel()))
        return of_texture, images

    @property
    def images_digest(self) -> bytes:
        """A hash of what Mitsuba does not tell of textures: their wrap modes, and images that it does not hold."""
        wrap_modes = [wrap for _, _, wrap in self._sizes]
        images = [(number, self._sizes[number], self._texels[number].digest) for number in self._of_images]
        return hashlib.sha256(repr((wrap_modes, images)).encode()).digest()

    def add_emission_group(self, name: str, weights: FloatArray) -> int:
        """Add a colour group that holds what shapes emit under a name, and return its number.

        Args:
            weights: (3,) of red, green and blue in its luma.
        """
        group = len(self.group_weights)
        self.group_weights.append(np.zeros(3))  # light of this group falls on nothing and has no background
        self._emission_groups[group] = name, weights
        return group

    def emissive(
        self, lights: Mapping[str, int], factors: FloatArray
    ) -> tuple[npt.NDArray[np.uint32], list[list[int]], list[int], npt.NDArray[np.float32]]:
        """Return what shapes emit in red, green and blue, as the core takes it for glossy surfaces.

        Args:
            lights: the number of the light of each emission group, by its name.
            factors: (3,) on red, green and blue.
        """
        of_texture = np.full(len(self._sizes), _DARK, np.uint32)
        of_texture[list(self._emissions)] = np.arange(len(self._emissions))
        images = (
            (self._products(texels, np.diag(factors)), self._sizes[number][2])
            for number, (_, texels) in self._emissions.items()
        )
        layouts, texels = laid_out(images, np.float32)
        return of_texture, layouts, [lights[name] for name, _ in self._emissions.values()], texels

    def _emitted(self, number: int, group: int) -> npt.NDArray[np.float32] | None:
        """Return the luma (H, W) that a texture's surfaces emit in an emission group; None for nothing."""
        name, weights = self._emission_groups[group]
        emission = self._emissions.get(number)
        return self._products(emission[1], weights) if emission is not None and emission[0] == name else None

    @staticmethod
    def _products(texels: Texels, weights: FloatArray) -> npt.NDArray[np.float32]:
        """Return weighted sums (H, W, ...) of the red, green and blue of texels, by weights (3, ...)."""
        image = np.empty((*texels.shape[:2], *weights.shape[1:]), np.float32)
        flat = image.reshape(-1, *weights.shape[1:])
        for start, piece in texels.pieces():
            flat[start : start + len(piece)] = piece @ weights
        return image

    @property
    def of_framed(self) -> npt.NDArray[np.int64]:
        """The number in :meth:`texels` of each texel of :meth:`framed`."""
        firsts = self.sizes[:, 0].tolist()

        def numbers(number: int) -> IntArray:
            width, height, _ = self._sizes[number]
            return np.arange(firsts[number], firsts[number] + width * height).reshape(height, width)

        return self._framed(numbers, np.int64)

    def _framed(
        self,
        image_of: Callable[[int], npt.NDArray[_Number] | None],
        dtype: type[_Number],
    ) -> npt.NDArray[_Number]:
        """Put the images of all textures one after the other, each in its border. There is no second copy of all.

        Of zeros nothing is written (None), because memory that nobody wrote to takes none.
        """
        layout = self.framed_sizes.tolist()
        framed = np.zeros(self._count(1), dtype)
        for number in self.stored():
            if (pixels := image_of(number)) is None:
                continue
            first, width, height, wrap = layout[number]
            image = framed[first : first + (width + 2) * (height + 2)].reshape(height + 2, width + 2)
            image[1:-1, 1:-1] = pixels
            fill_border(image, wrap)
        return framed

    @property
    def framed_sizes(self) -> npt.NDArray[np.int32]:
        """The :attr:`sizes`, with the first texel's number among those of :meth:`framed`."""
        return self._placed(1)

    def add(
        self,
        shape: MitsubaShape,
        records: int,
        mesh: Callable[[], MeshTriangles],
        pixels_per_unit: PixelsPerUnit | None = None,
        *,
        emission: str | None = None,
        normals: NormalTextures | None = None,
    ) -> Added:
        """Add the reflectance of a shape that has ``records`` records.

        Args:
            mesh: gives its triangles.
            pixels_per_unit: of the shape, along the camera's path; None if that is not known.
            emission: the name of the emission group that its area light belongs to; None where none is shown.
            normals: gets its normal texture, if it has one.

        Raises:
            Unsuitable: if its BSDF is not diffuse, or its texture none that can be made of texels.
        """
        bsdf = shape.bsdf()
        parameters, named = self._mi.traverse(bsdf), surface_name(bsdf, shape)
        two_sided = is_two_sided(bsdf)
        if not is_plain(bsdf):
            rule = f"has a {surface_kind(bsdf)} surface, not a diffuse one"
            if any(name in surface_kind(bsdf) for name in _POLARISING):
                rule += " (polarisation of light is not simulated, by any renderer)"
            raise Unsuitable(rule, surface_remedy(bsdf, self._mi), named)
        prefix = "brdf_0.reflectance" if two_sided else "reflectance"
        if two_sided and not _same_on_both_sides(parameters):
            raise Unsuitable("has two different sides", "give both the same diffuse material", named)
        uv: FloatArray | None = None
        uv_map, wrap = np.eye(3), 0
        image = self._stand_ins.get(reflectance_of(bsdf))
        if image is not None:
            self._of_images.append(len(self._sizes))
            texels, wrap = self._of_image(image, pixels_per_unit)
        elif f"{prefix}.value" in parameters:
            value = np.array(parameters[f"{prefix}.value"], np.float64).reshape(-1)
            texels = Texels(np.broadcast_to(value, (1, 1, 3)))
        elif f"{prefix}.data" in parameters:
            uv_map = uv_map_of(parameters, f"{prefix}.")
            data, evaluate = np.asarray(parameters[f"{prefix}.data"]), bsdf.eval_diffuse_reflectance
            texels, wrap = self._lookup(data, evaluate, uv_map, pixels_per_unit, named)
        else:
            texture = reflectance_of(bsdf)
            kind = plugin_name(texture)
            if kind == "checkerboard":
                uv_map = uv_map_of(parameters, f"{prefix}.")
                pixels = None if pixels_per_unit is None else pixels_per_unit(uv_map)
                if (made := checkerboard(parameters, prefix, pixels)) is None:
                    rule = "has a checkerboard of textures as its reflectance"
                    raise Unsuitable(rule, "give it two colours, or as a bitmap", named)
                texels = Texels(made[0])
                self._ramped(made[1])
            elif kind == "mesh_attribute":
                colours = vertex_colours(texture, shape, mesh().faces, self._mi) if shape.is_mesh() else None
                if colours is None:
                    raise Unsuitable("has a mesh_attribute that its mesh does not have", "give the mesh colours", named)
                data, upwards = colours_as_texture(colours)
                texels, uv, wrap = Texels(data), upwards * [1, -1] + [0, 1], 1
            else:
                rule = f"has a {kind} as its reflectance, neither a constant nor a bitmap"
                raise Unsuitable(rule, "give it as a bitmap", named)
        if emission is not None:
            emitted = self._emission_of(shape, pixels_per_unit)
            (texels, wrap, uv_map), emitted_texels = alike(TextureImage(texels, wrap, uv_map), emitted, named)
            self._emissions[len(self._sizes)] = emission, emitted_texels
        if normals is not None and (turned := normals.of(bsdf)) is not None:
            if uv is not None:
                raise Unsuitable("has a mesh_attribute and a normal map", "give it one of the two", named)
            read = self._directions_of if turned.height is None else self._heights_of
            turning, plain = read(turned.texture, named), TextureImage(texels, wrap, uv_map)
            texels, wrap, uv_map = normals.add(len(self._sizes), turning, plain, named, turned)
        number, (height, width) = len(self._sizes), texels.shape[:2]
        first = number
        if height * width > _LARGE and number not in self._emissions:
            first = self._first_alike(texels, wrap)
        self._texture_of.append(np.full(records, number, np.uint32))
        self._sizes.append((width, height, wrap))
        self._uv_maps.append(uv_map[:2])
        self._texels.append(texels if first == number else self._texels[first])
        self._alike.append(first)
        return Added(two_sided, uv)

    def _first_alike(self, texels: Texels, wrap: int) -> int:
        """Return the number of the first texture that has the same texels; that of the next one where there is none."""
        of_size = self._large.setdefault((texels.shape, wrap), [])
        for known in of_size:
            # Texels of another size are not read for it.
            if self._texels[known] is texels or self._texels[known].digest == texels.digest:
                return known
        of_size.append(len(self._sizes))
        return len(self._sizes)

    def _of_image(self, texture: ImageTexture, pixels_per_unit: PixelsPerUnit | None) -> tuple[Texels, int]:
        """Return the texels of an image and the number of its wrap mode; with hard edges, made finer."""
        if texture not in self._image_texels:
            self._image_texels[texture] = Texels(texture.image.texels, texture.image.light)
        texels = self._image_texels[texture]
        if texture.nearest:
            texels = self._finer(texels, np.eye(3), pixels_per_unit)
        return texels, WRAP_MODES.index(texture.wrap)

    def _finer(self, texels: Texels, uv_map: FloatArray, pixels_per_unit: PixelsPerUnit | None) -> Texels:
        """Return texels with hard edges as so many more that a bilinear lookup shows these as narrow ramps."""
        height, width = texels.shape[:2]
        per_unit = None if pixels_per_unit is None else pixels_per_unit(uv_map)
        pixels = None if per_unit is None else (per_unit[0] / width, per_unit[1] / height)
        ramp = divide(pixels, 1, width * height)
        self._ramped(ramp)
        return texels.repeated(ramp.rows, ramp.columns)

    def _emission_of(self, shape: MitsubaShape, pixels_per_unit: PixelsPerUnit | None) -> TextureImage:
        """Return the radiance that a shape with an area light emits."""
        emitter, named = shape.emitter(), f"the area light of {shape.id()!r}"
        parameters = self._mi.traverse(emitter)
        if "radiance.value" in parameters:
            value = np.array(parameters["radiance.value"], np.float64).reshape(-1)
            return TextureImage(Texels(np.broadcast_to(value, (1, 1, 3))), 0, np.eye(3))
        if "radiance.data" not in parameters:
            raise Unsuitable("has a texture that is no bitmap", "give it as one", named)
        uv_map = uv_map_of(parameters, "radiance.")
        data = np.asarray(parameters["radiance.data"])
        return TextureImage(*self._lookup(data, emitter.eval, uv_map, pixels_per_unit, named), uv_map)

    def _directions_of(self, texture: MitsubaTexture, named: str) -> TextureImage:
        """Return the directions of a normal texture, from 0 to 1."""
        parameters = self._mi.traverse(texture)
        if "value" in parameters:
            value = np.array(parameters["value"], np.float32).reshape(-1)
            # One texel would have no texture coordinates, which say how a surface is turned.
            return TextureImage(Texels(np.broadcast_to(value, (2, 2, 3)).copy()), 0, np.eye(3))
        if "data" not in parameters:
            raise Unsuitable("has a normal map that is no bitmap", "give it as one", named)
        uv_map, data = uv_map_of(parameters), np.asarray(parameters["data"])
        return TextureImage(*self._lookup(data, texture.eval_3, uv_map, None, named), uv_map)

    def _heights_of(self, texture: MitsubaTexture, named: str) -> TextureImage:
        """Return the values of a bump map, as grey texels."""
        parameters = self._mi.traverse(texture)
        uv_map, data = uv_map_of(parameters), np.asarray(parameters["data"])
        uv, mapped = lookup_positions(uv_map)
        meant = bilinear_meaning(data, mapped, looked_up(texture.eval_1, uv, self._mi), LUMINANCE)
        if meant is None:
            raise Unsuitable("has a bump map whose lookup is not bilinear", "give it that filter_type", named)
        texels, wrap = meant
        grey = np.concatenate([piece @ LUMINANCE for _, piece in texels.pieces()]).astype(np.float32)
        return TextureImage(Texels(np.repeat(grey.reshape(*texels.shape[:2], 1), 3, axis=2)), wrap, uv_map)

    def _ramped(self, ramp: Ramp) -> None:
        self.has_ramps = True
        if not ramp.width_px <= RAMP_PX:
            self.ramp_px = max(ramp.width_px, self.ramp_px)

    def _lookup(
        self,
        data: npt.NDArray[np.generic],
        evaluate: Callable[[MitsubaValue], MitsubaValue],
        uv_map: FloatArray,
        pixels_per_unit: PixelsPerUnit | None,
        named: str,
    ) -> tuple[Texels, int]:
        """Find the values (H, W, 3) and the wrap mode of a bitmap; of one that is not filtered, made finer.

        Mitsuba does not tell a bitmap's encoding, wrap mode or filter. So each is tried, until a lookup agrees with
        Mitsuba's own.

        Args:
            evaluate: gives Mitsuba's for a surface interaction.
            named: what has the bitmap, for messages.
        """
        uv, mapped = lookup_positions(uv_map)
        own = looked_up(evaluate, uv, self._mi)
        if (meant := bilinear_meaning(data, mapped, own)) is not None:
            return meant
        if (meant := nearest_meaning(data, mapped, own)) is not None:
            return self._finer(meant[0], uv_map, pixels_per_unit), meant[1]
        rule = "has a texture whose lookup is neither bilinear nor nearest"
        raise Unsuitable(rule, "give its bitmap the filter_type bilinear", named)


def _same_on_both_sides(parameters: MitsubaParameters) -> bool:
    front, back = ({key[7:]: value for key, value in parameters if key.startswith(f"brdf_{side}.")} for side in (0, 1))
    # One BSDF for both sides is listed once.
    return not back or (
        front.keys() == back.keys() and all(np.array_equal(_numbers(front[key]), _numbers(back[key])) for key in front)
    )


def _numbers(value: MitsubaValue) -> npt.NDArray[np.generic]:
    return np.asarray(getattr(value, "matrix", value))
