"""How far the fastest pixel has moved: the clock by which renders are spaced."""

from __future__ import annotations

import numpy as np

from ..camera import Camera
from ..pose import FloatArray
from ..rendering.flow import OpticalFlow
from ..rendering.render import Renderer
from ..rendering.scene_motion import held, seen_from
from ..trajectory.trajectory import Trajectory
from ..trajectory.views import Views

_BLOCK_US = 10_000
_STEP_US = 1_000
_BLOCKS_A_LAUNCH = 4
_LIGHT_STEP_US = 50
_TILE, _OBJECT_TILE = 4, 8
_NEARER = 0.1
"""Share of the nearest depth seen below which no point of a moving object is taken to be."""

LIGHT_PER_PIXEL = 0.45
"""Change of a light's log strength that counts like one pixel of motion: 0.15, a usual contrast threshold, like a
third of a pixel, the displacement at which renders are usually spaced."""

DARKEST = 1e-3
"""Added to a light's factor before the logarithm, so that its profile may reach 0."""


class DisplacementClock:
    """The path of the fastest pixel, in pixels, over a trajectory's time.

    The speed of a pixel is its optical flow, from depth and the camera's twist; depth maps are rendered every 10 ms
    and pooled so that the nearest surface in 4 x 4 pixels and at both ends of the 10 ms counts, as if all stood still.
    A moving object counts besides, wherever the box around it may be seen, hidden or not, at the speed of the nearest
    and the farthest point that the box has there; nothing of it is taken to be nearer than a tenth of the nearest
    surface in the depth maps, so that the camera may be in the box. Both rather count too much than too little; the
    shadows of moving objects, which may be faster than these, do not count.

    A light that runs a profile adds the change of its log strength, :data:`LIGHT_PER_PIXEL` of which is a pixel,
    sampled every 50 us: of several lights that which changes most.

    Computed block by block as it is asked for; what lies more than a block behind is forgotten.

    Args:
        start_us: time of the sequence at which the trajectory starts: by it objects move and lights change.
    """

    def __init__(self, renderer: Renderer, trajectory: Trajectory, end_us: int, *, start_us: int = 0) -> None:
        camera = renderer.camera
        self._renderer, self._trajectory, self._end_us = renderer, trajectory, end_us
        self._start_s = start_us * 1e-6
        self._rows, self._columns = np.arange(0, camera.height, _TILE), np.arange(0, camera.width, _TILE)
        self._flow = OpticalFlow(camera, _centres(camera, _TILE))
        if renderer.motion.objects:
            self._objects = _ObjectSpeeds(renderer, _centres(camera, _OBJECT_TILE))
        self._t_us, self._path = np.zeros(1), np.zeros(1)
        self._ahead: dict[int, FloatArray] = {}
        self._nearest = self._nearest_at(0) if end_us > 0 else None

    def path_at(self, t_us: int) -> float:
        """The path until an instant, which may lie no more than a block before the last one asked for."""
        while self._t_us[-1] < min(t_us, self._end_us):
            self._extend()
        return float(np.interp(t_us, self._t_us, self._path))

    def time_at(self, path: float, until_us: int | None = None) -> int | None:
        """The microsecond in which the path becomes so long; None where it does not by ``until_us`` or the end.

        With ``until_us`` no more than the block around it is looked at: ``path_at(until_us)`` stays within reach.
        """
        until_us = self._end_us if until_us is None else min(until_us, self._end_us)
        while self._path[-1] < path:
            if self._t_us[-1] >= until_us:
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
        if self._renderer.motion.lights:
            steps = -(-(stop_us - start_us) // _LIGHT_STEP_US)
            fine_us = np.linspace(start_us, stop_us, steps + 1)
            moved = np.interp(fine_us[1:], t_us, np.concatenate([[0.0], moved])) + self._light_path(fine_us * 1e-6)
            t_us = fine_us
        keep = self._t_us >= start_us - _BLOCK_US
        self._path = np.concatenate([self._path[keep], self._path[-1] + moved])
        self._t_us = np.concatenate([self._t_us[keep], t_us[1:]])
        self._nearest = nearest

    def _nearest_at(self, t_us: int) -> FloatArray:
        """The least depth in each tile at an instant."""
        if t_us not in self._ahead:
            # Several maps in one launch; those of blocks to come are kept for them.
            times = sorted({min(t_us + i * _BLOCK_US, self._end_us) for i in range(_BLOCKS_A_LAUNCH)})
            depths = self._renderer.depth(self._views(np.array(times) * 1e-6))
            pooled = np.minimum.reduceat(np.minimum.reduceat(depths, self._rows, 1), self._columns, 2)
            self._ahead = dict(zip(times, pooled.reshape(len(times), -1).astype(np.float64), strict=True))
        return self._ahead[t_us]

    def _fastest(self, depth: FloatArray, t_s: FloatArray) -> FloatArray:
        """The largest flow of any tile at each time, in pixels per second."""
        views = self._views(t_s)
        speed = _largest(self._flow(views, depth))
        if self._renderer.motion.objects:
            speed = np.maximum(speed, self._objects(views, _NEARER * float(depth.min())))
        return speed

    def _light_path(self, t_s: FloatArray) -> FloatArray:
        """What lights add to the path from the first of n times until each of the others."""
        factors = self._renderer.motion.factors(self._start_s + t_s)
        changes = np.abs(np.diff(np.log(factors + DARKEST), axis=0)).max(1)
        return np.asarray(np.cumsum(changes) / LIGHT_PER_PIXEL)

    def _views(self, t_s: FloatArray) -> Views:
        return Views.along(self._trajectory, t_s, start_s=self._start_s)


class _ObjectSpeeds:
    """The largest flow of moving objects, anywhere in the boxes around them, at tiles of the image."""

    def __init__(self, renderer: Renderer, centres: FloatArray) -> None:
        camera = renderer.camera
        self._motion, self._flow = renderer.motion, OpticalFlow(camera, centres)
        rays = camera.rays(centres)
        self._rays = np.concatenate([rays, np.ones((len(rays), 1))], -1)
        # How far a ray within a tile may be from the tile's own, per metre of depth.
        per_pixel = np.abs(np.linalg.inv(camera.distortion_jacobian(rays))).sum(-1).max()
        self._spread = _OBJECT_TILE / 2 * float(per_pixel)

    def __call__(self, views: Views, nearest: float) -> FloatArray:
        """(n,) pixels per second, nothing taken to be nearer than ``nearest``."""
        speed = np.zeros(len(views))
        for trajectory, box in zip(self._motion.objects.values(), self._motion.boxes, strict=True):
            own = seen_from(views, held(trajectory, views.t_s))
            near, far = self._within(own, box)
            for depth in (np.maximum(near, np.minimum(nearest, far)), far):
                seen = ~np.isnan(depth)
                flow = self._flow(own, np.where(seen, depth, np.inf))
                speed = np.maximum(speed, _largest(np.where(seen[..., None], flow, 0.0)))
        return speed

    def _within(self, own: Views, box: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Least and largest depth (n, tiles) of a box (2, 3) along the tiles' rays, in its own frame; NaN: none."""
        away = np.linalg.norm(own.positions - box.mean(0), axis=-1) + np.linalg.norm(box[1] - box[0]) / 2
        margin = (self._spread * away)[:, None, None]
        directions = np.einsum("nij,tj->nti", own.rotations, self._rays)
        directions = np.where(np.abs(directions) < 1e-12, 1e-12, directions)
        low, high = (box[0] - own.positions)[:, None] - margin, (box[1] - own.positions)[:, None] + margin
        depths = np.stack([low / directions, high / directions])
        enter, leave = depths.min(0).max(-1), depths.max(0).min(-1)
        missed = (enter > leave) | (leave <= 0)
        return np.where(missed, np.nan, enter), np.where(missed, np.nan, leave)


def _centres(camera: Camera, size: int) -> FloatArray:
    """Centres (tiles, 2) of tiles of size x size pixels, row by row."""
    columns, rows = np.arange(0, camera.width, size), np.arange(0, camera.height, size)
    centres = np.stack(np.meshgrid(columns + (size - 1) / 2, rows + (size - 1) / 2), -1)
    return np.minimum(centres, (camera.width - 1, camera.height - 1)).reshape(-1, 2)


def _largest(flow: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt((flow**2).sum(-1).max(-1)))
