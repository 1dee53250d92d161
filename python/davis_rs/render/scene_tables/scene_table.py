"""Makes flat tables of a diffuse scene of triangles, for the native renderer and the table kernel.

Each triangle becomes one record: its plane, and affine maps from a point on it to texture coordinates (and to the
interpolated normal, where a mesh is smooth). All textures lie in one flat buffer of texels, already weighted to luma:
one buffer for each light colour, so that a red light sees the red of a texture.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from ..._mitsuba.types import (
    JitFloat,
    Mitsuba,
    MitsubaBsdf,
    MitsubaEmitter,
    MitsubaIntegrator,
    MitsubaScene,
    MitsubaShape,
    MitsubaValue,
)
from ..._util.memory_forecast import MeshForecast
from ..._util.progress import say
from ...events.colour import Weights
from ...events.luma import LUMA_WEIGHTS
from ...scene.image_textures import StandIns
from ..baked.baked_scene import BakedLight
from ..baked.irradiance import Surfaces, in_one_point
from ..baked.light_maps import map_coordinates
from ..baked.lights import (
    SHARP,
    area_light_name,
    group_name,
    hidden_shapes,
    hides_lights,
    integrator_of,
    shows_absorption,
    small_lamps,
    textured_lamp,
)
from ..beam_lights import BEAMS, Slide, beam_light
from ..closest_view import ClosestView
from ..curves import CURVES
from ..finish import Finish
from ..media import absorption_within
from ..mesh_buffers import MeshBuffers
from ..obstacles import Obstacles, Unsuitable, plugin_name, shape_name
from ..rays.shadow_rays import scene_centre
from ..round_meshes import MOST_TRIANGLES
from ..texels import CoreColours
from .deforming_meshes import DeformingMesh
from .gloss_table import DIFFUSE, CoreGloss, gloss_table
from .mesh_triangles import MeshTriangles, triangles_of_shapes
from .normal_textures import NormalTextures
from .scene_texture import Added, TextureTable
from .small_lamps import LampPlaces

FloatArray = npt.NDArray[np.float64]

_Float = TypeVar("_Float", np.float32, np.float64)

CoreChannel = tuple[npt.NDArray[np.float32], int, int]
"""A channel of light maps, see :class:`davis_rs._core.SceneRenderer`."""


@dataclass(frozen=True)
class Light:
    """One light: its kind, colour group, strength and id.

    ``vector`` is the position (point, spot, projector and lamp, metres) or the direction that light travels
    (directional, unit). ``background`` is what baked light of strength 1 adds to luma where nothing is hit. ``axis`` is
    the middle of a spot's beam, and the normal at a point of a small area light (kind ``lamp``); ``angles`` (radians
    from a spot's axis) are those up to which it shines fully, and up to which it shines at all. ``slide`` is the number
    of what it throws among the table's slides, and which plane of that. ``instant`` is the number of the instant of
    baked light, see :class:`BakedLight`. What a camera sees directly of the same area lights and skies is a
    light of kind ``visible``. What shapes emit, where that is shown without a bake, is of kind ``emission``: constant
    light on texels of emission.
    """

    kind: str
    group: int
    strength: float
    vector: FloatArray
    name: str = ""
    background: float = 0.0
    axis: FloatArray | None = None
    angles: tuple[float, float] | None = None
    slide: tuple[int, int] | None = None
    instant: int | None = None

    @property
    def beam(self) -> tuple[list[float], tuple[float, float] | None] | None:
        """The spot's axis and angles, as the Rust core takes them."""
        return None if self.axis is None else (self.axis.tolist(), self.angles)


