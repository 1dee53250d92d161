"""Holds which places on surfaces a camera sees along its path, so that a quick bake is finest there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...geometry.camera import PRESETS, Camera
from ...geometry.trajectory.views import Views
from ...scene.scene import Scene
from .surface_lattice import CellHits, SurfaceLattice

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_INSTANTS, _COLUMNS = 32, 64
"""At how many instants of the path the camera looks, and through how many columns of pixels."""


class SeenPlaces(NamedTuple):
    """Holds places on a scene's triangles.

    Attributes:
        triangles: int64 (h), the triangle of each.
        backs: bool (h), whether the triangle's back is seen.
        weights: float64 (h, 3), barycentric coordinates.
    """

    triangles: IntArray
    backs: npt.NDArray[np.bool_]
    weights: FloatArray

    def on(self, lattice: SurfaceLattice, corners: FloatArray) -> CellHits | None:
        """Return them as hits of the sides of a lattice of triangles (t, 3, 3).

        Sides that do not reflect, and triangles without area (of clear glass), have none. None where nothing is left.
        """
        count = len(corners)
        backs = lattice.triangles[count:]
        at = np.searchsorted(backs, self.triangles).clip(max=max(len(backs) - 1, 0))
        kept = ~self.backs
        if len(backs):
            kept |= backs[at] == self.triangles
        kept &= (np.ptp(corners[self.triangles], axis=1) > 0).any(1)
        faces = np.where(self.backs, count + at, self.triangles)
        return CellHits(faces[kept], self.weights[kept]) if kept.any() else None


def camera_that_looks(scene: Scene) -> Camera:
    """Return the scene's own camera with few pixels: one bake is good for cameras of all sizes."""
    camera = PRESETS["ideal"] if scene.camera is None else scene.camera
    return camera.resized(_COLUMNS, max(1, round(_COLUMNS * camera.height / camera.width)))


def views_that_look(scene: Scene) -> Views | None:
    """Return where the camera looks from along the path that counts for the bake; None where there is no path."""
    path = scene.path_of_bake
    if path is not None:
        return Views.along(path, np.linspace(0.0, path.duration_s, _INSTANTS))
    return None if scene.start is None else Views.at_rest([scene.start])
