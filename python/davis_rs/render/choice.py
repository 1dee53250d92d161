"""Which renderer a scene takes."""

from __future__ import annotations

import functools
import warnings
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

from .._mitsuba.variants import FAST, SCALAR, default_variant, load_scene_source, stay_in, variant, variant_is_free
from .._util.argument_error import ArgumentError
from ..geometry.camera import Camera
from ..scene.scene import Scene
from .baked.bake import BAKE_ERROR
from .baked.baked_scene import baked_light, check_baking
from .base import Renderer
from .edges.swept_objects import MovingSilhouettes
from .integrator.renderer import IntegratorRenderer
from .integrator.scalar import ScalarRenderer
from .kept_scenes import kept
from .matte import simplify_materials
from .motion.scene_motion import SceneMotion
from .motion.scene_updates import scene_motion
from .native.renderer import NativeRenderer
from .obstacles import Obstacle, Obstacles, Unsuitable, listed
from .scene_tables.scene_table import SceneTable
from .table.renderer import TableRenderer


@dataclass(frozen=True)
class _Asked:
    """What a renderer is made from, see :func:`make_renderer`.

    Attributes:
        by_name: this renderer and no other.
        reason: why Mitsuba's integrators render it.
    """

    scene: Scene
    camera: Camera
    by_name: bool
    samples: int | None
    lattice_samples: int
    seed: int
    blur: bool
    threads: int | None
    edges: bool
    bake_error: float
    reason: str = "asked for"


class RendererKind(ABC):
    """A renderer that can be chosen.

    Attributes:
        name: of the setting ``renderer``.
        called: how lines call it.
        does: what it renders, for help.
    """

    name: ClassVar[str]
    called: ClassVar[str]
    does: ClassVar[str]

    @abstractmethod
    def make(self, asked: _Asked) -> Renderer:
        """Build the renderer.

        Raises:
            Unsuitable: with all that keeps it from the scene.
            ValueError, OSError: as :func:`make_renderer`.
        """


class _Tables(NamedTuple):
    """A scene's tables, and what they were made from."""

    loaded: Any
    replaced: tuple[str, ...]
    motion: SceneMotion
    table: SceneTable


class NoiseFreeKind(RendererKind):
    """Diffuse triangles, whose light is computed and not drawn at random."""

    baked: ClassVar[bool] = False

    def why_not(self, scene: Scene) -> tuple[Obstacle, ...]:
        """What keeps it from a scene that nobody gave it by name; nothing is rendered or baked."""
        try:
            with variant(SCALAR) as (mi, _):
                self._tables(scene, mi, by_name=False)
        except Unsuitable as unsuitable:
            return unsuitable.obstacles
        return ()

    def _tables(self, scene: Scene, mi: Any, *, by_name: bool) -> _Tables:
        try:
            loaded = load_scene_source(scene.source(), mi)
        except ValueError as error:
            if by_name:
                raise
            # Its other variants may have the plugin.
            raise Unsuitable(f"{mi.variant()} cannot load it") from error
        replaced = simplify_materials(loaded, mi, matte=scene.matte)
        motion = scene_motion(scene, loaded, mi)
        obstacles = Obstacles()
        if self.baked:
            with obstacles.go_on():
                check_baking(loaded, mi, motion, by_name=by_name)
        table = SceneTable(
            loaded,
            mi,
            shadows=scene.shadows,
            any_integrator=by_name,
            moving=list(motion.objects),
            baked=self.baked,
            obstacles=obstacles,
        )
        return _Tables(loaded, replaced, motion, table)


class NativeKind(NoiseFreeKind):
    """The Rust core, under direct light."""

    name, called = "native", "native renderer"
    does = "diffuse meshes, direct light"

    def make(self, asked: _Asked) -> Renderer:
        scene = asked.scene
        with variant(SCALAR) as (mi, _):
            known = scene.source, scene.matte, scene.shadows, asked.by_name, tuple(scene.objects)
            made = kept(known, lambda: self._tables(scene, mi, by_name=asked.by_name))
            motion = scene_motion(scene, made.loaded, mi)
            return _native(asked, made._replace(motion=motion))


