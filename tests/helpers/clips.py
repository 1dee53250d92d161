"""Clips that tests make: frames in motion, videos of them in many codecs, and folders of images."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import numpy.typing as npt
from PIL import Image

Frames = npt.NDArray[np.uint8]

LIMITED, FULL = 1, 2
"""FFmpeg's colour ranges."""


def moving_bars(count: int = 6, width: int = 48, height: int = 32, step: float = 1.5) -> Frames:
    """Grey frames (n, H, W) of a smooth pattern that moves to the right by ``step`` pixels a frame."""
    y, x = np.mgrid[:height, :width]
    shifted = x[None] - step * np.arange(count)[:, None, None]
    return np.rint(127 + 100 * np.sin(shifted * 0.45 + y * 0.1)).astype(np.uint8)


def write_video(
    path: Path,
    frames: Sequence[npt.NDArray[Any]] | npt.NDArray[Any],
    stamps_ms: Sequence[int],
    *,
    codec: str = "ffv1",
    pixel_format: str = "yuv444p",
    colour_range: int = FULL,
    colour: Mapping[str, int] | None = None,
    options: dict[str, str] | None = None,
) -> Path:
    """Write frames (H, W, 3) or (H, W), uint8, with a variable rate. Grey comes to Y' without loss by ``ffv1``.

    Args:
        colour: attributes of the codec's context, such as ``color_trc``.
    """
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream(codec, rate=1000, options=options or {})
        stream.height, stream.width = frames[0].shape[:2]
        stream.pix_fmt = pixel_format
        stream.codec_context.time_base = Fraction(1, 1000)
        stream.codec_context.color_range = colour_range
        for name, value in (colour or {}).items():
            setattr(stream.codec_context, name, value)
        for image, stamp in zip(frames, stamps_ms, strict=True):
            if pixel_format == "gray" and colour_range == LIMITED:  # FFmpeg's converter knows grey of full range only
                image, kept = np.rint(16 + image * (219 / 255)).astype(np.uint8), FULL
            else:
                kept = colour_range
            given = av.VideoFrame.from_ndarray(image, format="gray" if image.ndim == 2 else "rgb24")
            frame: Any = given.reformat(format=pixel_format, src_color_range=FULL, dst_color_range=kept)
            frame.pts, frame.time_base = stamp, Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def write_images(folder: Path, frames: Sequence[npt.NDArray[Any]] | npt.NDArray[Any], suffix: str = ".png") -> Path:
    """Write frames as numbered images, without leading zeros."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, image in enumerate(frames):
        Image.fromarray(image).save(folder / f"frame_{number}{suffix}")
    return folder


def write_exr(path: Path, channels: Mapping[str, npt.NDArray[Any]]) -> None:
    """Write an OpenEXR image."""
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    planes = {name: np.ascontiguousarray(values) for name, values in channels.items()}  # it looks at no strides
    OpenEXR.File(header, planes).write(str(path))


def texture(x: npt.NDArray[np.float64], y: npt.NDArray[np.float64]) -> npt.NDArray[np.float32]:
    """A plain of light in 0.05..0.95 without end, with detail of several sizes."""
    waves = np.sin(x * 0.31 + y * 0.17) + np.sin(x * 0.11 - y * 0.23 + 1) + np.sin(x * 0.53 + 2) * np.sin(y * 0.41)
    return np.asarray(0.5 + 0.15 * waves, np.float32)


def moving_texture(count: int, step: float, width: int = 96, height: int = 64) -> npt.NDArray[np.float32]:
    """Frames (n, H, W) of :func:`texture` that moves to the right by ``step`` pixels a frame."""
    y, x = np.mgrid[:height, :width].astype(np.float64)
    return np.stack([texture(x - step * k, y) for k in range(count)])
