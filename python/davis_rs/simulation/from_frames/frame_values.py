"""Finds out what the values of frames show: how far apart they are, and whether white is what it is taken for."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from .frame_source import Encoding, FrameArray

_CERTAIN = 16.0
"""A step is believed if values of a finer source would show it by chance with a probability below exp(-16)."""

_FEWEST_LEVELS = 63
"""From black to white: 6 bits. Fewer are no camera's; a drawn picture uses few of its grey levels."""

_AS_FINE = 0.9
"""A step that is found counts if it leaves fewer levels than this share of those that the source says."""

_BITS = (8, 10, 12, 14)
"""How many of 16 bits a source may use."""

_BRIGHT, _BRIGHT_SHARE = 4.0, 0.01
"""White is not 1 if more than this share of a frame is above this value. Lamps in a rendered image are, but small."""

_FEWEST_VALUES = 16
"""Different values that show that a frame of floating point holds 8 bits."""


class FrameValuesWarning(UserWarning):
    """Warns that the values of frames may stand for other light than they are taken for."""


class FrameValues:
    """Watches the values of frames as they pass, in constant memory.

    A source may use only some of its type's integers: 8 bits that are shifted or stretched to 16, for example. The step
    is the smallest gap between values that occur. The first frame decides, because events are made while frames are
    read. The frames after it show whether that was right.

    Args:
        stated: what the source says of its encoding.
        first: the first frame (H, W) or (H, W, 3).
        white_level, log_eps: what the user says in place of what is found; None where the user does not.

    Attributes:
        encoding: the source's, with the step that the first frame shows.
    """

    def __init__(
        self, stated: Encoding, first: FrameArray, *, white_level: float | None, log_eps: float | None
    ) -> None:
        self._stated = stated
        self._white_given, self._dark_given = white_level is not None, log_eps is not None
        integers = first.dtype in (np.uint8, np.uint16)
        self._occurs = np.zeros(np.iinfo(first.dtype).max + 1, np.bool_) if integers else None
        self._finest = self._bright = False
        self._largest = 0.0
        self._eight_bits = not integers and _are_eight_bits(first, stated.white if white_level is None else white_level)
        self._told: set[str] = set()
        self.add(first)
        self.encoding = self.shown()

    @property
    def step_found(self) -> bool:
        """Tell whether the first frame shows larger steps than the source says."""
        return self.encoding != self._stated

    def add(self, image: FrameArray) -> None:
        """Take the values of a frame."""
        if self._stated.by_type:
            self._largest = max(self._largest, float(image.max()))
        if self._occurs is None:
            self._bright = self._bright or bool(np.count_nonzero(image > _BRIGHT) > _BRIGHT_SHARE * image.size)
        elif not self._finest:
            self._occurs[image] = True
            self._finest = bool((self._occurs[1:] & self._occurs[:-1]).any())

    def shown(self) -> Encoding:
        """Return the source's encoding, with the step that all frames so far show."""
        if self._occurs is None or self._finest:
            return self._stated
        values = np.flatnonzero(self._occurs)
        step = _step_of(values)
        black, white = (self._stated.in_frame(value) for value in (self._stated.black, self._stated.white))
        if step is None or not _FEWEST_LEVELS * step <= white - black <= _AS_FINE * (self._stated.levels or 0) * step:
            return self._stated
        encoding = self._stated
        if encoding.in_frames is None and (values % step == 0).all():
            white = white // step * step  # of 8 bits that are shifted to 16 it is 255 times 256
            encoding = replace(encoding, white=white)
        return replace(encoding, levels=round((white - black) / step))

    def doubts(self) -> Iterator[str]:
        """Yield what is doubtful about white and steps in the frames so far, a line each, and each one once."""
        for kind, line in self._doubts():
            if kind not in self._told:
                self._told.add(kind)
                yield line

    def _doubts(self) -> Iterator[tuple[str, str]]:
        if not self._stated.by_type:
            return
        white = f"{self._stated.white:g} is taken for white"
        if not self._white_given:
            bits = next((bits for bits in _BITS if self._finest and self._largest < 1 << bits), None)
            if self._stated.white > 255 and bits is not None:
                most = (1 << bits) - 1
                yield (
                    "bits",
                    f"{white}, but no value is above {self._largest:g}: for {bits} bits give white_level {most}",
                )
            if self._bright:
                yield (
                    "bright",
                    f"{white}, but values go up to {self._largest:g}: give integers as uint8 or uint16, or give "
                    "white_level",
                )
        if self._eight_bits and not self._dark_given:
            yield (
                "eight bits",
                "floating point is taken for linear light without steps, but all values are multiples of white / 255, "
                "as 8 bits give: give the integers as uint8, or give log_eps",
            )


def _step_of(values: npt.NDArray[np.intp]) -> float | None:
    """Return the step of the increasing values that occur; None where there are too few to tell.

    n values that lie anywhere within a range R have no gap below g with a probability of about exp(-n^2 (g - 1) / R).
    Where values were stretched and then rounded, single steps differ, and their mean is taken.
    """
    if len(values) < 2:
        return None
    gaps = np.diff(values)
    least = int(gaps.min())
    if len(values) ** 2 * (least - 1) < _CERTAIN * (values[-1] - values[0]):
        return None
    return float(gaps[gaps <= 1.5 * least].mean())


def _are_eight_bits(image: FrameArray, white: float) -> bool:
    """Tell whether values of floating point are the integers from 0 to 255, times ``white`` / 255."""
    if not (image.min() >= 0 and image.max() <= white):
        return False
    values = np.asarray(image, np.float64) * (255 / white)
    whole = np.rint(values)
    return bool((np.abs(values - whole) < 1e-3).all()) and len(np.unique(whole)) >= _FEWEST_VALUES
