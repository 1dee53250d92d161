"""Renders any scene with Mitsuba's own integrators in the LLVM variant, along our own rays."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..._mitsuba.types import DrJit, JitFloat, JitIndex, JitRay, Mitsuba, MitsubaHit, MitsubaScene
from ..._mitsuba.variants import FAST, variant
from ...events.colour import Weights
from ...events.luma import LUMA_WEIGHTS, LumaFrames
from ...geometry.camera import Camera
from ...geometry.trajectory.views import Views
from ..base import Indices
from ..motion.scene_motion import STILL, SceneMotion, SceneState
from ..motion.scene_updates import owner_numbers
from ..rays.camera_rays import CameraRays, Lanes
from ..rays.frame_sampler import frame_sampler
from .base import PAST, SceneRenderer


class IntegratorRenderer(SceneRenderer):
    """Renders any scene through the integrator that the scene names, in the LLVM variant.

    The random numbers of a ray depend only on the seed and on its number in the frame. So a still image makes no
    events, and a single pixel has the same luma alone and in the frame. Rates are differences: Mitsuba's forward mode
    through these integrators is slow, is not always the slope of the rendered luma, and aborts the process in a
    volumetric one.
    """

    variant = FAST

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
        self._camera_rays = CameraRays(camera)
        self._camera_rays.prepare(rays_per_pixel)

    def _scaled_depth(self, views: Views) -> npt.NDArray[np.float32]:
        depths = self._blank(views)
        for i, depth in enumerate(depths):
            with variant(FAST) as (_, dr):
                hits, length = self._centre_hits(views, i)
                # Mitsuba's distance is along unit directions.
                z = dr.select(hits.is_valid(), hits.t / length, dr.inf)
                depth[:] = z.numpy().reshape(depth.shape)
        return depths

    def _scaled_owners(self, views: Views) -> npt.NDArray[np.uint32]:
        owners = np.zeros((len(views), self.camera.height, self.camera.width), np.uint32)
        with variant(FAST) as (mi, dr):
            table = mi.UInt32(owner_numbers(self._scene, self.motion, mi, dr))
            for i, owner in enumerate(owners):
                hits, _ = self._centre_hits(views, i)
                shape = dr.reinterpret_array(mi.UInt32, hits.shape)
                owner[:] = dr.gather(mi.UInt32, table, shape, hits.is_valid()).numpy().reshape(owner.shape)
        return owners

    def _centre_hits(self, views: Views, index: int) -> tuple[MitsubaHit, JitFloat]:
        """Return the hits of the pixels' centres in one view, and the length of rays whose z in camera axes is 1."""
        import drjit as dr
        import mitsuba as mi

        if self.motion:
            self._updates.set(self._state(views[index : index + 1]), 0)
        lanes, _, _ = self._lanes(views, *self._frame(index), 1, mi, dr)
        ray = self._camera_rays.ray(lanes, 0, 1)
        # Mitsuba expects unit directions.
        length = dr.norm(ray.d)
        return self._first_hits(mi.Ray3f(ray.o, ray.d / length), mi, dr), length

    def _first_hits(self, ray: JitRay, mi: Mitsuba, dr: DrJit) -> MitsubaHit:
        """Return what rays hit first, past the lamps that the integrator hides."""
        hits = self._scene.ray_intersect_preliminary(ray, coherent=True)
        if not self._hides_lights:
            return hits
        at_lamp = hits.is_valid() & hits.shape.is_emitter()
        while dr.any(at_lamp):
            passed = hits.t * PAST
            further = self._scene.ray_intersect_preliminary(
                mi.Ray3f(ray.o + passed * ray.d, ray.d), coherent=True, active=at_lamp
            )
            further.t += passed
            hits = dr.select(at_lamp, further, hits)
            at_lamp &= hits.is_valid() & hits.shape.is_emitter()
        return hits

    def _render(self, views: Views, state: SceneState) -> LumaFrames:
        frames = self._blank(views)
        for i, frame in enumerate(frames):
            frame[:] = self._samples_at(state, views, *self._frame(i), self.rays_per_pixel).reshape(frame.shape)
        return frames

    def _samples_at(self, state: SceneState, views: Views, view: Indices, pixel: Indices, rays: int) -> LumaFrames:
        if not self.motion:
            return self._traced(views, view, pixel, rays)
        luma = np.empty(len(view), np.float32)
        for i in np.unique(view):
            of_view = view == i
            with variant(FAST):
                self._updates.set(state, i)
            luma[of_view] = self._traced(views, view[of_view], pixel[of_view], rays)
        return luma

    def _traced(self, views: Views, view: Indices, pixel: Indices, rays: int) -> LumaFrames:
        """Return luma of pixels of views, in the scene's present state."""
        with variant(FAST) as (mi, dr):
            lanes, sample, number = self._lanes(views, view, pixel, rays, mi, dr)
            ray = self._camera_rays.ray(lanes, sample, rays)
            ray = mi.RayDifferential3f(mi.Ray3f(ray.o, dr.normalize(ray.d)))
            sampler = frame_sampler()(dr.opaque(mi.UInt32, self._seed), number)
            colour, valid, *_ = self._integrator.sample(self._scene, sampler, ray, None, True)
            del valid  # a ray that hits nothing has the background's colour
            luma = colour[0] * self._weights[0] + colour[1] * self._weights[1] + colour[2] * self._weights[2]
            # The rays of a pixel are neighbours, and are summed in order.
            return np.array((dr.block_sum(luma, rays) / rays).numpy(), np.float32)

    def _frame(self, index: int) -> tuple[Indices, Indices]:
        """Return (view, pixel) of all pixels of one view."""
        pixels = self._camera_rays.pixels
        return np.full(pixels, index), np.arange(pixels)

    def _lanes(
        self, views: Views, view: Indices, pixel: Indices, rays: int, mi: Mitsuba, dr: DrJit
    ) -> tuple[Lanes, JitIndex, JitIndex]:
        """Return (lanes, lattice ray of each, its number in the frame): the rays of a pixel are neighbours."""
        lane = dr.arange(mi.UInt32, len(view) * rays)
        pair = lane // rays
        views_of, pixels = (dr.gather(mi.UInt32, mi.UInt32(index.astype(np.uint32)), pair) for index in (view, pixel))
        sample = lane - pair * rays
        return self._camera_rays.lanes(views, views_of, pixels, motion=False), sample, pixels * rays + sample
