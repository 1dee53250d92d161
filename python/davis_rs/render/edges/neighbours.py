"""Maps images to images whose pixels depend on their neighbours, and finds the pixels that single ones need."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
import numpy.typing as npt

from ...events.luma import LumaFrames
from ...geometry.camera import Camera

Indices = npt.NDArray[np.int64]

_DENSE = 0.03
"""Where the squares together have this fraction of all pixels of the views, it is cheaper to find the pixels that they
have in common than to render them twice. It was measured for pixels along edges, which is the common case."""


class ImageMap(ABC):
    """A linear map of images, which maps rates of luma in the same way; a frame is mirrored beyond its edge.

    Attributes:
        reach: the largest distance in pixels, in x or y, from which a pixel gets light.
    """

    reach: int

    @abstractmethod
    def frames(self, luma: LumaFrames) -> LumaFrames:
        """Return new frames (n, H, W), float32, from frames (n, H, W); each depends on its own frame only."""

    @abstractmethod
    def pixels(self, squares: LumaFrames, pixel: Indices) -> LumaFrames:
        """Return the bits of :meth:`frames` (m,) at m pixels, given the squares (2 reach + 1, 2 reach + 1, m) there."""


class Neighbours:
    """The squares of pixels within ``reach`` around m pixels, mirrored at the frame's edge.

    Attributes:
        wanted: int64 (2 reach + 1, 2 reach + 1, m), by y and x: view H W + pixel of all in the squares.
        view, pixel: int64, all pixels to render: each once where many pixels are asked for, else whole squares.
    """

    def __init__(self, camera: Camera, views: int, view: Indices, pixel: Indices, reach: int) -> None:
        width, height = camera.width, camera.height
        size = width * height
        y, x = np.divmod(pixel, width)
        around = np.arange(-reach, reach + 1)[:, None]
        rows = view * size + mirrored(y + around, height) * width
        columns = mirrored(x + around, width)
        self.wanted = rows[:, None] + columns[None]
        if self.wanted.size < _DENSE * views * size:
            self._rendered: npt.NDArray[np.int64] | None = None
            self.view, self.pixel = np.divmod(self.wanted.ravel(), size)
        else:
            mask = np.zeros(views * size, np.bool_)
            mask[self.wanted] = True
            self._rendered = np.flatnonzero(mask)
            self.view, self.pixel = np.divmod(self._rendered, size)
        self._size = views * size

    def squares(self, luma: LumaFrames) -> LumaFrames:
        """Return luma in the squares (2 reach + 1, 2 reach + 1, m), by y and x, from luma of the rendered pixels."""
        if self._rendered is None:
            return luma.reshape(self.wanted.shape)
        frames = np.empty(self._size, np.float32)
        frames[self._rendered] = luma
        return frames[self.wanted]


def mirrored(i: Indices, size: int) -> Indices:
    """Return indices mirrored into 0..size - 1 at both ends, which are not repeated; all 0 where the size is 1."""
    if size == 1:
        return np.zeros_like(i)
    last = size - 1
    return last - np.abs(last - np.abs(i) % (2 * last))