class TableKind(NoiseFreeKind):
    """The same on Dr.Jit, with derivatives."""

    name, called = "table", "table kernel"
    does = "the same, on LLVM"

    def make(self, asked: _Asked) -> Renderer:
        name, why = default_variant()
        if name != FAST:
            raise ValueError(f"the table kernel needs Mitsuba's {FAST} variant: {why}")
        with variant(FAST) as (mi, _):
            loaded, replaced, motion, table = self._tables(asked.scene, mi, by_name=asked.by_name)
            if any(light.kind == "spot" for light in table.lights):
                raise Unsuitable("a light is a spot light, which only the native renderer has")
            renderer = TableRenderer(table, asked.camera, samples=_rays(asked), blur=asked.blur, motion=motion)
            renderer.silhouettes = MovingSilhouettes(loaded, motion) if asked.edges else None
        renderer.reason += _taken_as_matte(asked.scene, replaced)
        return renderer


class BakedKind(NoiseFreeKind):
    """The Rust core, under light that is computed once."""

    name, called = "baked", "renderer of baked light"
    does = "native, with the light of area lamps and bounces computed once"
    baked = True

    def make(self, asked: _Asked) -> Renderer:
        with variant(SCALAR) as (mi, _):
            made = self._tables(asked.scene, mi, by_name=asked.by_name)
            made.table.bake(functools.partial(baked_light, asked.scene, motion=made.motion, error=asked.bake_error))
            return _native(asked, made)


class IntegratorKind(RendererKind):
    """Mitsuba's own integrators, whose light is drawn at random."""

    name, called = "integrator", "Mitsuba's integrators"
    does = "Mitsuba's, for everything"

    def make(self, asked: _Asked) -> Renderer:
        scene = asked.scene
        variant_name, why_variant = default_variant()
        with variant(variant_name) as (mi, _):
            loaded = load_scene_source(scene.source(), mi)
            replaced = simplify_materials(loaded, mi, matte=scene.matte)
            motion = scene_motion(scene, loaded, mi)
            common: dict[str, Any] = {"blur": asked.blur, "seed": asked.seed, "motion": motion}
            renderer: Renderer
            if variant_name == SCALAR:
                samples = 2 if asked.samples is None else asked.samples
                renderer = ScalarRenderer(loaded, asked.camera, samples=samples, reason=why_variant, **common)
            else:
                samples = 8 if asked.samples is None else asked.samples
                renderer = IntegratorRenderer(loaded, asked.camera, samples=samples, reason=asked.reason, **common)
            renderer.silhouettes = MovingSilhouettes(loaded, motion) if asked.edges else None
        renderer.reason += _taken_as_matte(scene, replaced)
        return renderer


KINDS: dict[str, RendererKind] = {
    kind.name: kind for kind in (NativeKind(), TableKind(), BakedKind(), IntegratorKind())
}
"""All that can be chosen, by name."""

AUTOMATIC = tuple(KINDS[name] for name in ("native", "baked", "integrator"))
"""Of these ``auto`` takes the first that can render a scene; the last one can render any."""

RENDERERS = ("auto", *KINDS)
"""What ``renderer`` may be."""


