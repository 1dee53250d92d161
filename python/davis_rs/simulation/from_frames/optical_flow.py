"""Computes optical flow between two frames by OpenCV's DIS, both ways, with occlusions, and frames between them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..._util.argument_error import ArgumentError
from ..._util.extras import load_opencv
from .light import LumaFrame

FlowField = npt.NDArray[np.float32]
"""(H, W, 2): by how many pixels (x, y) what is seen there moves until the other frame."""

_SMALLEST = 32
"""Sides that DIS is given at the least; smaller frames are mirrored at their edges."""

_MOST_SIDE = 32766
"""OpenCV's remap counts pixels in 16 bits."""

_GAMMA = 1 / 2.2
"""Flow is sought in values of about equal steps to the eye, as DIS was made for, not in linear light."""

_AGREEMENT_PX = 1.0
"""Where flow there and back miss each other by as much, what is seen in one frame is hidden in the other."""

_TURNS = 3
"""Steps of the fixed-point iteration that finds where a pixel of an instant between came from."""

_PERCENTILE = 95.0
"""Of how far pixels move: the fastest may be mistakes."""

_TEXTURE = 3.0
"""Change from pixel to pixel, of 255, from which on there is something whose motion can be seen. In flat parts flow is
whatever smooth continuation makes of it, and no events come from there."""


def _opencv() -> Any:
    return load_opencv("optical flow", "video")


