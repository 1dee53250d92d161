"""Chooses the renderer for a scene, and builds it."""

from __future__ import annotations

import functools
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

from .._mitsuba.types import Mitsuba, MitsubaScene, MitsubaShape
from .._mitsuba.variants import (
    FAST,
    SCALAR,
    default_variant,
    load_scene_contents,
    load_scene_source,
    stay_in,
    variant,
    variant_is_free,
)
from .._util.argument_error import ArgumentError
from .._util.former_names import takes_former_names
from ..events.colour import Weights
from ..events.luma import LUMA_WEIGHTS
from ..geometry.camera import PRESETS, Camera
from ..scene.image_textures import stand_ins
from ..scene.scene import Scene
from .baked.bake import BAKE_ERROR
from .baked.baked_scene import baked_light, check_baking
from .baked.lights import follows_media, light_groups, shows_absorption
from .base import Renderer
from .closest_view import ClosestView
from .diffuse_materials import simplify_materials
from .edges.swept_objects import MovingSilhouettes
from .integrator.renderer import IntegratorRenderer
from .integrator.scalar import ScalarRenderer
from .media import has_media, has_more_than_absorption
from .motion.scene_motion import SceneMotion
from .motion.scene_updates import scene_motion
from .native.estimators import ESTIMATORS
from .native.renderer import NativeRenderer
from .native.seen_places import seen_places
from .obstacles import Obstacle, Obstacles, Unsuitable, listed, shape_name
from .primitives import triangulated
from .scene_cache import cached
from .scene_tables.normal_textures import NormalTextures
from .scene_tables.scene_table import SceneTable
from .scene_tables.scene_texture import TextureTable
from .table.renderer import TableRenderer


@dataclass(frozen=True)
class _RendererRequest:
    """Holds the arguments of :func:`make_renderer`.

    Attributes:
        by_name: the renderer was named, not chosen by ``auto``.
        reason: why Mitsuba's integrators render the scene.
    """

    scene: Scene
    camera: Camera
    by_name: bool
    rays_per_pixel: int | None
    lattice_rays_per_pixel: int
    glossy_rays_per_pixel: int | None
    seed: int
    blur: bool
    threads: int | None
    edges: bool
    bake_error: float
    pixel: str | None
    lattice_pixel: str
    weights: Weights
    reason: str = "asked for"


class RendererKind(ABC):
    """Describes a renderer that can be chosen.

    Attributes:
        name: the value of the setting ``renderer``.
        label: its name in messages.
        summary: what it renders, for help texts.
    """

    name: ClassVar[str]
    label: ClassVar[str]
    summary: ClassVar[str]

    @abstractmethod
    def make(self, request: _RendererRequest) -> Renderer:
        """Build the renderer.

        Raises:
            Unsuitable: with all obstacles of the scene.
            ValueError, OSError: as :func:`make_renderer`.
        """


class _SceneTables(NamedTuple):
    """Holds a scene's tables, and what they were made from.

    Attributes:
        view: the camera's path that they were made for.
        for_view: whether they would differ for another path.
        made: what was replaced by triangles or by texels, for a message.
    """

    loaded: MitsubaScene
    replaced: tuple[str, ...]
    motion: SceneMotion
    table: SceneTable
    view: ClosestView
    for_view: bool
    made: str


