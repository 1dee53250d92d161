"""Renders with the table kernel: the lattice rays of many views, or of single pixels, in one launch."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from ..._mitsuba.types import DrJit, JitArray, JitFloat, JitIndex, Mitsuba
from ..._mitsuba.variants import FAST, variant
from ...events.luma import LumaFrames
from ...geometry.camera import Camera
from ...geometry.trajectory.views import Views
from ..base import Indices, Renderer
from ..motion.scene_motion import STILL, SceneMotion
from ..rays.camera_rays import CameraRays, Lanes, rate_of
from ..scene_tables.scene_table import SceneTable
from .kernel import TableKernel
from .moving_lanes import MovingLanes

_Number = TypeVar("_Number", np.float32, np.uint32)

_RAYS_PER_LAUNCH = 1 << 22
_PACKET = 16
"""Pixels of a view are padded to whole ray packets. So no packet has rays of two views, and no result depends on which
views are rendered together."""


class TableRenderer(Renderer):
    """Renders a :class:`SceneTable`: direct light on diffuse triangles, without noise.

    The kernel loops over a pixel's lattice rays and adds them in a fixed order. Constant light is taken as unoccluded;
    shadows of the other lights are traced where the table asks for them. Rates are forward-mode derivatives,
    computed inside that loop.
    """

    name = "table kernel"
    variant = FAST

    def __init__(
        self, table: SceneTable, camera: Camera, *, rays_per_pixel: int, blur: bool, motion: SceneMotion = STILL
    ) -> None:
        super().__init__(camera, rays_per_pixel=rays_per_pixel, blur=blur, motion=motion)
        self.reason = table.description
        self._camera_rays = CameraRays(camera)
        columns = {name: column for column, name in enumerate(motion.lights)}
        self._profiles = [columns.get(light.name) for light in table.lights]
        self._padded = -(-self._camera_rays.pixels // _PACKET) * _PACKET
        self.poses_per_launch = int(np.clip(_RAYS_PER_LAUNCH // self._padded, 1, 64))
        with variant(FAST) as (mi, _):
            self._kernel = TableKernel(table, mi)
        self._camera_rays.prepare(rays_per_pixel)

    def _depth(self, views: Views) -> npt.NDArray[np.float32]:
        with variant(FAST) as (mi, dr):
            lanes, around = self._frame_lanes(views, mi, dr)
            ray = self._camera_rays.ray(lanes, 0, 1)
            if around is None:
                distance, hit, _, _ = self._kernel.hit(ray)
            else:
                distance, hit, _ = self._kernel.nearest(ray, around.of_rays(0, 1).bodies)
            return self._frames(dr.select(hit, distance, dr.inf), len(views), np.float32)

    def _owners(self, views: Views) -> npt.NDArray[np.uint32]:
        with variant(FAST) as (mi, dr):
            lanes, around = self._frame_lanes(views, mi, dr)
            if around is None:
                return super()._owners(views)
            _, _, owner = self._kernel.nearest(self._camera_rays.ray(lanes, 0, 1), around.of_rays(0, 1).bodies)
            return self._frames(owner, len(views), np.uint32)

    @property
    def ray_bytes(self) -> float:
        return 28.0 * self.rays_per_pixel

    def _luma(self, views: Views) -> LumaFrames:
        return self._begin_luma(views)()

    def _begin_luma(self, views: Views) -> Callable[[], LumaFrames]:
        with variant(FAST) as (mi, dr):
            luma, _ = self._mean(*self._frame_lanes(views, mi, dr), self.rays_per_pixel, mi, dr)
            dr.eval(luma)  # returns while Dr.Jit's threads compute
            return partial(self._frames, luma, len(views), np.float32)

    def _luma_and_rate(self, views: Views) -> tuple[LumaFrames, LumaFrames]:
        with variant(FAST) as (mi, dr):
            both = self._mean(*self._frame_lanes(views, mi, dr, motion=True), self.rays_per_pixel, mi, dr)
            dr.eval(both)
            luma, rate = (self._frames(values, len(views), np.float32) for values in both)
            return luma, rate

    def _samples(self, views: Views, view: Indices, pixel: Indices, rays: int) -> LumaFrames:
        padding = (0, -len(view) % _PACKET)
        with variant(FAST) as (mi, dr):
            lanes = [mi.UInt32(np.pad(index.astype(np.uint32), padding, mode="edge")) for index in (view, pixel)]
            luma, _ = self._mean(*self._lanes(views, *lanes, motion=False), rays, mi, dr)
            return np.array(luma.numpy()[: len(view)])

    def _frame_lanes(
        self, views: Views, mi: Mitsuba, dr: DrJit, *, motion: bool = False
    ) -> tuple[Lanes, MovingLanes | None]:
        """Return lanes for every pixel of every view."""
        lane = dr.arange(mi.UInt32, self._padded * len(views))
        view = lane // self._padded
        pixel = dr.minimum(lane - view * self._padded, self._camera_rays.pixels - 1)
        return self._lanes(views, view, pixel, motion=motion)

    def _lanes(
        self, views: Views, view: JitIndex, pixel: JitIndex, *, motion: bool
    ) -> tuple[Lanes, MovingLanes | None]:
        """Return the lanes of cameras and pixels, and the objects that move; None if nothing moves."""
        lanes = self._camera_rays.lanes(views, view, pixel, motion=motion)
        if not self.motion:
            return lanes, None
        state = self.motion.at(views.t_s)
        return lanes, MovingLanes(self._camera_rays, state, views, view, pixel, profiles=self._profiles, motion=motion)

    def _mean(
        self, lanes: Lanes, around: MovingLanes | None, rays: int, mi: Mitsuba, dr: DrJit
    ) -> tuple[JitFloat, JitFloat]:
        """Return luma, the mean over the lattice rays of each lane's pixel, and its rate (0 for lanes without
        motion)."""
        self._camera_rays.prepare(rays)

        def along_ray(sample: JitIndex) -> tuple[JitFloat, JitFloat]:
            ray = self._camera_rays.ray(lanes, sample, rays)
            luma = self._kernel.luma(ray) if around is None else self._kernel.luma(ray, around.of_rays(sample, rays))
            return dr.detach(luma), rate_of(luma)

        def body(sample: JitIndex, luma: JitFloat, rate: JitFloat) -> tuple[JitIndex, JitFloat, JitFloat]:
            more_luma, more_rate = along_ray(sample)
            return sample + 1, luma + more_luma, rate + more_rate

        if rays == 1:
            return along_ray(mi.UInt32(0))
        count, zero = mi.UInt32(rays), dr.zeros(mi.Float, dr.width(lanes.pixel))
        _, luma, rate = dr.while_loop((mi.UInt32(0), zero, zero), lambda sample, *_: sample < count, body)
        return luma / rays, rate / rays

    def _frames(self, lanes: JitArray, count: int, number: type[_Number]) -> npt.NDArray[_Number]:
        """Wait for lanes, and return them as images (count, H, W) of a type of numbers, without the padding."""
        height, width = self.camera.height, self.camera.width
        frames = lanes.numpy().reshape(count, self._padded)[:, : height * width]
        return np.ascontiguousarray(frames, number).reshape(count, height, width)
