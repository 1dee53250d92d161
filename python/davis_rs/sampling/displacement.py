"""Measures how far the fastest pixel has moved, by which renders are spaced."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from itertools import chain, product
from typing import NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from ..geometry.box import box_corners
from ..geometry.camera import Camera
from ..geometry.pose import FloatArray
from ..geometry.trajectory.trajectory import Trajectory
from ..geometry.trajectory.views import Views
from ..render.base import Renderer
from ..render.flow import OpticalFlow
from ..render.motion.scene_motion import held, seen_from
from ..render.rays.camera_rays import pixel_centres
from ..scene.deformation import Deformation
from .breaks import break_instants, find_breaks

BoolArray = npt.NDArray[np.bool_]
_Float = TypeVar("_Float", np.float32, np.float64)

_BLOCK_US = 10_000
_STEP_US = 1_000
_BLOCKS_A_LAUNCH = 4
_LIGHT_STEP_US = 50
_ESTIMATE = 17
"""How many instants the estimate of a path's length uses."""
_TILE, _OBJECT_TILE = 4, 8
_PART_MARGIN = 0.05
"""By which fraction of itself a tile is wider on each side where it is looked for surfaces: a lens bends its sides."""

_NEARER = 0.1
"""No point of a moving object is taken to be nearer than this fraction of the nearest depth in view."""

LIGHT_PER_PIXEL = 0.45
"""Change of a light's log strength that counts like one pixel of motion: 0.15, a usual contrast threshold, like a
third of a pixel, the displacement at which renders are usually spaced."""

DARKEST = 1e-3
"""Added to a light's factor before the logarithm, so that its profile may reach 0."""


LARGEST_BEND = 1 / 8
"""Between two keyframes displacement grows evenly in time within this fraction of the displacement between
keyframes."""

_SPEED_BEND_PX = 2e-3
"""How many pixels a step may be wrong if speed is taken to change linearly in it; else the step is halved."""

_LIGHT_BEND_PX = 1e-2
"""The same limit for the change of lights."""


_SURELY = 1 - 1e-6
"""What is below this fraction of a bound is below the bound, whatever is rounded: depth maps are float32."""

_REST_PX_S = 1e-6
"""A slower motion is rest, but for rounding."""

Rates = tuple[FloatArray, FloatArray, FloatArray]


class SpanEnd(NamedTuple):
    """Holds the end of a span between keyframes.

    Attributes:
        t_us: time of the trajectory.
        reached: whether the path has the asked length there; else it has a corner there.
    """

    t_us: int
    reached: bool


class _Tiles(NamedTuple):
    """Holds what tiles of the image show.

    Attributes:
        depth: (tiles,) least depth; NaN where all that is seen is a background of one luma, inf for another background.
        farthest: (tiles,) largest depth, where the centres of pixels meet nothing; NaN elsewhere.
    """

    depth: FloatArray
    farthest: FloatArray

    def together(self, other: _Tiles) -> _Tiles:
        """Return what they show at one of two instants."""
        return _Tiles(np.fmin(self.depth, other.depth), np.fmax(self.farthest, other.farthest))

    @property
    def nearest(self) -> float:
        """The least depth of all; inf where there is none."""
        return float(np.fmin.reduce(self.depth, initial=np.inf))