class NoiseFreeKind(RendererKind):
    """Describes a renderer of triangles whose light is computed, not drawn at random.

    Attributes:
        baked: light of lamps and of other surfaces is computed once.
        glossy: surfaces may have a finish, not diffuse ones alone.
        culls: one sees through backs, such as those of tubes from their open ends.
    """

    baked: ClassVar[bool] = False
    glossy: ClassVar[bool] = True
    culls: ClassVar[bool] = True

    def why_not(self, scene: Scene) -> tuple[Obstacle, ...]:
        """Return the obstacles for ``auto`` to take this renderer; renders and bakes nothing."""
        try:
            with variant(SCALAR) as (mi, _):
                self._tables(scene, PRESETS["ideal"] if scene.camera is None else scene.camera, mi, by_name=False)
        except Unsuitable as unsuitable:
            return unsuitable.obstacles
        return ()

    def _tables(
        self, scene: Scene, camera: Camera, mi: Mitsuba, *, by_name: bool, weights: Weights = LUMA_WEIGHTS
    ) -> _SceneTables:
        try:
            with stand_ins() as images:
                # The table kernel has Mitsuba trace its rays.
                loaded = (load_scene_source if mi.variant() == FAST else load_scene_contents)(scene.source(), mi)
        except ValueError as error:
            if by_name:
                raise
            # Its other variants may have the plugin.
            raise Unsuitable(f"{mi.variant()} cannot load it") from error
        loaded, motion, view, made = triangulated(scene, camera, loaded, mi)
        replaced, finishes, normal_textures = simplify_materials(
            loaded, mi, matte=scene.matte, glossy=self.glossy, may_blend=_may_blend(scene, loaded)
        )
        obstacles = Obstacles()
        for number in () if self.culls else made.open_curves:
            with obstacles.collect():
                rule = "is a bsplinecurve, through whose open ends only the native renderer sees"
                raise Unsuitable(rule, "give it as a mesh", shape_name(loaded.shapes()[number]))
        if self.baked:
            with obstacles.collect():
                check_baking(scene, loaded, mi, motion, by_name=by_name)
        table = SceneTable(
            loaded,
            mi,
            shadows=scene.shadows,
            any_integrator=by_name,
            moving=list(motion.objects),
            deforming=list(motion.deformations),
            baked=self.baked,
            view=view,
            obstacles=obstacles,
            weights=weights,
            finishes=finishes,
            reflections=scene.reflections,
            emission=light_groups(loaded, list(motion.lights)) if scene.soft_light else None,
            one_sided=made.one_sided(scene.one_sided),
            normal_textures=NormalTextures(normal_textures, like_gltf=scene.soft_light),
            stand_ins=images,
        )
        for_view = made.shapes > 0 or table.textures.has_ramps
        told = made.description + _ramps_told(table.textures) + _media_told(scene, loaded)
        return _SceneTables(loaded, replaced, motion, table, view, for_view, told)


class NativeKind(NoiseFreeKind):
    """Describes the native renderer: the Rust core, under direct light."""

    name, label = "native", "native renderer"
    summary = "diffuse meshes, direct light"

    def make(self, request: _RendererRequest) -> Renderer:
        scene = request.scene
        with variant(SCALAR) as (mi, _):
            looks = scene.matte, scene.shadows, scene.reflections, scene.one_sided
            known = scene.source, looks, request.by_name, (*scene.objects, *scene.deformations), request.weights

            def make() -> _SceneTables:
                return self._tables(scene, request.camera, mi, by_name=request.by_name, weights=request.weights)

            made = cached(known, make)
            motion = scene_motion(scene, made.loaded, mi)
            if made.for_view and made.view != ClosestView(scene, request.camera, motion):
                made = make()
            return _native(request, made._replace(motion=motion))


class TableKind(NoiseFreeKind):
    """Describes the table kernel: the same scenes on Dr.Jit, with derivatives."""

    name, label = "table", "table kernel"
    glossy = culls = False
    summary = "the same, on LLVM"

    def make(self, request: _RendererRequest) -> Renderer:
        name, why = default_variant()
        if name != FAST:
            raise ValueError(f"the table kernel needs Mitsuba's {FAST} variant: {why}")
        with variant(FAST) as (mi, _):
            made = self._tables(request.scene, request.camera, mi, by_name=request.by_name, weights=request.weights)
            table, motion = made.table, made.motion
            if motion.deformations:
                raise Unsuitable("a mesh deforms, which only the native renderer and Mitsuba's integrators show")
            if any(light.kind == "spot" for light in table.lights):
                raise Unsuitable("a light is a spot light, which only the native renderer has")
            if any(light.kind == "projector" for light in table.lights):
                raise Unsuitable("a light is a projector, which only the native renderer has")
            if any(light.kind == "emission" for light in table.lights):
                raise Unsuitable("a shape emits light, which only the native renderer shows")
            renderer = TableRenderer(
                table, request.camera, rays_per_pixel=_rays(request), blur=request.blur, motion=motion
            )
            renderer.silhouettes = MovingSilhouettes(made.loaded, motion) if request.edges else None
        renderer.reason += made.made + _taken_as_diffuse(request.scene, made.replaced)
        return renderer


