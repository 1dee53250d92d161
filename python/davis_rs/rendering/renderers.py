"""Which renderer a scene takes."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from typing import Any

from .._mitsuba import FAST, SCALAR, default_variant, load_scene_source, stay_in, variant, variant_is_free
from ..camera import Camera
from ..scene.scene import Scene
from .baked_light.bake import BAKE_ERROR
from .baked_light.baked_scene import baked_light, check_size
from .kept_scenes import kept
from .matte import Materials, listed, simplify_materials
from .render import Renderer
from .render_integrator import IntegratorRenderer
from .render_native import NativeRenderer
from .render_scalar import ScalarRenderer
from .render_table import TableRenderer
from .scene_table import SceneTable, Unsuitable
from .scene_texture import UnsuitableSurface
from .scene_updates import scene_motion
from .swept_objects import MovingSilhouettes

RENDERERS = ("auto", "table", "native", "baked", "integrator")
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
            ``native`` or ``baked`` was asked for and cannot render it.
        OSError: if a scene file cannot be read.

    Warns:
        UserWarning: if the scene's light is ambient (:attr:`Scene.ambient`), and it is one of Mitsuba's integrators
            that renders it.
    """
    if kind not in RENDERERS:
        raise ValueError(f"renderer must be one of {', '.join(RENDERERS)}, got {kind!r}")
    blur = scene.blur if blur is None else blur
    reason, free = "asked for", variant_is_free()
    known: dict[str, list[float | None]] = {"auto": [None, bake_error], "baked": [bake_error], "integrator": []}
    ways = known.get(kind, [None])
    load = functools.cache(functools.partial(_load, scene, kind))
    for error in ways:
        try:
            return _make_from_table(
                scene,
                camera,
                load,
                samples=lattice_samples if samples is None else samples,
                kind=kind,
                blur=blur,
                edges=edges,
                threads=threads,
                bake_error=error,
            )
        except Unsuitable as unsuitable:
            if kind != "auto":
                what = {"native": "native renderer", "baked": "renderer of baked light"}.get(kind, "table kernel")
                raise ValueError(f"the {what} cannot render this scene: {unsuitable}") from None
            reason = str(unsuitable)
    load.cache_clear()  # so that a large scene is in memory once
    renderer = _make_integrator(scene, camera, samples=samples, seed=seed, blur=blur, edges=edges, reason=reason)
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


def _load(scene: Scene, kind: str, variant_name: str) -> tuple[Any, Materials]:
    """The scene under a variant of Mitsuba's, and what was found of its materials.

    Raises:
        Unsuitable: under ``auto``, for one that cannot be loaded.
    """
    with variant(variant_name) as (mi, _):
        try:
            loaded = load_scene_source(scene.source(), mi)
        except ValueError as error:
            if kind != "auto":
                raise
            # Its other variants may have the plugin.
            raise Unsuitable(f"{variant_name} cannot load it") from error
        return loaded, simplify_materials(loaded, mi, matte=scene.matte)


def _make_from_table(
    scene: Scene,
    camera: Camera,
    load: Callable[[str], tuple[Any, Materials]],
    *,
    samples: int,
    kind: str,
    blur: bool,
    edges: bool,
    threads: int | None,
    bake_error: float | None,
) -> Renderer:
    """The table kernel, where it was asked for, or the native renderer.

    Args:
        load: see :func:`_load`.
        bake_error: of the light, which is baked; None for direct light alone.

    Raises:
        Unsuitable: for a scene that is not diffuse triangles, or not under light of the kind that is meant.
    """
    variant_name, why_variant = default_variant() if kind == "table" else (SCALAR, "")
    if variant_name == SCALAR and kind == "table":
        raise ValueError(f"the table kernel needs Mitsuba's {FAST} variant: {why_variant}")
    with variant(variant_name) as (mi, _):

        def make(bake_error: float | None) -> tuple[Any, Materials, SceneTable]:
            loaded, materials = load(variant_name)
            motion = scene_motion(scene, loaded, mi)
            bake = None
            if bake_error is not None:
                if kind == "auto":
                    check_size(loaded)
                bake = functools.partial(baked_light, scene, motion=motion, error=bake_error)
            moving = list(motion.objects)
            any_integrator = kind != "auto"
            try:
                table = SceneTable(
                    loaded, mi, shadows=scene.shadows, any_integrator=any_integrator, moving=moving, bake=bake
                )
            except UnsuitableSurface as unsuitable:
                raise UnsuitableSurface(f"{unsuitable}{_offer(materials)}") from None
            return loaded, materials, table

        if variant_name == SCALAR and bake_error is None:
            asked = scene.source, scene.matte, scene.shadows, kind != "auto", tuple(scene.objects)
            loaded, materials, table = kept(asked, lambda: make(None))
        else:
            loaded, materials, table = make(bake_error)
        motion = scene_motion(scene, loaded, mi)
        renderer: Renderer
        if kind == "table":
            if any(light.kind == "spot" for light in table.lights):
                raise Unsuitable("a light is a spot light, which only the native renderer has")
            renderer = TableRenderer(table, camera, samples=samples, blur=blur, motion=motion)
            renderer.silhouettes = MovingSilhouettes(loaded, motion) if edges else None
        else:
            renderer = NativeRenderer(table, camera, samples=samples, blur=blur, motion=motion, threads=threads)
        renderer.reason += _replaced(scene, materials)
    return renderer


def _make_integrator(
    scene: Scene, camera: Camera, *, samples: int | None, seed: int, blur: bool, edges: bool, reason: str
) -> Renderer:
    variant_name, why_variant = default_variant()
    with variant(variant_name) as (mi, _):
        loaded = load_scene_source(scene.source(), mi)
        materials = simplify_materials(loaded, mi, matte=scene.matte)
        motion = scene_motion(scene, loaded, mi)
        renderer: Renderer
        if variant_name == SCALAR:
            samples = 2 if samples is None else samples
            renderer = ScalarRenderer(
                loaded, camera, samples=samples, blur=blur, seed=seed, reason=why_variant, motion=motion
            )
        else:
            samples = 8 if samples is None else samples
            renderer = IntegratorRenderer(
                loaded, camera, samples=samples, blur=blur, seed=seed, reason=reason, motion=motion
            )
        renderer.reason += _replaced(scene, materials)
        renderer.silhouettes = MovingSilhouettes(loaded, motion) if edges else None
    return renderer


def _offer(materials: Materials) -> str:
    """What ``matte=True`` would do, for the line that says why a scene falls to Mitsuba's integrators."""
    if not materials.could_be:
        return ""
    return f"; --matte (matte=True) would take as matte: {listed(materials.could_be)}"


def _replaced(scene: Scene, materials: Materials) -> str:
    """Which materials are taken as matte, for the same line."""
    if not scene.matte:
        return ""
    return f"; taken as matte: {listed(materials.replaced) or 'nothing, all that has a diffuse colour is so'}"
