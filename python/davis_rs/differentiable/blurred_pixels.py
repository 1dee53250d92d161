"""Finds the pixels of unblurred luma that make one pixel of a renderer's frames."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..render.edges.neighbours import mirrored
from ..render.native.renderer import NativeRenderer

IntArray = npt.NDArray[np.int64]

_BLUR = np.array([0.25, 0.5, 0.25])


class BlurredPixels:
    """The 3 x 3 blur of a renderer's frames, as a sum over neighbours; one pixel alone where it does not blur.

    Attributes:
        weights: float64 (m,) of the neighbours.
    """

    def __init__(self, renderer: NativeRenderer) -> None:
        self._camera = renderer.camera
        around = np.arange(-1, 2) if renderer.blur else np.zeros(1, np.int64)
        self._rows, self._columns = (part.ravel() for part in np.meshgrid(around, around, indexing="ij"))
        self.weights = (np.outer(_BLUR, _BLUR) if renderer.blur else np.ones((1, 1))).ravel()

    def neighbours(self, pixel: IntArray) -> IntArray:
        """Return (n, m) pixels whose luma, times :attr:`weights`, adds up to the blurred luma of pixels (n,), y
        W + x."""
        y, x = np.divmod(pixel, self._camera.width)
        rows = mirrored(y[:, None] + self._rows, self._camera.height)
        return rows * self._camera.width + mirrored(x[:, None] + self._columns, self._camera.width)
