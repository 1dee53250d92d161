"""Reads frames from arrays: a stack, a .npy file, or any iterable of arrays."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..._util.budget import Budget
from ..._util.untrusted import decoding, regular_file
from .frame_source import Encoding, FrameArray, FrameSource, GivenStamps, StampedFrame, Stamps, charge_frame


class ArrayFrames(FrameSource):
    """Hands on frames that Python has, each (H, W), (H, W, 1) or (H, W, 3): uint8, uint16 or floating point.

    Args:
        images: a stack (n, H, W[, 3]), or an iterable of frames, which is gone through once.
        stamps_ns: one a frame. Both must end together.
        name: what they are called in messages and titles.
    """

    def __init__(self, images: Iterable[npt.ArrayLike], stamps_ns: Stamps, name: str = "frames") -> None:
        self.name, self._images, self._stamps = name, images, stamps_ns
        if isinstance(images, np.ndarray):
            if images.ndim not in (3, 4):
                raise ValueError(
                    f"{name}: a stack of frames must have the shape (n, H, W) or (n, H, W, 3), got {images.shape}"
                )
            self.count = len(images)
        if self.count is not None and not isinstance(stamps_ns, Iterator) and len(stamps_ns) != self.count:
            raise ValueError(f"{name}: {self.count} frames need as many stamps, got {len(stamps_ns)}")

    def frames(self) -> Iterator[StampedFrame]:
        stamps = GivenStamps(self._stamps, self.name)
        for number, image in enumerate(self._images):
            where = f"{self.name}, frame {number}"
            t_ns = stamps.next(where)
            yield StampedFrame(t_ns, _checked(np.asarray(image), where), where)
        stamps.end()

    def encoding(self, first: StampedFrame) -> Encoding:
        return Encoding.of(first.image.dtype, first.where)

    def describe(self) -> dict[str, object]:
        return {"kind": "arrays", "name": self.name}


class NpyFrames(ArrayFrames):
    """Reads the frames of a ``.npy`` file (n, H, W) or (n, H, W, 3), mapped into memory rather than read as a whole.

    Raises:
        OSError: if it cannot be read.
        DecodeError: if it is no array, or shorter than it says.
        ValueError: for another shape.
    """

    def __init__(self, path: str | Path, stamps_ns: Stamps) -> None:
        with decoding(path):
            stack = np.load(regular_file(path), mmap_mode="r", allow_pickle=False)
        super().__init__(stack, stamps_ns, str(path))

    def describe(self) -> dict[str, object]:
        return {"kind": "npy", "file": self.name}


def _checked(image: FrameArray, where: str) -> FrameArray:
    """Return the frame with one or three values a pixel."""
    if image.ndim == 3 and image.shape[2] == 1:
        image = image[..., 0]
    if image.ndim == 3 and image.shape[2] == 4:
        raise ValueError(f"{where}: a frame must not have an alpha channel: give red, green and blue alone")
    if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] != 3) or 0 in image.shape:
        raise ValueError(f"{where}: a frame must have the shape (H, W) or (H, W, 3), got {image.shape}")
    charge_frame(Budget(where), image.shape[1], image.shape[0])
    return image