class BakedKind(NoiseFreeKind):
    """Describes the native renderer under baked light, which is computed once."""

    name, label = "baked", "renderer of baked light"
    summary = "native, with the light of area lights and bounces computed once"
    baked = True

    def make(self, request: _RendererRequest) -> Renderer:
        with variant(SCALAR) as (mi, _):
            made = self._tables(request.scene, request.camera, mi, by_name=request.by_name, weights=request.weights)
            light = functools.partial(
                baked_light,
                request.scene,
                made.loaded,
                mi,
                made.motion,
                error=request.bake_error,
                by_name=request.by_name,
                weights=request.weights,
                seen_places=functools.partial(seen_places, made.table, made.motion),
            )
            made.table.bake(light)
            return _native(request, made)


class IntegratorKind(RendererKind):
    """Mitsuba's own integrators, whose light is drawn at random."""

    name, label = "integrator", "Mitsuba's integrators"
    summary = "Mitsuba's, for everything"

    def make(self, request: _RendererRequest) -> Renderer:
        scene = request.scene
        variant_name, why_variant = default_variant()
        with variant(variant_name) as (mi, _):
            loaded = load_scene_source(scene.source(), mi)
            replaced = simplify_materials(loaded, mi, matte=scene.matte).replaced
            motion = scene_motion(scene, loaded, mi)
            blur, seed = request.blur, request.seed
            renderer: Renderer
            if variant_name == SCALAR:
                rays_per_pixel = 2 if request.rays_per_pixel is None else request.rays_per_pixel
                renderer = ScalarRenderer(
                    loaded,
                    request.camera,
                    rays_per_pixel=rays_per_pixel,
                    blur=blur,
                    seed=seed,
                    reason=why_variant,
                    motion=motion,
                    weights=request.weights,
                )
            else:
                rays_per_pixel = 8 if request.rays_per_pixel is None else request.rays_per_pixel
                renderer = IntegratorRenderer(
                    loaded,
                    request.camera,
                    rays_per_pixel=rays_per_pixel,
                    blur=blur,
                    seed=seed,
                    reason=request.reason,
                    motion=motion,
                    weights=request.weights,
                )
            renderer.silhouettes = MovingSilhouettes(loaded, motion) if request.edges else None
        renderer.reason += _taken_as_diffuse(scene, replaced)
        return renderer


RENDERER_KINDS: dict[str, RendererKind] = {
    kind.name: kind for kind in (NativeKind(), TableKind(), BakedKind(), IntegratorKind())
}
"""All renderers that can be chosen, by name."""

AUTOMATIC = tuple(RENDERER_KINDS[name] for name in ("native", "baked", "integrator"))
"""``auto`` takes the first of these that can render a scene; the last one can render any."""

AUTO_RENDERER = "auto"
"""In place of a renderer: the first of :data:`AUTOMATIC` that can render the scene."""

RENDERERS = (AUTO_RENDERER, *RENDERER_KINDS)
"""The values of the setting ``renderer``."""


