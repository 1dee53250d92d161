"""Mitsuba's integrators without LLVM."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import numpy.typing as npt

from ._mitsuba import SCALAR, variant
from .camera import Camera
from .camera_rays import ray_table
from .luma import LUMA_WEIGHTS, LumaFrames
from .render import Indices, Renderer
from .render_integrator import scene_integrator
from .views import Views


class ScalarRenderer(Renderer):
    """Any scene, one ray after the other in Mitsuba's scalar variant. Slow, but it runs everywhere.

    Each ray seeds the sampler by its own number, so that its random numbers never depend on its neighbours' paths.
    """

    variant = SCALAR
    poses_per_launch = 1

    def __init__(self, scene: Any, camera: Camera, *, samples: int, blur: bool, seed: int, reason: str) -> None:
        super().__init__(camera, samples=samples, blur=blur)
        self._scene, self._seed, self.reason = scene, seed, reason
        with variant(SCALAR) as (mi, _):
            self._integrator = scene_integrator(scene, mi)
            self._sampler = mi.load_dict({"type": "independent"})
        self._unit_rays = functools.lru_cache(maxsize=4)(self._make_unit_rays)
        self._unit_rays(samples)
        self.name = f"Mitsuba's {self._integrator.class_name()}, scalar"

    def _depth(self, views: Views) -> npt.NDArray[np.float32]:
        rays = self._unit_rays(1)[:, 0]
        depths = self._blank(views)
        with variant(SCALAR) as (mi, _):
            hit = self._scene.ray_intersect_preliminary
            for depth, position, rotation in zip(depths, views.positions, views.rotations, strict=True):
                origin = mi.Point3f(*position.tolist())
                # A miss has t = inf; the unit direction's camera-frame z turns distance into depth.
                distance = np.array([hit(mi.Ray3f(origin, d), True).t for d in (rays @ rotation.T).tolist()])
                depth[:] = (distance * rays[:, 2]).reshape(depth.shape)
        return depths

    def _luma(self, views: Views) -> LumaFrames:
        shape = (len(views), self.camera.height, self.camera.width)
        view, pixel = np.divmod(np.arange(np.prod(shape, dtype=np.int64)), shape[1] * shape[2])
        return self._samples(views, view, pixel, self.rays).reshape(shape)

    def _samples(self, views: Views, view: Indices, pixel: Indices, rays: int) -> LumaFrames:
        axes = np.moveaxis(views.rotations[view], -1, 0)[:, :, None]
        x, y, z = np.moveaxis(self._unit_rays(rays)[pixel], -1, 0)[..., None]
        directions = x * axes[0] + y * axes[1] + z * axes[2]
        luma = np.empty((len(view), rays))
        with variant(SCALAR) as (mi, _):
            scene, sampler, sample = self._scene, self._sampler, self._integrator.sample
            make_ray, make_vector = mi.RayDifferential3f, mi.Vector3f
            red, green, blue = LUMA_WEIGHTS
            origins = [mi.Point3f(*position) for position in views.positions.tolist()]
            seeds = (self._seed + pixel * rays).tolist()
            for values, seed, which, of_pixel in zip(luma, seeds, view.tolist(), directions, strict=True):
                for ray, direction in enumerate(of_pixel.tolist()):
                    sampler.seed(seed + ray)
                    colour = sample(scene, sampler, make_ray(origins[which], make_vector(*direction)))[0]
                    values[ray] = red * colour[0] + green * colour[1] + blue * colour[2]
        return luma.mean(-1).astype(np.float32)

    def _make_unit_rays(self, rays: int) -> npt.NDArray[np.float64]:
        """Unit directions (H * W, rays, 3) in camera axes."""
        xy = ray_table(self.camera, rays).transpose(1, 0, 2)
        directions = np.concatenate([xy, np.ones((*xy.shape[:2], 1))], -1)
        return directions / np.linalg.norm(directions, axis=-1, keepdims=True)
