"""Estimates luma of pixels in the Rust core: as a mean over rays, or as the integral over a pixel's area by lines."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
import numpy.typing as npt

from ..._core import PixelRays, SceneRenderer
from ..._util.argument_error import ArgumentError
from ...geometry.camera import Camera
from ...geometry.lattice import rank1_lattice
from ...geometry.pose import FloatArray
from ..base import Indices
from ..rays.camera_rays import pixel_corners, pixel_rays

LINES = {8: 4, 32: 8, 64: 16, 256: 64}
"""How many lines a pixel has in place of so many rays: they are shaded at about as many taps."""

ViewArrays = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]
"""Cameras and lights as the core takes them."""

FlatLuma = npt.NDArray[np.float32]
"""Luma of frames, row by row, one view after the other; or of single pixels."""


class PixelEstimator(ABC):
    """Estimates luma of a camera's pixels.

    Args:
        camera: whose pixels they are.
        rays: how many rays a pixel has, or how many its lines stand for.
    """

    def __init__(self, camera: Camera, rays: int) -> None:
        rank1_lattice(rays)  # refuses bad numbers
        self.camera, self.rays = camera, rays

    @abstractmethod
    def luma(self, core: SceneRenderer, views: ViewArrays) -> FlatLuma:
        """Return luma of whole frames."""

    @abstractmethod
    def luma_and_rate(self, core: SceneRenderer, views: ViewArrays) -> tuple[FlatLuma, FlatLuma] | None:
        """Return luma of whole frames with its rate per second; None where the rate has no closed form."""

    @abstractmethod
    def samples(self, core: SceneRenderer, views: ViewArrays, view: Indices, pixel: Indices, rays: int) -> FlatLuma:
        """Return luma of single pixels (m,), the bits of :meth:`luma` where ``rays`` are the estimator's own.

        Raises:
            ValueError: where it cannot be estimated by another number of rays.
        """

    @abstractmethod
    def known_rays(self) -> PixelRays:
        """Return the rays, for what is known of single rays alone.

        Raises:
            ValueError: where there are none.
        """


class RayEstimator(PixelEstimator):
    """Takes the mean over the rays of a lattice."""

    def luma(self, core: SceneRenderer, views: ViewArrays) -> FlatLuma:
        return core.luma(self.known_rays(), views)[0]

    def luma_and_rate(self, core: SceneRenderer, views: ViewArrays) -> tuple[FlatLuma, FlatLuma]:
        luma, rate = core.luma(self.known_rays(), views, rate=True)
        assert rate is not None
        return luma, rate

    def samples(self, core: SceneRenderer, views: ViewArrays, view: Indices, pixel: Indices, rays: int) -> FlatLuma:
        return core.samples(pixel_rays(self.camera, rays), views, view, pixel)

    def known_rays(self) -> PixelRays:
        return pixel_rays(self.camera, self.rays)


class LineEstimator(PixelEstimator):
    """Takes the integral over a pixel's area along lines, on which edges are known.

    Raises:
        ValueError: for another number of rays than :data:`LINES` has.
    """

    def __init__(self, camera: Camera, rays: int) -> None:
        super().__init__(camera, rays)
        if rays not in LINES:
            raise ArgumentError("{pixel:lines} takes {rays_per_pixel} {}, got {}", ", ".join(map(str, LINES)), rays)
        self._lines = LINES[rays]

    def luma(self, core: SceneRenderer, views: ViewArrays) -> FlatLuma:
        return core.line_luma(pixel_corners(self.camera), self._lines, views)

    def luma_and_rate(self, core: SceneRenderer, views: ViewArrays) -> None:
        return None

    def samples(self, core: SceneRenderer, views: ViewArrays, view: Indices, pixel: Indices, rays: int) -> FlatLuma:
        if rays != self.rays:
            raise ValueError(f"lines take the place of {self.rays} rays a pixel, got {rays}")
        view, pixel = view.astype(np.uint32), pixel.astype(np.uint32)
        return core.line_samples(pixel_corners(self.camera), self._lines, views, view, pixel)

    def known_rays(self) -> PixelRays:
        raise ArgumentError("what single rays see and derivatives need {pixel:rays}, got {pixel:lines}")


ESTIMATORS: dict[str, type[PixelEstimator]] = {"rays": RayEstimator, "lines": LineEstimator}
"""By what luma of a pixel is made of."""
