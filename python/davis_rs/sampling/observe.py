"""Observes a simulation without changing it: counts its rays, and records the log luma that it assumes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from ..geometry.pose import FloatArray
from ..geometry.trajectory.views import Views
from ..render.base import Indices, Renderer
from .interpolate import interpolated
from .keyframes import Keyframe, Stretch
from .rules import TimeSampling


class LumaRecorder(TimeSampling):
    """Passes on another rule's keyframes, counts them, and records log luma at some instants.

    Attributes:
        keyframe_count: so far.
        log: log luma (H, W), float64, as interpolated, at each instant so far.

    Args:
        rule: which decides.
        instants_us: increasing.
    """

    def __init__(self, rule: TimeSampling, instants_us: npt.NDArray[np.int64], log_eps: float) -> None:
        self._rule, self._instants_us, self._log_eps = rule, instants_us, log_eps
        self.keyframe_count, self.log = 0, list[FloatArray]()

    @property
    def interpolation(self) -> str:
        return self._rule.interpolation

    @property
    def edges(self) -> bool:  # type: ignore[override]
        return self._rule.edges

    def keyframes(self, stretch: Stretch) -> Iterator[Keyframe]:
        for keyframe, log in interpolated(self._rule.keyframes(stretch), self._instants_us, self._log_eps):
            self.keyframe_count += 1
            self.log += log
            yield keyframe


class CountedRenderer(Renderer):
    """Counts another renderer's rays to surfaces, without shadow rays; luma and its rate share their rays.

    Attributes:
        count: rays so far.
    """

    def __init__(self, renderer: Renderer) -> None:
        super().__init__(
            renderer.camera, rays_per_pixel=renderer.rays_per_pixel, blur=renderer.blur, motion=renderer.motion
        )
        self.silhouettes, self.optics = renderer.silhouettes, renderer.optics
        self.name, self.reason, self.variant = renderer.name, renderer.reason, renderer.variant
        self.pixel = renderer.pixel
        self.poses_per_launch = renderer.poses_per_launch
        self._renderer, self._pixels = renderer, renderer.camera.width * renderer.camera.height
        self.count = 0

    def _owners(self, views: Views) -> npt.NDArray[np.uint32]:
        return self._renderer._owners(views)

    def _depth(self, views: Views) -> npt.NDArray[np.float32]:
        self.count += len(views) * self._pixels
        return self._renderer._depth(views)

    def _luma(self, views: Views) -> npt.NDArray[np.float32]:
        self.count += len(views) * self._pixels * self.rays_per_pixel
        return self._renderer._luma(views)

    def _luma_and_rate(self, views: Views) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        self.count += len(views) * self._pixels * self.rays_per_pixel
        return self._renderer._luma_and_rate(views)

    def _samples(self, views: Views, view: Indices, pixel: Indices, rays: int) -> npt.NDArray[np.float32]:
        self.count += len(pixel) * rays
        return self._renderer._samples(views, view, pixel, rays)
