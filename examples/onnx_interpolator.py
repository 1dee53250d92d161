"""Make frames between frames with a network in an ONNX file, which onnxruntime runs.

    pip install 'davis_rs[onnx,video]'
    export INTERPOLATOR_MODEL=model.onnx
    davis-rs frames clip.mp4 -o DIR --interpolator examples/onnx_interpolator.py:OnnxInterpolator

The network takes two images and a time, in this order, as exports of RIFE do: float32 (1, 3, H, W), (1, 3, H, W) and
(1, 1, 1, 1). Images are sRGB from 0 to 1; the time lies between 0, the first image, and 1, the second one. It gives an
image of the same shape. Sides are padded to multiples of 32, because networks halve them several times.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

_SIDES = 32
"""Sides of the images are multiples of this many pixels."""

Image = npt.NDArray[np.float32]


class OnnxInterpolator:
    """Makes frames between frames; davis-rs makes one object of it for a run.

    Args:
        model: the ONNX file; that of the environment variable INTERPOLATOR_MODEL if not given.
    """

    def __init__(self, model: str | Path | None = None) -> None:
        import onnxruntime

        self._session = onnxruntime.InferenceSession(str(model or os.environ["INTERPOLATOR_MODEL"]))
        self._names = [given.name for given in self._session.get_inputs()]
        if len(self._names) != 3:
            raise ValueError(f"the network must take two images and a time, it takes {', '.join(self._names)}")

    def __call__(self, before: Image, after: Image, shares: npt.NDArray[np.float64]) -> Iterator[Image]:
        """Yield linear luma (H, W) at each share of the way from ``before`` to ``after``, linear luma (H, W)."""
        height, width = before.shape
        # Luma above white would be clipped: both frames are divided by what is brightest in them.
        white = max(float(before.max()), float(after.max()), 1e-6)
        images = [_image(luma / white) for luma in (before, after)]
        for share in shares:
            time = np.full((1, 1, 1, 1), share, np.float32)
            made = self._session.run(None, dict(zip(self._names, [*images, time], strict=True)))[0]
            grey = np.clip(np.asarray(made, np.float32)[0].mean(axis=0), 0, 1)[:height, :width]
            yield white * _linear(grey)


def _image(luma: Image) -> Image:
    """Encode linear luma (H, W) from 0 to 1 as three channels of sRGB (1, 3, H', W'), with padded sides."""
    encoded = np.where(luma <= 0.0031308, 12.92 * luma, 1.055 * luma ** (1 / 2.4) - 0.055).astype(np.float32)
    missing = [-side % _SIDES for side in luma.shape]
    padded = np.pad(encoded, [(0, missing[0]), (0, missing[1])], mode="edge")
    return np.repeat(padded[None, None], 3, axis=1)


def _linear(encoded: Image) -> Image:
    """Decode sRGB (IEC 61966-2-1)."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4).astype(np.float32)
