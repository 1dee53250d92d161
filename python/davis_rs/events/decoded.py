"""Defines what comes out of a DAVIS besides events: inertial samples, frames, triggers; and all of it together."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

STANDARD_GRAVITY = 9.806_65
"""One g, in which datasheets give full scales, in m/s^2 (CGPM 1901)."""

IMU_DTYPE = np.dtype([("t", "<i8"), ("accel", "<f8", 3), ("gyro", "<f8", 3), ("temperature", "<f8")], align=True)
"""An inertial sample in SI units, 64 bytes: time of its end in microseconds; acceleration along x, y, z in m/s^2;
rotation about x, y, z in rad/s; temperature in degrees Celsius. What a sample lacks is 0."""

IMU_COUNTS_DTYPE = np.dtype(
    [
        ("t", "<i8"),
        ("accel", "<i2", 3),
        ("gyro", "<i2", 3),
        ("temperature", "<i2"),
        ("groups", "u1"),
        ("accel_range", "u1"),
        ("gyro_range", "u1"),
    ],
    align=True,
)
"""The same in the sensor's counts, 32 bytes. ``groups``: what the sample holds, bits 4 acceleration, 2 rotation,
1 temperature. ``accel_range`` 0..3: full scale 2, 4, 8, 16 g; ``gyro_range`` 0..3: 250, 500, 1000, 2000 deg/s. A count
is full scale / 32768."""

TRIGGER_DTYPE = np.dtype([("t", "<i8"), ("kind", "u1")], align=True)
"""A trigger, 16 bytes: time in microseconds (of a reset of the clock: 0), and its :class:`TriggerKind`."""


class TriggerKind(IntEnum):
    """The kind of a trigger; its number is that of the word in the camera's stream."""

    TIMESTAMP_RESET = 1
    INPUT_FALLING = 2
    INPUT_RISING = 3
    INPUT_PULSE = 4
    GENERATOR_FALLING = 16
    GENERATOR_RISING = 17


class Frame(NamedTuple):
    """An intensity image of the active pixels.

    Attributes:
        t: when the camera began with it, in microseconds, as all times.
        t_exposure_start, t_exposure_end: when the exposure began and ended.
        t_end: when its last sample was read.
        x, y: the column and row of the image where its first pixel lies; 0, 0 for a full frame.
        pixels: uint16, shape (height, width): intensity in ten bits, times 64.
        global_shutter: whether all pixels were exposed at once, or column by column (rolling shutter).
        exposure_us: the exposure as the camera states it, in microseconds; 0 if it did not.
    """

    t: int
    t_exposure_start: int
    t_exposure_end: int
    t_end: int
    x: int
    y: int
    pixels: npt.NDArray[np.uint16]
    global_shutter: bool = True
    exposure_us: float = 0.0


class Decoded(NamedTuple):
    """A piece of a camera's stream, by kind; each kind in the order of the stream.

    Attributes:
        events: :data:`davis_rs.EVENT_DTYPE`.
        imu: inertial samples, :data:`IMU_DTYPE` or :data:`IMU_COUNTS_DTYPE`.
        frames: :class:`Frame`, whole ones.
        triggers: :data:`TRIGGER_DTYPE`.
    """

    events: npt.NDArray[np.void]
    imu: npt.NDArray[np.void]
    frames: list[Frame]
    triggers: npt.NDArray[np.void]
