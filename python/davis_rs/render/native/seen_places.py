"""Finds which places on surfaces a camera sees, by the native renderer's own first hits."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ...geometry.camera import Camera
from ...geometry.trajectory.views import Views
from ..baked.seen_places import SeenPlaces
from ..motion.scene_motion import SceneMotion
from ..rays.camera_rays import ray_table
from ..scene_tables.scene_table import SceneTable
from .renderer import NativeRenderer

FloatArray = npt.NDArray[np.float64]


def seen_places(table: SceneTable, motion: SceneMotion, camera: Camera, views: Views) -> SeenPlaces:
    """Return the places that the centres of a camera's pixels see at all views; the table needs no light yet."""
    renderer = NativeRenderer(table, camera, rays_per_pixel=1, blur=False, motion=motion)
    depths, hits = renderer.first_hits(views)
    view, pixel = np.nonzero(np.isfinite(depths))
    depth, triangle = depths[view, pixel].astype(np.float64), hits[view, pixel].astype(np.int64)
    along = np.c_[ray_table(camera, 1)[0], np.ones(camera.width * camera.height)][pixel]
    cameras = renderer.cameras(views)
    frame = table.frames[triangle]
    rotations = np.stack([each.rotations for each in cameras])[frame, view]
    along = np.einsum("hij,hj->hi", rotations, along)
    at = np.stack([each.positions for each in cameras])[frame, view] + depth[:, None] * along
    corners = table.corners[triangle]
    backs = np.einsum("hi,hi->h", table.planes[triangle, :3], along) > 0
    return SeenPlaces(triangle, backs, _barycentric(corners, at))


def _barycentric(corners: FloatArray, points: FloatArray) -> FloatArray:
    """Return barycentric coordinates (h, 3), none negative, of points (h, 3) near triangles (h, 3, 3)."""
    opposite = np.roll(corners, -1, 1), np.roll(corners, -2, 1)
    to = points[:, None]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    parts = np.einsum("hki,hi->hk", np.cross(opposite[0] - to, opposite[1] - to), normal).clip(min=0.0)
    whole = parts.sum(1, keepdims=True)
    return np.divide(parts, whole, out=np.full_like(parts, 1 / 3), where=whole > 0)
