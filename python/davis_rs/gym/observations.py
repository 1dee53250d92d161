"""Defines what a controller sees of a step, each as a space of Gymnasium and a value in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box, Sequence, Space

from ..events.arrays import EventArray
from ..events.represent import count_image, voxel_grid
from ..geometry.camera import Camera

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class StepShape:
    """Holds what the shapes of observations depend on.

    Attributes:
        camera: its size counts.
        step_us: length of a step.
        bins: planes of a voxel grid.
        imu_samples: in each step.
    """

    camera: Camera
    step_us: int
    bins: int
    imu_samples: int

    @property
    def size(self) -> tuple[int, int]:
        """Return width and height."""
        return self.camera.width, self.camera.height


class Seen(NamedTuple):
    """Holds what the sensor gave in a step that began at ``start_us``; frame and depth only where asked for."""

    start_us: int
    events: EventArray
    frame: npt.NDArray[np.float32] | None
    depth: npt.NDArray[np.float32] | None
    imu: npt.NDArray[np.float32]


class Observation(NamedTuple):
    """Defines one kind of observation."""

    space: Callable[[StepShape], Space[Any]]
    value: Callable[[StepShape, Seen], Array]


def _events_space(shape: StepShape) -> Space[Any]:
    width, height = shape.size
    low, high = np.array([0, 0, 0, 0]), np.array([shape.step_us, width - 1, height - 1, 1])
    return Sequence(Box(low, high, dtype=np.int64), stack=True)


def _events(shape: StepShape, seen: Seen) -> Array:
    rows = np.empty((len(seen.events), 4), np.int64)
    for column, name in enumerate("txyp"):
        rows[:, column] = seen.events[name]
    rows[:, 0] -= seen.start_us
    return rows


def _counts_space(shape: StepShape) -> Space[Any]:
    width, height = shape.size
    return Box(0, np.iinfo(np.uint32).max, (2, height, width), np.uint32)


def _voxel_space(shape: StepShape) -> Space[Any]:
    width, height = shape.size
    return Box(-np.inf, np.inf, (shape.bins, height, width), np.float32)


def _voxel(shape: StepShape, seen: Seen) -> Array:
    # A step is (start, end], a window [start, stop): both have the same events, a microsecond apart.
    start_us = seen.start_us + 1
    return voxel_grid(seen.events, shape.size, shape.bins, start_us=start_us, stop_us=start_us + shape.step_us)


def _image_space(shape: StepShape) -> Space[Any]:
    width, height = shape.size
    return Box(0, np.inf, (height, width), np.float32)


def _frame(shape: StepShape, seen: Seen) -> Array:
    assert seen.frame is not None
    return seen.frame


def _depth(shape: StepShape, seen: Seen) -> Array:
    assert seen.depth is not None
    return seen.depth


def _imu_space(shape: StepShape) -> Space[Any]:
    return Box(-np.inf, np.inf, (shape.imu_samples, 6), np.float32)


OBSERVATIONS: dict[str, Observation] = {
    "events": Observation(_events_space, _events),
    "counts": Observation(_counts_space, lambda shape, seen: count_image(seen.events, shape.size)),
    "voxel_grid": Observation(_voxel_space, _voxel),
    "frame": Observation(_image_space, _frame),
    "depth": Observation(_image_space, _depth),
    "imu": Observation(_imu_space, lambda shape, seen: seen.imu),
}
"""What may be asked for, by name.

- ``events``: int64 (n, 4), rows (t, x, y, p), with t in microseconds from the start of the step, in (0, step];
- ``counts``: uint32 (2, H, W), OFF before ON, see :func:`davis_rs.events.represent.count_image`;
- ``voxel_grid``: float32 (bins, H, W), from the start of the step to its end, see
  :func:`davis_rs.events.represent.voxel_grid`;
- ``frame``: float32 (H, W), luma at the end of the step, or what active pixels (effect ``aps``) make of it;
- ``depth``: float32 (H, W), metres at the end of the step, inf where nothing is seen;
- ``imu``: float32 (samples, 6), specific force (m/s^2) and angular rate (rad/s) in camera axes, each the mean over its
  part of the step.
"""
