"""Declares the interface of a source of frames, whatever its file format is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..._util.array_types import UncheckedArray
from ..._util.budget import Budget

PIXEL_BYTES = 32
"""What a pixel of a frame takes while it becomes luma: as it is decoded, and in floating point."""


def charge_frame(budget: Budget, width: int, height: int) -> None:
    """Charge a frame, whose size a file may claim to be anything, before it is decoded.

    Raises:
        DecodeError: if it needs more than the budget has left.
    """
    budget.take(PIXEL_BYTES * width * height, f"a frame of {width} x {height} pixels")


FrameArray = UncheckedArray
"""A frame (H, W) or (H, W, 3): uint8, uint16 or floating point, which is known only when it is read."""

Stamps = Iterator[int] | Sequence[int]
"""Stamps in nanoseconds, one a frame: as many as there are frames, or an iterator that may have more."""


class StampedFrame(NamedTuple):
    """Holds a frame as its file has it.

    Attributes:
        t_ns: its stamp in nanoseconds.
        image: (H, W) or (H, W, 3) red, green, blue: uint8, uint16 or a floating-point type.
        where: the file and the frame, for messages.
    """

    t_ns: int
    image: FrameArray
    where: str


@dataclass(frozen=True)
class Encoding:
    """Says how the values of all frames of a source stand for light.

    Attributes:
        transfer: the transfer function that the source itself names, as the setting ``transfer`` takes it.
        black, white: the source's values for no light and for luma 1; a video's are those of its own bits and range.
        levels: how many steps there are from black to white; None for floating point, which has none to speak of.
        in_frames: what black and white are in the arrays of the frames, where these have another scale.
        by_type: black and white are those of the arrays' type, because the source does not say more.
    """

    transfer: str
    black: float
    white: float
    levels: int | None
    in_frames: tuple[float, float] | None = None
    by_type: bool = False

    @property
    def step(self) -> float | None:
        """Return how far apart neighbouring values of the source are; None for floating point."""
        return None if self.levels is None else (self.white - self.black) / self.levels

    def in_frame(self, value: float) -> float:
        """Return what a value of the source is in the arrays of the frames."""
        black, white = self.in_frames or (self.black, self.white)
        return black + (value - self.black) * (white - black) / (self.white - self.black)

    @classmethod
    def of(cls, dtype: np.dtype[Any], where: str) -> Encoding:
        """Return the encoding of plain images: integers use their type's whole range and are sRGB, floating point is
        linear.

        Raises:
            ValueError: for another type.
        """
        if dtype in (np.uint8, np.uint16):
            largest = int(np.iinfo(dtype).max)
            return cls("srgb", 0, largest, largest, by_type=True)
        if np.issubdtype(dtype, np.floating):
            return cls("linear", 0, 1, None, by_type=True)
        raise ValueError(f"{where}: frames must be uint8, uint16 or floating point, got {dtype}")


class GivenStamps:
    """Hands out stamps that are given apart from the frames, one a frame, and sees that both end together.

    Args:
        stamps: an iterator may have more than there are frames.
        name: of the frames, for messages.
    """

    def __init__(self, stamps: Stamps, name: str) -> None:
        self._rest, self._name = iter(stamps), name
        self._may_have_more = isinstance(stamps, Iterator)
        self._count = 0

    def next(self, where: str) -> int:
        """Return the stamp of the frame at ``where``, in nanoseconds.

        Raises:
            ValueError: if there is none.
        """
        t_ns = next(self._rest, None)
        if t_ns is None:
            raise ValueError(f"{where}: there are only {self._count} stamps, and more frames")
        self._count += 1
        return int(t_ns)

    def end(self) -> None:
        """Check that no stamps are left; to be called after the last frame.

        Raises:
            ValueError: if there are more stamps.
        """
        if not self._may_have_more and next(self._rest, None) is not None:
            raise ValueError(f"{self._name}: there are only {self._count} frames, and more stamps")


class FrameSource(ABC):
    """Yields frames with their stamps, one after the other.

    Attributes:
        name: of the file or folder, for titles.
        count: how many frames there are; None if that is not known before all are read.
    """

    name: str
    count: int | None = None

    @abstractmethod
    def frames(self) -> Iterator[StampedFrame]:
        """Yield all frames in order. Stamps are as the source has them; the caller checks that they increase.

        Raises:
            OSError: if a file cannot be read.
            ValueError: for a malformed frame, naming it (for a file: :class:`~davis_rs.DecodeError`).
        """

    @abstractmethod
    def encoding(self, first: StampedFrame) -> Encoding:
        """Return how values encode light; a source may know it only from the first frame on."""

    @abstractmethod
    def describe(self) -> dict[str, object]:
        """Return what a repetition needs, in JSON's types, for meta.json."""
