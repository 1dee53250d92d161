"""Defines linear luma: what the renderers make and the pixels see."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

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
    blurred = np.empty_like(luma)
    column = np.empty(luma.shape[1:], np.float32)
    # Frame by frame, and in place: what is worked on then stays in the cache.
    for frame, out in zip(luma, blurred, strict=True):
        _blur_along(frame, column)
        _blur_along(column.T, out.T)
    return blurred


def _blur_along(rows: LumaFrames, out: LumaFrames) -> None:
    """Compute out[i] = rows[i] / 2 + (rows[i - 1] + rows[i + 1]) / 4; a row at an end is its own neighbour."""
    if len(rows) == 1:
        out[:] = rows
        return
    np.add(rows[:-2], rows[2:], out=out[1:-1])
    np.add(rows[1], rows[1], out=out[0])
    np.add(rows[-2], rows[-2], out=out[-1])
    np.multiply(out, _QUARTER, out=out)
    np.add(out, _HALF * rows, out=out)


def blur_neighbourhoods(luma: LumaFrames) -> LumaFrames:
    """Blur the inner pixels (h - 2, w - 2, m) of squares (h, w, m) of a frame, bit by bit as :func:`blur_3x3` does."""
    column: LumaFrames = _HALF * luma[1:-1] + _QUARTER * (luma[:-2] + luma[2:])
    return _HALF * column[:, 1:-1] + _QUARTER * (column[:, :-2] + column[:, 2:])
