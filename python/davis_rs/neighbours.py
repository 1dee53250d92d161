"""Which pixels must be rendered so that single blurred ones can be had."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .camera import Camera
from .luma import LumaFrames, blur_neighbourhoods

Indices = npt.NDArray[np.int64]

_FEWEST_A_VIEW = 1 / 300
"""From this share of a view's pixels on, finding what they share costs less than rendering it twice: measured for
pixels along edges, which are what is asked for; scattered ones share little, and lose little."""


class Neighbours:
    """The 3 x 3 neighbourhoods of m pixels, mirrored at the frame's edge.

    Attributes:
        view, pixel: int64, all pixels to render: each once where many of a view are asked for, else nine for each.
    """

    def __init__(self, camera: Camera, views: int, view: Indices, pixel: Indices) -> None:
        width, height = camera.width, camera.height
        self.view, self.pixel = view, pixel
        size = width * height
        y, x = np.divmod(pixel, width)
        rows = view * size + _beside(y, height) * width
        columns = _beside(x, width)
        self._wanted = rows[:, None] + columns[None]
        if len(view) < _FEWEST_A_VIEW * views * size:
            self._place: npt.NDArray[np.int64] | None = None
            self.view, self.pixel = np.divmod(self._wanted.ravel(), size)
        else:
            mask = np.zeros(views * size, np.bool_)
            mask[self._wanted] = True
            self._place = np.flatnonzero(mask)
            self.view, self.pixel = np.divmod(self._place, size)
        self._size = views * size

    def blur(self, luma: LumaFrames) -> LumaFrames:
        """The m blurred pixels, from the luma of those to render."""
        if self._place is None:
            return blur_neighbourhoods(luma.reshape(self._wanted.shape))
        frames = np.empty(self._size, np.float32)
        frames[self._place] = luma
        return blur_neighbourhoods(frames[self._wanted])


def _beside(i: Indices, size: int) -> Indices:
    """(3, m): the index before, itself and the next, mirrored at both ends; one alone is its own neighbour."""
    if size == 1:
        return np.stack([i, i, i])
    return np.stack([np.abs(i - 1), i, size - 1 - np.abs(size - 2 - i)])
