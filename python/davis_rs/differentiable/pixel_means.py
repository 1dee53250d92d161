"""Computes log luma with the derivatives of a pixel's mean: of the surfaces, and of the edges that pass the pixel."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..geometry.trajectory.trajectory import Trajectory
from ..geometry.trajectory.views import Views
from ..render.native.renderer import NativeRenderer
from .log_luma import LogLuma, LogLumaField
from .turned_edges import TurnedEdges

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_MOST_UNKNOWN = 0.01
"""If edges leave more than this fraction of the change unexplained, the derivative is not known."""

_RAYS_TOGETHER = 1 << 22
"""How many rays are processed in one call."""


class MeanLogLumaField(LogLumaField):
    """Gives a :class:`LogLumaField` whose derivatives by the camera's pose and motion are those of the mean over the
    whole pixel.

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
        self._edges = TurnedEdges(renderer.without_blur())
        reach = np.arange(-2, 3) if renderer.blur else np.arange(-1, 2)
        self._rows, self._columns = (part.ravel() for part in np.meshgrid(reach, reach, indexing="ij"))

    def _of_view(self, views: Views, view: npt.NDArray[np.uint32], pixel: IntArray) -> LogLuma:
        surfaces = super()._of_view(views, view, pixel)
        count = max(_RAYS_TOGETHER // (len(self._rows) * self.renderer.rays_per_pixel), 1)
        derivatives = [
            self._of_edges(views[view[first : first + count]], pixel[first : first + count])
            for first in range(0, len(pixel), count)
        ]
        pose = np.concatenate([np.zeros((0, 6)), *derivatives]) * surfaces.log_eps[:, None]
        motion = np.concatenate([views.velocities, views.angular_rates], 1)[view]
        return surfaces._replace(pose=surfaces.pose + pose, rate=surfaces.rate + (pose * motion).sum(1))

    def _of_edges(self, views: Views, pixel: IntArray) -> FloatArray:
        """Return the part of edges in the derivatives (n, 6) of luma by an increment of the pose."""
        slopes = np.zeros((len(pixel), 6))
        known, unknown = np.zeros(len(pixel)), np.zeros(len(pixel))
        event, around = self._around(pixel)
        taken = self.pixels.neighbours(pixel)
        for turn in self._edges.turns(views[event], around, self.renderer.ray_luma):
            own = event[turn.event]
            weights = (turn.pixel[:, :, None] == taken[own][:, None]) @ self.pixels.weights
            change = turn.change / self.renderer.rays_per_pixel
            explained, size = np.isfinite(turn.slope[:, 0]), np.abs(change)
            known += np.bincount(own[explained], size[explained], len(pixel))
            unknown += np.bincount(own[~explained], size[~explained], len(pixel))
            change *= (weights * turn.weight).sum(1)
            rows = change[explained, None] * turn.slope[explained]
            for column in range(6):
                slopes[:, column] += np.bincount(own[explained], rows[:, column], len(pixel))
        slopes[unknown > _MOST_UNKNOWN * (known + unknown)] = np.nan
        return slopes

    def _around(self, pixel: IntArray) -> tuple[IntArray, IntArray]:
        """Return the pixels from which pixels (n,) may get light of an edge: the index of the pixel, and their
        numbers."""
        camera = self.renderer.camera
        y, x = np.divmod(pixel, camera.width)
        rows, columns = y[:, None] + self._rows, x[:, None] + self._columns
        inside = (rows >= 0) & (rows < camera.height) & (columns >= 0) & (columns < camera.width)
        return np.nonzero(inside)[0], (rows * camera.width + columns)[inside]
