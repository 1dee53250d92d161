"""Cuts out the part of a frame that the sensor sees, and reduces it to the sensor's size."""

from __future__ import annotations

import re
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..._util.argument_checks import as_size, parse_size
from ..._util.argument_error import ArgumentError
from .frame_source import FrameArray

_SAME_SHAPE = 0.01
"""How far the two sides may be reduced by different factors: a pixel or so of rounding, not a stretched image."""


class FramePart(NamedTuple):
    """Holds a rectangle of a frame, and the size that it is reduced to.

    Attributes:
        left, top, width, height: of the rectangle in pixels of the frame.
        size: (width, height) of the result.
    """

    left: int
    top: int
    width: int
    height: int
    size: tuple[int, int]

    def cut(self, image: FrameArray) -> FrameArray:
        """Cut out the rectangle of a frame (H, W, ...), not copied."""
        return image[self.top : self.top + self.height, self.left : self.left + self.width]

    def reduce(self, luma: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """Reduce the cut-out part by averaging linear light over areas, as a larger pixel would.

        Raises:
            ImportError: without OpenCV, where the size changes.
        """
        if self.size == (self.width, self.height):
            return np.ascontiguousarray(luma)
        cv2 = _opencv()
        return np.asarray(cv2.resize(np.ascontiguousarray(luma), self.size, interpolation=cv2.INTER_AREA))


def frame_part(
    width: int, height: int, *, crop: tuple[int, int] | str | None, roi: str | None, size: tuple[int, int] | str | None
) -> FramePart:
    """Choose the part of frames of ``width`` x ``height`` pixels that the settings ask for.

    Raises:
        ValueError: for malformed settings, a part that is not inside the frame, a size that is larger than the part or
            of another shape, naming what would fit.
    """
    left = top = 0
    full = f"the frames of {width} x {height} pixels"
    if crop is not None and roi is not None:
        raise ArgumentError("only one of {crop} and {roi} may be given")
    if crop is not None:
        wide, high = as_size(crop, "crop")
        left, top = (width - wide) // 2, (height - high) // 2
    elif roi is not None:
        match = re.fullmatch(r"(\d{1,5}[xX]\d{1,5})\+(\d{1,5})\+(\d{1,5})", roi.strip())
        if match is None:
            raise ArgumentError("{roi} must be WIDTHxHEIGHT+LEFT+TOP in pixels, such as 346x260+100+50, got {!r}", roi)
        wide, high = as_size(match[1], "roi")
        left, top = int(match[2]), int(match[3])
    else:
        wide, high = width, height
    if left < 0 or top < 0 or left + wide > width or top + high > height:
        name = "crop" if roi is None else "roi"
        raise ArgumentError("{argument} {} does not lie inside {}", roi or f"{wide}x{high}", full, argument=name)
    result = parse_size(size) or (wide, high)
    if result[0] > wide or result[1] > high:
        raise ArgumentError(
            "{size} {}x{} must not be larger than the {} x {} pixels that the frames give: "
            "what lies between pixels is not known",
            *(*result, wide, high),
        )
    across, down = wide / result[0], high / result[1]
    if abs(across / down - 1) > _SAME_SHAPE and min(abs(wide - result[0] * down), abs(high - result[1] * across)) > 1:
        factor = min(across, down)
        fits = f"{round(result[0] * factor)}x{round(result[1] * factor)}"
        raise ArgumentError(
            "{size} {}x{} has another shape than the {} x {} pixels that the frames give, and would stretch the image: "
            "{crop:{}} fits",
            *(*result, wide, high, fits),
        )
    if max(result) > 65535:
        raise ArgumentError("a sensor has at most 65535 pixels each way, {} have more: give {size} or {crop}", full)
    return FramePart(left, top, wide, high, result)


def _opencv() -> Any:
    try:
        import cv2
    except ImportError as error:
        raise ImportError("reducing frames to another size needs OpenCV: pip install 'davis_rs[video]'") from error
    return cv2
