"""Defines the interface of all renderers: views in; luma, its rates, single pixels, depth and optical flow out."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from functools import cached_property, partial

import numpy as np
import numpy.typing as npt

from ..events.luma import LumaFrames, blur_3x3, blur_neighbourhoods
from ..geometry.camera import Camera
from ..geometry.lattice import rank1_lattice
from ..geometry.pose import FloatArray
from ..geometry.trajectory.views import Views
from .edges.neighbours import ImageMap, Neighbours
from .edges.swept_objects import MovingSilhouettes
from .flow import OpticalFlow
from .motion.scene_motion import STILL, SceneMotion, seen_from
from .rate_difference import rate_by_differences
from .rays.camera_rays import pixel_centres

Indices = npt.NDArray[np.int64]


Launched = Callable[[], tuple[LumaFrames, LumaFrames | None]]
"""A function that waits for frames being rendered, and returns them, and their rates where they were asked for."""


class Renderer(ABC):
    """Renders a scene through a camera's own rays, so that images match its calibration and distortion.

    Each pixel averages ``rays`` rays of a fixed lattice over its square; depth and flow are those of the ray through
    its centre. The same view gives the same bits, whatever is rendered before it, with it or after it.
    """

    name: str
    """The renderer's name, for messages."""

    reason: str
    """Why this renderer was chosen, for messages."""

    variant: str
    """The Mitsuba variant."""

    poses_per_launch: int
    """How many views are best rendered in one call."""

    concurrent: bool = False
    """Whether several threads may call the renderer at once."""

    pixel: str = "rays"
    """What luma of a pixel is made of: ``rays`` or ``lines``, in place of so many rays."""

    culls_backs: bool = False
    """Whether one sees through the backs of one-sided shapes, see :attr:`Scene.one_sided`."""

    motion: SceneMotion
    """What moves and flickers in the scene, as a function of the views' times."""

    def __init__(self, camera: Camera, *, rays_per_pixel: int, blur: bool, motion: SceneMotion = STILL) -> None:
        self.camera, self.rays_per_pixel, self.blur, self.motion = camera, rays_per_pixel, blur, motion

    silhouettes: MovingSilhouettes | None = None
    """The edges of the geometry; None unless they were asked for."""

    optics: ImageMap | None = None
    """What the lens does to luma and its rates, after the blur; None for a perfect lens."""

    @property
    def ray_bytes(self) -> float:
        """Return bytes of memory per pixel that its rays take, in kept tables or while all pixels are rendered at
        once."""
        return 16.0 * self.rays_per_pixel

    @property
    def reach_px(self) -> int:
        """Return the largest distance in pixels, in x or y, from which blur and lens bring light to a pixel."""
        return int(self.blur) + (0 if self.optics is None else self.optics.reach)

    def luma(self, views: Views) -> LumaFrames:
        """Return linear luma (n, H, W), float32, of n views."""
        return self.begin_luma(views)()[0]

    def begin_luma(self, views: Views) -> Launched:
        """Begin to render :meth:`luma`; a call of the result waits for the frames and returns (luma, None)."""
        frames = self._begin_luma(views) if len(views) else partial(self._blank, views)
        return lambda: (self._finished(frames()), None)

    def begin_luma_and_rate(self, views: Views) -> Launched:
        """Do as :meth:`begin_luma`, for :meth:`luma_and_rate`; it renders before it returns."""
        both = self.luma_and_rate(views)
        return lambda: both

    def luma_and_rate(self, views: Views) -> tuple[LumaFrames, LumaFrames]:
        """Return :meth:`luma`, and dY/dt in luma per second at each instant, (n, H, W), float32.

        The rate counts the motion of the camera and of all objects, and the change of the lights. It is the rate of
        the surfaces that the rays hit, with shading and texture. It leaves out what appears, vanishes or passes into
        shadow, because at the edges of surfaces and shadows true luma changes in another way. The native renderer and
        the table kernel differentiate, and inside surfaces are as exact as float32; the others take differences over
        0.04 pixels of motion, with the same random numbers, good to about 1 %.
        """
        frames, rates = self._luma_and_rate(views) if len(views) else (self._blank(views), self._blank(views))
        return self._finished(frames), self._finished(rates)

    def samples(
        self, views: Views, view: npt.ArrayLike, pixel: npt.ArrayLike, *, rays: int | None = None
    ) -> LumaFrames:
        """Return luma (m,), float32, of m single pixels: the bits of ``luma(views)[view, y, x]``.

        Args:
            view: (m,) which of the views.
            pixel: (m,) which pixel, y W + x.
            rays: how many lattice rays a pixel; None means the renderer's own.

        Raises:
            ValueError: for indices of another shape or out of range, or ``rays`` outside of 1..1024.
        """
        size = self.camera.width * self.camera.height
        view, pixel = _indices("view", view, len(views)), _indices("pixel", pixel, size)
        if view.shape != pixel.shape:
            raise ValueError(f"view and pixel must be of one length, got {len(view)} and {len(pixel)}")
        rays = self.rays_per_pixel if rays is None else rays
        rank1_lattice(rays)  # refuses bad numbers
        if len(view) == 0:
            return np.empty(0, np.float32)
        if self.reach_px:
            neighbours = Neighbours(self.camera, len(views), view, pixel, self.reach_px)
            squares = neighbours.squares(self._samples(views, neighbours.view, neighbours.pixel, rays))
        else:
            squares = self._samples(views, view, pixel, rays).reshape(1, 1, -1)
        return self._composed(squares, pixel)

    def _composed(self, squares: LumaFrames, pixel: Indices) -> LumaFrames:
        """Apply the blur and the lens to the squares around pixels."""
        if self.blur:
            squares = blur_neighbourhoods(squares)
        return squares[0, 0] if self.optics is None else self.optics.pixels(squares, pixel)

    def depth(self, views: Views) -> npt.NDArray[np.float32]:
        """Return depth (n, H, W), float32: z along the optical axis in metres; inf where a ray hits nothing."""
        return self._depth(views) if len(views) else self._blank(views)

    def nearest_distance(self, point: FloatArray) -> float:
        """Return a distance in metres from a point (3,) of the world, within which no surface that stands still lies.

        It is 0 where the renderer does not know it, and inf where nothing stands still.
        """
        return 0.0

    def depths_in_parts(self, views: Views, parts: FloatArray) -> FloatArray:
        """Return the least and the largest depth of what may be seen in parts of the image.

        Args:
            parts: (m, 2, 2), of rays (x, y, 1) in camera axes the lowest x and y, and the highest.

        Returns:
            Depths (n, m, 2) in metres of all surfaces there, whatever hides them. NaN where surely nothing is seen but
            a background of one luma; inf where the renderer does not know it, or where the background has a pattern.
        """
        return np.full((len(views), len(parts), 2), np.inf)

    def flow(self, views: Views) -> npt.NDArray[np.float32]:
        """Return optical flow (n, H, W, 2), float32, in pixels/s (x right, y down); NaN where a ray hits nothing.

        It is the motion in the image, through the lens, of the surface point that the pixel's centre sees: by the
        camera's motion, and by its own. On meshes that deform Mitsuba's integrators give a bound on its length.
        """
        depth = self.depth(views)
        flows = np.empty((*depth.shape, 2), np.float32)
        for flow, z, exact in zip(flows, depth, self._flows(views, depth), strict=True):
            flow[:] = exact.reshape(flow.shape)
            flow[np.isinf(z)] = np.nan
        return flows

    def _flows(self, views: Views, depth: npt.NDArray[np.float32]) -> Iterator[FloatArray]:
        """Yield flow (H * W, 2) of each view; where depth is inf, the flow that the camera's rotation makes."""
        poses: tuple[Views, ...] = ()
        if self.motion.objects and len(views):
            poses = self.motion.at(views.t_s).objects
        owners = self._owners(views) if poses else None
        for i, depths in enumerate(depth):
            view, z = views[i : i + 1], depths.reshape(1, -1)
            flow = self._centre_flow(view, z)[0]
            for number, (name, pose) in enumerate(zip(self.motion.objects, poses, strict=True), 1):
                assert owners is not None
                seen = np.flatnonzero(owners[i].ravel() == number)
                if len(seen):
                    flow[seen] = self._centre_flow(seen_from(view, pose[i : i + 1]), z)[0][seen]
                if len(seen) and name in self.motion.deformations:
                    flow[seen] = self._deforming_flow(number, view, seen, z[0, seen], flow[seen])
            yield flow

    def _deforming_flow(
        self, number: int, view: Views, pixel: Indices, depth: npt.NDArray[np.float32], flow: FloatArray
    ) -> FloatArray:
        """Return flow (m, 2) of pixels that see a mesh that deforms, given that of the mesh as if it were rigid.

        Where it is not known which triangle a pixel sees, it is longer by the speed of the mesh's fastest point.
        """
        deformation = self.motion.deformations[list(self.motion.objects)[number - 1]]
        speed = self._centre_flow.fastest_of_motion(pixel, float(deformation.fastest(view.t_s)[0]), depth)[:, None]
        length = np.linalg.norm(flow, axis=1, keepdims=True)
        ahead = np.divide(flow, length, out=np.tile([1.0, 0.0], (len(flow), 1)), where=length > 0)
        return np.asarray(flow + speed * ahead)

    @cached_property
    def _centre_flow(self) -> OpticalFlow:
        return OpticalFlow(self.camera, pixel_centres(self.camera))

    def _finished(self, frames: LumaFrames) -> LumaFrames:
        """Apply the blur and the lens to rendered frames, or to their rates: both are linear."""
        blurred = blur_3x3(frames) if self.blur else frames
        return blurred if self.optics is None else self.optics.frames(blurred)

    def _blank(self, views: Views) -> npt.NDArray[np.float32]:
        return np.empty((len(views), self.camera.height, self.camera.width), np.float32)

    # What a renderer implements, for at least one view or pixel, before the blur and the lens.

    @abstractmethod
    def _luma(self, views: Views) -> LumaFrames: ...

    def _begin_luma(self, views: Views) -> Callable[[], LumaFrames]:
        """Begin to render :meth:`_luma`, in parallel with other work if the renderer can do that."""
        frames = self._luma(views)
        return lambda: frames

    @abstractmethod
    def _samples(self, views: Views, view: Indices, pixel: Indices, rays: int) -> LumaFrames: ...

    @abstractmethod
    def _depth(self, views: Views) -> npt.NDArray[np.float32]: ...

    def _owners(self, views: Views) -> npt.NDArray[np.uint32]:
        """Return what each pixel's centre sees, (n, H, W): object 1, 2, ... of ``motion``, or 0 for all else."""
        return np.zeros((len(views), self.camera.height, self.camera.width), np.uint32)

    def _luma_and_rate(self, views: Views) -> tuple[LumaFrames, LumaFrames]:
        # What is infinitely far counts too: it may be a background, which moves in the image when the camera rotates.
        depths = (self.depth(views[i : i + 1]) for i in range(len(views)))
        flows = (flow for i, depth in enumerate(depths) for flow in self._flows(views[i : i + 1], depth))
        speeds = np.array([np.linalg.norm(flow, axis=-1).max() for flow in flows])
        return rate_by_differences(partial(self._luma_after, views), speeds)

    def _luma_after(self, views: Views, step_s: FloatArray) -> LumaFrames:
        """Return luma a short time (n,) after each view, when all has moved on at constant rates."""
        return self._luma(views.moved(step_s))


def _indices(name: str, values: npt.ArrayLike, size: int) -> Indices:
    array = np.asarray(values)
    if array.size == 0:
        array = array.astype(np.int64)
    if array.ndim != 1 or array.dtype.kind not in "iu":
        raise ValueError(f"{name} must be whole numbers of shape (m,), got {array.dtype} of shape {array.shape}")
    if array.size and not (array.min() >= 0 and array.max() < size):
        wrong = array[(array < 0) | (array >= size)][0]
        raise ValueError(f"{name} must lie in 0..{size - 1}, got {wrong}")
    return array.astype(np.int64, copy=False)