class SceneTable:
    """The tables of a Mitsuba scene, loaded under any variant.

    Args:
        moving: ids of the shapes that move; each has its records in its own frame.
        deforming: ids of those of them whose meshes deform.
        baked: light of area lights and of other surfaces will be baked, see :meth:`bake`; otherwise there is only
            direct light.
        view: how close the camera comes, for textures with hard edges; without it they have a fixed number of texels.
        obstacles: those found before. Where there are any, the scene is only searched for more, because tables of
            millions of triangles take gigabytes.
        finishes: for materials that stand for glossy ones, how these reflect.
        reflections: mirrors show all surfaces, whatever the integrator says.
        emission: the names of the groups of lights, see :func:`~..baked.lights.light_groups`. Then area lights are
            shown from both sides, also by textures, and light of theirs that falls on other surfaces comes from a bake
            alone. None: they need a bake to be shown at all.
        one_sided: the numbers of the shapes whose backs are culled.
        normal_textures: what turns the normals of shapes; the textures are read here. None: there are none.
        stand_ins: textures of the scene that hold no texels, and the images that they stand for.

    Attributes:
        scene: the Mitsuba scene.
        shadows: whether point and directional lights throw them.
        names: the ids of the scene's shapes.
        counts: how many records each of these shapes has.
        corners: float64 (n, 3, 3), the triangles' corners, metres.
        planes: float64 (n, 4): unit normal and offset, n . p + offset = 0.
        u_maps, v_maps: float64 (n, 4): texture coordinates, the texture's own transform included: u = map . (p, 1); 0
            where a texture has one texel and there is no normal texture.
        normal_maps: float64 (n, 3, 4), the interpolated vertex normal before normalisation; None where all is flat.
        textures: the textures, and which one each record has.
        normal_textures: what turns normals.
        two_sided: uint32 (n), 1 where the back of the surface reflects too.
        culled: uint32 (n), 1 where the native renderer sees through the back; None where no shape is so.
        hidden: uint32 (n), 1 where the camera sees through; None where no shape is so.
        frames: uint32 (n), 0 for what stands still, 1, 2, ... for the shapes of ``moving``.
        moving: the ids of the shapes that move.
        deforming: what does not change of the meshes that deform.
        centre: (3,), the middle of what stands still, see :mod:`shadow_rays`.
        lights: the lights.
        slides: what lights throw on surfaces.
        gloss: how glossy surfaces reflect, their textures being their base colours; None where all are diffuse.
        baked: the baked light; None before :meth:`bake`.
        emission_lights: uint32 (n), the number of its light for each triangle that emits.

    Raises:
        Unsuitable: with all that is not a diffuse triangle or a direct light.
        ValueError: for more triangles than there is memory for.
    """

    def __init__(
        self,
        scene: MitsubaScene,
        mi: Mitsuba,
        *,
        shadows: bool,
        any_integrator: bool,
        moving: Sequence[str] = (),
        deforming: Sequence[str] = (),
        baked: bool = False,
        view: ClosestView | None = None,
        obstacles: Obstacles | None = None,
        weights: Weights = LUMA_WEIGHTS,
        finishes: Mapping[MitsubaBsdf, Finish] | None = None,
        reflections: bool = False,
        emission: Sequence[str] | None = None,
        one_sided: Sequence[int] = (),
        normal_textures: NormalTextures | None = None,
        stand_ins: StandIns | None = None,
    ) -> None:
        self.scene, self.shadows, self.moving = scene, shadows, list(moving)
        self._weights = np.asarray(weights)
        self.normal_textures = NormalTextures({}, like_gltf=False) if normal_textures is None else normal_textures
        self._hides_lights = hides_lights(scene)
        obstacles = Obstacles() if obstacles is None else obstacles
        if not any_integrator and not baked:
            with obstacles.collect():
                _check_integrator(integrator_of(scene))
        colours: list[FloatArray] = []
        self.lights: list[Light] = []
        self.slides: list[Slide] = []
        for emitter in scene.emitters():
            if emission is not None and emitter.class_name() == "AreaLight":
                continue
            if not baked or emitter.class_name() in SHARP:
                with obstacles.collect():
                    self.lights += self._lights_of(emitter, mi, colours)
        for shape in small_lamps(scene) if baked and emission is None else ():
            with obstacles.collect():
                self.lights += _area_light_points(shape, mi, colours)
        self.textures = TextureTable(mi, [self._weights * colour for colour in colours], stand_ins)
        shining = dict[MitsubaShape, str]()
        if emission is not None:
            emitters = [shape for shape in scene.shapes() if shape.is_emitter()]
            shining = {shape: group_name(area_light_name(shape), emission) for shape in emitters}
        for name in dict.fromkeys(shining.values()):
            group = self.textures.add_emission_group(name, self._weights)
            self.lights.append(Light("emission", group, 1.0, np.zeros(3), name))
        self.names = [str(shape.id()) for shape in scene.shapes()]
        self.counts: list[int] = []
        surfaces: list[Added] = []
        for shape in scene.shapes():
            faces, added = 0, Added(False)
            with obstacles.collect():
                faces = _triangles(shape)
            read = _once(shape)
            with obstacles.collect():
                per_unit = None
                if view is not None and view.known and faces:
                    per_unit = functools.partial(_pixels_per_unit, view, shape, read)
                finish = (finishes or {}).get(shape.bsdf())
                _check_anisotropic(shape, finish)
                if self._hides_lights:
                    _check_see_through(shape, finish)
                if reflections or shows_absorption(scene):
                    _check_absorbing(shape, finish)
                added = self.textures.add(
                    shape, faces, read, per_unit, emission=shining.get(shape), normals=self.normal_textures
                )
            self.counts.append(faces)
            surfaces.append(added)
        obstacles.refuse()
        self._forecast_memory()
        self.gloss = None
        if finishes:
            self.gloss = gloss_table(scene, finishes, self.counts, baked=baked, reflections=reflections)
        self.two_sided = np.repeat(np.array([added.two_sided for added in surfaces], np.uint32), self.counts)
        self.culled = triangles_of_shapes(self.counts, one_sided)
        self.hidden = triangles_of_shapes(self.counts, hidden_shapes(scene))
        frames = [self.moving.index(name) + 1 if name in self.moving else 0 for name in self.names]
        self.frames = np.repeat(np.array(frames, np.uint32), self.counts)
        self.deforming: list[DeformingMesh] = []
        shapes = list(zip(scene.shapes(), surfaces, strict=True))
        self._add_triangles(shapes, mi, baked=baked, deforming=deforming, one_sided=one_sided)
        still = self.frames == 0
        self.centre = scene_centre((self.corners if still.all() else self.corners[still]).reshape(-1, 3))
        self.baked: BakedLight | None = None

    def _lights_of(self, emitter: MitsubaEmitter, mi: Mitsuba, colours: list[FloatArray]) -> list[Light]:
        """Return the lights of an emitter, and add their colours to ``colours`` unless those of the same hue are there.

        A light whose slide has hues is three lights, each of one channel: the texels of a surface are weighted to luma
        for one colour, and that of such a light differs from place to place.
        """
        if emitter.class_name() not in BEAMS:
            return [_light(emitter, mi, colours)]
        read = beam_light(emitter, mi)
        kind = "projector" if read.angles is None else "spot"

        def light(intensity: FloatArray, slide: tuple[int, int] | None) -> Light:
            strength, group = _strength(intensity, colours)
            axis = None if read.angles is None else read.axis
            return Light(kind, group, strength, read.position, emitter.id(), axis=axis, angles=read.angles, slide=slide)

        if read.slide is None:
            return [light(read.intensity, None)]
        number, planes = len(self.slides), read.slide.planes
        self.slides.append(read.slide)
        if planes == 1:
            return [light(read.intensity, (number, 0))]
        channels = (plane for plane in range(planes) if read.intensity[plane] != 0)
        return [light(read.intensity * np.eye(planes)[plane], (number, plane)) for plane in channels]

    def _forecast_memory(self) -> None:
        """Say how much memory the tables will take if it is much, and refuse more than there is before it is taken."""
        forecast = MeshForecast(
            sum(self.counts),
            textured=bool((self.textures.sizes[:, 1:3] > 1).any()),
            smooth=any(shape.has_vertex_normals() for shape in self.scene.shapes()),
            sharp_lights=sum(light.kind not in _EVEN for light in self.lights) if self.shadows else 0,
        )
        forecast.refuse()
        if line := forecast.line():
            say(line)

    def _add_triangles(
        self,
        shapes: Sequence[tuple[MitsubaShape, Added]],
        mi: Mitsuba,
        *,
        baked: bool,
        deforming: Sequence[str],
        one_sided: Sequence[int],
    ) -> None:
        """Compute what each triangle has, a part of a mesh at a time.

        Args:
            shapes: each with what its reflectance says.
            deforming: ids of those whose meshes deform.
            one_sided: the numbers of those whose backs are culled; the order of their corners says which side that is,
                where they emit nothing.
        """
        count, first = sum(self.counts), 0
        self.corners, self.planes = np.empty((count, 3, 3)), np.empty((count, 4))
        # Zeros that nobody writes take no memory: where a texture is the same everywhere, or nothing is smooth.
        self._mesh_uv = np.zeros((count, 4)), np.zeros((count, 4))
        normal_maps, smooth, flat = np.zeros((count, 3, 4)), False, np.ones(count, np.bool_)
        sizes = zip(shapes, self.textures.sizes.tolist(), self.textures.uv_maps, strict=True)
        for number, ((shape, added), (_, width, height, _), uv_map) in enumerate(sizes):
            textured = (width, height) != (1, 1) or number in self.normal_textures
            of_shape, parts = first, list[MeshTriangles]()
            # Which side is the front matters only where the back is another, or the front alone emits.
            matters = not added.two_sided or (baked and shape.is_emitter())
            matters |= number in self.normal_textures and not self.normal_textures.like_gltf
            turned = None if matters and (number not in one_sided or shape.is_emitter()) else False
            for part in MeshTriangles.parts(shape, added.uv):
                turned = part.is_turned(shape, mi) if turned is None else turned
                if shape.id() in deforming:
                    parts.append(part)
                    part.replace_flat()
                side, rows = -1.0 if turned else 1.0, slice(first, first + part.count)
                first = rows.stop
                self.corners[rows], self.planes[rows] = part.corners, part.planes() * side
                if textured:
                    for table, maps in zip(self._mesh_uv, part.texture_maps(), strict=True):
                        table[rows] = maps
                if part.vertex_normals is not None:
                    maps, is_smooth = part.normal_maps()
                    smooth |= is_smooth
                    normal_maps[rows], flat[rows] = maps * side, False
            if parts:
                self.deforming.append(
                    _deforming(shape, self.moving, of_shape, parts, uv_map if textured else None, side)
                )
        self.u_maps, self.v_maps = self.uv_maps(np.float64)
        self.normal_maps = normal_maps if smooth else None
        if smooth:
            normal_maps[flat, :, 3] = self.planes[flat, :3]

    @property
    def surfaces(self) -> Surfaces:
        """What light falls on, for the bake."""
        maps = self.normal_maps
        if maps is None:
            at_corners = np.repeat(self.planes[:, None, :3], 3, axis=1)
        else:
            at_corners = np.einsum("tij,tkj->tki", maps[..., :3], self.corners) + maps[:, None, :, 3]
        length = np.linalg.norm(at_corners, axis=-1, keepdims=True)
        normals = np.divide(at_corners, length, out=np.zeros_like(at_corners), where=length > 0)
        # A file may list the corners of some triangles the wrong way round. What reflects on both sides shows it in
        # nothing else, and the light of a side must be that of the half space in front of it.
        turned = (np.einsum("tki,ti->t", normals, self.planes[:, :3]) < 0) & (self.two_sided != 0)
        normals[turned] *= -1.0
        corners, looks, texture_of = self.corners, self.textures.images_digest, self.textures.texture_of
        clear, any_lit = np.zeros(len(corners), np.bool_), True
        if self.gloss is not None:
            looks += self.gloss.digest
            clear, glass = self.gloss.is_clear, self.gloss.is_glass
            corners, any_lit = in_one_point(corners, glass), not glass.all()
            normals[glass] = (0.0, 0.0, 1.0)
        at_points = np.concatenate([self.corners, np.ones((*self.corners.shape[:2], 1))], -1)
        return Surfaces(
            corners=corners,
            fronts=self.planes[:, :3],
            normals=normals,
            clear=clear,
            two_sided=self.two_sided == 1,
            counts=self.counts,
            frames=self.frames.astype(np.int64),
            uv=np.stack([np.einsum("tkj,tj->tk", at_points, maps) for maps in (self.u_maps, self.v_maps)], -1),
            texture_of=texture_of,
            reflectances=functools.cache(self._reflectances),
            looks=looks,
            bumpy=np.isin(texture_of, self.normal_textures.numbers),
            any_lit=any_lit,
        )

    def _reflectances(self) -> CoreColours:
        """Return how much of the light from all sides each texel reflects."""
        gloss = self.gloss
        if gloss is None:
            return self.textures.shared().colours()
        # A texture that no triangle shows has no finish.
        finishes = gloss.finishes_of_textures(self.textures.texture_of)

        def albedo(number: int, base: FloatArray) -> FloatArray:
            return gloss.albedo(finishes.get(number, DIFFUSE), base)

        return self.textures.shared(finishes).colours(albedo)

    def bake(self, light: Callable[[Surfaces], BakedLight]) -> None:
        """Compute the light on the surfaces with ``light``, and add it to the lights."""
        self.baked = light(self.surfaces)
        self._first_baked = self._add_baked(self.baked)
        self.emission_lights = (self._first_baked + self.baked.emitters).astype(np.uint32)

    def _add_baked(self, baked: BakedLight) -> int:
        """Add baked light to the lights, and return the number of the first.

        Each group has one light that is seen directly, and one for each instant and colour that falls on surfaces.
        """
        grey = self.textures.is_grey and all((texels == texels[:, :1]).all() for texels in baked.maps.texels)
        self._channels = 1 if grey else 3
        group_weights = self.textures.group_weights
        first, group = len(self.lights), len(group_weights)
        group_weights += [self._weights] if grey else list(np.diag(self._weights))
        nowhere = np.zeros(3)
        for name, background in zip(baked.names, baked.backgrounds, strict=True):
            self.lights.append(Light("visible", group, 1.0, nowhere, name, background))
        for instant in range(len(baked.maps.instants)):
            for name in baked.names:
                for channel in range(self._channels):
                    self.lights.append(Light("baked", group + channel, 1.0, nowhere, name, instant=instant))
        return first

    def light_of_group(self, group: int) -> int:
        """Return the number of the light by which a group of baked lights is seen directly."""
        return self._first_baked + group

    @property
    def irradiance(self) -> list[CoreChannel]:
        """The texels of the maps of each baked light: irradiance / pi."""
        maps = [] if self.baked is None else self.baked.maps.texels
        return [_channel(texels, channel) for texels in maps for channel in range(self._channels)]

    @property
    def irradiance_vectors(self) -> list[list[CoreChannel]]:
        """The x, y and z of the maps of irradiance vectors of each baked light; empty where no surface needs them."""
        maps = [] if self.baked is None else self.baked.maps.vectors
        return [
            [_channel(vectors, 3 * axis + channel) for axis in range(3)]
            for vectors in maps
            for channel in range(self._channels)
        ]

    def light_map_coordinates(self) -> tuple[FloatArray, FloatArray]:
        """Return affine maps (n, 2, 4) of a point to u and v in the light maps of a triangle's front and back."""
        assert self.baked is not None
        return map_coordinates(self.corners, self.baked.maps.divisions)

    def core_texels(self, textures: TextureTable) -> list[npt.NDArray[np.float32]]:
        """Return the texels as luma, for each light colour, with a border of one texel around each texture.

        Glossy surfaces are shaded in colour, so that of their textures no luma is there.

        Args:
            textures: those of the table, or the same ones shared.
        """
        finishes = {} if self.gloss is None else self.gloss.finishes_of_textures(self.textures.texture_of)
        unseen = {number for number, finish in finishes.items() if finish != DIFFUSE}
        return [textures.framed(group, unseen) for group in range(len(textures.group_weights))]

    def core_gloss(self, textures: TextureTable) -> CoreGloss | None:
        """Return what the core takes of glossy surfaces; None where all are diffuse.

        Args:
            textures: those of the table, or the same ones shared, as the core has them.
        """
        if self.gloss is None:
            return None
        # The core makes luma of red, green and blue; behind a colour filter other weights stand in their place.
        colours = np.array(self.textures.group_weights).reshape(-1, 3) / LUMA_WEIGHTS
        of_luma = self._weights / LUMA_WEIGHTS
        backgrounds = np.zeros((len(self.lights), 3))
        emitted, sky = np.zeros(0), None
        shining = {light.name: number for number, light in enumerate(self.lights) if light.kind == "emission"}
        for number, light in enumerate(self.lights):
            if light.kind == "constant":
                backgrounds[number] = colours[light.group]
        if self.baked is not None and self.baked.coloured is not None:
            coloured = self.baked.coloured
            groups = slice(self._first_baked, self._first_baked + len(coloured.backgrounds))
            backgrounds[groups] = coloured.backgrounds * of_luma
            emitted = (coloured.emitted * of_luma).ravel()
            if coloured.sky is not None:
                texels = np.ascontiguousarray(coloured.sky.texels * of_luma, np.float32)
                sky = self.light_of_group(coloured.sky.group), coloured.sky.side, texels.ravel()
        return (
            self.gloss.core_finishes(),
            self.gloss.finish_of,
            textures.colours(),
            colours.tolist(),
            backgrounds.tolist(),
            emitted,
            sky,
            self.gloss.longest,
            self.gloss.core_lobes(),
            self.textures.emissive(shining, of_luma),
        )

    def uv_maps(self, precision: type[_Float]) -> tuple[npt.NDArray[_Float], npt.NDArray[_Float]]:
        """Return :attr:`u_maps` and :attr:`v_maps`, computed in this precision from maps that were rounded to it."""
        u, v = (maps.astype(precision, copy=False) for maps in self._mesh_uv)
        # The texture's own uv transform is affine too: fold it into the mesh's maps.
        if (self.textures.uv_maps == np.eye(3)[:2]).all():
            return u, v
        own = self.textures.uv_maps.astype(precision)[self.textures.texture_of]
        offset = np.array([0, 0, 0, 1], precision)
        folded = [own[:, i, :1] * u + own[:, i, 1:2] * v + own[:, i, 2:] * offset for i in (0, 1)]
        return folded[0], folded[1]

    @property
    def description(self) -> str:
        """What the scene is made of, for messages."""
        surfaces = "diffuse triangles" if self.gloss is None else "diffuse and glossy triangles"
        glass = "; what solid glass shows is grainy, and makes events of its own" if self._has_solid_glass else ""
        polarizers = ""
        if self.gloss is not None and self.gloss.has_polarizers:
            polarizers = "; light is not polarised, so that each polarizer takes half of it, whatever its angle"
        if self.baked is not None:
            films = f"{polarizers}, and throws no shadow in baked light" if polarizers else ""
            return f"{surfaces} under {self.baked.description}{glass}{films}"
        kinds = sorted({light.kind for light in self.lights} - {"emission"})
        lights = f"{' and '.join(kinds)} light" if kinds else "no light"
        return f"{surfaces} under {lights}, {'with' if self.shadows else 'without'} shadows{glass}{polarizers}"

    @property
    def _has_solid_glass(self) -> bool:
        return self.gloss is not None and self.gloss.has_solid_glass

    @property
    def background_luma(self) -> float:
        """Luma of a ray that hits nothing: the radiance of the constant lights, unless the scene hides its lights."""
        return float(self.background(self.lights))

    def background(self, lights: Sequence[Light]) -> JitFloat:
        """Return :attr:`background_luma` under these lights, whose strengths may be Dr.Jit arrays."""
        shown = ((light.strength, self.background_per_strength(light)) for light in lights)
        return sum(strength * per_strength for strength, per_strength in shown if per_strength)

    def background_per_strength(self, light: Light) -> float:
        """Return what a light of strength 1 adds to :attr:`background_luma`."""
        if light.kind in ("baked", "visible"):
            return light.background
        if self._hides_lights or light.kind != "constant":
            return 0.0
        return float(self.textures.group_weights[light.group].sum())


