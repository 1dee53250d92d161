"""Finds the edges that pass rays between two views: when they do, and how this instant moves with the camera's pose.

An edge of a surface passes a ray when the ray lies in the plane of the edge and the camera. The edge of a shadow passes
when the point that the ray hits lies in the plane of the edge and the light. How the instant moves with the camera's
pose follows from that alone; it does not depend on luma.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..geometry.trajectory.views import Views
from ..render.native.renderer import NativeRenderer
from ..render.rays.camera_rays import ray_table
from ..render.rays.shadow_rays import STEP
from .blurred_pixels import BlurredPixels

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

_NOTHING = 2**32 - 1
_ENDS = 1e-6
"""How far beyond an edge's end, as a fraction of its length, a ray may pass, because of rounding at corners."""

_IN_PLANE_M = 1e-11
"""How far rounding may move a point off a plane."""


class ChangedRays(NamedTuple):
    """Rays whose hit, or whose hidden lights, differ between the start and the end of a short time.

    Attributes:
        event: (m,) number of the event.
        ray: (m, 3) in camera axes.
        before, after: (m,) triangles.
        hidden: (m,) mask of the lights that are hidden at one end only.
        weight: (m,) weight of the ray in the event's pixel.
        change: (m,) change of the luma of the event's pixel by the ray.
    """

    event: IntArray
    ray: FloatArray
    before: IntArray
    after: IntArray
    hidden: npt.NDArray[np.uint64]
    weight: FloatArray
    change: FloatArray

    def take(self, index: IntArray) -> ChangedRays:
        """Return the rays with these numbers."""
        return ChangedRays(
            self.event[index],
            self.ray[index],
            self.before[index],
            self.after[index],
            self.hidden[index],
            self.weight[index],
            self.change[index],
        )


class Passes(NamedTuple):
    """The instants at which edges pass m rays.

    Attributes:
        fraction: (m,) of the way from the first view to the second; NaN where no edge is found.
        pose: (m, 6) its derivative by an increment of the camera's pose: position in world axes, metres, then rotation
            vector in camera axes, radians.
    """

    fraction: FloatArray
    pose: FloatArray


class _LitPoints(NamedTuple):
    """Points that rays hit, and a light, in a frame of the scene.

    Attributes:
        point: (m, 3).
        light: (m, 3) its position, or the direction in which a directional one shines.
        directional: whether the light is directional.
    """

    point: FloatArray
    light: FloatArray
    directional: bool

    def sides(self, occluders: _Occluders) -> FloatArray:
        """Evaluate (m, 4 t) functions that are 0 where a point lies in the plane of an edge and the light, or of a
        triangle.

        The first 3 t belong to edges, the other t to triangles.
        """
        if self.directional:
            of_edges = np.cross(self.light, self.point) @ occluders.along.T - self.light @ occluders.moment.T
        else:
            of_edges = (self.point - self.light) @ occluders.moment.T
            of_edges -= np.cross(self.point, self.light) @ occluders.along.T
        of_faces = self.point @ occluders.planes[:, :3].T + occluders.planes[:, 3]
        return np.concatenate([of_edges, of_faces], 1)

    def matter(self, occluders: _Occluders, row: IntArray, which: IntArray) -> Flags:
        """Return whether functions of :meth:`sides` matter: the point lies behind the edge, or in the triangle."""
        of_edge = which < len(occluders.along)
        matter = np.empty(len(row), np.bool_)
        point, light = self.point[row], self.light[row]
        ray = light if self.directional else point - light
        edge = np.where(of_edge, which, 0)
        a, along = occluders.start[edge] - point, occluders.along[edge]
        # The edge's point a + s along that lies on the line through point and light, or is the nearest to it.
        across = np.cross(ray, np.cross(along, ray))
        length = (along * across).sum(-1)
        s = -(a * across).sum(-1) / np.where(length == 0, 1.0, length)
        back = -((a + s[:, None] * along) * ray).sum(-1) / (ray**2).sum(-1)
        matter = (length != 0) & (s >= -_ENDS) & (s <= 1 + _ENDS) & (back > _ENDS)
        if not self.directional:
            matter &= back < 1
        face = np.where(of_edge, 0, which - len(occluders.along))
        corner = 3 * face[:, None] + np.arange(3)
        normal = np.cross(occluders.along[corner[:, 0]], occluders.along[corner[:, 1]])[:, None]
        inward = (np.cross(occluders.along[corner], point[:, None] - occluders.start[corner]) * normal).sum(-1)
        return np.where(of_edge, matter, (inward >= 0).all(-1))

    def gradient(self, occluders: _Occluders, row: IntArray, which: IntArray) -> FloatArray:
        """Return the gradients of functions of :meth:`sides` by the point, with the light at rest."""
        edge = np.minimum(which, len(occluders.along) - 1)
        face = np.maximum(which - len(occluders.along), 0)
        of_edge = np.cross(occluders.along[edge], self.light[row])
        if not self.directional:
            of_edge += occluders.moment[edge]
        return np.where((which < len(occluders.along))[:, None], of_edge, occluders.planes[face, :3])


