"""Makes tubes of triangles of Mitsuba's curves, as fine as an outline asks for.

A ``linearcurve`` is a cone between each two balls that follow each other, and the balls. A ``bsplinecurve`` is a circle
that is swept along a cubic B-spline, at right angles to it, and open at its ends. Corners lie as far outside of the
true circles as the middles of sides lie inside. Normals and texture coordinates are Mitsuba's at the corners.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..scene.meshes import Mesh
from .round_meshes import LEAST_SIDES, MOST_TRIANGLES, OUTLINE_PX, UNKNOWN_SIDES, RoundMesh, face_areas, grid_faces

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

CURVES = ("linearcurve", "bsplinecurve")
"""Mitsuba's plugins that have them."""

_FEWEST_SIDES = 6
"""The fewest sides around a tube, however many tubes there are."""

_LARGEST_PX = 1e9
"""The thickest radius counts as no more pixels, also where the camera's path touches it."""

_COARSER = 1.1
"""The step in which the distance from the true outline grows until there are few enough triangles."""

_TESTED = 8
"""Parts of a segment of a spline, and places around it, at which its bends are measured."""

# Weights of the four control points of a segment of a cubic B-spline, by powers of the place on it, from 0 to 3.
_SPLINE = np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6


class Curves(NamedTuple):
    """Holds the curves of one shape.

    Attributes:
        points: (n, 4), the control points: position and radius, metres.
        firsts: (m,), the first control point of each segment, in Mitsuba's order: those of a curve follow each other.
        is_spline: they are splines of four control points a segment, not balls and cones between two.
    """

    points: FloatArray
    firsts: IntArray
    is_spline: bool

    @property
    def controls(self) -> FloatArray:
        """The control points of each segment, (m, 4 or 2, 4)."""
        return self.points[self.firsts[:, None] + np.arange(4 if self.is_spline else 2)]

    @property
    def boxes(self) -> FloatArray:
        """The corners (m, 8, 3) of boxes that hold the segments."""
        controls = self.controls
        radii = controls[..., 3:].max(1)
        ends = np.stack([controls[..., :3].min(1) - radii, controls[..., :3].max(1) + radii])
        corners = np.indices((2, 2, 2)).reshape(3, 8)
        return np.stack([ends[corners[axis], :, axis] for axis in range(3)], -1).transpose(1, 0, 2)

    @property
    def begins(self) -> npt.NDArray[np.bool_]:
        """Whether each segment is the first one of its curve, (m,)."""
        return np.append(True, np.diff(self.firsts) != 1)


def curve_mesh(curves: Curves, pixels_per_metre: FloatArray | None) -> RoundMesh | None:
    """Make the triangles of curves, at most :data:`MOST_TRIANGLES`; None where there are too many segments for that.

    At least one radius is above 0.

    Args:
        pixels_per_metre: (m,), how many pixels a metre on each segment covers at most; None if that is not known.
    """
    if 2 * _FEWEST_SIDES * len(curves.firsts) > MOST_TRIANGLES:
        return None
    thickest = float(curves.points[:, 3].max())
    if pixels_per_metre is None:
        pixels = np.full(len(curves.firsts), (UNKNOWN_SIDES / np.pi) ** 2 * 2 * OUTLINE_PX / thickest)
    else:
        pixels = np.minimum(pixels_per_metre, _LARGEST_PX / thickest)
    plan = _SplinePlan(curves, pixels) if curves.is_spline else _BallPlan(curves, pixels)
    times = 1.0
    while plan.count(times) > MOST_TRIANGLES:
        if plan.is_coarsest(times):
            return None
        times *= _COARSER
    parts = plan.parts(times)
    firsts = np.cumsum([0, *(len(part.mesh.vertices) for part in parts)])
    faces = [part.mesh.faces + first for part, first in zip(parts, firsts, strict=False)]
    vertices, uv = (np.concatenate([getattr(part.mesh, name) for part in parts]) for name in ("vertices", "uv"))
    off_px = np.nan if pixels_per_metre is None else max(part.off_px for part in parts)
    return RoundMesh(
        Mesh(vertices, np.concatenate(faces), uv), np.concatenate([part.normals for part in parts]), off_px
    )


