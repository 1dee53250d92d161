"""Renders any scene with Mitsuba's own integrators on machines without LLVM."""

from __future__ import annotations

import functools
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from ..._mitsuba.types import JitRay, Mitsuba, MitsubaHit, MitsubaScene
from ..._mitsuba.variants import SCALAR, variant
from ...events.colour import Weights
from ...events.luma import LUMA_WEIGHTS, LumaFrames
from ...geometry.camera import Camera
from ...geometry.trajectory.views import Views
from ..base import Indices
from ..motion.scene_motion import STILL, SceneMotion, SceneState
from ..rays.camera_rays import ray_table
from .base import PAST, SceneRenderer


class ScalarRenderer(SceneRenderer):
    """Renders any scene, ray by ray in Mitsuba's scalar variant. It is slow, but runs everywhere.

    Each ray seeds the sampler by its own number, so that its random numbers never depend on its neighbours' paths.
    """

    variant = SCALAR

    def __init__(
        self,
        scene: MitsubaScene,
        camera: Camera,
        *,
        rays_per_pixel: int,
        blur: bool,
        seed: int,
        reason: str,
        motion: SceneMotion = STILL,
        weights: Weights = LUMA_WEIGHTS,
    ) -> None:
        super().__init__(
            scene, camera, rays_per_pixel=rays_per_pixel, blur=blur, seed=seed, reason=reason, motion=motion
        )
        self._weights = weights
        with variant(SCALAR) as (mi, _):
            self._sampler = mi.load_dict({"type": "independent"})
        self._unit_rays = functools.lru_cache(maxsize=4)(self._make_unit_rays)
        self._unit_rays(rays_per_pixel)
        self.name += ", scalar"

    def _scaled_depth(self, views: Views) -> npt.NDArray[np.float32]:
        depths = self._blank(views)
        z = self._unit_rays(1)[:, 0, 2]
        for depth, hits in zip(depths, self._centre_hits(views), strict=True):
            # A miss has t = inf; the unit direction's camera-frame z turns distance into depth.
            depth[:] = (np.array([hit.t for hit in hits]) * z).reshape(depth.shape)
        return depths

    def _scaled_owners(self, views: Views) -> npt.NDArray[np.uint32]:
        owners = np.zeros((len(views), self.camera.height, self.camera.width), np.uint32)
        numbers = {name: number for number, name in enumerate(self.motion.objects, 1)}
        for owner, hits in zip(owners, self._centre_hits(views), strict=True):
            names = (hit.shape.id() if hit.is_valid() else "" for hit in hits)
            owner[:] = np.array([numbers.get(name, 0) for name in names]).reshape(owner.shape)
        return owners

    def _centre_hits(self, views: Views) -> Iterator[list[MitsubaHit]]:
        """Yield the hits of the pixels' centres, view by view."""
        rays, state = self._unit_rays(1)[:, 0], self._state(views)
        for i, (position, rotation) in enumerate(zip(views.positions, views.rotations, strict=True)):
            with variant(SCALAR) as (mi, _):
                self._update(state, i)
                origin = mi.Point3f(*position.tolist())
                hits = [self._first_hit(mi.Ray3f(origin, direction), mi) for direction in (rays @ rotation.T).tolist()]
            yield hits

    def _first_hit(self, ray: JitRay, mi: Mitsuba) -> MitsubaHit:
        """Return what a ray hits first, past the lamps that the integrator hides."""
        hit = self._scene.ray_intersect_preliminary(ray, True)
        while self._hides_lights and hit.is_valid() and hit.shape.is_emitter():
            passed = hit.t * PAST
            hit = self._scene.ray_intersect_preliminary(mi.Ray3f(ray.o + passed * ray.d, ray.d), True)
            hit.t += passed
        return hit

    def _render(self, views: Views, state: SceneState) -> LumaFrames:
        shape = (len(views), self.camera.height, self.camera.width)
        view, pixel = np.divmod(np.arange(np.prod(shape, dtype=np.int64)), shape[1] * shape[2])
        return self._samples_at(state, views, view, pixel, self.rays_per_pixel).reshape(shape)

    def _samples_at(self, state: SceneState, views: Views, view: Indices, pixel: Indices, rays: int) -> LumaFrames:
        order = np.argsort(view, kind="stable")  # so that the scene changes once a view
        axes = np.moveaxis(views.rotations[view], -1, 0)[:, :, None]
        x, y, z = np.moveaxis(self._unit_rays(rays)[pixel], -1, 0)[..., None]
        directions = x * axes[0] + y * axes[1] + z * axes[2]
        luma = np.empty((len(view), rays))
        with variant(SCALAR) as (mi, _):
            scene, sampler, sample = self._scene, self._sampler, self._integrator.sample
            make_ray, make_vector = mi.RayDifferential3f, mi.Vector3f
            red, green, blue = self._weights
            origins = [mi.Point3f(*position) for position in views.positions.tolist()]
            seeds, views_of = (self._seed + pixel * rays).tolist(), view.tolist()
            last = None
            for index in order.tolist():
                which, values, seed = views_of[index], luma[index], seeds[index]
                if which != last:
                    self._update(state, which)
                    last = which
                for ray, direction in enumerate(directions[index].tolist()):
                    sampler.seed(seed + ray)
                    colour = sample(scene, sampler, make_ray(origins[which], make_vector(*direction)))[0]
                    values[ray] = red * colour[0] + green * colour[1] + blue * colour[2]
        return luma.mean(-1).astype(np.float32)

    def _update(self, state: SceneState, instant: int) -> None:
        if self.motion:
            self._updates.set(state, instant)

    def _make_unit_rays(self, rays: int) -> npt.NDArray[np.float64]:
        """Return unit directions (H * W, rays, 3) in camera axes."""
        xy = ray_table(self.camera, rays).transpose(1, 0, 2)
        directions = np.concatenate([xy, np.ones((*xy.shape[:2], 1))], -1)
        return directions / np.linalg.norm(directions, axis=-1, keepdims=True)