class _Occluders(NamedTuple):
    """The t triangles of a frame: each edge's start, direction and start x end, (3 t, 3); and the planes (t, 4)."""

    start: FloatArray
    along: FloatArray
    moment: FloatArray
    planes: FloatArray


class EdgePasses:
    """Finds the edges that pass rays of a renderer."""

    def __init__(self, renderer: NativeRenderer) -> None:
        self._renderer, self._table, self._pixels = renderer, renderer.table, BlurredPixels(renderer)
        rays = ray_table(self._renderer.camera, self._renderer.rays_per_pixel).astype(np.float32)
        self._ray_table = np.concatenate([rays, np.ones_like(rays[..., :1])], -1).astype(np.float64)
        corners, self._frames = self._table.corners, self._table.frames.astype(np.int64)
        self._edges = np.stack([corners, np.roll(corners, -1, axis=1)], 2)  # (t, 3, 2, 3)
        self._occluders = []
        for frame in range(1 + len(self._table.moving)):
            start, end = np.moveaxis(self._edges[self._frames == frame].reshape(-1, 2, 3), 1, 0)
            planes = self._table.planes[self._frames == frame]
            self._occluders.append(_Occluders(start, end - start, np.cross(start, end), planes))

    def changed(self, ends: tuple[Views, Views], pixel: IntArray) -> tuple[FloatArray, FloatArray, ChangedRays]:
        """Find the rays of pixels (n,) that change between two views each.

        Returns:
            Luma at the first view; luma at the second view without the change of these rays; and the rays.
        """
        around = self._pixels.neighbours(pixel)
        count, near = around.shape
        view, flat = np.repeat(np.arange(count, dtype=np.uint32), near), around.ravel().astype(np.uint32)
        (before, dark, luma), (after, dark_after, luma_after) = (
            self._renderer.ray_hits(views, view, flat) for views in ends
        )
        weights = np.tile(self._pixels.weights, count)[:, None] / self._renderer.rays_per_pixel
        changed, ray = np.nonzero((before != after) | (dark != dark_after))
        rays = ChangedRays(
            view[changed].astype(np.int64),
            self._ray_table[ray, flat[changed]],
            before[changed, ray].astype(np.int64),
            after[changed, ray].astype(np.int64),
            dark[changed, ray] ^ dark_after[changed, ray],
            weights[changed, 0],
            ((luma_after - luma) * weights)[changed, ray],
        )
        start, stop = ((values * weights).reshape(count, -1).sum(1) for values in (luma, luma_after))
        return start, stop - np.bincount(rays.event, rays.change, count), rays

    def passes(self, ends: tuple[Views, Views], rays: ChangedRays) -> Passes:
        """Return when edges pass the rays that change between two views."""
        passes = Passes(np.full(len(rays.event), np.nan), np.zeros((len(rays.event), 6)))
        cameras = [self._renderer.cameras(views) for views in ends]
        surfaces = rays.before != rays.after
        for which, find in ((surfaces, self._surface_passes), (~surfaces, self._shadow_passes)):
            index = np.flatnonzero(which)
            if len(index):
                fraction, pose = find(cameras, rays.take(index))
                passes.fraction[index], passes.pose[index] = fraction, pose
        return passes

    def _surface_passes(self, cameras: list[list[Views]], rays: ChangedRays) -> Passes:
        """Return when the edges of the two triangles that a ray hits pass it."""
        triangles = np.stack([rays.before, rays.after], 1)
        known = triangles != _NOTHING
        triangles = np.where(known, triangles, 0)
        edges = self._edges[triangles].reshape(len(triangles), 6, 2, 3)
        frames = np.repeat(self._frames[triangles], 3, axis=1)
        known = np.repeat(known, 3, axis=1)
        start, end = (self._in_camera(of_end, rays.event[:, None], frames, edges) for of_end in cameras)
        ray = rays.ray[:, None]

        def sides(seen: FloatArray) -> FloatArray:
            return np.asarray((np.cross(seen[..., 0, :], seen[..., 1, :]) * ray).sum(-1))

        fraction, passed = _root(sides(start), sides(end))
        a, b = np.moveaxis(start + fraction[..., None, None] * (end - start), -2, 0)
        normal = np.cross(a, b)
        of_a, of_b = (np.cross(ray, b) * normal).sum(-1), (np.cross(a, ray) * normal).sum(-1)
        passed &= known & (np.minimum(of_a, of_b) >= -_ENDS * (np.abs(of_a) + np.abs(of_b)))
        # Of several edges the nearest counts, because it hides the others.
        inverse_depth = (of_a + of_b) / (normal**2).sum(-1)
        best = np.where(passed, inverse_depth, -np.inf).argmax(1)
        rows = np.arange(len(best))
        slope = (sides(end) - sides(start))[rows, best]
        camera = cameras[0][0]
        by_turn = np.cross(rays.ray, normal[rows, best])
        moved = -np.cross((b - a)[rows, best], rays.ray)
        by_position = np.einsum("nij,nj->ni", camera.rotations[rays.event], moved)
        any_passed = passed[rows, best]
        pose = -np.concatenate([by_position, by_turn], 1) / np.where(any_passed, slope, 1.0)[:, None]
        passes = Passes(np.where(any_passed, fraction[rows, best], np.nan), pose)
        index = np.flatnonzero(~any_passed & known.all(1))
        meeting = self._meeting_passes(cameras, rays.take(index))
        passes.fraction[index], passes.pose[index] = meeting
        return passes

    def _meeting_passes(self, cameras: list[list[Views]], rays: ChangedRays) -> Passes:
        """Return when the line in which the planes of two triangles meet passes a ray."""
        ray, camera = rays.ray, cameras[0][0]

        def planes(of_end: list[Views], triangle: IntArray) -> tuple[FloatArray, FloatArray]:
            """Return normals in camera axes, and the camera's height above the planes."""
            position, rotation = _poses(of_end, rays.event, self._frames[triangle])
            plane = self._table.planes[triangle]
            normal = np.einsum("nji,nj->ni", rotation, plane[:, :3])
            return normal, (plane[:, :3] * position).sum(-1) + plane[:, 3]

        both = rays.before, rays.after
        (first, first_height), (second, second_height) = (planes(cameras[0], triangle) for triangle in both)
        after = [planes(cameras[1], triangle) for triangle in both]
        # Inverse depths are -normal . ray / height.
        line = second / second_height[:, None] - first / first_height[:, None]
        start = (line * ray).sum(-1)
        end = ((after[1][0] / after[1][1][:, None] - after[0][0] / after[0][1][:, None]) * ray).sum(-1)
        fraction, passed = _root(start, end)
        towards = first * ((first * ray).sum(-1) / first_height**2)[:, None]
        towards -= second * ((second * ray).sum(-1) / second_height**2)[:, None]
        by_position = np.einsum("nij,nj->ni", camera.rotations[rays.event], towards)
        slope = np.where(passed, end - start, 1.0)
        pose = -np.concatenate([by_position, np.cross(ray, line)], 1) / slope[:, None]
        return Passes(np.where(passed, fraction, np.nan), pose)

    def _shadow_passes(self, cameras: list[list[Views]], rays: ChangedRays) -> Passes:
        """Return when the shadow of a triangle's edge passes the point that a ray hits.

        The line in which a triangle's plane meets the surface there counts too.
        """
        count = len(rays.event)
        passes = Passes(np.full(count, np.nan), np.zeros((count, 6)))
        for number, light in enumerate(self._table.lights):
            if light.kind in _EVERYWHERE:
                continue
            its = (rays.hidden >> np.uint64(number % 64)) & np.uint64(1) == 1
            for frame, occluders in enumerate(self._occluders):
                index = np.flatnonzero(its & np.isnan(passes.fraction))
                if len(index) and len(occluders.along):
                    rest = rays.take(index)
                    passes.fraction[index], passes.pose[index] = self._one_shadow(cameras, rest, frame, number)
        return passes

    def _one_shadow(self, cameras: list[list[Views]], rays: ChangedRays, frame: int, light: int) -> Passes:
        """Return when the shadows of the triangles of one frame, from one light, pass the points that rays hit."""
        occluders = self._occluders[frame]
        start, end = (self._lit_points(of_end, rays, frame, light) for of_end in cameras)
        value, value_after = start.sides(occluders), end.sides(occluders)
        row, which = np.nonzero((value < 0) != (value_after < 0))
        # A point stays in the plane of its own surface, but for rounding.
        moves = (which < len(occluders.along)) | (np.abs(value_after - value)[row, which] > _IN_PLANE_M)
        matter = moves & start.matter(occluders, row, which)
        row, first = np.unique(row[matter], return_index=True)
        which = which[matter][first]
        value, value_after = value[row, which], value_after[row, which]
        passes = Passes(np.full(len(rays.event), np.nan), np.zeros((len(rays.event), 6)))
        passes.fraction[row] = value / (value - value_after)
        # In camera axes the point moves with the camera, along its own surface.
        event, ray = rays.event[row], rays.ray[row]
        _, rotation = _poses(cameras[0], event, np.full(len(row), frame))
        gradient = np.einsum("nji,nj->ni", rotation, start.gradient(occluders, row, which))
        point, normal = (part[row] for part in self._hit_points(cameras[0], rays))
        on_plane = gradient - normal * ((gradient * ray).sum(-1) / (normal * ray).sum(-1))[:, None]
        by_position = np.einsum("nij,nj->ni", cameras[0][0].rotations[event], on_plane)
        by_pose = np.concatenate([by_position, np.cross(point, on_plane)], 1)
        passes.pose[row] = -by_pose / (value_after - value)[:, None]
        return passes

    def _hit_points(self, cameras: list[Views], rays: ChangedRays) -> tuple[FloatArray, FloatArray]:
        """Return the points that rays hit, and the surface's normals there, in camera axes."""
        position, rotation = _poses(cameras, rays.event, self._frames[rays.before])
        plane = self._table.planes[rays.before]
        normal = np.einsum("nji,nj->ni", rotation, plane[:, :3])
        height = (plane[:, :3] * position).sum(-1) + plane[:, 3]
        return rays.ray * (-height / (normal * rays.ray).sum(-1))[:, None], normal

    def _lit_points(self, cameras: list[Views], rays: ChangedRays, frame: int, light: int) -> _LitPoints:
        source = self._table.lights[light]
        directional = source.kind == "directional"
        position, rotation = _poses(cameras, rays.event, np.full(len(rays.event), frame))
        camera, turned = cameras[0].positions[rays.event], cameras[0].rotations[rays.event]
        light_vector = np.einsum(
            "nji,nj->ni", turned, source.vector - (np.zeros_like(camera) if directional else camera)
        )
        point, normal = self._hit_points(cameras, rays)
        # A shadow's ray begins a step off the surface, on the light's side.
        world = np.einsum("nij,nj->ni", turned, point) + camera
        step = STEP * (np.abs(world - self._table.centre).max(-1) + point[:, 2])
        towards = -light_vector if directional else light_vector - point
        point = point + normal * np.copysign(step, (normal * towards).sum(-1))[:, None]
        point, light_vector = (np.einsum("nij,nj->ni", rotation, vector) for vector in (point, light_vector))
        return _LitPoints(point + position, light_vector if directional else light_vector + position, directional)

    @staticmethod
    def _in_camera(cameras: list[Views], event: IntArray, frames: IntArray, edges: FloatArray) -> FloatArray:
        """Return the ends (m, e, 2, 3) of edges in camera axes, from those in their own frames."""
        positions, rotations = _poses(cameras, event, frames)
        # A row of points times a matrix: its transpose times each point.
        return np.asarray((edges - positions[..., None, :]) @ rotations)


def _poses(cameras: list[Views], event: IntArray, frames: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return positions and rotations of the cameras of events, in frames of the scene."""
    positions = np.stack([view.positions for view in cameras], 1)[event, frames]
    rotations = np.stack([view.rotations for view in cameras], 1)[event, frames]
    return positions, rotations


_EVERYWHERE = ("constant", "baked", "visible")
"""Kinds of light that are never shadowed edge by edge."""


def _root(start: FloatArray, end: FloatArray) -> tuple[FloatArray, Flags]:
    """Return at which fraction of the time between two instants a function passes 0, and whether it does."""
    passed = (start < 0) != (end < 0)
    return np.where(passed, start / np.where(passed, start - end, 1.0), 0.0), passed
