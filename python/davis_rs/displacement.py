"""How far the fastest pixel has moved: the clock by which renders are spaced."""

from __future__ import annotations

import numpy as np

from .flow import OpticalFlow
from .pose import FloatArray
from .render import Renderer
from .trajectory import Trajectory
from .views import Views

_BLOCK_US = 10_000
_STEP_US = 1_000
_TILE = 4


class DisplacementClock:
    """The path of the fastest pixel, in pixels, over a trajectory's time; in a scene that stands still.

    The speed of a pixel is its optical flow, from depth and the camera's twist; depth maps are rendered every 10 ms
    and pooled so that the nearest surface in 4 x 4 pixels and at both ends of the 10 ms counts. Computed block by block
    as it is asked for; what lies more than a block behind is forgotten.
    """

    def __init__(self, renderer: Renderer, trajectory: Trajectory, end_us: int) -> None:
        camera = renderer.camera
        self._renderer, self._trajectory, self._end_us = renderer, trajectory, end_us
        self._rows, self._columns = np.arange(0, camera.height, _TILE), np.arange(0, camera.width, _TILE)
        centres = np.stack(np.meshgrid(self._columns + (_TILE - 1) / 2, self._rows + (_TILE - 1) / 2), -1)
        limits = (camera.width - 1, camera.height - 1)
        self._flow = OpticalFlow(camera, np.minimum(centres, limits).reshape(-1, 2))
        self._t_us, self._path = np.zeros(1), np.zeros(1)
        self._nearest = self._nearest_at(0) if end_us > 0 else None

    def path_at(self, t_us: int) -> float:
        """The path until an instant, which may lie no more than a block before the last one asked for."""
        while self._t_us[-1] < min(t_us, self._end_us):
            self._extend()
        return float(np.interp(t_us, self._t_us, self._path))

    def time_at(self, path: float) -> int | None:
        """The first microsecond at which the path is so long; None where it ends before."""
        while self._path[-1] < path:
            if self._t_us[-1] >= self._end_us:
                return None
            self._extend()
        return int(np.interp(path, self._path, self._t_us))

    def _extend(self) -> None:
        start_us = int(self._t_us[-1])
        stop_us = min(start_us + _BLOCK_US, self._end_us)
        nearest = self._nearest_at(stop_us)
        assert self._nearest is not None
        steps = -(-(stop_us - start_us) // _STEP_US)
        t_us = np.linspace(start_us, stop_us, steps + 1)
        speed = self._fastest(np.minimum(self._nearest, nearest), t_us * 1e-6)
        moved = np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(t_us) * 1e-6)
        keep = self._t_us >= start_us - _BLOCK_US
        self._path = np.concatenate([self._path[keep], self._path[-1] + moved])
        self._t_us = np.concatenate([self._t_us[keep], t_us[1:]])
        self._nearest = nearest

    def _nearest_at(self, t_us: int) -> FloatArray:
        """The least depth in each tile at an instant."""
        depth = self._renderer.depth(Views.along(self._trajectory, [t_us * 1e-6]))[0]
        pooled = np.minimum.reduceat(np.minimum.reduceat(depth, self._rows, 0), self._columns, 1)
        return np.asarray(pooled.ravel(), np.float64)

    def _fastest(self, depth: FloatArray, t_s: FloatArray) -> FloatArray:
        """The largest flow of any tile at each time, in pixels per second."""
        flow = self._flow(Views.along(self._trajectory, t_s), depth)
        return np.asarray(np.sqrt((flow**2).sum(-1).max(-1)))