class _Plan:
    """Says how fine a shape's curves are.

    Args:
        radius_px: (k,), of each tube, pixels.
    """

    def __init__(self, radius_px: FloatArray) -> None:
        # As for round shapes: half of what a side is off lies on each side of the true circle. What is lost along the
        # tube adds up with that.
        self._wanted = np.maximum(np.pi * np.sqrt(radius_px / (2 * OUTLINE_PX)), LEAST_SIDES)
        self._radius_px = radius_px

    def sides(self, times: float) -> IntArray:
        """Return how many sides each tube has, (k,), if its outline may be off by so many times what it should be."""
        even = 2 * np.ceil(self._wanted / np.sqrt(times) / 2)
        return np.maximum(even, _FEWEST_SIDES).astype(np.int64)

    def is_coarsest(self, times: float) -> bool:
        """Return whether there cannot be fewer triangles."""
        return bool((self.sides(times) == _FEWEST_SIDES).all())


class _BallPlan(_Plan):
    """Plans balls and cones: one tube for each segment, with the ball at its end, and that at its start if no other
    segment ends there.

    Args:
        pixels_per_metre: (m,), on each segment.
    """

    def __init__(self, curves: Curves, pixels_per_metre: FloatArray) -> None:
        self._curves = curves
        controls = curves.controls
        super().__init__(controls[..., 3].max(1) * pixels_per_metre)
        along = controls[:, 1, :3] - controls[:, 0, :3]
        length = np.linalg.norm(along, axis=1)
        self._axes = _unit(along)
        self._frames = _local_frame(self._axes)
        narrower = controls[:, 0, 3] - controls[:, 1, 3]
        # The latitude, as seen from the middle of each ball, where its cone begins. One ball may hold the other.
        self._latitudes = np.arctan2(narrower, np.sqrt(np.maximum(length**2 - narrower**2, 0.0)))

    def _rows(self, times: float) -> tuple[IntArray, IntArray]:
        """Return how many rows of triangles the balls at the start and at the end have, (k,) each."""
        per_radian = self.sides(times) / (2 * np.pi)
        start, end = (np.ceil((np.pi / 2 + sign * self._latitudes) * per_radian) for sign in (1, -1))
        return np.where(self._curves.begins, start, 0).astype(np.int64), end.astype(np.int64)

    def count(self, times: float) -> int:
        """Return how many triangles there are at most."""
        return int((2 * self.sides(times) * (1 + sum(self._rows(times)))).sum())

    def parts(self, times: float) -> list[RoundMesh]:
        """Return the mesh of each segment."""
        rows = zip(self.sides(times).tolist(), *(number.tolist() for number in self._rows(times)), strict=True)
        return [self._part(number, *of_part) for number, of_part in enumerate(rows)]

    def _part(self, number: int, sides: int, before: int, after: int) -> RoundMesh:
        (start, end), latitude = self._curves.controls[number], self._latitudes[number]
        off = 1 - np.cos(np.pi / sides) ** 2
        latitudes = np.append(
            np.linspace(-np.pi / 2, latitude, before + 1) if before else latitude,
            np.linspace(latitude, np.pi / 2, after + 1),
        )[:, None]
        at_end = np.arange(len(latitudes)) > before
        around = np.linspace(0, 1, sides + 1)
        start_of_turn, across = (directions[number] for directions in self._frames)
        circle = _circle(start_of_turn, across, around)
        normals = np.cos(latitudes)[..., None] * circle + np.sin(latitudes)[..., None] * self._axes[number]
        ball = np.where(at_end[:, None], end, start)[:, None]
        points = ball[..., :3] + ball[..., 3:] * (2 / (2 - off)) * normals
        uv = np.stack(np.broadcast_arrays(around, (number + at_end[:, None]) / len(self._curves.firsts)), -1)
        # At the poles, where all directions meet, each triangle takes the one in its middle.
        if before:
            uv[0, :-1, 0] += 0.5 / sides
        uv[-1, 1:, 0] -= 0.5 / sides
        return _grid_mesh(points, normals, uv, float(self._radius_px[number] * off / (2 - off)))