@takes_former_names(samples="rays_per_pixel", lattice_samples="lattice_rays_per_pixel")
def make_renderer(
    scene: Scene,
    camera: Camera,
    *,
    rays_per_pixel: int | None = None,
    lattice_rays_per_pixel: int = 8,
    glossy_rays_per_pixel: int | None = None,
    seed: int = 0,
    kind: str = AUTO_RENDERER,
    blur: bool | None = None,
    threads: int | None = None,
    edges: bool = False,
    bake_error: float = BAKE_ERROR,
    pixel: str | None = None,
    lattice_pixel: str = "rays",
    weights: Weights = LUMA_WEIGHTS,
) -> Renderer:
    """Choose and build the renderer for a scene.

    Args:
        rays_per_pixel: rays a pixel; None means ``lattice_rays_per_pixel``, and for Mitsuba's integrators, whose
            rays are random, 8, or 2 in the scalar variant.
        glossy_rays_per_pixel: what None means in place of ``lattice_rays_per_pixel`` where surfaces are glossy; None:
            no other number.
        seed: of Mitsuba's integrators; the others draw nothing at random.
        kind: ``table`` (the table kernel: diffuse meshes under point, directional and constant light, on Dr.Jit),
            ``native`` (the same scenes in the Rust core, without LLVM and faster), ``baked`` (the native renderer under
            light from area lights, from all sides and from other surfaces, which is computed once and kept),
            ``integrator`` (Mitsuba's own, for everything else) or ``auto``: the native renderer where it computes what
            the scene asks for, else under baked light where that is possible, and else Mitsuba's integrators.
        edges: prepare :attr:`Renderer.silhouettes`, unless the pixel is one of lines, which see all edges.
        blur: the 3 x 3 blur of luma; None leaves it to the scene.
        threads: of the native renderer; None for all that there are.
        bake_error: how much baked light may err, relative.
        pixel: ``rays`` or ``lines``, see :class:`NativeRenderer`; only that renderer has lines, and only where all
            surfaces are diffuse. None means ``lattice_pixel`` where that is possible and ``rays_per_pixel`` is None,
            else rays.
        weights: of linear red, green and blue in luma; others than those of luma are for colour filters.

    Raises:
        ValueError: if the scene cannot be loaded, if it lacks an object or light that shall change, or if ``table``,
            ``native`` or ``baked`` was asked for and cannot render it: with all obstacles.
        OSError: if a scene file cannot be read.

    Warns:
        UserWarning: if the scene's light is ambient (:attr:`Scene.ambient`) and one of Mitsuba's integrators renders
            it.
    """
    if kind not in RENDERERS:
        raise ArgumentError("{renderer} must be one of {}, got {!r}", ", ".join(RENDERERS), kind)
    free = variant_is_free()
    request = _RendererRequest(
        scene=scene,
        camera=camera,
        by_name=kind != AUTO_RENDERER,
        rays_per_pixel=rays_per_pixel,
        lattice_rays_per_pixel=lattice_rays_per_pixel,
        glossy_rays_per_pixel=glossy_rays_per_pixel,
        seed=seed,
        blur=scene.blur if blur is None else blur,
        threads=threads,
        edges=edges,
        bake_error=bake_error,
        pixel=pixel,
        lattice_pixel=lattice_pixel,
        weights=weights,
    )
    if pixel is not None and pixel not in ESTIMATORS:
        raise ArgumentError("{pixel} must be one of {}, got {!r}", ", ".join(ESTIMATORS), pixel)
    chosen, renderer = (
        _first_possible(request)
        if kind == AUTO_RENDERER
        else (RENDERER_KINDS[kind], _by_name(RENDERER_KINDS[kind], request))
    )
    if pixel == "lines" and not isinstance(renderer, NativeRenderer):
        raise ArgumentError(
            "{pixel:lines} needs the native renderer, not the {} ({}): take {pixel:rays}",
            renderer.name,
            renderer.reason,
        )
    if isinstance(chosen, NoiseFreeKind):
        return renderer
    if free:
        stay_in(renderer.variant)
    if scene.ambient:
        warnings.warn(
            f"scene {scene.name!r} is made for the table kernel or the native renderer, not for the {renderer.name} "
            f"({renderer.reason}): the scene's constant light, which shall come from all sides, does not reach into "
            "its closed room, so that shadows are black and the range of illuminance is far wider than the scene's",
            stacklevel=2,
        )
    return renderer


def why_not_noise_free(scene: Scene) -> tuple[Obstacle, ...]:
    """Return why ``auto`` takes none of the renderers without noise; renders and bakes nothing.

    Of the lists of obstacles of those renderers, this is the shortest.

    Raises:
        ValueError, OSError: as :func:`make_renderer`.
    """
    return _fewest([kind.why_not(scene) for kind in AUTOMATIC if isinstance(kind, NoiseFreeKind)])


def _by_name(kind: RendererKind, request: _RendererRequest) -> Renderer:
    try:
        return kind.make(request)
    except Unsuitable as unsuitable:
        raise ValueError(f"the {kind.label} cannot render this scene: {unsuitable}") from None


