"""Bounds how many occlusion edges sweep a pixel between two instants: from the geometry, not from samples.

Something thin may cross a pixel between two rendered instants and leave no trace in either. So the edges at which one
surface may hide another are followed through the image, and every pixel that one of them may touch is marked.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt

from ..._mitsuba.types import MitsubaScene, MitsubaShape
from ..._util.argument_error import ArgumentError
from ...geometry.camera import Camera
from ...geometry.pose import FloatArray, Pose, conjugate, hamilton, rotation_matrices

IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
Counts = npt.NDArray[np.uint8]

_BEND_PX = 0.1
"""An edge is divided into pieces whose image, and whose motion in the image, is straight within this."""

_BEND_SAFETY = 1.5
"""A bend is measured half way; nowhere is it taken to be more than this many times larger."""

_DIVISIONS = 16
"""A piece that is still not straight after this many divisions passes through the camera, or very nearly does."""

_TURN_RAD = 0.5
"""A longer turn is taken in several steps."""

_INTERVALS_AT_ONCE, _CANDIDATES_AT_ONCE, _PIECES_AT_ONCE = 32, 1 << 20, 1 << 13
_NEVER = 2.0
"""Beyond the end of a piece, whose own length is 1."""

_BOTH_ENDS = np.array([0.0, 1.0])

_ROUNDING_PX = 1e-3
"""Rays of renderers are float32: this far they may miss the pixel's square."""


