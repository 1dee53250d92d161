"""Which renderer a scene takes."""

from __future__ import annotations

import warnings

from .._mitsuba import FAST, SCALAR, default_variant, load_scene_source, variant
from ..camera import Camera
from ..scene.scene import Scene
from .render import Renderer
from .render_integrator import IntegratorRenderer
from .render_scalar import ScalarRenderer
from .render_table import TableRenderer
from .scene_table import SceneTable, Unsuitable
from .scene_updates import scene_motion
from .swept_objects import MovingSilhouettes

RENDERERS = ("auto", "table", "integrator")
"""What ``renderer`` may be."""


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
        samples: rays a pixel; None means 8, or 2 in the scalar variant.
        seed: of Mitsuba's integrators; the table kernel draws nothing at random.
        kind: ``table`` (diffuse meshes under point, directional and constant light: fastest), ``integrator`` (Mitsuba's
            own, for everything else) or ``auto``: the table kernel where it computes what the scene asks for.
        edges: prepare :attr:`Renderer.silhouettes`.
        blur: the 3 x 3 blur of luma; None leaves it to the scene.

    Raises:
        ValueError: if the scene cannot be loaded, it has none of the objects or lights that shall change, or ``table``
            was asked for and cannot render it.
        OSError: if a scene file cannot be read.

    Warns:
        UserWarning: if the scene's light is ambient (:attr:`Scene.ambient`), and it is not the table kernel that shows
            it.
    """
    if kind not in RENDERERS:
        raise ValueError(f"renderer must be one of {', '.join(RENDERERS)}, got {kind!r}")
    blur = scene.blur if blur is None else blur
    variant_name, why_variant = default_variant()
    if variant_name == SCALAR and kind == "table":
        raise ValueError(f"the table kernel needs Mitsuba's {FAST} variant: {why_variant}")
    with variant(variant_name) as (mi, dr):
        loaded = load_scene_source(scene.source(), mi)
        motion = scene_motion(scene, loaded, mi)
        silhouettes = MovingSilhouettes(loaded, motion) if edges else None
        renderer: Renderer
        if variant_name == SCALAR:
            samples = 2 if samples is None else samples
            renderer = ScalarRenderer(
                loaded, camera, samples=samples, blur=blur, seed=seed, reason=why_variant, motion=motion
            )
        else:
            samples = 8 if samples is None else samples
            moving = list(motion.objects)
            try:
                if kind == "integrator":
                    raise Unsuitable("asked for")
                table = SceneTable(loaded, mi, dr, shadows=scene.shadows, any_integrator=kind == "table", moving=moving)
                renderer = TableRenderer(table, camera, samples=samples, blur=blur, motion=motion)
            except Unsuitable as unsuitable:
                if kind == "table":
                    raise ValueError(f"the table kernel cannot render this scene: {unsuitable}") from None
                renderer = IntegratorRenderer(
                    loaded, camera, samples=samples, blur=blur, seed=seed, reason=str(unsuitable), motion=motion
                )
    if scene.ambient and not isinstance(renderer, TableRenderer):
        warnings.warn(
            f"scene {scene.name!r} is made for the table kernel, not for the {renderer.name} ({renderer.reason}): the "
            "scene's constant light, which shall come from all sides, does not reach into its closed room, so that "
            "shadows are black and the range of illuminance is far wider than the scene's",
            stacklevel=2,
        )
    renderer.silhouettes = silhouettes
    return renderer