def _first_possible(request: _RendererRequest) -> tuple[RendererKind, Renderer]:
    """Build the first renderer of :data:`AUTOMATIC` that can render the scene.

    Where the scene's light is soft (:attr:`Scene.soft_light`), baked light comes first, and what keeps from it is told.
    """
    met: list[tuple[Obstacle, ...]] = []
    baked_first = request.scene.soft_light
    for kind in sorted(AUTOMATIC[:-1], key=lambda kind: kind.name != "baked") if baked_first else AUTOMATIC[:-1]:
        try:
            renderer = kind.make(request)
        except Unsuitable as unsuitable:
            met.append(unsuitable.obstacles)
        else:
            if baked_first and met:
                renderer.reason += f"; its soft light is not baked: {'; '.join(map(str, met[0][:_OBSTACLES_TOLD]))}"
            return kind, renderer
    obstacles = list(map(str, _fewest(met)))
    more = f"; and {len(obstacles) - _OBSTACLES_TOLD} more" if len(obstacles) > _OBSTACLES_TOLD else ""
    return AUTOMATIC[-1], AUTOMATIC[-1].make(replace(request, reason="; ".join(obstacles[:_OBSTACLES_TOLD]) + more))


_OBSTACLES_TOLD = 3
"""How many obstacles the message names that says why Mitsuba's integrators render a scene."""


def _fewest(lists: Sequence[tuple[Obstacle, ...]]) -> tuple[Obstacle, ...]:
    """Return the shortest list of obstacles; among equally short ones the last, because its renderer can do more."""
    return min(reversed(lists), key=len)


def _may_blend(scene: Scene, loaded: MitsubaScene) -> Callable[[MitsubaShape], bool]:
    """Return what says whether a shape may be seen through in part, as the renderers without noise show it.

    It has the shadow of a whole shape, as with most of Mitsuba's integrators; with the volumetric ones it has not. And
    in Mitsuba an area light shines unseen where a mask hides its shape.
    """
    if scene.soft_light:
        return lambda _: True
    volumetric = follows_media(loaded)
    return lambda shape: not volumetric and not shape.is_emitter()


def _native(request: _RendererRequest, made: _SceneTables) -> Renderer:
    """Build the native renderer from tables."""
    renderer = NativeRenderer(
        made.table,
        request.camera,
        rays_per_pixel=_rays(request, glossy=made.table.gloss is not None),
        blur=request.blur,
        motion=made.motion,
        pixel=_pixel(request, made.table),
        threads=request.threads,
    )
    if request.edges and renderer.pixel == "rays" and not made.motion.deformations:
        renderer.silhouettes = MovingSilhouettes(made.loaded, made.motion)
    renderer.reason += made.made + _taken_as_diffuse(request.scene, made.replaced)
    return renderer


def _pixel(request: _RendererRequest, table: SceneTable) -> str:
    """Return what a pixel of the native renderer is made of."""
    if request.pixel is not None:
        return request.pixel
    return request.lattice_pixel if request.rays_per_pixel is None and table.gloss is None else "rays"


def _rays(request: _RendererRequest, *, glossy: bool = False) -> int:
    """Return the rays per pixel of a renderer whose rays are a lattice."""
    if request.rays_per_pixel is not None:
        return request.rays_per_pixel
    if glossy and request.glossy_rays_per_pixel is not None:
        return request.glossy_rays_per_pixel
    return request.lattice_rays_per_pixel


def _ramps_told(textures: TextureTable) -> str:
    """Return how wide the ramps in place of hard edges of textures are, where they are wider than they should be."""
    return f"; hard edges of textures are up to {textures.ramp_px:.2g} px wide" if textures.ramp_px > 0 else ""


def _media_told(scene: Scene, loaded: MitsubaScene) -> str:
    """Return that a scene's media are not rendered, where it has some that are not."""
    left_out = has_more_than_absorption(loaded) if scene.reflections or shows_absorption(loaded) else has_media(loaded)
    return "; its media (fog, milk) are not rendered" if left_out else ""


def _taken_as_diffuse(scene: Scene, replaced: tuple[str, ...]) -> str:
    """Return which materials are taken as diffuse, for the message that names the renderer."""
    if not scene.matte:
        return ""
    return f"; taken as diffuse: {listed(replaced) or 'nothing, all that has a diffuse colour is so'}"