class Silhouettes:
    """Holds the edges of a scene's surfaces at which something may appear or disappear; the scene stands still.

    An edge between two triangles hides something only while both lie to one side of it in the image (one faces the
    camera, the other does not); the free edge of a mesh, or one where more than two triangles meet, always may.

    Not covered, because nothing is occluded there: creases of which both sides are seen, seams of texture, shadows,
    reflections. Not covered either: the line where two surfaces pass through each other, which is no edge of a mesh,
    and the outlines of an opacity texture. Edges hidden behind other surfaces count too: that marks more pixels, never
    fewer.

    Args:
        edges: (m, 2, 3), the ends of each edge in the world, metres; each edge once.
        wings: (m, 2, 3), the third corners of the two triangles that meet in it; NaN where the edge always counts.
        boxes: (b, 2, 3), lowest and highest corners around what is not made of triangles: such a box sweeps all that
            its image covers.

    Raises:
        ValueError: for an edge or box that is not finite, or another number of wings than of edges.
    """

    def __init__(self, edges: npt.ArrayLike, wings: npt.ArrayLike, *, boxes: npt.ArrayLike = ()) -> None:
        self.edges = np.asarray(edges, np.float64).reshape(-1, 2, 3)
        self.boxes = np.asarray(boxes, np.float64).reshape(-1, 2, 3)
        third = np.asarray(wings, np.float64).reshape(-1, 2, 3)
        if len(third) != len(self.edges):
            raise ValueError(f"every edge needs two wings, got {len(self.edges)} edges and wings of {len(third)}")
        if not (np.isfinite(self.edges).all() and np.isfinite(self.boxes).all()):
            raise ValueError("the corners of edges and boxes must be finite")
        start = self.edges[:, :1]
        normals = np.cross(self.edges[:, 1:] - start, third - start)
        with np.errstate(invalid="ignore"):  # a triangle without area has no plane: NaN, and its edge always counts
            normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        # Both normals turn the same way about the edge: a camera that sees the wings to both sides of it has them
        # at distances of opposite signs.
        self._planes = np.concatenate([normals, -(normals * start).sum(-1, keepdims=True)], -1)
        self._rounding = 1e-6 * float(np.abs(self.edges).max(initial=0.0))

    @classmethod
    def of_scene(cls, mi_scene: MitsubaScene) -> Silhouettes:
        """Find the outlines of a loaded Mitsuba scene: the edges of its meshes, and the boxes of all else (spheres,
        disks, instances).

        Rectangles and cubes are meshes. Where two meshes touch, the free edges of both count.
        """
        return cls.of_shapes(mi_scene.shapes())

    @classmethod
    def of_shapes(cls, shapes: Iterable[MitsubaShape]) -> Silhouettes:
        """Find the outlines of some shapes of a loaded Mitsuba scene, see :meth:`of_scene`."""
        meshes, boxes = [mesh_edges(np.empty((0, 3, 3)))], []
        for shape in shapes:
            if shape.is_mesh():
                vertices = np.array(shape.vertex_positions_buffer(), np.float64).reshape(-1, 3)
                meshes.append(mesh_edges(vertices[np.array(shape.faces_buffer()).reshape(-1, 3)]))
            else:
                bounds = shape.bbox()
                boxes.append([np.array(bounds.min).reshape(3), np.array(bounds.max).reshape(3)])
        edges, wings = (np.concatenate(parts) for parts in zip(*meshes, strict=True))
        return cls(edges, wings, boxes=boxes)

    def swept(
        self, camera: Camera, poses_before: Sequence[Pose], poses_after: Sequence[Pose], *, margin_px: float
    ) -> Counts:
        """Count the edges that may touch each pixel's square, grown by ``margin_px``, during each of n intervals.

        Returns:
            (n, H, W); 255 stands for more. One edge may count twice at its ends, and where it is followed in pieces;
            none counts less than once. What has no edges, and an edge that passes through the camera, count as two.

        In interval i the camera goes from ``poses_before[i]`` to ``poses_after[i]`` at constant velocity and constant
        body rate, the shorter way round; where its true path bends away from that, the margin has to hold the bend, in
        pixels. Between two equal poses nothing is swept. An edge that passes through the camera marks the whole image.
        Many intervals in one call cost less each; they do not depend on each other.

        Raises:
            ValueError: for unequal numbers of poses, or a margin that is negative or not finite.
        """
        if len(poses_before) != len(poses_after):
            raise ValueError(f"{len(poses_before)} intervals begin, but {len(poses_after)} end")
        if not 0 <= margin_px < np.inf:
            raise ArgumentError("{margin_px} must be finite and >= 0, got {}", margin_px)
        counts = np.zeros((len(poses_before), camera.height, camera.width), np.uint8)
        at_once = min(_INTERVALS_AT_ONCE, max(1, _CANDIDATES_AT_ONCE // max(1, len(self.edges))))
        for first in range(0, len(counts), at_once):
            some = slice(first, first + at_once)
            motion = _CameraMotion(poses_before[some], poses_after[some])
            swept = _SweptPixels(camera, len(motion.position), margin_px)
            edge, interval = self._occluding(motion)
            for piece in range(0, len(edge), _PIECES_AT_ONCE):
                pieces = slice(piece, piece + _PIECES_AT_ONCE)
                _follow(self.edges[edge[pieces]], interval[pieces], motion, swept)
            for box in self.boxes:
                _cover(box, motion, swept)
            counts[some] = swept.counts()
        return counts

    def _occluding(self, motion: _CameraMotion) -> tuple[IntArray, IntArray]:
        """Return (edge, interval) of all edges that may occlude at some time of an interval with motion.

        The camera goes straight, so its distance from a wing's plane changes linearly: if it sees the wings to both
        sides of the edge at both ends, and in the same order, it does so all the way.
        """
        moving = np.flatnonzero(motion.moving)
        ends = [motion.position[moving], (motion.position + motion.travel)[moving]]
        first_side, second_side = (
            np.stack([plane[:, :3] @ end.T + plane[:, 3:] for end in ends]) for plane in self._planes.swapaxes(0, 1)
        )
        in_order, swapped = (
            ((sign * first_side > self._rounding) & (sign * second_side < -self._rounding)).all(0)
            for sign in (1.0, -1.0)
        )
        edge, nth = np.nonzero(~(in_order | swapped))
        return edge, moving[nth]


def mesh_edges(triangles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return edges and wings, as :class:`Silhouettes` takes them, of one mesh's triangles (k, 3 corners, 3).

    Corners at the same place are one, whatever their normals or texture coordinates.
    """
    points, corner = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    faces = corner.reshape(-1, 3)
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(1)]
    ends = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    third = np.concatenate([faces[:, 2], faces[:, 0], faces[:, 1]])
    order = np.lexsort(ends.T)
    edges, first, count = np.unique(ends[order], axis=0, return_index=True, return_counts=True)
    wings = np.full((len(edges), 2, 3), np.nan)
    shared = count == 2
    for wing in (0, 1):
        wings[shared, wing] = points[third[order][first[shared] + wing]]
    return points[edges], wings


class _CameraMotion:
    """Holds the camera's motion in n intervals, each of which lasts from 0 to 1."""

    def __init__(self, before: Sequence[Pose], after: Sequence[Pose]) -> None:
        self.position, end = (np.array([pose.position for pose in poses]).reshape(-1, 3) for poses in (before, after))
        self.travel = end - self.position
        self._quaternion, last = (
            np.array([pose.quaternion for pose in poses]).reshape(-1, 4) for poses in (before, after)
        )
        turn = hamilton(conjugate(self._quaternion), last)
        turn *= np.where(turn[:, 3:] < 0, -1.0, 1.0)
        sine = np.linalg.norm(turn[:, :3], axis=1)
        self._axis = turn[:, :3] / np.where(sine > 0, sine, 1.0)[:, None]
        self.angle = 2 * np.arctan2(sine, turn[:, 3])
        self.moving = (self.angle > 0) | self.travel.any(1)

    def seen(self, points: FloatArray, interval: IntArray, times: FloatArray) -> FloatArray:
        """Return points (k, p, 3) of the world in camera axes at times (k, t) of their intervals (k): (k, t, p, 3)."""
        half = times * self.angle[interval, None] / 2
        turn = np.concatenate([self._axis[interval, None] * np.sin(half)[..., None], np.cos(half)[..., None]], -1)
        quaternion = hamilton(self._quaternion[interval, None], turn)
        axes = rotation_matrices(quaternion.reshape(-1, 4)).reshape(*times.shape, 3, 3)
        position = self.position[interval, None] + self.travel[interval, None] * times[..., None]
        return (points[:, None] - position[:, :, None]) @ axes


class _SweptPixels:
    """Counts how often the pixels were marked so far in n intervals.

    Quadrangles are kept as starts and ends of runs, along columns where they are steep, else along rows.
    """

    def __init__(self, camera: Camera, intervals: int, margin_px: float) -> None:
        self.camera = camera
        self.reach = margin_px + 0.5 + _ROUNDING_PX
        self.rays = _ray_bounds(camera, self.reach + 1.0)  # a pixel to spare for what is not straight
        low, high = self.rays
        self.window = (low.min((0, 1)), high.max((0, 1)))
        self._columns = np.zeros((intervals, camera.width, camera.height + 1), np.int32)
        self._rows = np.zeros((intervals, camera.height, camera.width + 1), np.int32)
        self._areas = np.zeros((intervals, camera.height, camera.width), np.bool_)

    def mark_quads(self, interval: IntArray, quads: FloatArray, spare_px: FloatArray) -> None:
        """Mark the pixels near the convex hulls of four image points (k, 4, 2), grown by ``spare_px`` (k) too.

        The hull is what an edge sweeps that moves evenly; a little more where it turns about a point of its own.
        """
        extent = np.ptp(quads, axis=1)
        steep = extent[:, 0] < extent[:, 1]
        reach = self.reach + spare_px
        _add_runs(self._columns, interval[steep], quads[steep], reach[steep])
        _add_runs(self._rows, interval[~steep], quads[~steep][..., ::-1], reach[~steep])

    def mark_pixels(self, interval: IntArray, pixels: BoolArray | np.bool_) -> None:
        """Mark pixels (k, H, W), or all, of k different intervals."""
        self._areas[interval] |= pixels

    def counts(self) -> Counts:
        """Return how many edges pass over each pixel, (n, H, W), at most 255."""
        columns, rows = (np.cumsum(runs, axis=-1, dtype=np.int32)[..., :-1] for runs in (self._columns, self._rows))
        return np.minimum(columns.swapaxes(1, 2) + rows + 2 * self._areas, 255).astype(np.uint8)


@functools.lru_cache(maxsize=8)
def _ray_bounds(camera: Camera, reach: float) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and highest undistorted ray (H, W, 2) within ``reach`` pixels, in x and y, of each centre."""
    centres = camera.rays(np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), -1))
    per_pixel = np.abs(np.linalg.inv(camera.distortion_jacobian(centres))).sum(-1)
    return centres - reach * per_pixel, centres + reach * per_pixel


def _add_runs(counts: npt.NDArray[np.int32], interval: IntArray, quads: FloatArray, reach: FloatArray) -> None:
    """Add a run's start (+1) and end (-1) to lines (n, lines, cells + 1) that come within reach of a hull.

    The points are (line, cell); reach is that of a square, in both directions.
    """
    lines, cells = counts.shape[1], counts.shape[2] - 1
    ordered = np.take_along_axis(quads, np.argsort(quads[..., :1], axis=1), axis=1)
    first = np.ceil(np.clip(ordered[:, 0, 0] - reach, 0, lines)).astype(np.int64)
    number = np.floor(np.clip(ordered[:, 3, 0] + reach, -1, lines - 1)).astype(np.int64) - first + 1
    number = np.maximum(number, 0)
    shape, nth = _repeated(number)
    line = first[shape] + nth
    reach = reach[shape]
    low, high = line - reach, line + reach
    least, most = np.full(len(shape), np.inf), np.full(len(shape), -np.inf)
    for corner in range(3):
        for other in range(corner + 1, 4):
            # The hull's cells on these lines are those of its points' connections, cut off where they leave the lines.
            start, end = ordered[:, corner], ordered[:, other]
            length = np.maximum(end[:, 0] - start[:, 0], 1e-12)
            x, slope = start[shape, 0], 1 / length[shape]
            from_cell, across = start[shape, 1], (end[:, 1] - start[:, 1])[shape]
            enters = from_cell + across * np.clip((low - x) * slope, 0.0, 1.0)
            leaves = from_cell + across * np.clip((high - x) * slope, 0.0, 1.0)
            met = (x <= high) & (end[shape, 0] >= low)
            np.minimum(least, np.minimum(enters, leaves), out=least, where=met)
            np.maximum(most, np.maximum(enters, leaves), out=most, where=met)
    begin = np.ceil(np.clip(least - reach, 0, cells)).astype(np.int64)
    stop = np.floor(np.clip(most + reach, -1, cells - 1)).astype(np.int64) + 1
    runs = counts.reshape(-1)
    at = (interval[shape] * lines + line) * (cells + 1)
    # Of the counts' own type: NumPy adds others forty times slower.
    np.add.at(runs, at + begin, np.int32(1))
    np.add.at(runs, at + np.maximum(stop, begin), np.int32(-1))


def _follow(edges: FloatArray, interval: IntArray, motion: _CameraMotion, swept: _SweptPixels) -> None:
    """Mark what edges (k, 2, 3) sweep in their intervals (k): in pieces straight enough to be quadrangles."""
    steps = np.maximum(1, np.ceil(motion.angle[interval] / _TURN_RAD)).astype(np.int64)
    edge, step = _repeated(steps)
    edges, interval = edges[edge], interval[edge]
    span = (step[:, None] + _BOTH_ENDS) / steps[edge, None]
    for _ in range(_DIVISIONS):
        points = motion.seen(edges, interval, np.stack([span[:, 0], span.mean(1), span[:, 1]], 1))
        inside = _inside(points, swept.window)
        kept = inside[:, 0] <= inside[:, 1]
        inside, interval, span = inside[kept], interval[kept], span[kept]
        edges, points = _subsegments(edges[kept], inside), _subsegments(points[kept], inside[:, None])
        image, along, over = _bends(points, swept.camera)
        straight = along + over <= _BEND_PX
        quads = image[straight][:, ::2].reshape(-1, 4, 2)
        swept.mark_quads(interval[straight], quads, _BEND_SAFETY * (along + over)[straight])
        if straight.all():
            return
        bent = ~straight
        piece, fraction, time_fraction = _division(along[bent], over[bent])
        edges, interval = _subsegments(edges[bent][piece], fraction), interval[bent][piece]
        span = _subsegments(span[bent][piece][..., None], time_fraction)[..., 0]
    swept.mark_pixels(np.unique(interval), np.True_)


def _repeated(number: IntArray) -> tuple[IntArray, IntArray]:
    """Return 0, 1, ... of k, each ``number`` (k) times; and which time it is, from 0."""
    which = np.repeat(np.arange(len(number)), number)
    return which, np.arange(len(which)) - np.repeat(np.cumsum(number) - number, number)


def _subsegments(ends: FloatArray, fraction: FloatArray) -> FloatArray:
    """Return the part of segments (..., 2, d) between two fractions (..., 2) of their length."""
    return ends[..., :1, :] + fraction[..., None] * (ends[..., 1:, :] - ends[..., :1, :])


def _positive(start: FloatArray, end: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return (from, to) in [0, 1] where a quantity linear from start to end is >= 0; from > to means nowhere."""
    apart = (start < 0) != (end < 0)
    root = np.divide(start, start - end, out=np.zeros_like(start), where=apart)
    nowhere = (start < 0) & (end < 0)
    low = np.where(nowhere, _NEVER, np.where(start < 0, root, 0.0))
    return low, np.where(nowhere, -_NEVER, np.where(end < 0, root, 1.0))


def _inside(points: FloatArray, window: tuple[FloatArray, FloatArray]) -> FloatArray:
    """Return the parts (k, 2) of segments (k, 3 times, 2, 3) that may be in a window of rays; from > to: none.

    A distance from a side of the window changes evenly along the segment, and almost so in time: the bend is added.
    """
    (left, top), (right, bottom) = window
    sides = np.array([[1.0, 0.0, -left], [-1.0, 0.0, right], [0.0, 1.0, -top], [0.0, -1.0, bottom]])
    distance = points @ sides.T
    bend = _BEND_SAFETY * np.abs(distance[:, 1] - (distance[:, 0] + distance[:, 2]) / 2)
    ends = distance[:, ::2] + bend[:, None]
    low, high = _positive(ends[:, :, 0], ends[:, :, 1])
    return np.stack([np.minimum(low[:, 0], low[:, 1]).max(-1), np.maximum(high[:, 0], high[:, 1]).min(-1)], -1)


def _bends(points: FloatArray, camera: Camera) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return images (k, 3 times, 2, 2) of segments, and by how many pixels they bend along the segment and over time.

    The bends are infinite where a segment is not wholly in front of the camera.
    """
    with np.errstate(all="ignore"):
        image = camera.project(points)
        over = np.linalg.norm(image[:, 1] - (image[:, 0] + image[:, 2]) / 2, axis=-1).max(-1)
        along = np.zeros(len(points))
        if any(camera.distortion):
            middle = (points[..., :2] / points[..., 2:]).mean(2)
            chord = image[:, :, 1] - image[:, :, 0]
            aside = camera.project(np.concatenate([middle, np.ones_like(middle[..., :1])], -1)) - image[:, :, 0]
            off = np.abs(chord[..., 0] * aside[..., 1] - chord[..., 1] * aside[..., 0])
            along = (off / np.maximum(np.linalg.norm(chord, axis=-1), 1e-12)).max(-1)
        unknown = ~np.isfinite(along + over)
    return image, np.where(unknown, np.inf, along), np.where(unknown, np.inf, over)


def _division(along: FloatArray, over: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return which piece (j) to take, which part (j, 2) of its length, and which part (j, 2) of its time.

    A bend falls with the square of the number of parts. What is not wholly before the camera is halved both ways.
    """
    in_length, in_time = (
        np.where(np.isfinite(bend), np.clip(np.ceil(np.sqrt(2 * bend / _BEND_PX)), 1, 8), 2).astype(np.int64)
        for bend in (along, over)
    )
    piece, nth = _repeated(in_length * in_time)
    in_length, in_time = in_length[piece, None], in_time[piece, None]
    fraction, time_fraction = (
        (nth[:, None] % in_length + _BOTH_ENDS) / in_length,
        (nth[:, None] // in_length + _BOTH_ENDS) / in_time,
    )
    return piece, fraction, time_fraction


_BOX_EDGES = np.array([(i, i | bit) for bit in (1, 2, 4) for i in range(8) if not i & bit])


def _cover(box: FloatArray, motion: _CameraMotion, swept: _SweptPixels) -> None:
    """Mark the rectangle of rays that holds a box (2, 3), in all intervals: what is in the box may have any outline."""
    corners = box[(np.arange(8)[:, None] >> np.arange(3)) & 1, np.arange(3)]
    for interval in np.flatnonzero(motion.moving):
        steps = 4 * max(1, int(np.ceil(motion.angle[interval] / _TURN_RAD)))
        points = motion.seen(corners[None], np.array([interval]), np.linspace(0.0, 1.0, steps + 1)[None])[0]
        edges = points[:, _BOX_EDGES]
        near = 1e-6 * np.abs(points).max()
        front = np.stack(_positive(edges[..., 0, 2] - near, edges[..., 1, 2] - near), -1)
        visible = front[..., 0] <= front[..., 1]
        if visible.any():
            ends = _subsegments(edges[visible], front[visible]).reshape(-1, 3)
            rays = ends[:, :2] / np.maximum(ends[:, 2:], near)
            low, high = swept.rays
            met = ((low <= rays.max(0)) & (high >= rays.min(0))).all(-1)
            swept.mark_pixels(np.array([interval]), met[None])