class _SplinePlan(_Plan):
    """Plans splines: one tube for each curve, with rows of triangles that are as long as its bends allow.

    Args:
        pixels_per_metre: (m,), on each segment.
    """

    def __init__(self, curves: Curves, pixels_per_metre: FloatArray) -> None:
        self._curves = curves
        starts = np.flatnonzero(curves.begins)
        self._segments = np.split(np.arange(len(curves.firsts)), starts[1:])
        radius_px = curves.controls[..., 3].max(1) * pixels_per_metre
        super().__init__(np.array([radius_px[segments].max() for segments in self._segments]))
        tested = [self._tested(segments) for segments in self._segments]
        bends, self._turns = (np.concatenate(of_all) for of_all in zip(*tested, strict=True))
        self._bends_px = bends * pixels_per_metre

    def _tested(self, segments: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return for each segment of a curve how far the middles of its parts lie from straight lines at most, metres,
        and by how much its direction turns, radians."""
        tube = _Tube(self._curves.controls[segments], np.full(len(segments), 2 * _TESTED))
        points = tube.surface(np.arange(_TESTED) / _TESTED, 1.0)[0]
        bends = np.linalg.norm(points[1::2] - (points[:-1:2] + points[2::2]) / 2, axis=-1).max(1)
        turns = np.arccos(np.clip((tube.tangents[1:] * tube.tangents[:-1]).sum(1), -1, 1))
        return bends.reshape(-1, _TESTED).max(1), turns.reshape(-1, 2 * _TESTED).sum(1)

    def _rows(self, times: float) -> IntArray:
        """Return how many rows of triangles each segment has, (m,)."""
        straight = _TESTED * np.sqrt(self._bends_px / (OUTLINE_PX / 2))
        even = self._turns / (2 * np.pi / LEAST_SIDES)
        return np.maximum(np.ceil(np.maximum(straight, even) / np.sqrt(times)), 1).astype(np.int64)

    def count(self, times: float) -> int:
        """Return how many triangles there are at most."""
        rows = self._rows(times)
        of_curves = np.array([rows[segments].sum() for segments in self._segments])
        return int((2 * self.sides(times) * of_curves).sum())

    def is_coarsest(self, times: float) -> bool:
        """Return whether there cannot be fewer triangles."""
        return super().is_coarsest(times) and bool((self._rows(times) == 1).all())

    def parts(self, times: float) -> list[RoundMesh]:
        """Return the mesh of each curve."""
        rows, sides = self._rows(times), self.sides(times).tolist()
        return [self._part(number, rows[segments], sides[number]) for number, segments in enumerate(self._segments)]

    def _part(self, number: int, rows: IntArray, sides: int) -> RoundMesh:
        segments = self._segments[number]
        tube = _Tube(self._curves.controls[segments], rows)
        off, around = 1 - np.cos(np.pi / sides), np.linspace(0, 1, sides + 1)
        points, normals = tube.surface(around, 2 / (2 - off))
        along = (segments[0] + tube.places) / len(self._curves.firsts)
        uv = np.stack(np.broadcast_arrays(around + tube.twists[:, None], along[:, None]), -1)
        bends_px = (self._bends_px[segments] * (_TESTED / rows) ** 2).max()
        off_px = float(self._radius_px[number] * off / (2 - off) + bends_px)
        return _without_turns(_grid_mesh(points, normals, uv, off_px))


class _Tube:
    """Follows a spline from row to row.

    Its circles turn as little as possible from one row to the next. Mitsuba's, which texture coordinates follow, turn
    about the upright where the curve comes near it.

    Args:
        controls: (s, 4, 4), of its segments.
        rows: (s,), how many rows of triangles each has.

    Attributes:
        places: (r,), along it, from 0 to s.
        tangents: (r, 3), unit vectors.
        twists: (r,), by which part of a turn its circles begin after Mitsuba's.
    """

    def __init__(self, controls: FloatArray, rows: IntArray) -> None:
        segment = np.append(np.repeat(np.arange(len(rows)), rows), len(rows) - 1)
        place = np.append(np.concatenate([np.arange(count) / count for count in rows.tolist()]), 1.0)
        self.places = segment + place
        powers = place[:, None] ** np.arange(4)
        slopes = np.arange(1, 4) * powers[:, :3]
        curvatures = [2.0, 6.0] * powers[:, :2]
        of_rows = controls[segment]
        self._at = np.einsum("rp,pk,rkx->rx", powers, _SPLINE, of_rows)
        self._slope = np.einsum("rp,pk,rkx->rx", slopes, _SPLINE[1:], of_rows)
        self._curvature = np.einsum("rp,pk,rkx->rx", curvatures, _SPLINE[2:], of_rows)[:, :3]
        self.tangents = _unit(self._slope[:, :3])
        side, upwards = _local_frame(self.tangents)
        starts = side.copy()
        for row, (before, after) in enumerate(zip(self.tangents[:-1], self.tangents[1:], strict=True), 1):
            between = before + after
            starts[row] = starts[row - 1] - between * (starts[row - 1] @ after) / max(1 + before @ after, 1e-9)
        self._starts = starts
        angles = np.arctan2((starts * upwards).sum(1), (starts * side).sum(1))
        self.twists = np.unwrap(angles) / (2 * np.pi)

    def surface(self, around: FloatArray, wider: float) -> tuple[FloatArray, FloatArray]:
        """Return points and unit normals of the surface, (r, c, 3) each.

        Args:
            around: (c,), parts of a turn.
            wider: factor on the radius.
        """
        across = np.cross(self.tangents, self._starts)
        circle = _circle(self._starts[:, None], across[:, None], around[:, None])
        radius, slope = self._at[:, None, 3:], self._slope[:, None]
        speed = (slope[..., :3] ** 2).sum(-1, keepdims=True)
        bent = speed - radius * (circle * self._curvature[:, None]).sum(-1, keepdims=True)
        normals = bent * circle - slope[..., 3:] * slope[..., :3]
        length = np.linalg.norm(normals, axis=-1, keepdims=True)
        normals = np.divide(normals, length, out=circle.copy(), where=length > 0)
        return self._at[:, None, :3] + wider * radius * circle, normals


def _unit(vectors: FloatArray) -> FloatArray:
    """Return unit vectors (n, 3); in place of one without a length, the last one before that has one, or the first."""
    length = np.linalg.norm(vectors, axis=1)
    known = length > 1e-9 * length.max()
    if not known.any():
        return np.tile([0.0, 0.0, 1.0], (len(vectors), 1))
    last = np.maximum.accumulate(np.where(known, np.arange(len(vectors)), known.argmax()))
    return np.asarray(vectors[last] / length[last, None])


def _local_frame(axes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return Mitsuba's directions (n, 3) at right angles to unit vectors, from which and towards which turns count."""
    upwards = [0.0, 0.0, 1.0] - axes * axes[:, 2:]
    length = np.linalg.norm(upwards, axis=1, keepdims=True)
    upwards = np.where(length > 1e-9, upwards / np.maximum(length, 1e-9), [0.0, 1.0, 0.0])
    return np.cross(upwards, axes), upwards


def _circle(start: FloatArray, across: FloatArray, around: FloatArray) -> FloatArray:
    """Return unit vectors (..., c, 3) that turn from one towards another (..., 3) by parts of a turn (c,)."""
    angles = 2 * np.pi * around.reshape(-1, 1)
    return np.cos(angles) * start + np.sin(angles) * across


def _grid_mesh(points: FloatArray, normals: FloatArray, uv: FloatArray, off_px: float) -> RoundMesh:
    """Return a grid of vertices (r, c, 3), whose rows follow its axis, as triangles that face outwards."""
    vertices, faces = points.reshape(-1, 3), grid_faces(*points.shape[:2])[:, ::-1]
    areas = face_areas(vertices, faces)
    faces = faces[areas > 1e-12 * areas.max(initial=0.0)]
    return RoundMesh(Mesh(vertices, faces, uv.reshape(-1, 2)), normals.reshape(-1, 3), off_px)


def _without_turns(made: RoundMesh) -> RoundMesh:
    """Return a mesh whose triangles have texture coordinates u of about 0..1, without whole turns.

    A vertex that belongs to triangles with other turns becomes several.
    """
    mesh = made.mesh
    turns = np.floor(mesh.uv[mesh.faces, 0].mean(1)).astype(np.int64)
    pairs = np.stack([mesh.faces, np.broadcast_to(turns[:, None], mesh.faces.shape)], -1).reshape(-1, 2)
    unique, faces = np.unique(pairs, axis=0, return_inverse=True)
    vertex, turn = unique.T
    uv = mesh.uv[vertex] - np.stack([turn, 0 * turn], 1)
    return RoundMesh(Mesh(mesh.vertices[vertex], faces.reshape(-1, 3), uv), made.normals[vertex], made.off_px)
