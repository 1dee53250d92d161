"""The renderer: views in; frames of linear luma, their rates, single pixels, depth maps and optical flow out."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property

import numpy as np
import numpy.typing as npt

from .camera import Camera
from .camera_rays import pixel_centres
from .flow import OpticalFlow
from .lattice import rank1_lattice
from .luma import LumaFrames, blur_3x3
from .neighbours import Neighbours
from .rate_difference import rate_by_differences
from .views import Views

Indices = npt.NDArray[np.int64]


class Renderer(ABC):
    """Renders a scene through a camera's own rays, so that images match its calibration and distortion.

    Each pixel averages ``rays`` rays of a fixed lattice over its square; depth and flow are those of the ray through
    its centre. The same view gives the same bits, whatever is rendered before, beside or after it.
    """

    name: str
    """What renders, for people."""

    reason: str
    """Why it was chosen, for people."""

    variant: str
    """The Mitsuba variant."""

    poses_per_launch: int
    """How many views are best rendered in one call."""

    def __init__(self, camera: Camera, *, samples: int, blur: bool) -> None:
        self.camera, self.rays, self.blur = camera, samples, blur

    def luma(self, views: Views) -> LumaFrames:
        """Linear luma (n, H, W), float32, of n views."""
        frames = self._luma(views) if len(views) else self._blank(views)
        return blur_3x3(frames) if self.blur else frames

    def luma_and_rate(self, views: Views) -> tuple[LumaFrames, LumaFrames]:
        """:meth:`luma`, and dY/dt in luma per second at each instant, (n, H, W), float32.

        The rate is total: of the camera's translation and rotation. It is that of the surfaces which the rays hit,
        shading and texture included. What appears, vanishes or passes into shadow as the camera moves is not in it: at
        the edges of surfaces and shadows the true luma changes otherwise. The table kernel differentiates, and inside
        surfaces is as exact as float32; the others take differences over 0.04 pixels of motion, with the same random
        numbers, good to about 1 %.
        """
        frames, rates = self._luma_and_rate(views) if len(views) else (self._blank(views), self._blank(views))
        return (blur_3x3(frames), blur_3x3(rates)) if self.blur else (frames, rates)

    def samples(
        self, views: Views, view: npt.ArrayLike, pixel: npt.ArrayLike, *, rays: int | None = None
    ) -> LumaFrames:
        """Luma (m,), float32, of m single pixels: the bits of ``luma(views)[view, y, x]``, without the rest.

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
        rays = self.rays if rays is None else rays
        rank1_lattice(rays)  # refuses bad numbers
        if len(view) == 0:
            return np.empty(0, np.float32)
        if not self.blur:
            return self._samples(views, view, pixel, rays)
        neighbours = Neighbours(self.camera, len(views), view, pixel)
        return neighbours.blur(self._samples(views, neighbours.view, neighbours.pixel, rays))

    def depth(self, views: Views) -> npt.NDArray[np.float32]:
        """Depth (n, H, W), float32: z along the optical axis in metres; inf where a ray hits nothing."""
        return self._depth(views) if len(views) else self._blank(views)

    def flow(self, views: Views) -> npt.NDArray[np.float32]:
        """Optical flow (n, H, W, 2), float32, in pixels per second (x right, y down); NaN where a ray hits nothing.

        It is the motion in the image, through the lens, of the surface point that the pixel's centre sees.
        """
        depth = self.depth(views)
        flows = np.empty((*depth.shape, 2), np.float32)
        for i, (flow, z) in enumerate(zip(flows, depth, strict=True)):
            flow[:] = self._centre_flow(views[i : i + 1], z.reshape(1, -1)).reshape(flow.shape)
            flow[np.isinf(z)] = np.nan
        return flows

    @cached_property
    def _centre_flow(self) -> OpticalFlow:
        return OpticalFlow(self.camera, pixel_centres(self.camera))

    def _blank(self, views: Views) -> npt.NDArray[np.float32]:
        return np.empty((len(views), self.camera.height, self.camera.width), np.float32)

    # What an implementation gives, for at least one view or pixel, before the blur.

    @abstractmethod
    def _luma(self, views: Views) -> LumaFrames: ...

    @abstractmethod
    def _samples(self, views: Views, view: Indices, pixel: Indices, rays: int) -> LumaFrames: ...

    @abstractmethod
    def _depth(self, views: Views) -> npt.NDArray[np.float32]: ...

    def _luma_and_rate(self, views: Views) -> tuple[LumaFrames, LumaFrames]:
        # What is infinitely far counts too: it may be a background that a rotation carries past.
        flow = (
            self._centre_flow(views[i : i + 1], self.depth(views[i : i + 1]).reshape(1, -1)) for i in range(len(views))
        )
        speeds = np.array([np.linalg.norm(f, axis=-1).max() for f in flow])
        return rate_by_differences(self._luma, views, speeds)


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
