"""Renders what pixels behind colour filters see: each pixel of a mosaic is that of the renderer of its colour."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np
import numpy.typing as npt

from ..events.luma import LumaFrames
from ..geometry.pose import FloatArray
from ..geometry.trajectory.views import Views
from .base import Indices, Launched, Renderer
from .edges.neighbours import ImageMap


class MosaicRenderer(Renderer):
    """Renders through a renderer for each of three colours, and takes each pixel from that of its filter.

    Blur and lens act on the light of each colour before the filters, as in a camera. It costs three times as much as
    one renderer.

    Args:
        channels: renderers of the same scene and lens, whose luma is the light that passes the red, the green and the
            blue filter.
        numbers: uint8 (H, W), which of them each pixel takes.
    """

    def __init__(self, channels: Sequence[Renderer], numbers: npt.NDArray[np.uint8]) -> None:
        first = channels[0]
        super().__init__(first.camera, rays_per_pixel=first.rays_per_pixel, blur=first.blur, motion=first.motion)
        self._channels, self._numbers = list(channels), numbers
        self.name, self.variant, self.pixel = first.name, first.variant, first.pixel
        self.reason = f"{first.reason}; for each of three colours"
        self.poses_per_launch, self.concurrent = first.poses_per_launch, first.concurrent
        self.silhouettes = first.silhouettes
        for channel in channels[1:]:
            channel.motion = first.motion  # what a caller moves, moves for all

    @property
    def optics(self) -> ImageMap | None:
        """Return what the lens does to the light of each colour."""
        return self._channels[0].optics

    @optics.setter
    def optics(self, optics: ImageMap | None) -> None:
        self._channels = [copy(channel) for channel in self._channels]
        for channel in self._channels:
            channel.optics = optics

    @property
    def ray_bytes(self) -> float:
        return sum(channel.ray_bytes for channel in self._channels)

    def nearest_distance(self, point: FloatArray) -> float:
        return self._channels[0].nearest_distance(point)

    def depths_in_parts(self, views: Views, parts: FloatArray) -> FloatArray:
        return self._channels[0].depths_in_parts(views, parts)

    def begin_luma(self, views: Views) -> Launched:
        launched = [channel.begin_luma(views) for channel in self._channels]
        return lambda: (self._picked([wait()[0] for wait in launched]), None)

    def luma_and_rate(self, views: Views) -> tuple[LumaFrames, LumaFrames]:
        luma, rate = zip(*(channel.luma_and_rate(views) for channel in self._channels), strict=True)
        return self._picked(luma), self._picked(rate)

    def samples(
        self, views: Views, view: npt.ArrayLike, pixel: npt.ArrayLike, *, rays: int | None = None
    ) -> LumaFrames:
        view, pixel = np.asarray(view), np.asarray(pixel)
        if not len(pixel):
            return self._channels[0].samples(views, view, pixel, rays=rays)
        luma = np.empty(len(pixel), np.float32)
        numbers = self._numbers.ravel()[np.clip(pixel, 0, self._numbers.size - 1)]
        for number, channel in enumerate(self._channels):
            own = numbers == number
            if own.any():
                luma[own] = channel.samples(views, view[own], pixel[own], rays=rays)
        return luma

    def depth(self, views: Views) -> npt.NDArray[np.float32]:
        return self._channels[0].depth(views)

    def flow(self, views: Views) -> npt.NDArray[np.float32]:
        return self._channels[0].flow(views)

    def _luma(self, views: Views) -> LumaFrames:
        return self._picked([channel._luma(views) for channel in self._channels])

    def _samples(self, views: Views, view: Indices, pixel: Indices, rays: int) -> LumaFrames:
        return self.samples(views, view, pixel, rays=rays)

    def _depth(self, views: Views) -> npt.NDArray[np.float32]:
        return self._channels[0]._depth(views)

    def _picked(self, frames: Sequence[LumaFrames]) -> LumaFrames:
        """Take each pixel from the frames of its colour."""
        return np.where(self._numbers == 0, frames[0], np.where(self._numbers == 1, frames[1], frames[2]))
