"""Wraps the Rust core's renderer, which needs only the tables of a scene."""

from __future__ import annotations

import functools
from collections.abc import Callable
from copy import copy
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from ..._core import PixelRays, SceneRenderer
from ..._mitsuba.variants import SCALAR
from ...events.luma import LumaFrames
from ...geometry.camera import Camera
from ...geometry.pose import FloatArray
from ...geometry.trajectory.views import Views
from ..base import Indices, Renderer
from ..motion.scene_motion import STILL, SceneMotion, pose_arrays, seen_from
from ..rays.camera_rays import pixel_rays, ray_table, table_bytes
from ..rays.shadow_rays import END, STEP
from ..scene_cache import cached
from ..scene_tables.deforming_meshes import DeformingMeshes
from ..scene_tables.scene_table import CoreChannel, SceneTable
from ..scene_tables.scene_texture import TextureTable
from .estimators import ESTIMATORS, ViewArrays

_Pixel = TypeVar("_Pixel", np.float32, np.uint32)

_KINDS = {"spot": "point", "projector": "point", "lamp": "point", "emission": "constant"}

_PIXELS_PER_LAUNCH = 1 << 21

_MOST_ACROSS = 65535
"""The largest width of an image that the core takes."""


class NativeRenderer(Renderer):
    """Renders a :class:`SceneTable`: direct light on diffuse triangles, without noise, in Rust.

    It needs Mitsuba only to load the scene, and no LLVM. Constant light is taken as unoccluded; shadows of the other
    lights are traced where the table asks for them. Rates are closed forms along the surfaces that the rays hit. A
    pixel has the same bits in any batch, on any number of threads and on any processor of one architecture.

    Args:
        pixel: ``rays``, or ``lines``: luma is the integral over a pixel's area along lines, on which the nearest
            surface and the shadows of points of light are known from edge to edge, so that it does not jump while an
            edge passes. Rates are differences then, and hold at edges too.
        threads: number of threads; None for all processors.

    Raises:
        ValueError: for lines in place of another number of rays than ``LINES`` of :mod:`.estimators` has.

    Attributes:
        baked: the baked light; None without any.
        table: the tables of the scene.
        deforming: its meshes that deform.
    """

    name = "native renderer"
    variant = SCALAR
    concurrent = True
    culls_backs = True

    def __init__(
        self,
        table: SceneTable,
        camera: Camera,
        *,
        rays_per_pixel: int,
        blur: bool,
        motion: SceneMotion = STILL,
        pixel: str = "rays",
        threads: int | None = None,
    ) -> None:
        if table.baked is not None:
            motion = motion.with_bends(table.baked.maps.instants)
        super().__init__(camera, rays_per_pixel=rays_per_pixel, blur=blur, motion=motion)
        self.pixel, self._estimator = pixel, ESTIMATORS[pixel](camera, rays_per_pixel)
        self.reason, self.baked, self.table = table.description, table.baked, table
        columns = {name: column for column, name in enumerate(motion.lights)}
        self._profiles = [columns.get(light.name) for light in table.lights]
        self._instants = [light.instant for light in table.lights]
        self.poses_per_launch = int(np.clip(_PIXELS_PER_LAUNCH // (camera.width * camera.height), 1, 64))
        # The last entry is for rays that hit nothing.
        self._frame_of_triangle = np.append(table.frames, np.uint32(0))

        def core() -> SceneRenderer:
            return _core_of(table, threads, table.textures.shared())

        # Nobody else may use a core whose meshes change.
        self._core = core() if motion.deformations else cached((table, threads), core)
        self.concurrent = not motion.deformations
        self._threads = threads
        self.deforming = DeformingMeshes(self._core, table.deforming, motion.deformations, table.planes)

    @property
    def ray_bytes(self) -> float:
        tables = table_bytes(self.camera, self.rays_per_pixel) + table_bytes(self.camera, 1)
        return tables / (self.camera.width * self.camera.height)

    def without_blur(self) -> NativeRenderer:
        """Return a renderer by the same rays of the same scene, but without blur and lens.

        Raises:
            ValueError: for lines.
        """
        self._known_rays("derivatives")
        return NativeRenderer(
            self.table, self.camera, rays_per_pixel=self.rays_per_pixel, blur=False, motion=self.motion
        )

    def by_rays(self, rays_per_pixel: int) -> NativeRenderer:
        """Return a renderer of the same image, with its blur and lens, whose pixels are means over so many rays.

        It shares the scene.
        """
        other = copy(self)
        other.rays_per_pixel, other.pixel = rays_per_pixel, "rays"
        other._estimator = ESTIMATORS["rays"](self.camera, rays_per_pixel)
        return other

    def _luma(self, views: Views) -> LumaFrames:
        return self._frames(views, lambda arrays: self._estimator.luma(self._core, arrays))

    def _frames(self, views: Views, render: Callable[[ViewArrays], npt.NDArray[_Pixel]]) -> npt.NDArray[_Pixel]:
        """Render frames (n, H, W): all at once, or one after the other where meshes deform in between."""
        if not self.deforming:
            return render(self._arrays(views)).reshape(self._shape(views))
        frames = [render(self._arrays(views[i : i + 1])) for i in self.deforming.each(views.t_s)]
        return np.concatenate(frames).reshape(self._shape(views))

    def _known_rays(self, what: str) -> PixelRays:
        """Return the rays, for what is known of single rays alone.

        Raises:
            ValueError: for lines, or where meshes deform; ``what`` says in the message what needs them.
        """
        self._check_rigid(what)
        return self._estimator.known_rays()

    def _check_rigid(self, what: str) -> None:
        if self.deforming:
            raise ValueError(f"{what} need rigid meshes, and {next(iter(self.motion.deformations))!r} deforms")

    def _luma_and_rate(self, views: Views) -> tuple[LumaFrames, LumaFrames]:
        if self.deforming:
            return super()._luma_and_rate(views)
        both = self._estimator.luma_and_rate(self._core, self._arrays(views))
        if both is None:
            return super()._luma_and_rate(views)
        luma, rate = both
        return luma.reshape(self._shape(views)), rate.reshape(self._shape(views))

    def _samples(self, views: Views, view: Indices, pixel: Indices, rays: int) -> LumaFrames:
        luma = np.empty(len(view), np.float32)
        for some, number, rows in self.deforming.batches(views, view):
            luma[rows] = self._estimator.samples(self._core, self._arrays(some), number, pixel[rows], rays)
        return luma

    def nearest_distance(self, point: FloatArray) -> float:
        x, y, z = point.tolist()
        return self._core.nearest_distance((x, y, z))

    def depths_in_parts(self, views: Views, parts: FloatArray) -> FloatArray:
        # What is far away is also seen in reflections, and moves there as it does behind them.
        if _sky(self.table) is not None or self.table.gloss is not None:
            return super().depths_in_parts(views, parts)
        flat, shape = np.ascontiguousarray(parts, np.float64).ravel(), (len(views), len(parts), 2)
        if not self.deforming:
            return self._core.depths_in_parts(flat, self._arrays(views)).reshape(shape)
        each = self.deforming.each(views.t_s)
        return np.stack([self._core.depths_in_parts(flat, self._arrays(views[i : i + 1])) for i in each]).reshape(shape)

    def gradients(
        self, views: Views, view: npt.NDArray[np.uint32], pixel: npt.NDArray[np.uint32], weights: FloatArray
    ) -> FloatArray:
        """Return luma in float64 with its derivatives, of the renderer's own rays before the blur and the lens.

        Args:
            view: (k,) which of the views.
            pixel: (k, m) pixels, y W + x, whose weighted luma is added up.
            weights: (m,) their weights.

        Returns:
            (k, 8 + l): luma; its rate per second; its derivatives by the camera's position in world axes, per metre,
            and by a rotation vector in camera axes, per radian; and the part of luma that comes from each light, in the
            order of :attr:`table`.
        """
        gradients = self._core.gradients(
            self._known_rays("derivatives"),
            self._arrays(views),
            view,
            np.ascontiguousarray(pixel).ravel(),
            weights,
        )
        return gradients.reshape(len(view), 8 + len(self.table.lights))

    def texel_gradients(
        self, views: Views, view: npt.NDArray[np.uint32], pixel: npt.NDArray[np.uint32], weights: FloatArray
    ) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.int64], FloatArray]:
        """Return derivatives of luma by the reflectance of texels, all channels alike; light that bounces is held
        constant.

        Args:
            view, pixel, weights: as in :meth:`gradients`.

        Returns:
            (k,) how many texels each of k pixels sees; the numbers of these texels in :attr:`table`, pixel after pixel
            (a texel that wraps around its texture may come more than once); and for each the derivative of luma.
        """
        textures = self.table.textures
        steps = np.array([weights.sum() for weights in textures.group_weights], np.float64)
        counts, texels, values = self._unshared_core.texel_gradients(
            self._known_rays("derivatives"),
            self._arrays(views),
            view,
            np.ascontiguousarray(pixel).ravel(),
            weights,
            steps,
        )
        return counts, textures.of_framed[texels], values

    @functools.cached_property
    def _unshared_core(self) -> SceneRenderer:
        """A core in which each shape has texels of its own, because it has derivatives by them."""
        if self.motion.deformations or not self.table.textures.has_alike:
            return self._core
        return _core_of(self.table, self._threads, self.table.textures)

    def ray_hits(
        self, views: Views, view: npt.NDArray[np.uint32], pixel: npt.NDArray[np.uint32]
    ) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.uint64], FloatArray]:
        """Return the hits of each of r rays of single pixels (k,), in float64.

        Returns:
            (k, r) each: the number of the triangle in :attr:`table`, 2^32 - 1 for none; a mask of hidden lights (bit
            n mod 64 is flipped for each light n that something hides); and luma.
        """
        shape = len(pixel), self.rays_per_pixel
        triangle, hidden, luma = self._core.ray_hits(self._known_rays("hits of rays"), self._arrays(views), view, pixel)
        return triangle.reshape(shape), hidden.reshape(shape), luma.reshape(shape)

    def ray_luma(self, views: Views, rays: FloatArray) -> FloatArray:
        """Return luma (n,), in float64, along one ray of each of n views: (n, 3), x, y and 1 in camera axes."""
        self._check_rigid("single rays")
        parts = [np.zeros(0)]
        for first in range(0, len(views), _MOST_ACROSS):
            block = views[first : first + _MOST_ACROSS]
            table = np.ascontiguousarray(rays[first : first + _MOST_ACROSS, :2], np.float32)
            number = np.arange(len(block), dtype=np.uint32)
            pixels = PixelRays(len(block), 1, 1, table.ravel())
            parts.append(self._core.ray_hits(pixels, self._arrays(block), number, number)[2])
        return np.concatenate(parts)

    def cameras(self, views: Views) -> list[Views]:
        """Return the cameras in the world, and in the frame of each body that moves."""
        return [views, *(seen_from(views, poses) for poses in self.motion.at(views.t_s).objects)]

    def _depth(self, views: Views) -> npt.NDArray[np.float32]:
        return self._frames(views, lambda arrays: self._core.depth(pixel_rays(self.camera, 1), arrays)[0])

    def first_hits(self, view: Views) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.uint32]]:
        """Return what the centres of pixels see first at one view; meshes deform as they are then.

        Returns:
            Depth (H W), infinite where nothing is hit, and the number of the triangle in :attr:`table`.
        """
        if self.deforming:
            self.deforming.deform(view.t_s)
        return self._core.depth(pixel_rays(self.camera, 1), self._arrays(view))

    def _owners(self, views: Views) -> npt.NDArray[np.uint32]:
        triangles = self._frames(views, lambda arrays: self._core.depth(pixel_rays(self.camera, 1), arrays)[1])
        return self._frame_of_triangle[np.minimum(triangles, len(self._frame_of_triangle) - 1)]

    def _deforming_flow(
        self, number: int, view: Views, pixel: Indices, depth: npt.NDArray[np.float32], flow: FloatArray
    ) -> FloatArray:
        which, camera = np.zeros(len(pixel), np.uint32), self.cameras(view)[number]
        self.deforming.deform(view.t_s)
        _, triangle = self._core.hits(pixel_rays(self.camera, 1), self._arrays(view), which, pixel.astype(np.uint32))
        rays = np.c_[ray_table(self.camera, 1)[0][pixel], np.ones(len(pixel))]
        points = (rays * depth[:, None]) @ camera.rotations[0].T + camera.positions[0]
        velocities = self.deforming.velocities(number, triangle.astype(np.int64), points)
        return np.asarray(flow + self._centre_flow.of_motion(pixel, velocities @ camera.rotations[0], depth))

    def shapes_seen(self, views: Views, view: Indices, pixel: Indices) -> tuple[Indices, npt.NDArray[np.bool_]]:
        """Return which shapes the centres of single pixels see, and whether they see the back of its triangles.

        Args:
            view: (m,) which of the views.
            pixel: (m,) which pixel, y W + x.

        Returns:
            The number (m,) of a shape in the names of :attr:`table`, -1 where nothing is hit; and bool (m,), whether
            the side is seen on which a triangle's corners run clockwise.
        """
        shapes, back = np.empty(len(view), np.int64), np.empty(len(view), np.bool_)
        of_triangle = np.repeat(np.arange(len(self.table.counts)), self.table.counts)
        for some, number, rows in self.deforming.batches(views, view):
            _, triangle = self._core.hits(
                pixel_rays(self.camera, 1), self._arrays(some), number.astype(np.uint32), pixel[rows].astype(np.uint32)
            )
            missed = triangle >= len(of_triangle)
            triangle = np.where(missed, 0, triangle)
            rays = np.c_[ray_table(self.camera, 1)[0][pixel[rows]], np.ones(len(rows))]
            rotations = np.stack([camera.rotations for camera in self.cameras(some)])
            along = rotations[self._frame_of_triangle[triangle], number] @ rays[:, :, None]
            shapes[rows] = np.where(missed, -1, of_triangle[triangle])
            back[rows] = (np.einsum("mi,mij->m", self.deforming.planes[triangle, :3], along) > 0) & ~missed
        return shapes, back

    def _shape(self, views: Views) -> tuple[int, int, int]:
        return len(views), self.camera.height, self.camera.width

    def _arrays(self, views: Views) -> ViewArrays:
        """Return the cameras in the world and in the objects' frames, and the lights' factors with their rates."""
        shape = (len(views), len(self._profiles))
        factors, rates = np.ones(shape), np.zeros(shape)
        cameras = [views]
        if self.motion:
            state = self.motion.at(views.t_s)
            cameras += [seen_from(views, poses) for poses in state.objects]
            for light, column in enumerate(self._profiles):
                if column is not None:
                    factors[:, light], rates[:, light] = state.factors[:, column], state.rates[:, column]
        if self.baked is not None and len(self.baked.maps.instants) > 1:
            weights, weight_rates = self.baked.at(views.t_s)
            for light, instant in enumerate(self._instants):
                if instant is not None:
                    weight, weight_rate = weights[:, instant], weight_rates[:, instant]
                    rates[:, light] = weight * rates[:, light] + weight_rate * factors[:, light]
                    factors[:, light] *= weight
        return *pose_arrays(cameras), factors.ravel(), rates.ravel()


