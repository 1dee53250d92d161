"""A scene's tables in float64, as the renderers' contract has them: what renderers are compared with."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from davis_rs import Camera, Scene
from davis_rs._mitsuba.variants import SCALAR, load_scene_source, variant
from davis_rs.events.luma import LumaFrames
from davis_rs.geometry.trajectory.views import Views
from davis_rs.render.base import Indices, Renderer
from davis_rs.render.motion.scene_updates import scene_motion
from davis_rs.render.rays.camera_rays import ray_table
from davis_rs.render.rays.shadow_rays import END, STEP
from davis_rs.render.scene_tables.scene_table import SceneTable
from davis_rs.scene.texel_lookup import bilinear
from ray_caster import met

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Sights:
    """What rays (m, k) see: luma; the triangle, -1 for nothing; bit i for a light i that does not reach it, -1 for a
    back that reflects nothing; how much farther the next surface lies, as a share of the depth."""

    luma: FloatArray
    triangle: IntArray
    shadows: IntArray
    margin: FloatArray


class ExactScene:
    """A scene's tables at an instant, in float64: what rays see of them by the renderers' contract.

    Args:
        poses: for each moving shape (rotation, position) in the world.
        factors: for each light the factor on its strength.
    """

    def __init__(self, table: SceneTable, poses: list[tuple[FloatArray, FloatArray]], factors: FloatArray) -> None:
        self.table, self.factors = table, factors
        rotations, positions = zip((np.eye(3), np.zeros(3)), *poses, strict=True)
        self._rotations, self._positions = np.array(rotations)[table.frames], np.array(positions)[table.frames]
        self.corners = table.corners @ self._rotations.swapaxes(1, 2) + self._positions[:, None]
        self._middles = self.corners.mean(1)
        self._radii = np.linalg.norm(self.corners - self._middles[:, None], axis=2).max(1)

    def see(self, position: FloatArray, rotation: FloatArray, rays: FloatArray) -> Sights:
        """What m bundles of k rays (m, k, 3) with z = 1 in camera axes see. A bundle's rays pass within 1e-4 of each
        other at depth 1."""
        ways = rays @ rotation.T
        origins = np.broadcast_to(position, ways.shape)
        bundle, triangle = self._near(origins[:, 0], ways[:, 0], np.zeros(len(ways)), 1e-4)
        depth = met(self.corners[triangle], origins[bundle], ways[bundle])
        nearest, next_one = (np.full(rays.shape[:2], np.inf) for _ in range(2))
        np.minimum.at(nearest, bundle, depth)
        seen = np.full(rays.shape[:2], len(self.corners))
        first = (depth == nearest[bundle]) & np.isfinite(depth)
        np.minimum.at(seen, bundle, np.where(first, triangle[:, None], len(self.corners)))
        np.minimum.at(next_one, bundle, np.where(triangle[:, None] == seen[bundle], np.inf, depth))
        with np.errstate(invalid="ignore"):
            margin = np.where(np.isfinite(next_one), (next_one - nearest) / nearest, np.inf)
        luma, shadows = self._reflected(np.where(np.isfinite(nearest), seen, -1), position, ways, nearest)
        return Sights(luma, np.where(np.isfinite(nearest), seen, -1), shadows, margin)

    def _near(
        self, origins: FloatArray, ways: FloatArray, reach: FloatArray, widening: float
    ) -> tuple[IntArray, IntArray]:
        """Pairs of a line and a triangle whose sphere it may meet: lines from origins (m, 3) along ways (m, 3), each as
        thick as its reach (m,) and wider by so much a unit of distance; ordered by line."""
        lines, triangles = [], []
        units = ways / np.linalg.norm(ways, axis=1, keepdims=True)
        step = max(1, 4_000_000 // max(1, len(self.corners)))
        for first in range(0, len(ways), step):
            part = slice(first, first + step)
            to = self._middles[None] - origins[part, None]
            along = np.einsum("mnk,mk->mn", to, units[part])
            wide = (self._radii + reach[part, None]) * (1 + 1e-6) + widening * np.abs(along)
            met = (np.einsum("mnk,mnk->mn", to, to) - along**2 <= wide**2) & (along >= -wide)
            line, triangle = np.nonzero(met)
            lines.append(line + first)
            triangles.append(triangle)
        return np.concatenate([*lines, np.zeros(0, np.int64)]), np.concatenate([*triangles, np.zeros(0, np.int64)])

    def _reflected(
        self, seen: IntArray, position: FloatArray, ways: FloatArray, depth: FloatArray
    ) -> tuple[FloatArray, IntArray]:
        """Luma (m, k), and which lights do not reach the place: bit i for light i."""
        table, hit = self.table, seen >= 0
        lights = list(zip(table.lights, self.factors, strict=True))
        background = sum(light.strength * factor * table.background_per_strength(light) for light, factor in lights)
        luma, shadows = np.full(seen.shape, float(background)), np.zeros(seen.shape, np.int64)
        which, way, z = seen[hit], ways[hit], depth[hit]
        place = position + way * z[:, None]
        own = np.einsum("nij,ni->nj", self._rotations[which], place - self._positions[which])
        own = np.concatenate([own, np.ones((len(own), 1))], 1)
        flat = np.einsum("nij,nj->ni", self._rotations[which], table.planes[which, :3])
        normal = flat
        if table.normal_maps is not None:
            turned = np.einsum("nij,nj->ni", table.normal_maps[which], own)
            normal = np.einsum("nij,nj->ni", self._rotations[which], turned)
            normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        facing = -np.sign((normal * way).sum(1))
        normal = normal * facing[:, None]
        lit = (facing > 0) | (table.two_sided[which] == 1)
        uv = np.stack([(maps[which] * own).sum(1) for maps in (table.u_maps, table.v_maps)])
        total, dark = np.zeros(len(which)), np.zeros(len(which), np.int64)
        for number, (light, factor) in enumerate(lights):
            light_on = light.strength * factor * self._texels(which, uv, light.group)
            if light.kind == "constant":
                total += light_on
                continue
            towards = light.vector - place if light.kind == "point" else np.broadcast_to(-light.vector, place.shape)
            falls = (normal * towards).sum(1) / np.pi
            if light.kind == "point":
                falls /= np.linalg.norm(towards, axis=1) ** 3
            hidden = falls <= 0
            if table.shadows:
                step = STEP * (np.abs(place - table.centre).max(1) + z)
                side = np.sign((flat * towards).sum(1))
                origins = np.zeros(ways.shape)
                origins[hit] = place + flat * (step * side)[:, None]
                far = 1 - END if light.kind == "point" else np.inf
                hidden |= self._hidden(origins, seen, light.vector, light.kind == "point", far)[hit]
            total += np.where(hidden, 0, light_on * falls)
            dark |= hidden.astype(np.int64) << number
        luma[hit], shadows[hit] = np.where(lit, total, 0), np.where(lit, dark, -1)
        return luma, shadows

    def _texels(self, which: IntArray, uv: FloatArray, group: int) -> FloatArray:
        textures = self.table.textures
        number, texels = textures.texture_of[which], textures.texels(group).astype(np.float64)
        found = np.zeros(len(which))
        for texture in np.unique(number):
            first, width, height, wrap = textures.sizes[texture].tolist()
            image = texels[first : first + width * height].reshape(height, width, 1)
            found[number == texture] = bilinear(image, uv[:, number == texture], wrap)[:, 0]
        return found

    def _hidden(
        self, origins: FloatArray, seen: IntArray, vector: FloatArray, is_point: bool, far: float
    ) -> npt.NDArray[np.bool_]:
        """Whether something lies between places (m, k, 3), on the triangles (m, k), and a light."""
        m, k = seen.shape
        bundle = np.repeat(np.arange(m), k)
        # A bundle's rays that see one triangle lie close together; those that see another may lie far away.
        keys, group = np.unique(np.stack([bundle, seen.ravel()], 1), axis=0, return_inverse=True)
        group = group.reshape(m, k)
        counts = np.bincount(group.ravel(), minlength=len(keys)).astype(np.float64)[:, None]
        sums = [np.bincount(group.ravel(), origins[..., i].ravel(), len(keys)) for i in range(3)]
        middles: FloatArray = np.stack(sums, 1) / counts
        reach = np.zeros(len(keys))
        np.maximum.at(reach, group.ravel(), np.linalg.norm(origins - middles[group], axis=2).ravel())
        ways = vector - middles if is_point else np.broadcast_to(-vector, middles.shape)
        asked = np.flatnonzero(keys[:, 1] >= 0)
        line, triangle = self._near(middles[asked], ways[asked], reach[asked], 0.0)
        line = asked[line]
        of = keys[line, 0]
        towards = vector - origins if is_point else np.broadcast_to(-vector, origins.shape)
        share = met(self.corners[triangle], origins[of], towards[of])
        hidden = np.zeros((m, k), np.bool_)
        between = np.isfinite(share) & (share <= far) & (group[of] == line[:, None])
        np.logical_or.at(hidden, of, between)
        return hidden


def exact_scenes(scene: Scene, views: Views) -> Iterator[ExactScene]:
    """A scene at the instants of views."""
    with variant(SCALAR) as (mi, _):
        loaded = load_scene_source(scene.source(), mi)
        motion = scene_motion(scene, loaded, mi)
        table = SceneTable(loaded, mi, shadows=scene.shadows, any_integrator=True, moving=list(motion.objects))
    state = motion.at(views.t_s)
    columns = {light: column for column, light in enumerate(motion.lights)}
    for i in range(len(views)):
        poses = [(pose.rotations[i], pose.positions[i]) for pose in state.objects]
        factors = [state.factors[i, columns[x.name]] if x.name in columns else 1.0 for x in table.lights]
        yield ExactScene(table, poses, np.array(factors))


class ExactRenderer(Renderer):
    """Frames of :class:`ExactScene`: slow, and right."""

    name, reason, variant, poses_per_launch = "float64 ray caster", "asked for", SCALAR, 64

    def __init__(self, scene: Scene, camera: Camera, *, rays_per_pixel: int) -> None:
        super().__init__(camera, rays_per_pixel=rays_per_pixel, blur=False)
        self._scene, rays = scene, ray_table(camera, rays_per_pixel)
        self._rays = np.concatenate([rays, np.ones((*rays.shape[:2], 1))], 2)

    def _luma(self, views: Views) -> LumaFrames:
        frames = []
        for i, exact in enumerate(exact_scenes(self._scene, views)):
            rays = [exact.see(views.positions[i], views.rotations[i], rays[:, None]).luma[:, 0] for rays in self._rays]
            frames.append(np.mean(rays, 0).reshape(self.camera.height, self.camera.width))
        return np.array(frames, np.float32)

    def _samples(self, views: Views, view: Indices, pixel: Indices, rays: int) -> LumaFrames:
        raise NotImplementedError

    def _depth(self, views: Views) -> npt.NDArray[np.float32]:
        raise NotImplementedError
