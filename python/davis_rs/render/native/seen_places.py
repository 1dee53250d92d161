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
    """Return the places that the centres of a camera's pixels see at all views; the table needs no light yet.

    Of a mesh that deforms they are the middles of triangles.
    """
    renderer = NativeRenderer(table, camera, rays_per_pixel=1, blur=False, motion=motion)
    deforms = np.isin(table.frames, [mesh.frame for mesh in table.deforming])
    rays = np.c_[ray_table(camera, 1)[0], np.ones(camera.width * camera.height)]
    parts = list[SeenPlaces]()
    for number in range(len(views)):
        view = views[number : number + 1]
        depths, hits = renderer.first_hits(view)
        pixel = np.flatnonzero(np.isfinite(depths))
        depth, triangle = depths[pixel].astype(np.float64), hits[pixel].astype(np.int64)
        cameras, frame = renderer.cameras(view), table.frames[triangle]
        along = np.einsum("hij,hj->hi", np.concatenate([each.rotations for each in cameras])[frame], rays[pixel])
        at = np.concatenate([each.positions for each in cameras])[frame] + depth[:, None] * along
        weights = _barycentric(table.corners[triangle], at)
        weights[deforms[triangle]] = 1 / 3
        backs = np.einsum("hi,hi->h", renderer.deforming.planes[triangle, :3], along) > 0
        parts.append(SeenPlaces(triangle, backs, weights))
    return SeenPlaces(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _barycentric(corners: FloatArray, points: FloatArray) -> FloatArray:
    """Return barycentric coordinates (h, 3), none negative, of points (h, 3) near triangles (h, 3, 3)."""
    opposite = np.roll(corners, -1, 1), np.roll(corners, -2, 1)
    to = points[:, None]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    parts = np.einsum("hki,hi->hk", np.cross(opposite[0] - to, opposite[1] - to), normal).clip(min=0.0)
    whole = parts.sum(1, keepdims=True)
    return np.divide(parts, whole, out=np.full_like(parts, 1 / 3), where=whole > 0)