class DisplacementClock:
    """Measures the length of the fastest pixel's path, in pixels, over a trajectory's time.

    The speed of a pixel is its optical flow, from depth and the camera's twist; depth maps are rendered every 10 ms
    and pooled so that the nearest surface in 4 x 4 pixels and at both ends of the 10 ms counts, as if all stood still.
    A moving object counts besides, hidden or not, by how the corners of the box around it move, or points that its
    deformation names: all of its points move as means of these. Where one of them is behind the camera, or nearer than
    a tenth of the nearest surface in the depth maps, an object counts by the nearest and the farthest point that its
    box has wherever it may be seen, and the speed of the fastest point of a mesh that deforms comes on top. Where the
    centres of pixels meet nothing, the triangles count that a tile may show, if the renderer knows them; a background
    of one luma does not count, because nothing is seen to move there. All this rather overestimates than
    underestimates; the shadows of moving objects, which may be faster than the objects, do not count.

    A light that runs a profile adds the change of its log strength, :data:`LIGHT_PER_PIXEL` of which is a pixel,
    sampled every 50 us; of several lights the one that changes most counts.

    Speed is sampled every millisecond; where the motion or a light changes unevenly within a sample's time that is
    divided further, down to a microsecond, and each break (:mod:`~davis_rs.sampling.breaks`) is sampled on both sides.

    It is computed block by block on demand; what lies more than a block behind is discarded.

    Args:
        start_us: time of the sequence at which the trajectory starts; objects and lights follow the sequence's time.
    """

    def __init__(self, renderer: Renderer, trajectory: Trajectory, end_us: int, *, start_us: int = 0) -> None:
        camera = renderer.camera
        self._renderer, self._trajectory, self._end_us = renderer, trajectory, end_us
        self._start_s = start_us * 1e-6
        self._flow = _flow_of_tiles(camera, _TILE)
        if renderer.motion.objects:
            self._objects = _ObjectSpeeds(renderer)
        self._t_us, self._path = np.zeros(1), np.zeros(1)
        self._seen: tuple[FloatArray, Views] | None = None
        self._ahead: dict[int, _Tiles] = {}
        self._nearest = self._nearest_at(0) if end_us > 0 else None
        breaks = find_breaks(trajectory, renderer.motion, start_us, start_us + end_us)
        self._breaks = chain((t_us - start_us for t_us in break_instants(breaks, start_us, both=True)), [end_us])
        self._next_break = next(self._breaks)
        self._pixels_per_rad = _pixels_per_rad(camera)

    def path_at(self, t_us: int) -> float:
        """Return the path's length at an instant, which may lie at most a block before the last one computed."""
        while self._t_us[-1] < min(t_us, self._end_us):
            self._extend()
        return float(np.interp(t_us, self._t_us, self._path))

    def time_at(self, path: float, until_us: int | None = None) -> int | None:
        """Return the microsecond in which the path reaches a length; None if it does not by ``until_us`` or the end.

        With ``until_us`` no later block than the one around it is computed, so that ``path_at(until_us)`` still works.
        """
        until_us = self._end_us if until_us is None else min(until_us, self._end_us)
        while self._path[-1] < path:
            if self._t_us[-1] >= until_us:
                return None
            self._extend()
        return int(np.interp(path, self._path, self._t_us))

    def estimated_renders(self, pixels: float) -> float:
        """Estimate how many renders lie ``pixels`` apart on the whole path, and at least a microsecond.

        It goes by the speeds at a few instants, without the change of lights.
        """
        t_us = np.unique(np.linspace(0, self._end_us, _ESTIMATE).astype(np.int64))
        speeds = [float(self._fastest(self._pooled([int(t)])[0], np.array([t * 1e-6]))[0]) for t in t_us]
        path = float(np.sum(np.diff(t_us) * np.add(speeds[1:], speeds[:-1]) / 2) * 1e-6)
        return min(path / pixels, self._end_us)

    def span_end(self, start_us: int, path: float, bend_px: float, until_us: int | None = None) -> SpanEnd | None:
        """Return where a span from ``start_us`` should end: where the path has the length ``path``, or before.

        It ends before that where something starts or stops changing, and where the path would no longer be a
        straight line over time within ``bend_px`` (a "swinging door": a line from the start must pass all points of
        the path so closely). Then what is interpolated over the time of the span is as good as if it were interpolated
        over the displacement. None where no end comes by ``until_us`` or the end, for which see :meth:`time_at`.
        """
        until_us = self._end_us if until_us is None else min(until_us, self._end_us)
        origin = self.path_at(start_us)
        last_us, last, moving = float(start_us), origin, None
        flattest, steepest = -np.inf, np.inf
        while last_us < until_us:
            ahead = int(np.searchsorted(self._t_us, last_us, side="right"))
            if ahead == len(self._t_us):
                self._extend()
                continue
            for t_us, p in zip(self._t_us[ahead:].tolist(), self._path[ahead:].tolist(), strict=True):
                moves, reached_us = p > last, float(t_us)
                if p >= path:
                    reached_us = max(float(np.interp(path, self._path, self._t_us)), last_us)
                corner = moving is not None and moves != moving
                if reached_us > start_us:
                    corner |= not flattest <= (min(p, path) - origin) / (reached_us - start_us) <= steepest
                if corner and int(last_us) > start_us:
                    return SpanEnd(int(last_us), False)
                if p >= path:
                    return SpanEnd(int(reached_us), True)
                flattest = max(flattest, (p - bend_px - origin) / (t_us - start_us))
                steepest = min(steepest, (p + bend_px - origin) / (t_us - start_us))
                last_us, last, moving = t_us, p, moves
                if last_us >= until_us:
                    break
        return None

    def _extend(self) -> None:
        start_us = int(self._t_us[-1])
        stop_us = min(start_us + _BLOCK_US, self._end_us)
        nearest = self._nearest_at(stop_us)
        assert self._nearest is not None
        breaks = self._breaks_until(stop_us)
        tiles = self._nearest.together(nearest)
        t_us = _evenly(start_us, stop_us, _STEP_US, breaks)
        t_us = self._where_motion_bends(t_us, tiles.nearest)
        speed = self._fastest(tiles, t_us * 1e-6)
        moved = np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(t_us) * 1e-6)
        if self._renderer.motion.lights:
            fine_us = self._where_light_bends(_evenly(start_us, stop_us, _LIGHT_STEP_US, breaks))
            moved = np.interp(fine_us[1:], t_us, np.concatenate([[0.0], moved])) + self._light_path(fine_us * 1e-6)
            t_us = fine_us
        keep = self._t_us >= start_us - _BLOCK_US
        self._path = np.concatenate([self._path[keep], self._path[-1] + moved])
        self._t_us = np.concatenate([self._t_us[keep], t_us[1:]])
        self._nearest = nearest

    def _breaks_until(self, stop_us: int) -> list[int]:
        """Return the next instants at breaks, each once."""
        instants = []
        while self._next_break < min(stop_us, self._end_us):
            instants.append(self._next_break)
            self._next_break = next(self._breaks)
        return instants

    def _where_motion_bends(self, t_us: FloatArray, nearest: float) -> FloatArray:
        """Add instants where speed does not change linearly between them, or where rest begins or ends."""
        if self._trajectory.steady and not self._renderer.motion.objects:
            return t_us

        def rates(at_us: FloatArray) -> FloatArray:
            """Return, for each part of the motion, about the most pixels per second that it makes."""
            t_s = at_us * 1e-6
            per_metre = self._pixels_per_rad / max(nearest, 1e-9)
            trajectory = self._trajectory
            terms = [per_metre * trajectory.velocities(t_s), self._pixels_per_rad * trajectory.angular_rates(t_s)]
            motion = self._renderer.motion
            for path, box in zip(motion.objects.values(), motion.boxes, strict=True):
                own = held(path, self._start_s + t_s)
                reach = float(np.linalg.norm(np.abs(box).max(0)))
                terms += [per_metre * own.velocities, per_metre * reach * own.angular_rates]
            for deformation in motion.deformations.values():
                terms.append(per_metre * deformation.fastest(self._start_s + t_s)[:, None])
            together = np.concatenate(terms, 1)
            return np.where(np.abs(together) > _REST_PX_S, together, 0.0)

        def bent(left: FloatArray, right: FloatArray, values: Rates) -> BoolArray:
            before, middle, after = values
            missed = np.linalg.norm(middle - (before + after) / 2, axis=1) * (right - left) * 1e-6
            bends = missed > _SPEED_BEND_PX
            # Between the two instants a rest of some length ends, or begins.
            for still, moving, beside_us in ((before, after, left + 1), (after, before, right - 1)):
                ends = np.flatnonzero(~still.any(1) & moving.any(1))
                bends[ends] |= ~rates(beside_us[ends]).any(1)
            return bends

        return _divided(t_us, rates, bent)

    def _where_light_bends(self, t_us: FloatArray) -> FloatArray:
        """Add instants where a light does not change linearly between them."""

        def bent(left: FloatArray, right: FloatArray, values: Rates) -> BoolArray:
            before, middle, after = values
            return np.asarray(np.abs(middle - (before + after) / 2).max(1) > _LIGHT_BEND_PX * LIGHT_PER_PIXEL)

        return _divided(t_us, lambda at_us: self._log_strengths(at_us * 1e-6), bent)

    def _nearest_at(self, t_us: int) -> _Tiles:
        """Return what tiles show at an instant."""
        if t_us not in self._ahead:
            # Several maps are rendered in one launch; those of later blocks are kept.
            times = sorted({min(t_us + i * _BLOCK_US, self._end_us) for i in range(_BLOCKS_A_LAUNCH)})
            self._ahead = dict(zip(times, self._pooled(times), strict=True))
        return self._ahead[t_us]

    def _pooled(self, times: list[int]) -> list[_Tiles]:
        """Return what tiles show at instants in microseconds."""
        views = self._views(np.array(times) * 1e-6)
        least: FloatArray = _least_in_tiles(self._renderer.depth(views)).astype(np.float64)
        farthest = np.full_like(least, np.nan)
        missed = np.isinf(least)
        tiles = np.flatnonzero(missed.any(0))
        if len(tiles):
            depths = self._renderer.depths_in_parts(views, _parts(self._renderer.camera)[tiles])
            for by_rays, by_triangles in zip((least, farthest), np.moveaxis(depths, -1, 0), strict=True):
                by_rays[:, tiles] = np.where(missed[:, tiles], by_triangles, by_rays[:, tiles])
        return [_Tiles(*of_instant) for of_instant in zip(least, farthest, strict=True)]

    def _fastest(self, tiles: _Tiles, t_s: FloatArray) -> FloatArray:
        """Return the largest flow of any tile at each time, in pixels per second."""
        views = self._views(t_s)
        speed = np.zeros(len(t_s))
        for depth in (tiles.depth, tiles.farthest):
            if not np.isnan(depth).all():
                speed = np.maximum(speed, self._largest_flow(views, depth))
        if self._renderer.motion.objects:
            speed = np.maximum(speed, self._objects(views, _NEARER * tiles.nearest))
        return np.where(speed > _REST_PX_S, speed, 0.0)

    def _largest_flow(self, views: Views, depth: FloatArray) -> FloatArray:
        """Return the largest flow (n,) of tiles at these depths; those of NaN do not count."""
        none = np.isnan(depth)
        return _largest(self._flow(views, np.where(none, np.inf, depth)) * ~none[:, None])

    def _light_path(self, t_s: FloatArray) -> FloatArray:
        """Return the part of lights in the path's length, from the first of n times to each of the others."""
        changes = np.abs(np.diff(self._log_strengths(t_s), axis=0)).max(1)
        return np.asarray(np.cumsum(changes) / LIGHT_PER_PIXEL)

    def _log_strengths(self, t_s: FloatArray) -> FloatArray:
        return np.asarray(np.log(self._renderer.motion.factors(self._start_s + t_s) + DARKEST))

    def _views(self, t_s: FloatArray) -> Views:
        if self._seen is None or not np.array_equal(t_s, self._seen[0]):
            # A step of a closed loop asks twice for its two ends.
            self._seen = t_s, Views.along(self._trajectory, t_s, start_s=self._start_s)
        return self._seen[1]