def _check_see_through(shape: MitsubaShape, finish: Finish | None) -> None:
    """Refuse what one sees through along straight rays: Mitsuba hides the sky behind it, and in part lamps."""
    if finish is not None and (finish.blends or finish.under[0] == "sheet"):
        rule = "is seen through, and the scene's integrator hides lights (hide_emitters), in part also those behind it"
        raise Unsuitable(rule, "leave hide_emitters out", shape_name(shape))


def _check_anisotropic(shape: MitsubaShape, finish: Finish | None) -> None:
    """Refuse an anisotropic mesh without texture coordinates, which say along what."""
    if finish is not None and finish.across is not None and shape.is_mesh() and not shape.has_vertex_texcoords():
        rule = "is anisotropic, and has no texture coordinates that say along what"
        raise Unsuitable(rule, "give it some, or one roughness along and across", shape_name(shape))


def _check_absorbing(shape: MitsubaShape, finish: Finish | None) -> None:
    """Refuse what absorbs light inside and is no surface of a solid, but lets light pass."""
    passes = finish is not None and (finish.under[0] in ("sheet", "blend") or finish.transmission > 0)
    if passes and any(absorption_within(shape) or ()):
        rule = "has a medium inside, and its surface is not that of a dielectric"
        raise Unsuitable(rule, "make it a dielectric, or take its medium away", shape_name(shape))


