"""Defines linear luma: what the renderers make and the pixels see."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .._core import blur_3x3 as core_blur_3x3

LUMA_WEIGHTS = (0.299, 0.587, 0.114)
"""Y = 0.299 R + 0.587 G + 0.114 B on linear RGB (the weights of ITU-R BT.601)."""

LumaFrames = npt.NDArray[np.float32]

_HALF, _QUARTER = np.float32(0.5), np.float32(0.25)


def blur_3x3(luma: LumaFrames) -> LumaFrames:
    """Convolve each frame of (n, H, W) luma with the kernel [1 2 1] x [1 2 1] / 16, edges mirrored.

    The Gaussian blur of the dataset's simulator (OpenCV's 3 x 3 kernel), there to soften aliasing. Plain float32 sums
    in a fixed order, columns first: the same bits everywhere. It is linear, so rates of luma are blurred alike.

    Source: Mueggler et al., IJRR 2017, section 6 and its published simulator.
    """
    return core_blur_3x3(np.ascontiguousarray(luma))


def blur_neighbourhoods(luma: LumaFrames) -> LumaFrames:
    """Blur the inner pixels (h - 2, w - 2, m) of squares (h, w, m) of a frame, bit by bit as :func:`blur_3x3` does."""
    column: LumaFrames = _HALF * luma[1:-1] + _QUARTER * (luma[:-2] + luma[2:])
    return _HALF * column[:, 1:-1] + _QUARTER * (column[:, :-2] + column[:, 2:])
