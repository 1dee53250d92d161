"""Cuts out the part of a frame that the sensor sees, and brings it to the sensor's size."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..._util.argument_checks import as_size, parse_roi, parse_size
from ..._util.argument_error import ArgumentError
from ..._util.extras import load_opencv
from .frame_source import FrameArray

_SAME_SHAPE = 0.01
"""How far the two sides may be reduced by different factors: a pixel or so of rounding, not a stretched image."""


class FramePart(NamedTuple):
    """Holds a rectangle of a frame, and where it comes to lie on the sensor.

    Attributes:
        left, top, width, height: of the rectangle in pixels of the frame.
        size: (width, height) of the sensor.
        image: (width, height) that the rectangle has on the sensor, in its middle; the rest of the sensor is black.
            The sensor's size where nothing is padded.
    """

    left: int
    top: int
    width: int
    height: int
    size: tuple[int, int]
    image: tuple[int, int]

    @property
    def resized(self) -> bool:
        """Return whether pixels of the sensor are other than those of the frame."""
        return self.image != (self.width, self.height)

    def describe(self) -> dict[str, object]:
        """Return the attributes in JSON's types; ``image`` only where it does not fill the sensor."""
        shown: dict[str, object] = {**self._asdict(), "size": list(self.size)}
        del shown["image"]
        return shown if self.image == self.size else {**shown, "image": list(self.image)}

    def cut(self, image: FrameArray) -> FrameArray:
        """Cut out the rectangle of a frame (H, W, ...), not copied."""
        return image[self.top : self.top + self.height, self.left : self.left + self.width]

    def fit(self, luma: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """Bring the cut-out part to the sensor's size.

        A side that shrinks is averaged over areas of linear light, as a larger pixel would. A side that grows is
        interpolated by straight lines, which makes no light below or above that of the pixels.

        Raises:
            ImportError: without OpenCV, where the size changes.
        """
        image = np.ascontiguousarray(luma)
        if self.resized:
            cv2 = load_opencv("bringing frames to another size", "video")
            # One side after the other, because OpenCV would also take the nearest pixel for one that grows by areas.
            shrunk = min(self.image[0], self.width), min(self.image[1], self.height)
            if shrunk != (self.width, self.height):
                image = cv2.resize(image, shrunk, interpolation=cv2.INTER_AREA)
            if self.image != shrunk:
                image = cv2.resize(image, self.image, interpolation=cv2.INTER_LINEAR)
        if self.image == self.size:
            return np.asarray(image)
        padded = np.zeros((self.size[1], self.size[0]), np.float32)
        left, top = (self.size[0] - self.image[0]) // 2, (self.size[1] - self.image[1]) // 2
        padded[top : top + self.image[1], left : left + self.image[0]] = image
        return padded


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
        left, top, right, bottom = parse_roi(roi)
        wide, high = right - left, bottom - top
    else:
        wide, high = width, height
    if left < 0 or top < 0 or left + wide > width or top + high > height:
        name = "crop" if roi is None else "roi"
        raise ArgumentError("{argument} {} does not lie inside {}", roi or f"{wide}x{high}", full, argument=name)
    result = parse_size(size) or (wide, high)
    if result[0] > wide or result[1] > high:
        raise ArgumentError(
            "{size} {}x{} must not be larger than the {} x {} pixels that the frames give, because what lies between "
            "pixels is not known; {fit} crop, pad or scale enlarges them all the same",
            *(*result, wide, high),
        )
    across, down = wide / result[0], high / result[1]
    if abs(across / down - 1) > _SAME_SHAPE and min(abs(wide - result[0] * down), abs(high - result[1] * across)) > 1:
        factor = min(across, down)
        fits = f"{round(result[0] * factor)}x{round(result[1] * factor)}"
        raise ArgumentError(
            "{size} {}x{} has another shape than the {} x {} pixels that the frames give, and would stretch the image: "
            "{crop:{}} fits, and so does {fit}",
            *(*result, wide, high, fits),
        )
    if max(result) > 65535:
        raise ArgumentError("a sensor has at most 65535 pixels each way, {} have more: give {size} or {crop}", full)
    return FramePart(left, top, wide, high, result, result)


def fitted(part: FramePart, size: tuple[int, int], fit: str) -> FramePart:
    """Bring a part of a frame to a sensor of any size.

    Args:
        part: that would be taken without a size.
        size: (width, height) of the sensor.
        fit: ``crop`` fills the sensor, and cuts off what goes beyond it, on both sides alike; ``pad`` shows all, with
            black around it; ``scale`` stretches both sides to those of the sensor.
    """
    (width, height), (wide, high) = size, (part.width, part.height)
    if fit == "scale":
        return part._replace(size=size, image=size)
    across, down = width / wide, height / high
    if fit == "pad":
        factor = min(across, down)
        image = min(width, max(1, round(wide * factor))), min(height, max(1, round(high * factor)))
        return part._replace(size=size, image=image)
    factor = max(across, down)
    kept = min(wide, max(1, round(width / factor))), min(high, max(1, round(height / factor)))
    left, top = part.left + (wide - kept[0]) // 2, part.top + (high - kept[1]) // 2
    return FramePart(left, top, *kept, size, size)
