"""Computes how edges that pass a pixel change its mean when the camera moves.

A pixel is the mean of its rays, and as a function of the camera's pose each ray jumps where an edge passes it. The mean
over the whole pixel does not: its derivative has a part of the surfaces, and one of the edges, the integral along them
of the difference of luma on both sides times how fast they move across. The camera is turned about its y and its x
axis by a fraction of a pixel to either side. Rays that change meanwhile lie next to an edge, and tell where the edge
is and how it moves. A window weighs those the most that are closest to it. It is as wide as two rows of rays: in a
narrower one are few rays. How much a ray changes is taken right before and right after the edge passes it, because over
the whole turn the surfaces change too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..geometry.trajectory.views import Views
from ..render.native.renderer import NativeRenderer
from .edge_passes import EdgePasses, Passes

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_TURN_COLUMNS = (4, 3)
"""Columns of a pose's increment: the turn about y, which moves the image along x, and the turn about x."""

_BESIDE = 0.005
"""At which distance from an edge, as a fraction of a turn, luma is taken: far enough for float32, and before the
surface changes much."""

_SMEARED = 0.5
"""The assumed width of an edge, in distances between rays: on the border of two pixels, half of it is in each."""

RayLuma = Callable[[Views, FloatArray], FloatArray]
"""Luma (m,) along one ray of each of m views, (m, 3) in camera axes."""


class Turn(NamedTuple):
    """Holds the contributions of m rays that change while the camera turns to the derivatives of their pixels.

    Attributes:
        event: (m,) the index of the ray's pixel among the given ones.
        pixel, weight: (m, 4) the pixels that the edge is in, y W + x, and its weight in each: where a ray lies close to
            the border of its pixel, the edge may be in the next one. Weights are 0 outside of the image, and where no
            edge is found that makes the ray change.
        change: (m,) change of the ray's luma at the edge.
        slope: (m, 6) by an increment of the camera's pose: position in world axes, per metre, then rotation vector in
            camera axes, per radian; NaN where no edge is found. The mean over all rays of a pixel of change times slope
            times weight is what edges add to the derivative of its luma.
    """

    event: IntArray
    pixel: IntArray
    weight: FloatArray
    change: FloatArray
    slope: FloatArray


class TurnedEdges:
    """Finds what edges add to the derivatives of pixels' means, with the rays of a renderer."""

    def __init__(self, renderer: NativeRenderer) -> None:
        self._edges, self._camera = EdgePasses(renderer), renderer.camera
        self._to_either_side_px = 1 / math.sqrt(renderer.rays_per_pixel)

    def turns(self, views: Views, pixel: IntArray, luma: RayLuma) -> Iterator[Turn]:
        """Yield the two turns of pixels (n,), y W + x, each seen in its own one of n views."""
        for axis, column, focal_px in zip((1, 0), _TURN_COLUMNS, (self._camera.fx, self._camera.fy), strict=True):
            angle = self._to_either_side_px / focal_px
            ends = _turned(views, axis, np.full(len(pixel), -angle)), _turned(views, axis, np.full(len(pixel), angle))
            _, _, rays = self._edges.changed(ends, pixel)
            passes = self._edges.passes(ends, rays)
            known = np.isfinite(passes.fraction)
            own = views[rays.event]
            before, after = (
                luma(_turned(own, axis, angle * (2 * fraction - 1)), rays.ray)
                for fraction in (
                    np.where(known, passes.fraction - _BESIDE, 0.0),
                    np.where(known, passes.fraction + _BESIDE, 1.0),
                )
            )
            seen, weight = self._pixels(rays.ray, axis, angle * (2 * passes.fraction - 1))
            yield Turn(rays.event, seen, weight, after - before, _slope(passes, column))

    def _pixels(self, ray: FloatArray, axis: int, angle: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return the pixels in which the turned camera's rays lie when the camera is not turned, and their weights in
        them.

        A point on the border of two pixels is half in each, as on average if the camera moves a little.
        """
        camera = self._camera
        point = camera.project(np.einsum("nij,nj->ni", _turns(axis, angle), ray)) + 0.5
        known = np.isfinite(point).all(1) & np.isfinite(angle)
        point = np.where(known[:, None], point, -9.0)
        border = np.rint(point)
        after = np.clip(0.5 + (point - border) / (_SMEARED * self._to_either_side_px), 0.0, 1.0)
        (x, y), (right, below) = border.astype(np.int64).T, after.T
        columns, rows = np.stack([x - 1, x, x - 1, x], 1), np.stack([y - 1, y - 1, y, y], 1)
        weight = np.stack([1 - right, right, 1 - right, right], 1) * np.stack([1 - below, 1 - below, below, below], 1)
        inside = (columns >= 0) & (columns < camera.width) & (rows >= 0) & (rows < camera.height)
        return np.where(inside, rows * camera.width + columns, 0), np.where(inside, weight, 0.0)


def _slope(passes: Passes, column: int) -> FloatArray:
    """Return the slopes of rays that edges pass while the camera turns about one axis.

    Edges along the image's motion pass few rays, each with a large weight. So an edge is divided between both turns, by
    the squares of its normal's components, which are proportional to the derivatives of its fraction by either turn.
    """
    window = 1 - np.cos(2 * np.pi * passes.fraction)
    fraction = passes.pose[:, column] ** 2 / np.maximum((passes.pose[:, list(_TURN_COLUMNS)] ** 2).sum(1), 1e-300)
    return -(window * fraction)[:, None] * passes.pose


def _turned(views: Views, axis: int, angle: FloatArray) -> Views:
    """Turn each view (n,) about an axis of its camera, by an angle in radians (n,)."""
    rotations = views.rotations @ _turns(axis, angle)
    return Views(views.t_s, views.positions, rotations, views.velocities, views.angular_rates)


def _turns(axis: int, angle: FloatArray) -> FloatArray:
    """Return rotations (n, 3, 3) about an axis by angles (n,); the identity where an angle is NaN."""
    from scipy.spatial.transform import Rotation

    vector = np.zeros((len(angle), 3))
    vector[:, axis] = np.nan_to_num(angle)
    return np.asarray(Rotation.from_rotvec(vector).as_matrix(), np.float64)
