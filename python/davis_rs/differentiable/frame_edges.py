"""Adds the part of edges to the derivatives of frames by the camera's poses, as a Dr.Jit expression."""

from __future__ import annotations

import warnings

import numpy as np
import numpy.typing as npt

from .._mitsuba.types import JitFloat, JitVector
from ..geometry.camera import Camera
from ..geometry.trajectory.views import Views
from ..render.motion.scene_motion import SceneMotion
from ..render.native.renderer import NativeRenderer
from ..render.scene_tables.scene_table import SceneTable
from ..render.table.kernel import TableKernel
from .poses import CameraPoses
from .scene_at import SceneAt
from .turned_edges import TurnedEdges

FloatArray = npt.NDArray[np.float64]

_RAYS_TOGETHER = 1 << 22
"""How many rays are processed in one call."""

_MOST_UNKNOWN = 0.01
"""The fraction of the change at edges that may stay unexplained without a warning."""


class FrameEdges:
    """Computes the part of edges in the derivatives of whole frames, before the blur.

    Edges are found by the native renderer in float64; how much luma changes at them is the kernel's, with the values
    that its parameters have now.
    """

    def __init__(self, table: SceneTable, camera: Camera, rays_per_pixel: int, motion: SceneMotion) -> None:
        self._table, self._motion = table, motion
        self._renderer = NativeRenderer(table, camera, rays_per_pixel=rays_per_pixel, blur=False, motion=motion)
        self._edges, self._pixels = TurnedEdges(self._renderer), camera.width * camera.height

    def attached_zero(self, poses: CameraPoses, t_s: FloatArray, kernel: TableKernel) -> JitFloat:
        """Return 0 for each pixel (n H W) of n poses at times (n,), with the derivatives that edges have by the poses.

        Warns:
            UserWarning: if more than 1 % of the change at edges stays unexplained, and so is left out.
        """
        import drjit as dr
        import mitsuba as mi

        columns = self._slopes(_views(poses, t_s), kernel)
        view = dr.arange(mi.UInt32, len(poses) * self._pixels) // self._pixels
        total = dr.zeros(mi.Float, len(poses) * self._pixels)
        for column, increment in zip(columns.T, _increments(poses), strict=True):
            moved = increment if dr.width(increment) == 1 else dr.gather(mi.Float, increment, view)
            total += mi.Float(np.array(column, np.float32)) * moved
        return total

    def _slopes(self, views: Views, kernel: TableKernel) -> FloatArray:
        """Return the derivatives (n H W, 6) of luma by an increment of the pose."""
        slopes = np.zeros((len(views) * self._pixels, 6))
        together = max(_RAYS_TOGETHER // self._renderer.rays_per_pixel, 1)
        known = unknown = 0.0

        def luma(own: Views, rays: FloatArray) -> FloatArray:
            return _luma(kernel, own, rays, SceneAt(self._motion, self._table, own.t_s))

        for first in range(0, len(slopes), together):
            view, pixel = np.divmod(np.arange(first, min(first + together, len(slopes))), self._pixels)
            of_views = slopes[view[0] * self._pixels : (view[-1] + 1) * self._pixels]
            for turn in self._edges.turns(views[view], pixel, luma):
                explained, size = np.isfinite(turn.slope[:, 0]), np.abs(turn.change)
                known += float(size[explained].sum())
                unknown += float(size[~explained].sum())
                into = ((view[turn.event] - view[0]) * self._pixels)[:, None] + turn.pixel
                rows = (turn.change / self._renderer.rays_per_pixel)[:, None] * np.where(
                    explained[:, None], turn.slope, 0.0
                )
                for column in range(6):
                    weighted = turn.weight * rows[:, column, None]
                    of_views[:, column] += np.bincount(into.ravel(), weighted.ravel(), len(of_views))
        if unknown > _MOST_UNKNOWN * (known + unknown):
            fraction = unknown / (known + unknown)
            warnings.warn(
                f"derivatives leave out {fraction:.1%} of the change at edges: no edge explains it", stacklevel=4
            )
        return slopes


def _luma(kernel: TableKernel, views: Views, rays: FloatArray, scene_at: SceneAt) -> FloatArray:
    """Return luma along one ray of each view, without derivatives."""
    import drjit as dr
    import mitsuba as mi

    if not len(rays):
        return np.zeros(0)
    origins, directions = views.positions, np.einsum("nij,nj->ni", views.rotations, rays)
    ray = mi.Ray3f(mi.Point3f(_columns(origins)), mi.Vector3f(_columns(directions)))
    luma = kernel.luma(ray, scene_at.around(ray, dr.arange(mi.UInt32, len(rays))))
    return np.asarray(dr.detach(luma).numpy(), np.float64)


def _columns(vectors: FloatArray) -> list[JitFloat]:
    import mitsuba as mi

    return [mi.Float(np.array(column, np.float32)) for column in vectors.T]


def _views(poses: CameraPoses, t_s: FloatArray) -> Views:
    """Return cameras at rest, each at its own time (n,)."""
    import drjit as dr

    count = len(poses)

    def table(values: JitVector) -> FloatArray:
        return np.stack([np.broadcast_to(dr.detach(value).numpy(), (count,)) for value in values], 1)

    rotations = np.stack([table(row) for row in poses.rotations], 1).astype(np.float64)
    still = np.zeros((count, 3))
    return Views(t_s, table(poses.positions).astype(np.float64), rotations, still, still)


def _increments(poses: CameraPoses) -> list[JitFloat]:
    """Return zeros, attached to the poses: position in world axes, then the rotation vector in camera axes."""
    import drjit as dr
    import mitsuba as mi

    turn = dr.detach(poses.rotations).T @ poses.rotations
    vector = [(turn[2, 1] - turn[1, 2]) / 2, (turn[0, 2] - turn[2, 0]) / 2, (turn[1, 0] - turn[0, 1]) / 2]
    return [dr.replace_grad(mi.Float(0), value) for value in [*poses.positions, *vector]]
