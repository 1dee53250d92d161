"""Measures which fraction of the image shows shapes whose look is lost (:attr:`davis_rs.Scene.lost_looks`)."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ...geometry.camera import Camera
from ...geometry.trajectory.views import Views
from ...scene.lost_looks import BACKS, LostLook, LostLookWarning
from ...scene.scene import Scene
from ..base import Renderer
from ..native.renderer import NativeRenderer
from .scene_surfaces import SceneSurfaces

_INSTANTS = 5
"""How many instants of the camera path are examined; its ends are among them."""
_GRID = 64, 48
"""The largest number of pixels, across and down, that stand for the image."""

Fractions = dict[LostLook, float | None]


def lost_look_fractions(scene: Scene, camera: Camera, renderer: Renderer | None = None) -> Fractions:
    """Measure the fraction of the image that each lost look of a scene concerns, averaged over its camera path.

    Args:
        renderer: a renderer of the scene, if there is one. Unless it is a native one, the scene is loaded again.
            Without one, backs are culled, as the native renderer does.

    Returns:
        For each look a fraction from 0 to 1, of a grid of pixels at a few instants of the path, or at the camera's
        start in a scene without a path. None where it is not known: for a look of no shape, in a scene without path and
        start, and in a scene with shapes that are not made of triangles. A look of backs counts only pixels that see a
        back.
    """
    views = _views(scene)
    fractions: Fractions = dict.fromkeys(scene.lost_looks)
    if views is None or not any(look.shapes for look in scene.lost_looks):
        return fractions
    pixels = _pixels(camera)
    view, pixel = np.repeat(np.arange(len(views)), len(pixels)), np.tile(pixels, len(views))
    if isinstance(renderer, NativeRenderer):
        names: Sequence[str] = renderer.table.names
        shape, back = renderer.shapes_seen(views, view, pixel)
    else:
        try:
            surfaces = SceneSurfaces(scene, camera, culled=renderer is None)
        except ValueError:
            return fractions
        seen = surfaces.of_pixels(views, view, pixel)
        names, shape, back = surfaces.names, seen.shape.astype(np.int64) - 1, seen.back
    numbers = {name: number for number, name in enumerate(names)}
    for look in scene.lost_looks:
        if look.shapes:
            concerned = np.isin(shape, [numbers[name] for name in look.shapes if name in numbers])
            fractions[look] = float((concerned & back if look.what == BACKS else concerned).mean())
    return fractions


def warn_of_lost_looks(scene: Scene, fractions: Fractions, stacklevel: int) -> None:
    """Warn in one line which looks of a scene's file are lost, the largest fraction first.

    Warns:
        LostLookWarning: with the line, if anything is lost.
    """
    told = {look: fraction for look, fraction in fractions.items() if look.what != BACKS or fraction != 0}
    if not told:
        return
    largest = sorted((look for look in told if told[look]), key=lambda look: -(told[look] or 0))
    phrases = [f"{look} ({100 * (told[look] or 0):.2g} %)" for look in largest]
    for fraction, state in ((0.0, "not in view"), (None, "fraction not known")):
        looks = [str(look) for look in told if told[look] == fraction]
        phrases += [f"{state}: {', '.join(looks)}"] if looks else []
    name = scene.name if scene.file is None else scene.file
    shares = ", with their fraction of the image along the camera path" if largest else ""
    warnings.warn(
        f"{name}: these looks are lost{shares}: {'; '.join(phrases)}",
        LostLookWarning,
        stacklevel=stacklevel + 1,
    )


def _views(scene: Scene) -> Views | None:
    if scene.trajectory is not None:
        return Views.along(scene.trajectory, np.linspace(0.0, scene.trajectory.duration_s, _INSTANTS))
    return None if scene.start is None else Views.at_rest([scene.start])


def _pixels(camera: Camera) -> npt.NDArray[np.int64]:
    """Return the numbers of pixels that are spread evenly over the image."""
    columns, rows = (
        ((np.arange(count) + 0.5) * size / count).astype(np.int64)
        for size, count in zip(
            (camera.width, camera.height), map(min, _GRID, (camera.width, camera.height)), strict=True
        )
    )
    return (rows[:, None] * camera.width + columns).ravel()
