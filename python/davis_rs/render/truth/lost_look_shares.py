"""Which share of the image shows shapes whose look is lost (:attr:`davis_rs.Scene.lost_looks`)."""

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
"""Of the camera path, which are looked at; its ends are among them."""
_LATTICE = 64, 48
"""Pixels across and down, at most, which stand for the image."""

Shares = dict[LostLook, float | None]


def lost_look_shares(scene: Scene, camera: Camera, renderer: Renderer | None = None) -> Shares:
    """Measure the share of the image that each lost look of a scene concerns, on average over its camera path.

    Args:
        renderer: of the scene. A native one knows what pixels see; for any other the scene is loaded again.

    Returns:
        For each look a share from 0 to 1, of a lattice of pixels at a few instants of the path, or where a camera
        starts in a scene without one. None where it is not known: for a look of no shape, without path and start, and
        in a scene that was given shapes that are not made of triangles. A look of backs concerns only pixels that see
        one.
    """
    views = _views(scene)
    shares: Shares = dict.fromkeys(scene.lost_looks)
    if views is None or not any(look.shapes for look in scene.lost_looks):
        return shares
    pixels = _pixels(camera)
    view, pixel = np.repeat(np.arange(len(views)), len(pixels)), np.tile(pixels, len(views))
    if isinstance(renderer, NativeRenderer):
        names: Sequence[str] = renderer.table.names
        shape, back = renderer.shapes_seen(views, view, pixel)
    else:
        try:
            surfaces = SceneSurfaces(scene, camera)
        except ValueError:
            return shares
        seen = surfaces.of_pixels(views, view, pixel)
        names, shape, back = surfaces.names, seen.shape.astype(np.int64) - 1, seen.back
    numbers = {name: number for number, name in enumerate(names)}
    for look in scene.lost_looks:
        if look.shapes:
            concerned = np.isin(shape, [numbers[name] for name in look.shapes if name in numbers])
            shares[look] = float((concerned & back if look.what == BACKS else concerned).mean())
    return shares


def warn_of_lost_looks(scene: Scene, shares: Shares, stacklevel: int) -> None:
    """Tell what is lost of the looks of a scene's file, in one line; the largest share first.

    Warns:
        LostLookWarning: with the line, if anything is lost.
    """
    told = {look: share for look, share in shares.items() if look.what != BACKS or share != 0}
    if not told:
        return
    largest = sorted((look for look in told if told[look]), key=lambda look: -(told[look] or 0))
    parts = [f"{look} ({100 * (told[look] or 0):.2g} %)" for look in largest]
    for share, what in ((0.0, "not in view"), (None, "share not known")):
        looks = [str(look) for look in told if told[look] == share]
        parts += [f"{what}: {', '.join(looks)}"] if looks else []
    name = scene.name if scene.file is None else scene.file
    warnings.warn(
        f"{name}: surfaces are matte and opaque here; these looks are lost, with their share of the image along the "
        f"camera path: {'; '.join(parts)}",
        LostLookWarning,
        stacklevel=stacklevel + 1,
    )


def _views(scene: Scene) -> Views | None:
    if scene.trajectory is not None:
        return Views.along(scene.trajectory, np.linspace(0.0, scene.trajectory.duration_s, _INSTANTS))
    return None if scene.start is None else Views.at_rest([scene.start])


def _pixels(camera: Camera) -> npt.NDArray[np.int64]:
    """The lattice's pixels by their numbers, spread evenly."""
    columns, rows = (
        ((np.arange(count) + 0.5) * size / count).astype(np.int64)
        for size, count in zip(
            (camera.width, camera.height), map(min, _LATTICE, (camera.width, camera.height)), strict=True
        )
    )
    return (rows[:, None] * camera.width + columns).ravel()