class FlowFinder:
    """Finds the flow between frames; keeps its buffers from one pair to the next.

    Source: Kroeger, Timofte, Dai, Van Gool, "Fast optical flow using dense inverse search", ECCV 2016.

    Raises:
        ImportError: without OpenCV.
    """

    def __init__(self) -> None:
        self._cv2 = _opencv()
        self._dis = self._cv2.DISOpticalFlow_create(self._cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
        # The preset ends at half the resolution, where objects of less than 16 pixels hardly seem to move.
        self._dis.setFinestScale(0)

    def flow(self, before: LumaFrame, after: LumaFrame) -> FlowField:
        """Compute the flow from each pixel of ``before`` (H, W) to its position in ``after``.

        Raises:
            ValueError: for frames of more than 32,766 pixels on a side.
        """
        height, width = before.shape
        if max(before.shape) > _MOST_SIDE:
            raise ArgumentError(
                "optical flow takes frames of up to {} pixels on a side, got {} x {}: give {size}, {crop} or "
                "{interpolation:cubic}",
                *(_MOST_SIDE, width, height),
            )
        white = max(_white(before), _white(after))
        grey = [self._padded(_as_grey(frame, white)) for frame in (before, after)]
        threads = self._cv2.getNumThreads()
        self._cv2.setNumThreads(1)  # DIS cuts a frame into as many strips as there are threads, and their edges show
        try:
            field = self._dis.calc(*grey, None)
        finally:
            self._cv2.setNumThreads(threads)
        return np.ascontiguousarray(field[:height, :width])

    def between(self, before: LumaFrame, after: LumaFrame) -> FlowPair:
        """Compute the flow there and back."""
        return FlowPair.of(before, after, self.flow(before, after), self.flow(after, before))

    def _padded(self, grey: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
        low, wide = (max(0, _SMALLEST - side) for side in grey.shape)
        return np.pad(grey, ((0, low), (0, wide)), "symmetric") if low or wide else grey


def displacement(frame: LumaFrame, flow: FlowField, other: LumaFrame) -> float:
    """Return how far the image moves, in pixels: the 95th percentile of pixels that have texture; 0 without any.

    Pixels count by how much they change, because that many events come from there: before a camera that stands still, a
    small object makes all of them.

    Args:
        frame: (H, W), whose pixels move by ``flow`` until ``other``.
    """
    cv2 = _opencv()
    white = max(_white(frame), _white(other))
    grey, then = (_as_grey(luma, white).astype(np.float32) for luma in (frame, other))
    across, down = (cv2.Sobel(grey, -1, 1 - k, k, ksize=3, scale=1 / 8) for k in (0, 1))
    textured = across * across + down * down > np.float32(_TEXTURE**2)
    moved, changed = np.hypot(flow[..., 0], flow[..., 1])[textured], np.abs(then - grey)[textured]
    order = np.argsort(moved, kind="stable")
    counted = np.cumsum(changed[order], dtype=np.float64)
    if not len(counted) or not counted[-1]:
        return 0.0
    return float(moved[order[np.searchsorted(counted, _PERCENTILE / 100 * counted[-1])]])


class BoundedPlane(NamedTuple):
    """Holds a plane of a frame, which is looked up by cubics within the range of the four pixels around a place.

    Beyond that range cubics swing at hard edges. In log intensity a swing towards 0 would be many events.

    Attributes:
        light: (H, W).
        least, most: (H, W), of each pixel, its right, its lower and its lower right neighbour.
    """

    light: LumaFrame
    least: LumaFrame
    most: LumaFrame

    @classmethod
    def of(cls, light: LumaFrame) -> BoundedPlane:
        """Find the ranges."""
        cv2, four = _opencv(), np.ones((2, 2), np.uint8)
        ranges = (way(light, four, anchor=(0, 0), borderType=_BORDER) for way in (cv2.erode, cv2.dilate))
        return cls(light, *ranges)

    def at(self, x: LumaFrame, y: LumaFrame) -> LumaFrame:
        """Look up places (H, W) between pixels."""
        cv2 = _opencv()
        found = cv2.remap(self.light, x, y, cv2.INTER_CUBIC, None, _BORDER)
        corner = np.floor(x), np.floor(y)
        least, most = (cv2.remap(bound, *corner, cv2.INTER_NEAREST, None, _BORDER) for bound in (self.least, self.most))
        return np.asarray(np.clip(found, least, most), np.float32)


@dataclass(frozen=True, eq=False)
class FlowPair:
    """Holds two frames, and how each moves to the other.

    Attributes:
        before, after: linear luma (H, W).
        forward, backward: flow from the one, and from the other.
        seen_after, seen_before: (H, W) in 0..1, how sure it is that a pixel of ``before`` is seen in ``after`` too, and
            one of ``after`` in ``before``.
    """

    before: LumaFrame
    after: LumaFrame
    forward: FlowField
    backward: FlowField
    seen_after: LumaFrame
    seen_before: LumaFrame

    @classmethod
    def of(cls, before: LumaFrame, after: LumaFrame, forward: FlowField, backward: FlowField) -> FlowPair:
        """Make the pair of flows, with the occlusions that follow from them."""
        seen = (_seen(one, other) for one, other in ((forward, backward), (backward, forward)))
        return cls(before, after, forward, backward, *seen)

    @cached_property
    def displacement_px(self) -> float:
        """Return how far the image moves, in pixels, as :func:`displacement`."""
        return max(
            displacement(self.before, self.forward, self.after), displacement(self.after, self.backward, self.before)
        )

    @property
    def occluded(self) -> float:
        """Return the fraction of the pixels of ``before`` whose flow there and back do not agree."""
        return float((self.seen_after < 0.5).mean())

    def frames(
        self, fractions: npt.ArrayLike, before: Sequence[LumaFrame], after: Sequence[LumaFrame]
    ) -> Iterator[list[LumaFrame]]:
        """Make the planes of a frame at each fraction of the way, in 0..1: what is seen moves straight, at constant
        speed.

        A pixel is taken from both frames, by how near they are in time, and from one alone where it is hidden in the
        other.

        Args:
            fractions: of the way, (n,).
            before, after: planes (H, W) of the two frames, such as their luma, or their light of three colours.
        """
        bounded = [[BoundedPlane.of(plane) for plane in planes] for planes in (before, after)]
        for fraction in np.asarray(fractions, np.float64).tolist():
            moved_before, seen_after = self._moved(bounded[0], self.forward, self.seen_after, fraction)
            moved_after, seen_before = self._moved(bounded[1], self.backward, self.seen_before, 1 - fraction)
            # What the first frame shows and the second does not, must not be mixed with the second; and back.
            w_before = np.float32(1 - fraction) * (seen_before + _FLOOR)
            w_after = np.float32(fraction) * (seen_after + _FLOOR)
            yield [
                np.asarray((w_before * y_before + w_after * y_after) / (w_before + w_after), np.float32)
                for y_before, y_after in zip(moved_before, moved_after, strict=True)
            ]

    @staticmethod
    def _moved(
        planes: Sequence[BoundedPlane], flow: FlowField, seen: LumaFrame, fraction: float
    ) -> tuple[list[LumaFrame], LumaFrame]:
        """Move planes of a frame, and how sure its pixels are, along its flow by a fraction of it."""
        cv2 = _opencv()
        x, y = _grid(*seen.shape)
        step = np.float32(fraction)
        moved = flow
        # The pixel that comes to p is q with q + share flow(q) = p.
        for _ in range(_TURNS):
            moved = cv2.remap(flow, x - step * moved[..., 0], y - step * moved[..., 1], cv2.INTER_LINEAR, None, _BORDER)
        from_x, from_y = x - step * moved[..., 0], y - step * moved[..., 1]
        moved_planes = [plane.at(from_x, from_y) for plane in planes]
        sure = cv2.remap(seen, from_x, from_y, cv2.INTER_LINEAR, None, _BORDER)
        return moved_planes, sure


_FLOOR = np.float32(1e-3)
"""Added to the weight of each frame. So frames that are both unsure are mixed as if both were sure."""

_BORDER = 1
"""OpenCV's BORDER_REPLICATE: what comes in over the edge looks as the edge does."""


def _grid(height: int, width: int) -> tuple[LumaFrame, LumaFrame]:
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    return x, y


def _seen(there: FlowField, back: FlowField) -> LumaFrame:
    """Tell whether what moves by ``there`` comes back by ``back`` to where it was: 1, and 0 where it misses widely."""
    x, y = _grid(*there.shape[:2])
    returned = _opencv().remap(back, x + there[..., 0], y + there[..., 1], 1, None, _BORDER)
    missed = (there[..., 0] + returned[..., 0]) ** 2 + (there[..., 1] + returned[..., 1]) ** 2
    return np.asarray(np.exp(-missed / np.float32(_AGREEMENT_PX**2)), np.float32)


def _white(luma: LumaFrame) -> float:
    """Return what is shown as white: all but the brightest highlights are below it."""
    return float(np.percentile(luma, 99.5)) or 1.0


def _as_grey(luma: LumaFrame, white: float) -> npt.NDArray[np.uint8]:
    return np.asarray(np.rint(255 * np.minimum(luma / np.float32(white), 1) ** np.float32(_GAMMA)), np.uint8)
