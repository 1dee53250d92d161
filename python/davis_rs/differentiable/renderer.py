"""Renders luma in Dr.Jit as a differentiable function of camera poses, textures and lights."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from .._mitsuba.types import JitFloat, JitTensor, TensorLike
from .._mitsuba.variants import FAST, default_variant, load_scene_source, variant
from .._util.argument_error import ArgumentError
from .._util.former_names import FormerAttribute, takes_former_names
from ..geometry.camera import Camera
from ..render.diffuse_materials import simplify_materials
from ..render.motion.scene_updates import scene_motion
from ..render.obstacles import Unsuitable
from ..render.rays.camera_rays import CameraRays, Lanes
from ..render.scene_tables.scene_table import SceneTable
from ..scene.scene import Scene, check_scene
from .frame_edges import FrameEdges
from .kernel import DifferentiableKernel
from .poses import CameraPoses, spline
from .scene_at import SceneAt

__all__ = ["CameraPoses", "DifferentiableRenderer", "spline"]

_PACKET = 16


class DifferentiableRenderer:
    """Renders linear luma of a diffuse scene, attached to Dr.Jit's graph: forward and reverse mode go through it.

    It is the table kernel on the table renderer's rays: frames are those of ``make_renderer(..., kind="table")``.
    Derivatives are exact inside surfaces, for the rays that are traced. Derivatives by the poses also have the part of
    edges, where the edge of a surface or of a shadow moves over a pixel, for the mean over the whole pixel. It is found
    from the rays next to the edge: more rays make it more exact (docs/differentiable.md has the figures). Derivatives
    by the parameters take as fixed which surface a ray meets and whether a light is hidden from it, so that a shadow
    that moves with its light adds nothing at its edge.

    Args:
        rays_per_pixel: rays a pixel.
        blur: the 3 x 3 blur of luma; None leaves it to the scene.
        edges: False leaves out the part of edges: poses then have derivatives of the surfaces alone. It costs nothing
            where poses need no derivatives.

    Raises:
        ValueError: if the table kernel cannot render the scene (the message says what in it is not a diffuse mesh
            under point, directional and constant light), for ``rays_per_pixel`` outside of 1..1024, or without
            ``llvm_ad_rgb``.
        OSError: if a scene file cannot be read.
    """

    samples = FormerAttribute("rays_per_pixel")

    @takes_former_names(samples="rays_per_pixel")
    def __init__(
        self,
        scene: Scene,
        camera: Camera | None = None,
        *,
        rays_per_pixel: int = 4,
        blur: bool | None = None,
        edges: bool = True,
    ) -> None:
        check_scene(scene)
        self.camera = scene.own_camera if camera is None else camera
        self.rays_per_pixel, self.blur = rays_per_pixel, scene.blur if blur is None else blur
        variant_name, why = default_variant()
        if variant_name != FAST:
            raise ValueError(f"derivatives need Mitsuba's {FAST} variant: {why}")
        self._rays = CameraRays(self.camera)
        self._rays.prepare(rays_per_pixel)
        with variant(FAST) as (mi, _):
            loaded = load_scene_source(scene.source(), mi)
            simplify_materials(loaded, mi, matte=scene.matte)
            self._motion = scene_motion(scene, loaded, mi)
            if self._motion.deformations:
                raise ValueError(f"derivatives need rigid meshes, and {next(iter(scene.deformations))!r} deforms")
            try:
                table = SceneTable(
                    loaded, mi, shadows=scene.shadows, any_integrator=True, moving=list(self._motion.objects)
                )
            except Unsuitable as unsuitable:
                raise ValueError(f"derivatives need the table kernel, which cannot render this: {unsuitable}") from None
            self._kernel = DifferentiableKernel(table, mi)
        self._table = table
        self._edges = FrameEdges(table, self.camera, rays_per_pixel, self._motion) if edges else None

    @property
    def parameters(self) -> dict[str, JitTensor]:
        """Return what :meth:`luma` can replace, each a new ``mi.TensorXf`` with the scene's own value.

        For each shape ``<id>.reflectance`` (H, W, 3): its texels, linear RGB; (1, 1, 3) for a shape of one colour. For
        each light ``<id>.intensity`` (point, W/sr), ``<id>.irradiance`` (directional, W/m^2) or ``<id>.radiance``
        (constant), (1,), in its strongest channel: the light's colour stays. ``<id>.position`` (3,) of a point light,
        metres, and ``<id>.direction`` (3,) of a directional one: where its light travels, of any length.
        """
        with variant(FAST):
            return self._kernel.parameters()

    def luma(
        self,
        poses: CameraPoses,
        parameters: Mapping[str, TensorLike] | None = None,
        *,
        t_s: npt.ArrayLike | None = None,
    ) -> JitTensor:
        """Return linear luma of n poses, a ``mi.TensorXf`` (n, H, W), attached to the poses and the parameters.

        All rays of all poses are traced at once: with no loop in it, reverse mode needs no more than the memory of
        n H W samples numbers, a few times over. ``dr.backward`` after each of several batches adds up the gradients.

        Args:
            parameters: replacements by their names in :attr:`parameters`: Dr.Jit arrays, or anything that NumPy takes.
                A reflectance may also be (H, W), the same in all channels.
            t_s: when each pose is taken, (n,) seconds of the scene's time, or one number for all. It says where objects
                are and how strong lights are; a scene in which nothing changes does not need it.

        Raises:
            ValueError: without ``t_s`` if objects move or lights change, and for another shape of it; for a name that
                the scene does not have, a value of another shape, or 2^32 rays or more; with ``edges`` and poses that
                need derivatives, for another position or direction of a light that throws shadows, because the edges of
                shadows are found for the scene's own.
        """
        with variant(FAST) as (mi, dr):
            times = self._times(len(poses), t_s)
            scene_at = SceneAt(self._motion, self._table, times)
            kernel = self._kernel.replaced(parameters or {})
            count, pixels, (height, width) = len(poses), self._rays.pixels, (self.camera.height, self.camera.width)
            # Whole ray packets of one sample and view, as in the table renderer, so that the bits are the same.
            padded = -(-pixels // _PACKET) * _PACKET
            lanes = count * padded
            if lanes * self.rays_per_pixel >= 1 << 32:
                raise ValueError(f"poses x pixels x samples must stay below 2^32, got {lanes * self.rays_per_pixel}")
            lane = dr.arange(mi.UInt32, lanes * self.rays_per_pixel)
            sample, lane = lane // lanes, lane % lanes
            view, pixel = lane // padded, dr.minimum(lane % padded, pixels - 1)
            cameras = poses.gather(view)
            ray = self._rays.ray(Lanes(pixel, cameras.positions, cameras.rotations, None), sample, self.rays_per_pixel)
            luma = kernel.luma(ray, scene_at.around(ray, view))
            pixel = dr.arange(mi.UInt32, count * pixels)
            first = pixel // pixels * padded + pixel % pixels
            frames = dr.zeros(mi.Float, count * pixels)
            for number in range(self.rays_per_pixel):
                frames += dr.gather(mi.Float, luma, first + number * lanes)
            frames /= self.rays_per_pixel
            if self._edges is not None and dr.grad_enabled(poses.positions, poses.rotations):
                moved = self._kernel.moved_lights(parameters or {}) if self._table.shadows else []
                if moved:
                    raise ValueError(
                        f"derivatives by the poses have the edges of shadows of the scene's own lights, so {moved[0]} "
                        "cannot be replaced; edges=False leaves edges out"
                    )
                frames += self._edges.attached_zero(poses, times, kernel)
            if self.blur:
                frames = _blur_along(_blur_along(frames, height, width), width, 1)
            return mi.TensorXf(frames, (count, height, width))

    def _times(self, count: int, t_s: npt.ArrayLike | None) -> npt.NDArray[np.float64]:
        if t_s is None and self._motion:
            changing = ", ".join([*self._motion.objects, *self._motion.lights])
            raise ArgumentError("{t_s} must say when each pose is taken, because {} changes with time", changing)
        times = np.asarray(0.0 if t_s is None else t_s, np.float64)
        if times.shape not in ((), (count,)):
            raise ArgumentError("{t_s} of {} poses must have shape ({},), got {}", count, count, times.shape)
        return np.broadcast_to(times, (count,))


def _blur_along(luma: JitFloat, size: int, stride: int) -> JitFloat:
    """Apply one of the two passes of :func:`davis_rs.events.luma.blur_3x3`: along ``size`` pixels, ``stride`` apart."""
    import drjit as dr
    import mitsuba as mi

    if size == 1:
        return luma
    pixel = dr.arange(mi.UInt32, dr.width(luma))
    position = pixel // stride % size
    before = dr.select(position == 0, pixel + stride, pixel - stride)
    after = dr.select(position == size - 1, pixel - stride, pixel + stride)
    return 0.5 * luma + 0.25 * (dr.gather(mi.Float, luma, before) + dr.gather(mi.Float, luma, after))
