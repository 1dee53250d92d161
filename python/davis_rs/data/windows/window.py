"""Holds one window of events, with what belongs to it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar, overload

import numpy as np
import numpy.typing as npt

from ...events.arrays import EventArray
from ...events.packet import Displacement
from ...geometry.pose import Pose
from ...sensor.imu import IMU_DTYPE, ImuArray

_Image = TypeVar("_Image")


class WindowImages(Sequence[_Image], Generic[_Image]):
    """Images of a window in order of time; each is read from its file whenever it is asked for.

    Attributes:
        t_us: int64 (n,): their times in microseconds.
    """

    def __init__(self, t_us: npt.NDArray[np.int64], first: int, read: Callable[[int], _Image]) -> None:
        self.t_us = t_us
        self._first, self._read = first, read

    def __len__(self) -> int:
        return len(self.t_us)

    @overload
    def __getitem__(self, index: int) -> _Image: ...
    @overload
    def __getitem__(self, index: slice) -> list[_Image]: ...
    def __getitem__(self, index: int | slice) -> _Image | list[_Image]:
        numbers = range(self._first, self._first + len(self))
        if isinstance(index, slice):
            return [self._read(number) for number in numbers[index]]
        return self._read(numbers[index])

    def __repr__(self) -> str:
        return f"<{len(self)} images, {self.t_us.tolist()} us>"


def no_images() -> WindowImages[Any]:
    """Return the images of a window without any."""
    return WindowImages(np.zeros(0, np.int64), 0, lambda _: None)


@dataclass(frozen=True)
class EventWindow:
    """Events of a stretch of time, and what a dataset folder has of the same stretch.

    Attributes:
        start_us, end_us: the stretch, start_us <= t < end_us.
        events: :data:`davis_rs.EVENT_DTYPE`, an array of the caller's.
        size: (width, height) of the sensor in pixels, None where it is not known.
        frames: intensity frames, uint8 (H, W).
        depth_maps: metres along the optical axis, float32 (H, W).
        flow_maps: pixels per second, float32 (H, W, 2).
        displacements: how far points go in the image, :class:`davis_rs.Displacement`.
        masks: numbers of shapes, uint16 (H, W).
        imu: inertial samples, :data:`davis_rs.IMU_DTYPE`.
        start_pose, end_pose: the camera's at the stretch's ends, interpolated (positions along lines, rotations along
            the shortest arc); None outside of the ground truth.
    """

    start_us: int
    end_us: int
    events: EventArray
    size: tuple[int, int] | None = None
    frames: WindowImages[npt.NDArray[np.uint8]] = field(default_factory=no_images)
    depth_maps: WindowImages[npt.NDArray[np.float32]] = field(default_factory=no_images)
    flow_maps: WindowImages[npt.NDArray[np.float32]] = field(default_factory=no_images)
    displacements: WindowImages[Displacement] = field(default_factory=no_images)
    masks: WindowImages[npt.NDArray[np.uint16]] = field(default_factory=no_images)
    imu: ImuArray = field(default_factory=lambda: np.zeros(0, IMU_DTYPE))
    start_pose: Pose | None = None
    end_pose: Pose | None = None

    def __repr__(self) -> str:
        return f"<EventWindow {self.start_us}..{self.end_us} us, {len(self.events):,} events>"
