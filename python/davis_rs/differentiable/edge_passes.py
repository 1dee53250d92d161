"""The edges that pass rays between two views: when they do, and how that moves with the camera's pose.

An edge of a surface passes a ray when the ray lies in the plane of the edge and the camera. The edge of a shadow passes
when the place that the ray hits lies in the plane of the edge and the light. How the instant moves with the camera's
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
"""How far beyond an edge's end, as a share of its length, a ray may pass it: what rounding makes of a corner."""

_IN_PLANE_M = 1e-11
"""How far a place moves from a plane by rounding alone."""


class ChangedRays(NamedTuple):
    """Rays that see something else at the end of a short time than at its beginning.

    Attributes:
        event: (m,) number of the event.
        ray: (m, 3) in camera axes.
        before, after: (m,) triangles.
        hidden: (m,) lights that are hidden at one end alone.
        weight: (m,) of the ray's luma in that of the event's pixel.
        change: (m,) of the event's luma.
    """

    event: IntArray
    ray: FloatArray
    before: IntArray
    after: IntArray
    hidden: npt.NDArray[np.uint64]
    weight: FloatArray
    change: FloatArray

    def take(self, index: IntArray) -> ChangedRays:
        """Some of them, by their numbers."""
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
    """When edges pass rays: share (m,) of the way from the first view to the second, NaN where none is found; and its
    derivative by an increment of the camera's pose (m, 6): position in world axes, metres, then rotation vector in
    camera axes, radians."""

    share: FloatArray
    pose: FloatArray


class _LitPlaces(NamedTuple):
    """Places that rays hit and a light, in a frame of the scene.

    Attributes:
        place: (m, 3).
        light: (m, 3) where it is, or for a directional one the way it travels.
        directional: whether it is one.
    """

    place: FloatArray
    light: FloatArray
    directional: bool

    def sides(self, occluders: _Occluders) -> FloatArray:
        """(m, 4 t) functions that are 0 where a place lies in the plane of an edge and the light (3 t of them), or in
        that of a triangle (t)."""
        if self.directional:
            of_edges = np.cross(self.light, self.place) @ occluders.along.T - self.light @ occluders.moment.T
        else:
            of_edges = (self.place - self.light) @ occluders.moment.T
            of_edges -= np.cross(self.place, self.light) @ occluders.along.T
        of_faces = self.place @ occluders.planes[:, :3].T + occluders.planes[:, 3]
        return np.concatenate([of_edges, of_faces], 1)

    def matter(self, occluders: _Occluders, row: IntArray, which: IntArray) -> Flags:
        """Whether some of these functions matter where they are: the place lies behind the edge, or in the triangle."""
        of_edge = which < len(occluders.along)
        matter = np.empty(len(row), np.bool_)
        place, light = self.place[row], self.light[row]
        ray = light if self.directional else place - light
        edge = np.where(of_edge, which, 0)
        a, along = occluders.start[edge] - place, occluders.along[edge]
        # The edge's point a + s along that lies on the line through place and light, or is the nearest to it.
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
        inward = (np.cross(occluders.along[corner], place[:, None] - occluders.start[corner]) * normal).sum(-1)
        return np.where(of_edge, matter, (inward >= 0).all(-1))

    def gradient(self, occluders: _Occluders, row: IntArray, which: IntArray) -> FloatArray:
        """Of some of the functions by the place, while the light stays."""
        edge = np.minimum(which, len(occluders.along) - 1)
        face = np.maximum(which - len(occluders.along), 0)
        of_edge = np.cross(occluders.along[edge], self.light[row])
        if not self.directional:
            of_edge += occluders.moment[edge]
        return np.where((which < len(occluders.along))[:, None], of_edge, occluders.planes[face, :3])


class _Occluders(NamedTuple):
    """The t triangles of a frame: of each edge (3 t, 3) where it starts, the way along it, and start x end; planes
    (t, 4)."""

    start: FloatArray
    along: FloatArray
    moment: FloatArray
    planes: FloatArray


