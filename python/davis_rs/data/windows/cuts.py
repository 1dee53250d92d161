"""Cuts streams into windows: by time, by count, between frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from ..._util.argument_error import ArgumentError
from ...events.arrays import EventArray
from ...io.files.random_access import RandomAccess


class Cuts(Protocol):
    """Cuts a stream into windows."""

    def __len__(self) -> int:
        """Return the number of windows."""

    def bounds(self, access: RandomAccess, index: int) -> tuple[int, int]:
        """Start and end of a window, without its events."""

    def window(self, access: RandomAccess, index: int) -> tuple[int, int, EventArray]:
        """Start, end and events of a window."""


@dataclass(frozen=True)
class TimeCuts:
    """Windows of one duration."""

    first_us: int
    duration_us: int
    stride_us: int
    count: int

    def __len__(self) -> int:
        return self.count

    def bounds(self, access: RandomAccess, index: int) -> tuple[int, int]:
        start_us = self.first_us + index * self.stride_us
        return start_us, start_us + self.duration_us

    def window(self, access: RandomAccess, index: int) -> tuple[int, int, EventArray]:
        start_us, end_us = self.bounds(access, index)
        return start_us, end_us, access.read_times(start_us, end_us)


@dataclass(frozen=True)
class CountCuts:
    """Windows of one number of events."""

    first: int
    events: int
    stride: int
    count: int

    def __len__(self) -> int:
        return self.count

    def bounds(self, access: RandomAccess, index: int) -> tuple[int, int]:
        first = self.first + index * self.stride
        ends = (access.read(number, number + 1) for number in (first, first + self.events - 1))
        start_us, last_us = (int(event["t"][0]) for event in ends)
        return start_us, last_us + 1

    def window(self, access: RandomAccess, index: int) -> tuple[int, int, EventArray]:
        first = self.first + index * self.stride
        events = access.read(first, first + self.events)
        return int(events["t"][0]), int(events["t"][-1]) + 1, events


@dataclass(frozen=True)
class FrameCuts:
    """Windows from each stamp to the next one."""

    t_us: npt.NDArray[np.int64]

    def __len__(self) -> int:
        return max(len(self.t_us) - 1, 0)

    def bounds(self, access: RandomAccess, index: int) -> tuple[int, int]:
        start_us, end_us = self.t_us[index : index + 2].tolist()
        return start_us, end_us

    def window(self, access: RandomAccess, index: int) -> tuple[int, int, EventArray]:
        start_us, end_us = self.bounds(access, index)
        return start_us, end_us, access.read_times(start_us, end_us)


def windows_that_fit(length: int, size: int, stride: int) -> int:
    """Return how many windows of ``size``, ``stride`` apart, lie within ``length``."""
    return max(0, (length - size) // stride + 1) if length >= size else 0


def positive(name: str, value: float | None) -> int:
    """Return a whole number, which may be a float such as 20e3.

    Raises:
        ValueError: if it is missing, not whole or not positive.
    """
    if isinstance(value, int | float | np.integer) and 1 <= value < 2**63 and value == int(value):
        return int(value)
    unit = " of microseconds" if name.endswith("_us") else ""
    raise ArgumentError("{argument} must be a positive integer{}: got {!r}", unit, value, argument=name)
