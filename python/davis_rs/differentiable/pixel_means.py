"""Log luma of a pixel's mean: what edges that pass the pixel add to its derivatives.

A pixel is the mean of its rays, and as a function of the camera's pose each ray jumps where an edge passes it. The mean
over the whole pixel does not: its derivative has a part of the surfaces, and one of the edges, the integral along them
of the difference of luma on both sides times how fast they move across. The camera is turned about its y and its x
axis by a fraction of a pixel to either side. Rays that change meanwhile lie next to an edge, and say where the edge
is and how it moves. A window weighs those the most that are closest to it. It is as wide as two rows of rays: a wider
one also counts what surfaces do in it, and in a narrower one are few rays.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ..rendering.render_native import NativeRenderer
from ..trajectory.trajectory import Trajectory
from ..trajectory.views import Views
from .edge_passes import ChangedRays, EdgePasses, Passes
from .log_luma import LogLuma, LogLumaField

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_MOST_UNKNOWN = 0.01
"""The share of what changes that edges need not explain; more, and the derivative is not known."""

_RAYS_TOGETHER = 1 << 22
"""Rays that are followed in one call."""

_TURN_COLUMNS = (4, 3)
"""Columns of a pose's increment: the turn about y, which moves the image along x, and that about x."""


class MeanLogLumaField(LogLumaField):
    """As :class:`LogLumaField`, with the derivatives by the camera's pose and motion of the mean over the whole pixel.

    They are NaN where rays change for a reason that is no edge.

    Raises:
        ValueError: for a scene in which something moves.
    """

    def __init__(self, renderer: NativeRenderer, trajectory: Trajectory, log_eps: float) -> None:
        super().__init__(renderer, trajectory, log_eps)
        if renderer.table.moving:
            raise ValueError(
                "the mean of a pixel at edges has derivatives in a scene at rest; something moves in this one "
                "(edges='rays' takes it)"
            )
        self._edges = EdgePasses(self)
        self._to_either_side_px = 1 / math.sqrt(renderer.rays)

    def _of_view(self, views: Views, view: npt.NDArray[np.uint32], pixel: IntArray) -> LogLuma:
        surfaces = super()._of_view(views, view, pixel)
        count = max(_RAYS_TOGETHER // (len(self.weights) * self.renderer.rays), 1)
        parts = [
            self._of_edges(_chosen(views, view[first : first + count]), pixel[first : first + count])
            for first in range(0, len(pixel), count)
        ]
        pose = np.concatenate([np.zeros((0, 6)), *parts]) * surfaces.log_eps[:, None]
        motion = np.concatenate([views.velocities, views.angular_rates], 1)[view]
        return surfaces._replace(pose=surfaces.pose + pose, rate=surfaces.rate + (pose * motion).sum(1))

    def _of_edges(self, views: Views, pixel: IntArray) -> FloatArray:
        """(n, 6) dY by an increment of the pose."""
        found = np.zeros((len(pixel), 6))
        known, unknown = np.zeros(len(pixel)), np.zeros(len(pixel))
        camera = self.renderer.camera
        for axis, column, focal_px in zip((1, 0), _TURN_COLUMNS, (camera.fx, camera.fy), strict=True):
            turn = np.zeros((len(pixel), 3))
            turn[:, axis] = self._to_either_side_px / focal_px
            ends = _turned(views, -turn), _turned(views, turn)
            _, _, rays = self._edges.changed(ends, pixel)
            passes = self._edges.passes(ends, rays)
            explained = np.isfinite(passes.share)
            size = np.abs(rays.change)
            known += np.bincount(rays.event[explained], size[explained], len(pixel))
            unknown += np.bincount(rays.event[~explained], size[~explained], len(pixel))
            _add(found, rays, passes, column)
        found[unknown > _MOST_UNKNOWN * (known + unknown)] = np.nan
        return found


def _add(found: FloatArray, rays: ChangedRays, passes: Passes, column: int) -> None:
    """What the edges add that pass rays while the camera turns about one axis.

    Edges that lie along the image's motion pass few rays, each with a large part. So both turns share an edge, by the
    squares of its normal's components, which are as how its share of the way moves with either turn.
    """
    index = np.flatnonzero(np.isfinite(passes.share))
    share, pose, event = passes.share[index], passes.pose[index], rays.event[index]
    window = 1 - np.cos(2 * np.pi * share)
    part = pose[:, column] ** 2 / np.maximum((pose[:, list(_TURN_COLUMNS)] ** 2).sum(1), 1e-300)
    rows = -(rays.change[index] * window * part)[:, None] * pose
    for one in range(6):
        found[:, one] += np.bincount(event, rows[:, one], len(found))


def _turned(views: Views, turn: FloatArray) -> Views:
    from scipy.spatial.transform import Rotation

    rotations = views.rotations @ Rotation.from_rotvec(turn).as_matrix()
    return Views(views.t_s, views.positions, rotations, views.velocities, views.angular_rates)


def _chosen(views: Views, view: npt.NDArray[np.uint32]) -> Views:
    """A view for each pixel."""
    return Views(
        views.t_s[view],
        views.positions[view],
        views.rotations[view],
        views.velocities[view],
        views.angular_rates[view],
    )