class EdgePasses:
    """Finds the edges that pass rays of a renderer."""

    def __init__(self, renderer: NativeRenderer) -> None:
        self._renderer, self._table, self._pixels = renderer, renderer.table, BlurredPixels(renderer)
        rays = ray_table(self._renderer.camera, self._renderer.rays).astype(np.float32)
        self._ray_table = np.concatenate([rays, np.ones_like(rays[..., :1])], -1).astype(np.float64)
        corners, self._frames = self._table.corners, self._table.frames.astype(np.int64)
        self._edges = np.stack([corners, np.roll(corners, -1, axis=1)], 2)  # (t, 3, 2, 3)
        self._occluders = []
        for frame in range(1 + len(self._table.moving)):
            start, end = np.moveaxis(self._edges[self._frames == frame].reshape(-1, 2, 3), 1, 0)
            planes = self._table.planes[self._frames == frame]
            self._occluders.append(_Occluders(start, end - start, np.cross(start, end), planes))

    def changed(self, ends: tuple[Views, Views], pixel: IntArray) -> tuple[FloatArray, FloatArray, ChangedRays]:
        """Luma of pixels (n,) at the first of two views each, at the second but for the rays that change, and these."""
        around = self._pixels.neighbours(pixel)
        count, near = around.shape
        view, flat = np.repeat(np.arange(count, dtype=np.uint32), near), around.ravel().astype(np.uint32)
        (before, dark, luma), (after, dark_after, luma_after) = (
            self._renderer.ray_hits(views, view, flat) for views in ends
        )
        weights = np.tile(self._pixels.weights, count)[:, None] / self._renderer.rays
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
        start, stop = ((one * weights).reshape(count, -1).sum(1) for one in (luma, luma_after))
        return start, stop - np.bincount(rays.event, rays.change, count), rays

    def passes(self, ends: tuple[Views, Views], rays: ChangedRays) -> Passes:
        """When edges pass rays that change."""
        passes = Passes(np.full(len(rays.event), np.nan), np.zeros((len(rays.event), 6)))
        cameras = [self._renderer.cameras(views) for views in ends]
        surfaces = rays.before != rays.after
        for which, find in ((surfaces, self._surface_passes), (~surfaces, self._shadow_passes)):
            index = np.flatnonzero(which)
            if len(index):
                share, pose = find(cameras, rays.take(index))
                passes.share[index], passes.pose[index] = share, pose
        return passes

    def _surface_passes(self, cameras: list[list[Views]], rays: ChangedRays) -> Passes:
        """By the edges of the two triangles that a ray sees."""
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

        share, passed = _root(sides(start), sides(end))
        a, b = np.moveaxis(start + share[..., None, None] * (end - start), -2, 0)
        normal = np.cross(a, b)
        of_a, of_b = (np.cross(ray, b) * normal).sum(-1), (np.cross(a, ray) * normal).sum(-1)
        passed &= known & (np.minimum(of_a, of_b) >= -_ENDS * (np.abs(of_a) + np.abs(of_b)))
        # Of several the nearest: what is nearer hides the rest.
        inverse_depth = (of_a + of_b) / (normal**2).sum(-1)
        best = np.where(passed, inverse_depth, -np.inf).argmax(1)
        rows = np.arange(len(best))
        slope = (sides(end) - sides(start))[rows, best]
        camera = cameras[0][0]
        by_turn = np.cross(rays.ray, normal[rows, best])
        moved = -np.cross((b - a)[rows, best], rays.ray)
        by_position = np.einsum("nij,nj->ni", camera.rotations[rays.event], moved)
        found = passed[rows, best]
        pose = -np.concatenate([by_position, by_turn], 1) / np.where(found, slope, 1.0)[:, None]
        passes = Passes(np.where(found, share[rows, best], np.nan), pose)
        index = np.flatnonzero(~found & known.all(1))
        meeting = self._meeting_passes(cameras, rays.take(index))
        passes.share[index], passes.pose[index] = meeting
        return passes

    def _meeting_passes(self, cameras: list[list[Views]], rays: ChangedRays) -> Passes:
        """By the line in which the planes of two triangles meet."""
        ray, camera = rays.ray, cameras[0][0]

        def planes(of_end: list[Views], triangle: IntArray) -> tuple[FloatArray, FloatArray]:
            """Normals in camera axes, and the camera's height above the planes."""
            position, rotation = _poses(of_end, rays.event, self._frames[triangle])
            plane = self._table.planes[triangle]
            normal = np.einsum("nji,nj->ni", rotation, plane[:, :3])
            return normal, (plane[:, :3] * position).sum(-1) + plane[:, 3]

        both = rays.before, rays.after
        (one, one_height), (other, other_height) = (planes(cameras[0], triangle) for triangle in both)
        after = [planes(cameras[1], triangle) for triangle in both]
        # Inverse depths are -normal . ray / height.
        line = other / other_height[:, None] - one / one_height[:, None]
        start = (line * ray).sum(-1)
        end = ((after[1][0] / after[1][1][:, None] - after[0][0] / after[0][1][:, None]) * ray).sum(-1)
        share, passed = _root(start, end)
        towards = one * ((one * ray).sum(-1) / one_height**2)[:, None]
        towards -= other * ((other * ray).sum(-1) / other_height**2)[:, None]
        by_position = np.einsum("nij,nj->ni", camera.rotations[rays.event], towards)
        slope = np.where(passed, end - start, 1.0)
        pose = -np.concatenate([by_position, np.cross(ray, line)], 1) / slope[:, None]
        return Passes(np.where(passed, share, np.nan), pose)

    def _shadow_passes(self, cameras: list[list[Views]], rays: ChangedRays) -> Passes:
        """By the edges of all triangles, as the light has them in front of the place that a ray hits, and where their
        planes meet the surface there."""
        count = len(rays.event)
        passes = Passes(np.full(count, np.nan), np.zeros((count, 6)))
        for number, light in enumerate(self._table.lights):
            if light.kind in _EVERYWHERE:
                continue
            its = (rays.hidden >> np.uint64(number % 64)) & np.uint64(1) == 1
            for frame, occluders in enumerate(self._occluders):
                index = np.flatnonzero(its & np.isnan(passes.share))
                if len(index) and len(occluders.along):
                    some = rays.take(index)
                    passes.share[index], passes.pose[index] = self._one_shadow(cameras, some, frame, number)
        return passes

    def _one_shadow(self, cameras: list[list[Views]], rays: ChangedRays, frame: int, light: int) -> Passes:
        """By what is in one frame, before one light."""
        occluders = self._occluders[frame]
        start, end = (self._lit_places(of_end, rays, frame, light) for of_end in cameras)
        value, value_after = start.sides(occluders), end.sides(occluders)
        row, which = np.nonzero((value < 0) != (value_after < 0))
        # A place stays in the plane of its own surface, but for rounding.
        moves = (which < len(occluders.along)) | (np.abs(value_after - value)[row, which] > _IN_PLANE_M)
        matter = moves & start.matter(occluders, row, which)
        row, first = np.unique(row[matter], return_index=True)
        which = which[matter][first]
        value, value_after = value[row, which], value_after[row, which]
        passes = Passes(np.full(len(rays.event), np.nan), np.zeros((len(rays.event), 6)))
        passes.share[row] = value / (value - value_after)
        # In camera axes the place moves with the camera, along its own surface.
        event, ray = rays.event[row], rays.ray[row]
        _, rotation = _poses(cameras[0], event, np.full(len(row), frame))
        gradient = np.einsum("nji,nj->ni", rotation, start.gradient(occluders, row, which))
        place, normal = (part[row] for part in self._places(cameras[0], rays))
        on_plane = gradient - normal * ((gradient * ray).sum(-1) / (normal * ray).sum(-1))[:, None]
        by_position = np.einsum("nij,nj->ni", cameras[0][0].rotations[event], on_plane)
        by_pose = np.concatenate([by_position, np.cross(place, on_plane)], 1)
        passes.pose[row] = -by_pose / (value_after - value)[:, None]
        return passes

    def _places(self, cameras: list[Views], rays: ChangedRays) -> tuple[FloatArray, FloatArray]:
        """What rays hit, and the surface's normal there, in camera axes."""
        position, rotation = _poses(cameras, rays.event, self._frames[rays.before])
        plane = self._table.planes[rays.before]
        normal = np.einsum("nji,nj->ni", rotation, plane[:, :3])
        height = (plane[:, :3] * position).sum(-1) + plane[:, 3]
        return rays.ray * (-height / (normal * rays.ray).sum(-1))[:, None], normal

    def _lit_places(self, cameras: list[Views], rays: ChangedRays, frame: int, light: int) -> _LitPlaces:
        one = self._table.lights[light]
        directional = one.kind == "directional"
        position, rotation = _poses(cameras, rays.event, np.full(len(rays.event), frame))
        camera, turned = cameras[0].positions[rays.event], cameras[0].rotations[rays.event]
        lamp = np.einsum("nji,nj->ni", turned, one.vector - (np.zeros_like(camera) if directional else camera))
        place, normal = self._places(cameras, rays)
        # A shadow's ray begins a step off the surface, on the light's side.
        world = np.einsum("nij,nj->ni", turned, place) + camera
        step = STEP * (np.abs(world - self._table.centre).max(-1) + place[:, 2])
        towards = -lamp if directional else lamp - place
        place = place + normal * np.copysign(step, (normal * towards).sum(-1))[:, None]
        place, lamp = (np.einsum("nij,nj->ni", rotation, vector) for vector in (place, lamp))
        return _LitPlaces(place + position, lamp if directional else lamp + position, directional)

    @staticmethod
    def _in_camera(cameras: list[Views], event: IntArray, frames: IntArray, edges: FloatArray) -> FloatArray:
        """Edges' ends (m, e, 2, 3), each in its own frame, in camera axes."""
        positions, rotations = _poses(cameras, event, frames)
        # A row of places times a matrix: its transpose times each place.
        return np.asarray((edges - positions[..., None, :]) @ rotations)


def _poses(cameras: list[Views], event: IntArray, frames: IntArray) -> tuple[FloatArray, FloatArray]:
    """Positions and rotations of the cameras of events, in frames of the scene."""
    positions = np.stack([view.positions for view in cameras], 1)[event, frames]
    rotations = np.stack([view.rotations for view in cameras], 1)[event, frames]
    return positions, rotations


_EVERYWHERE = ("constant", "baked", "visible")
"""Kinds of light that are never shadowed edge by edge."""


def _root(start: FloatArray, end: FloatArray) -> tuple[FloatArray, Flags]:
    """Where between two instants a function passes 0, as a share of the time; and whether it does."""
    passed = (start < 0) != (end < 0)
    return np.where(passed, start / np.where(passed, start - end, 1.0), 0.0), passed
