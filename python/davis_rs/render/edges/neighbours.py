"""Images whose pixels take from their neighbours, and what must be rendered so that single ones can be had."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
import numpy.typing as npt

from ...events.luma import LumaFrames
from ...geometry.camera import Camera

Indices = npt.NDArray[np.int64]

_FEWEST_A_VIEW = 0.03
"""Where the squares together have this share of all pixels of the views, finding what they share costs less than
rendering it twice: measured for pixels along edges, which are what is asked for; scattered ones share little, and lose
little."""


class ImageMap(ABC):
    """A linear map of images, so that rates of luma are mapped alike; beyond its edge a frame is mirrored.

    Attributes:
        reach: how many pixels away, in x or y, the farthest pixel lies that a pixel takes from.
    """

    reach: int

    @abstractmethod
    def frames(self, luma: LumaFrames) -> LumaFrames:
        """Return new frames (n, H, W), float32, of frames (n, H, W); each as if it were alone."""

    @abstractmethod
    def pixels(self, squares: LumaFrames, pixel: Indices) -> LumaFrames:
        """Return the bits of :meth:`frames` (m,) at m pixels, given the squares (2 reach + 1, 2 reach + 1, m) there."""


class Neighbours:
    """The squares of pixels within ``reach`` around m pixels, mirrored at the frame's edge.

    Attributes:
        wanted: int64 (2 reach + 1, 2 reach + 1, m), by y and x: view H W + pixel of all in the squares.
        view, pixel: int64, all pixels to render: each once where many of a view are asked for, else a square for each.
    """

    def __init__(self, camera: Camera, views: int, view: Indices, pixel: Indices, reach: int) -> None:
        width, height = camera.width, camera.height
        size = width * height
        y, x = np.divmod(pixel, width)
        around = np.arange(-reach, reach + 1)[:, None]
        rows = view * size + mirrored(y + around, height) * width
        columns = mirrored(x + around, width)
        self.wanted = rows[:, None] + columns[None]
        if self.wanted.size < _FEWEST_A_VIEW * views * size:
            self._place: npt.NDArray[np.int64] | None = None
            self.view, self.pixel = np.divmod(self.wanted.ravel(), size)
        else:
            mask = np.zeros(views * size, np.bool_)
            mask[self.wanted] = True
            self._place = np.flatnonzero(mask)
            self.view, self.pixel = np.divmod(self._place, size)
        self._size = views * size

    def squares(self, luma: LumaFrames) -> LumaFrames:
        """Return the squares (2 reach + 1, 2 reach + 1, m), by y and x, from the luma of those to render."""
        if self._place is None:
            return luma.reshape(self.wanted.shape)
        frames = np.empty(self._size, np.float32)
        frames[self._place] = luma
        return frames[self.wanted]


def mirrored(i: Indices, size: int) -> Indices:
    """Indices within 0..size - 1 for any: mirrored at both ends, which are not repeated; one alone is all there is."""
    if size == 1:
        return np.zeros_like(i)
    last = size - 1
    return last - np.abs(last - np.abs(i) % (2 * last))
