"""Which renderer a scene takes."""

from __future__ import annotations

import warnings

from .._mitsuba import FAST, SCALAR, default_variant, load_scene_source, variant
from ..camera import Camera
from ..scene.scene import Scene
from .render import Renderer
from .render_integrator import IntegratorRenderer
from .render_native import NativeRenderer
from .render_scalar import ScalarRenderer
from .render_table import TableRenderer
from .scene_table import SceneTable, Unsuitable
from .scene_updates import scene_motion
from .swept_objects import MovingSilhouettes

RENDERERS = ("auto", "native", "table", "integrator")
"""What may be asked for, see :func:`make_renderer`."""


def check_renderer(kind: str) -> None:
    """Refuse, by a ValueError, what is no kind of renderer."""
    if kind not in RENDERERS:
        raise ValueError(f"renderer must be auto, native, table or integrator, got {kind!r}")


def make_renderer(
    scene: Scene,
    camera: Camera,
    *,
    samples: int | None = None,
    seed: int = 0,
    kind: str = "auto",
    blur: bool | None = None,
    edges: bool = False,
) -> Renderer:
    """Choose and build the renderer for a scene.

    Args:
        samples: rays a pixel; None means 8, or 2 for an integrator in the scalar variant.
        seed: of Mitsuba's integrators; the others draw nothing at random.
        kind: ``native`` (diffuse meshes under point, directional and constant light: fastest, and without LLVM),
            ``table`` (the same scenes on Dr.Jit), ``integrator`` (Mitsuba's own, for everything else) or ``auto``: the
            native renderer where it computes what the scene asks for.
        edges: prepare :attr:`Renderer.silhouettes`.
        blur: the 3 x 3 blur of luma; None leaves it to the scene.

    Raises:
        ValueError: if the scene cannot be loaded, it has none of the objects or lights that shall change, or ``native``
            or ``table`` was asked for and cannot render it.
        OSError: if a scene file cannot be read.

    Warns:
        UserWarning: if the scene's light is ambient (:attr:`Scene.ambient`), and it is an integrator that shows it.
    """
    check_renderer(kind)
    blur = scene.blur if blur is None else blur
    reason = "asked for"
    if kind != "integrator":
        try:
            return _make_from_table(scene, camera, samples=samples, kind=kind, blur=blur, edges=edges)
        except Unsuitable as unsuitable:
            if kind != "auto":
                what = "native renderer" if kind == "native" else "table kernel"
                raise ValueError(f"the {what} cannot render this scene: {unsuitable}") from None
            reason = str(unsuitable)
    renderer = _make_integrator(scene, camera, samples=samples, seed=seed, blur=blur, edges=edges, reason=reason)
    if scene.ambient:
        warnings.warn(
            f"scene {scene.name!r} is made for the native renderer or the table kernel, not for the {renderer.name} "
            f"({renderer.reason}): the scene's constant light, which shall come from all sides, does not reach into "
            "its closed room, so that shadows are black and the range of illuminance is far wider than the scene's",
            stacklevel=2,
        )
    return renderer


def _make_from_table(
    scene: Scene, camera: Camera, *, samples: int | None, kind: str, blur: bool, edges: bool
) -> Renderer:
    """The native renderer or the table kernel.

    Raises:
        Unsuitable: for a scene that is not diffuse triangles under direct light.
    """
    variant_name = SCALAR
    if kind == "table":
        variant_name, why_variant = default_variant()
        if variant_name == SCALAR:
            raise ValueError(f"the table kernel needs Mitsuba's {FAST} variant: {why_variant}")
    samples = 8 if samples is None else samples
    with variant(variant_name) as (mi, _):
        loaded = load_scene_source(scene.source(), mi)
        motion = scene_motion(scene, loaded, mi)
        moving = list(motion.objects)
        table = SceneTable(loaded, mi, shadows=scene.shadows, any_integrator=kind != "auto", moving=moving)
        make = TableRenderer if kind == "table" else NativeRenderer
        renderer = make(table, camera, samples=samples, blur=blur, motion=motion)
        renderer.silhouettes = MovingSilhouettes(loaded, motion) if edges else None
    return renderer


def _make_integrator(
    scene: Scene, camera: Camera, *, samples: int | None, seed: int, blur: bool, edges: bool, reason: str
) -> Renderer:
    variant_name, why_variant = default_variant()
    with variant(variant_name) as (mi, _):
        loaded = load_scene_source(scene.source(), mi)
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
        renderer.silhouettes = MovingSilhouettes(loaded, motion) if edges else None
    return renderer