def _channel(texels: npt.NDArray[np.float32], channel: int) -> CoreChannel:
    """Return one channel of texels (n, channels) for the core; nothing is copied."""
    return texels.ravel(), texels.shape[1], channel


_EVEN = ("constant", "emission")
"""Kinds of light that throw no shadow."""


def _check_integrator(integrator: MitsubaIntegrator) -> None:
    remedy = "name the integrator direct, for direct light alone"
    if integrator is None:
        raise Unsuitable("the scene names no integrator, so it means a path tracer's light, with all bounces", remedy)
    if integrator.class_name() != "DirectIntegrator":
        raise Unsuitable(f"the scene asks for the light of Mitsuba's {integrator.class_name()}", remedy)


def _triangles(shape: MitsubaShape) -> int:
    """Return the number of triangles of a mesh."""
    if not shape.is_mesh():
        rule = f"is a {plugin_name(shape)}, not made of triangles"
        if plugin_name(shape) in CURVES:
            segments = int(shape.primitive_count())
            rule = f"is a {plugin_name(shape)} of {segments:,} segments, too many for {MOST_TRIANGLES:,} triangles"
        raise Unsuitable(rule, "give it as a mesh", shape_name(shape))
    return int(shape.face_count())


def _deforming(
    shape: MitsubaShape,
    moving: Sequence[str],
    first: int,
    parts: Sequence[MeshTriangles],
    uv_map: FloatArray | None,
    side: float,
) -> DeformingMesh:
    """Return what does not change of a mesh that deforms.

    Args:
        first: the number of its first triangle.
        uv_map: the texture's own transform (2, 3) of texture coordinates; None where it has one texel.
    """
    name = str(shape.id())
    uv = None
    if uv_map is not None:
        uv = np.concatenate([part.corner_uv() for part in parts]) @ uv_map[:, :2].T + uv_map[:, 2]
    faces = np.concatenate([part.faces for part in parts])
    return DeformingMesh(name, moving.index(name) + 1, first, faces, uv, side)