def _core_of(table: SceneTable, threads: int | None, textures: TextureTable) -> SceneRenderer:
    """Build the core's renderer from a table, with its textures or those that share their texels."""
    return SceneRenderer(
        corners=table.corners.ravel(),
        planes=table.planes.ravel(),
        u_maps=table.u_maps.ravel(),
        v_maps=table.v_maps.ravel(),
        normal_maps=None if table.normal_maps is None else table.normal_maps.ravel(),
        textures=textures.texture_of,
        two_sided=table.two_sided,
        culled=table.culled,
        hidden=table.hidden,
        frames=table.frames,
        frame_count=1 + len(table.moving),
        layouts=textures.framed_sizes.astype(np.int64).ravel(),
        texels=table.core_texels(textures),
        lights=[
            (
                _KINDS.get(light.kind, light.kind),
                light.group,
                light.strength,
                table.background_per_strength(light),
                light.vector.tolist(),
                light.beam,
                light.slide,
            )
            for light in table.lights
        ],
        light_maps=_light_maps(table),
        emissions=None if table.baked is None else (table.baked.emitted, table.emission_lights),
        sky=_sky(table),
        gloss=table.core_gloss(textures),
        normal_textures=table.normal_textures.core(table.textures.sizes),
        slides=[slide.core() for slide in table.slides],
        shadows=table.shadows,
        centre=table.centre.tolist(),
        step=STEP,
        end=END,
        threads=threads,
    )


def _sky(table: SceneTable) -> tuple[int, int, npt.NDArray[np.float32]] | None:
    if table.baked is None or table.baked.sky is None:
        return None
    sky = table.baked.sky
    return table.light_of_group(sky.group), sky.side, sky.texels.ravel()


_Texels = list[CoreChannel]
_VectorMaps = tuple[npt.NDArray[np.int64], list[_Texels]]


def _light_maps(
    table: SceneTable,
) -> tuple[FloatArray, FloatArray, npt.NDArray[np.int64], _Texels, _VectorMaps | None] | None:
    if table.baked is None:
        return None
    (u, v), maps = table.light_map_coordinates(), table.baked.maps
    vectors = (maps.vector_layouts.ravel(), table.irradiance_vectors) if maps.vectors else None
    return u.ravel(), v.ravel(), maps.layouts.ravel(), table.irradiance, vectors
