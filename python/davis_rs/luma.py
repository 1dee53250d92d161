"""Linear luma: what the renderers make and the pixels see."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

LUMA_WEIGHTS = (0.299, 0.587, 0.114)
"""Y = 0.299 R + 0.587 G + 0.114 B on linear RGB (the weights of ITU-R BT.601)."""

LumaFrames = npt.NDArray[np.float32]


def blur_3x3(luma: LumaFrames) -> LumaFrames:
    """Convolve each frame of (n, H, W) luma with the kernel [1 2 1] x [1 2 1] / 16, edges mirrored.

    The Gaussian blur of the dataset's simulator (OpenCV's 3 x 3 kernel), there to soften aliasing. Plain float32 sums
    in a fixed order: the same bits everywhere.

    Source: Mueggler et al., IJRR 2017, section 6 and its published simulator.
    """
    half, quarter = np.float32(0.5), np.float32(0.25)
    height, width = luma.shape[1:]
    if height > 1:  # a single row, mirrored at both edges, is its own neighbour
        padded = np.pad(luma, ((0, 0), (1, 1), (0, 0)), mode="reflect")
        luma = half * luma + quarter * (padded[:, :-2] + padded[:, 2:])
    if width > 1:
        padded = np.pad(luma, ((0, 0), (0, 0), (1, 1)), mode="reflect")
        luma = half * luma + quarter * (padded[..., :-2] + padded[..., 2:])
    return luma