def _once(shape: MitsubaShape) -> Callable[[], MeshTriangles]:
    """Return what gives a shape's triangles, read when they are first asked for."""
    return functools.cache(lambda: MeshTriangles(MeshBuffers.of(shape)))


def _pixels_per_unit(
    view: ClosestView, shape: MitsubaShape, read: Callable[[], MeshTriangles], uv_map: FloatArray
) -> tuple[float, float]:
    """Return how many pixels a unit of a shape's texture coordinates covers at most along each axis.

    Args:
        read: gives the shape's triangles.
        uv_map: the transform (3, 3) of the texture coordinates.
    """
    mesh = read()
    u, v = mesh.texture_maps()
    pixels = view.pixels_per_metre(mesh.corners, str(shape.id()))
    along = []
    for row in uv_map[:2]:
        per_metre = np.linalg.norm(row[0] * u[:, :3] + row[1] * v[:, :3], axis=1)
        varies = per_metre > 0
        along.append(float((pixels[varies] / per_metre[varies]).max(initial=0.0)))
    return along[0], along[1]


def _light(emitter: MitsubaEmitter, mi: Mitsuba, colours: list[FloatArray]) -> Light:
    """Return an emitter that shines alike to all sides as a light, and add its colour to ``colours`` unless one of the
    same hue is there."""
    kind = emitter.class_name()
    parameters = mi.traverse(emitter)
    names = {
        "PointLight": ("point", "intensity.value"),
        "DirectionalEmitter": ("directional", "irradiance.value"),
        "ConstantBackgroundEmitter": ("constant", "radiance.value"),
    }
    if kind not in names or names[kind][1] not in parameters:
        rule = f"a light is a {kind}, not a projector, or a point, spot, directional or constant light of one colour"
        raise Unsuitable(rule, "give it as one of these")
    kind, name = names[kind]
    strength, group = _strength(parameters[name], colours)
    vector = np.zeros(3)
    if kind == "point":
        vector = np.array(parameters["position"], np.float64).reshape(3)
    elif kind == "directional":
        vector = np.array(parameters["to_world"].matrix, np.float64).reshape(4, 4)[:3, 2]
        vector = vector / np.linalg.norm(vector)
    return Light(kind, group, strength, vector, emitter.id())


def _strength(value: MitsubaValue, colours: list[FloatArray]) -> tuple[float, int]:
    """Return a light's strongest channel, and the number of its colour in ``colours``, to which it is added if new."""
    rgb = np.broadcast_to(np.array(value, np.float64).reshape(-1), (3,))
    strength = float(rgb.max())
    colour = rgb / strength if strength > 0 else np.ones(3)
    group = next((i for i, known in enumerate(colours) if np.allclose(known, colour, atol=1e-6)), len(colours))
    if group == len(colours):
        colours.append(colour)
    return strength, group


def _area_light_points(shape: MitsubaShape, mi: Mitsuba, colours: list[FloatArray]) -> list[Light]:
    """Return a small area light as a few places on it, whose light falls off with the cosine to their normals."""
    parameters = mi.traverse(shape.emitter())
    if "radiance.value" not in parameters:
        raise textured_lamp(area_light_name(shape))
    strength, group = _strength(parameters["radiance.value"], colours)
    name = area_light_name(shape)
    return [
        Light("lamp", group, strength * area, point, name, axis=normal)
        for point, normal, area in zip(*LampPlaces.on(shape, mi), strict=True)
    ]
