"""Packs disparity as 16-bit PNG, as KITTI and DSEC have it: 256 steps a pixel, 0 where there is none."""

from __future__ import annotations

import io

import numpy as np
import numpy.typing as npt

STEPS = 256
"""Of a pixel."""


def encode_disparity(disparity: npt.NDArray[np.float32]) -> bytes:
    """Return a grey PNG of 16 bits.

    There is none where nothing is seen, and where 16 bits do not tell it: below 1/512 px, or from 256 px on.

    Args:
        disparity: (H, W), pixels, NaN for none.

    Source: the development kit of KITTI's stereo benchmark 2015; DSEC's documentation of its disparity.
    """
    with np.errstate(invalid="ignore"):
        steps = np.rint(disparity.astype(np.float64) * STEPS)
        told = (steps >= 1) & (steps < 1 << 16)
    return encode_grey(np.where(told, steps, 0).astype(np.uint16))


def decode_disparity(steps: npt.NDArray[np.uint16]) -> npt.NDArray[np.float32]:
    """Return pixels, NaN for none."""
    return np.where(steps > 0, steps / np.float32(STEPS), np.float32(np.nan))


def encode_grey(image: npt.NDArray[np.uint8] | npt.NDArray[np.uint16]) -> bytes:
    """Return a grey PNG of 8 or of 16 bits."""
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(image).save(stream, "PNG")
    return stream.getvalue()