def make_renderer(
    scene: Scene,
    camera: Camera,
    *,
    samples: int | None = None,
    lattice_samples: int = 8,
    seed: int = 0,
    kind: str = "auto",
    blur: bool | None = None,
    threads: int | None = None,
    edges: bool = False,
    bake_error: float = BAKE_ERROR,
) -> Renderer:
    """Choose and build the renderer for a scene.

    Args:
        samples: rays a pixel; None means ``lattice_samples``, and for Mitsuba's integrators, whose rays are random, 8,
            or 2 in the scalar variant.
        seed: of Mitsuba's integrators; the others draw nothing at random.
        kind: ``table`` (the table kernel: diffuse meshes under point, directional and constant light, on Dr.Jit),
            ``native`` (the same scenes in the Rust core, without LLVM and faster), ``baked`` (the native renderer under
            light from lamps, from all sides and from other surfaces, which is computed once and kept), ``integrator``
            (Mitsuba's own, for everything else) or ``auto``: the native renderer where it computes what the scene asks
            for, else under baked light where that is possible, and else Mitsuba's integrators.
        edges: prepare :attr:`Renderer.silhouettes` where the renderer does not track edges itself.
        blur: the 3 x 3 blur of luma; None leaves it to the scene.
        threads: of the native renderer; None for all that there are.
        bake_error: how much baked light may err, relative.

    Raises:
        ValueError: if the scene cannot be loaded, it has none of the objects or lights that shall change, or ``table``,
            ``native`` or ``baked`` was asked for and cannot render it: with all that keeps it from that.
        OSError: if a scene file cannot be read.

    Warns:
        UserWarning: if the scene's light is ambient (:attr:`Scene.ambient`), and it is one of Mitsuba's integrators
            that renders it.
    """
    if kind not in RENDERERS:
        raise ArgumentError("{renderer} must be one of {}, got {!r}", ", ".join(RENDERERS), kind)
    free = variant_is_free()
    asked = _Asked(
        scene=scene,
        camera=camera,
        by_name=kind != "auto",
        samples=samples,
        lattice_samples=lattice_samples,
        seed=seed,
        blur=scene.blur if blur is None else blur,
        threads=threads,
        edges=edges,
        bake_error=bake_error,
    )
    chosen, renderer = _first_possible(asked) if kind == "auto" else (KINDS[kind], _by_name(KINDS[kind], asked))
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
    """What keeps the renderers that ``auto`` prefers from a scene; nothing is rendered or baked.

    Each of them has a list; it is the one with the fewest obstacles.

    Raises:
        ValueError, OSError: as :func:`make_renderer`.
    """
    return _fewest([kind.why_not(scene) for kind in AUTOMATIC if isinstance(kind, NoiseFreeKind)])


def _by_name(kind: RendererKind, asked: _Asked) -> Renderer:
    try:
        return kind.make(asked)
    except Unsuitable as unsuitable:
        raise ValueError(f"the {kind.called} cannot render this scene: {unsuitable}") from None


def _first_possible(asked: _Asked) -> tuple[RendererKind, Renderer]:
    """The first of ``AUTOMATIC`` that can render the scene."""
    met: list[tuple[Obstacle, ...]] = []
    for kind in AUTOMATIC[:-1]:
        try:
            return kind, kind.make(asked)
        except Unsuitable as unsuitable:
            met.append(unsuitable.obstacles)
    obstacles = list(map(str, _fewest(met)))
    more = f"; and {len(obstacles) - _TOLD} more" if len(obstacles) > _TOLD else ""
    return AUTOMATIC[-1], AUTOMATIC[-1].make(replace(asked, reason="; ".join(obstacles[:_TOLD]) + more))


_TOLD = 3
"""Obstacles in the line that says why Mitsuba's integrators render a scene."""


def _fewest(lists: Sequence[tuple[Obstacle, ...]]) -> tuple[Obstacle, ...]:
    """The shortest list of obstacles; of equal ones the last, whose renderer can do more."""
    return min(reversed(lists), key=len)


def _native(asked: _Asked, made: _Tables) -> Renderer:
    """The native renderer of tables."""
    renderer = NativeRenderer(
        made.table,
        asked.camera,
        samples=_rays(asked),
        blur=asked.blur,
        motion=made.motion,
        threads=asked.threads,
    )
    renderer.reason += _taken_as_matte(asked.scene, made.replaced)
    return renderer


def _rays(asked: _Asked) -> int:
    """Rays a pixel of a renderer whose rays are a lattice."""
    return asked.lattice_samples if asked.samples is None else asked.samples


def _taken_as_matte(scene: Scene, replaced: tuple[str, ...]) -> str:
    """Which materials are, for the line that says what renders."""
    if not scene.matte:
        return ""
    return f"; taken as matte: {listed(replaced) or 'nothing, all that has a diffuse colour is so'}"