def path_bound(renderer: Renderer, trajectory: Trajectory, end_us: int) -> float:
    """Return what the path of a :class:`DisplacementClock` is surely shorter than, in pixels, over the whole time; inf
    where that is not known.

    It is known of steps of up to a millisecond at constant velocity through a scene at rest, by the distance to the
    nearest surface, which takes no depth map. So most steps of a closed loop need no clock.
    """
    motion = renderer.motion
    if end_us > _STEP_US or not trajectory.steady or motion or len(motion.bends_s):
        return math.inf
    start, duration_s = np.zeros(1), end_us * 1e-6
    speed, turn = (
        math.sqrt(sum(part * part for part in values(start)[0].tolist()))
        for values in (trajectory.velocities, trajectory.angular_rates)
    )
    least = renderer.nearest_distance(trajectory.positions(start)[0]) - speed * duration_s
    if least <= 0:
        return math.inf
    by_speed, by_turn = _fastest_flow(renderer.camera)
    return (by_speed * speed / least + by_turn * turn) * duration_s / _SURELY


class _ObjectSpeeds:
    """Bounds the flow of moving objects, anywhere in the boxes around them, at tiles of the image."""

    def __init__(self, renderer: Renderer) -> None:
        camera = renderer.camera
        self._motion, self._flow = renderer.motion, _flow_of_tiles(camera, _OBJECT_TILE)
        self._pixels_per_rad = _pixels_per_rad(camera)
        rays = camera.rays(_centres(camera, _OBJECT_TILE))
        self._rays = np.concatenate([rays, np.ones((len(rays), 1))], -1)
        # How far a ray within a tile may be from the tile's middle ray, per metre of depth.
        jacobian = camera.distortion_jacobian(rays)
        self._spread = _OBJECT_TILE / 2 * float(np.abs(np.linalg.inv(jacobian)).sum(-1).max())
        self._view = rays.min(0) - self._spread, rays.max(0) + self._spread
        self._pixels_per_tangent = float(np.linalg.norm(jacobian, 2, (1, 2)).max())

    def __call__(self, views: Views, nearest: float) -> FloatArray:
        """Return pixels per second (n,); nothing is taken to be nearer than ``nearest``."""
        speed = np.zeros(len(views))
        for (name, trajectory), box in zip(self._motion.objects.items(), self._motion.boxes, strict=True):
            own = seen_from(views, held(trajectory, views.t_s))
            near, far = self._within(own, box)
            deformation = self._motion.deformations.get(name)
            deforms = np.zeros(len(views)) if deformation is None else deformation.fastest(views.t_s)
            by_box = np.zeros(len(views))
            for depth in (np.maximum(near, np.minimum(nearest, far)), far):
                seen = ~np.isnan(depth)
                flow = self._flow(own, np.where(seen, depth, np.inf))
                own_speed = _largest(np.where(seen[..., None], flow, 0.0))
                nearest_seen = np.where(seen, depth, np.inf).min(1)
                by_deforming = self._pixels_per_rad * deforms / np.maximum(nearest_seen, 1e-9)
                by_box = np.maximum(by_box, own_speed + by_deforming)
            speed = np.maximum(speed, np.minimum(by_box, self._by_points(own, box, deformation, nearest)))
        return speed

    def _by_points(self, own: Views, box: FloatArray, deformation: Deformation | None, nearest: float) -> FloatArray:
        """Return a bound (n,) on the flow of an object by points of which all its points are means."""
        if deformation is None:
            corners = np.broadcast_to(box_corners(box), (len(own), 8, 3))
            return self._of_means(own, corners, np.zeros_like(corners), 0.0, nearest)
        instants = deformation.moving_points(own.t_s)
        bounds = [
            self._of_means(own[i : i + 1], positions[None], velocities[None], own_speed, nearest)
            for i, (positions, velocities, own_speed) in enumerate(instants)
        ]
        return np.concatenate(bounds)

    def _of_means(
        self, own: Views, positions: FloatArray, velocities: FloatArray, own_speed: float, nearest: float
    ) -> FloatArray:
        """Return a bound (n,) on the flow of means of points (n, k, 3); inf where a point is nearer than ``nearest``.

        A mean of points at depths z_i that move by (u, v, w)_i has at image point x the flow that is a mean of
        ((u, v)_i - x w_i) / z_i, by other weights. That is a convex function of x, so it is largest at a corner of what
        the points span in the image.
        """
        at = (positions - own.positions[:, None]) @ own.rotations  # camera axes
        moving = (velocities - own.velocities[:, None]) @ own.rotations - np.cross(own.angular_rates[:, None], at)
        depth = np.maximum(at[..., 2:], nearest)
        image = at[..., :2] / depth
        low, high = np.maximum(image.min(1), self._view[0]), np.minimum(image.max(1), self._view[1])
        bound = self._pixels_per_rad * own_speed / depth.min((1, 2))
        by_means = np.zeros(len(own))
        for x, y in product((low[:, 0], high[:, 0]), (low[:, 1], high[:, 1])):
            across = moving[..., :2] - np.stack([x, y], -1)[:, None] * moving[..., 2:]
            by_means = np.maximum(by_means, np.linalg.norm(across / depth, axis=-1).max(1))
        bound = np.where((low > high).any(1), 0.0, bound + self._pixels_per_tangent * by_means)
        return np.where(at[..., 2].min(1) < nearest, np.inf, bound)

    def _within(self, own: Views, box: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the least and the largest depth (n, tiles) of a box (2, 3) along the tiles' rays; NaN where it is
        missed."""
        away = np.linalg.norm(own.positions - box.mean(0), axis=-1) + np.linalg.norm(box[1] - box[0]) / 2
        margin = (self._spread * away)[:, None, None]
        directions = np.einsum("nij,tj->nti", own.rotations, self._rays)
        directions = np.where(np.abs(directions) < 1e-12, 1e-12, directions)
        low, high = (box[0] - own.positions)[:, None] - margin, (box[1] - own.positions)[:, None] + margin
        depths = np.stack([low / directions, high / directions])
        enter, leave = depths.min(0).max(-1), depths.max(0).min(-1)
        missed = (enter > leave) | (leave <= 0)
        return np.where(missed, np.nan, enter), np.where(missed, np.nan, leave)


def _evenly(start_us: int, stop_us: int, step_us: int, more_us: list[int]) -> FloatArray:
    """Return instants from start to stop, at most a step apart, together with ``more_us``."""
    steps = -(-(stop_us - start_us) // step_us)
    even = np.linspace(start_us, stop_us, steps + 1)
    return np.union1d(even, more_us) if more_us else even


def _divided(
    t_us: FloatArray,
    function: Callable[[FloatArray], FloatArray],
    bent: Callable[[FloatArray, FloatArray, Rates], BoolArray],
) -> FloatArray:
    """Add the middle of two neighbouring instants, down to a microsecond, where a function bends between them.

    Args:
        function: instants (n,) -> values (n, k).
        bent: takes the first and the second instants of n pairs, and the values (first, middle, second) there.
    """
    values = function(t_us)
    pairs = np.arange(len(t_us) - 1)
    while True:
        middle = np.floor((t_us[pairs] + t_us[pairs + 1]) / 2)
        longer = middle > t_us[pairs]
        pairs, middle = pairs[longer], middle[longer]
        if len(pairs) == 0:
            return t_us
        between = function(middle)
        chosen = bent(t_us[pairs], t_us[pairs + 1], (values[pairs], between, values[pairs + 1]))
        t_us = np.insert(t_us, pairs[chosen] + 1, middle[chosen])
        values = np.insert(values, pairs[chosen] + 1, between[chosen], axis=0)
        index = pairs[chosen] + 1 + np.arange(np.count_nonzero(chosen))
        pairs = np.sort(np.concatenate([index - 1, index]))


@lru_cache(maxsize=8)
def _flow_of_tiles(camera: Camera, size: int) -> OpticalFlow:
    """Make the flow at the tiles' middles; it is kept, because a simulator driven in steps makes a clock for each."""
    return OpticalFlow(camera, _centres(camera, size))


@lru_cache(maxsize=8)
def _parts(camera: Camera) -> FloatArray:
    """Return of rays (x, y, 1) through tiles the lowest x and y, and the highest (tiles, 2, 2), with a margin."""
    columns, rows = np.arange(camera.width + 1) - 0.5, np.arange(camera.height + 1) - 0.5
    corners = np.moveaxis(camera.rays(np.stack(np.meshgrid(columns, rows), -1)), -1, 0)
    low, high = (sign * _least_in_tiles(_least_of_corners(sign * corners)).T for sign in (1, -1))
    margin = _PART_MARGIN * (high - low)
    return np.stack([low - margin, high + margin], 1)


def _least_of_corners(corners: FloatArray) -> FloatArray:
    """Return the least of the four corners of each pixel (n, H, W), from (n, H + 1, W + 1)."""
    rows = np.minimum(corners[:, 1:], corners[:, :-1])
    return np.minimum(rows[..., 1:], rows[..., :-1])


@lru_cache(maxsize=8)
def _fastest_flow(camera: Camera) -> tuple[float, float]:
    """Return the most pixels per second that a camera sees where it moves by 1 m/s, of points 1 m from its centre, and
    where it turns by 1 rad/s."""
    by_speed, by_turn = _flow_of_tiles(camera, _TILE).fastest()
    # What is 1 m away has a smaller depth, by as much as its ray is tilted.
    rays = camera.rays(pixel_centres(camera))
    return by_speed * math.sqrt(1 + float((rays**2).sum(-1).max())), by_turn


@lru_cache(maxsize=8)
def _pixels_per_rad(camera: Camera) -> float:
    """Bound how many pixels an image point moves for each radian of a turn, anywhere in the image."""
    return max(camera.fx, camera.fy) * (1 + float((camera.rays(_centres(camera, _TILE)) ** 2).sum(-1).max()))


def _least_in_tiles(values: npt.NDArray[_Float]) -> npt.NDArray[_Float]:
    """Return the least in each tile (n, tiles) of arrays (n, rows, columns)."""
    least = _least_of_rows(_least_of_rows(values).swapaxes(1, 2)).swapaxes(1, 2)
    return least.reshape(len(values), -1)


def _least_of_rows(values: npt.NDArray[_Float]) -> npt.NDArray[_Float]:
    """Return the least of each :data:`_TILE` rows of arrays (n, rows, columns); the last tile may have fewer."""
    least = values[:, ::_TILE].copy()
    for row in range(1, _TILE):
        following = values[:, row::_TILE]
        reached = least[:, : following.shape[1]]
        np.minimum(reached, following, out=reached)
    return least


def _centres(camera: Camera, size: int) -> FloatArray:
    """Return the centres (tiles, 2) of tiles of size x size pixels, row by row."""
    columns, rows = np.arange(0, camera.width, size), np.arange(0, camera.height, size)
    centres = np.stack(np.meshgrid(columns + (size - 1) / 2, rows + (size - 1) / 2), -1)
    return np.minimum(centres, (camera.width - 1, camera.height - 1)).reshape(-1, 2)


def _largest(flow: FloatArray) -> FloatArray:
    x, y = flow[..., 0], flow[..., 1]
    return np.asarray(np.sqrt((x * x + y * y).max(-1)))
