"""Holds what a recording has, whatever its format was."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..._core import Device
from ..._util.array_types import IntegerArray, NumberArray
from ...events.arrays import EVENT_DTYPE, EventArray
from ...events.decoded import IMU_DTYPE, STANDARD_GRAVITY, TRIGGER_DTYPE, Decoded, Frame, TriggerKind
from ...events.luma import LUMA_WEIGHTS

RADIANS = math.pi / 180


class RecordingWarning(UserWarning):
    """Says that something of a recording is not there or was assumed: its end is cut off, or a conversion tells its
    notes."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Holds a recording, in the arrays of :class:`davis_rs.Decoder`, each in the order of the file.

    Times are those of the file: of AEDAT 4 microseconds since 1970 (UTC), of the others those of the camera's clock;
    :meth:`from_start` makes them count from the first.

    Attributes:
        path: the file.
        format: ``"AEDAT 2.0"``, ``"AEDAT 3.1"``, ``"AEDAT 4"`` or ``"camera bytes"``.
        chip: the camera's, such as ``"DAVIS240C"``; empty if the file does not name one that is known.
        width, height: of the image that events fall on; from the events where nothing else tells.
        events: :data:`davis_rs.EVENT_DTYPE`; y downwards, also where the file has it upwards.
        imu: :data:`davis_rs.IMU_DTYPE`, SI units, along the sensor's axes as the file has them.
        frames: whole ones, as intensities of 16 bits: an 8-bit value times 256, colour by the weights of BT.601.
        triggers: :data:`davis_rs.TRIGGER_DTYPE`.
        started: when the recording began, if the file says; of AEDAT 2.0 without a time zone, in that of the recorder.
        accelerometer_range_g, gyroscope_range_deg_s: full scales that made counts into units; None where the file has
            units.
        cut: what the end of the file cuts off, at which byte.
        notes: what was assumed, and what was left out.
    """

    path: Path
    format: str
    chip: str
    width: int
    height: int
    events: EventArray
    imu: npt.NDArray[np.void]
    frames: list[Frame]
    triggers: npt.NDArray[np.void]
    started: datetime | None = None
    accelerometer_range_g: int | None = None
    gyroscope_range_deg_s: int | None = None
    cut: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        parts = f"{len(self.events):,} events, {len(self.frames):,} frames, {len(self.imu):,} IMU samples"
        return f"<Recording {self.path}, {self.chip or self.format}, {self.width} x {self.height} px, {parts}>"

    @property
    def decoded(self) -> Decoded:
        """Return events, inertial samples, frames and triggers alone."""
        return Decoded(self.events, self.imu, self.frames, self.triggers)

    @property
    def device(self) -> Device:
        """Return what a decoder or encoder has to know of the camera.

        Raises:
            ValueError: if the chip is not known.
        """
        return Device(self.chip)

    @property
    def start_us(self) -> int:
        """Return the first time in it, in microseconds; 0 if it is empty. Resets of the camera's clock do not count."""
        times = [int(part["t"].min()) for part in (self.events, self.imu, _dated(self.triggers)) if len(part)]
        return min([*times, *(frame.t for frame in self.frames)], default=0)

    def from_start(self) -> Recording:
        """Return the recording with times that count from :attr:`start_us`, as those of a sequence do."""
        start = self.start_us
        events, imu, triggers = self.events.copy(), self.imu.copy(), self.triggers.copy()
        events["t"] -= start
        imu["t"] -= start
        triggers["t"][triggers["kind"] != TriggerKind.TIMESTAMP_RESET] -= start
        frames = [
            frame._replace(**{name: getattr(frame, name) - start for name in Frame._fields[:4]})
            for frame in self.frames
        ]
        return replace(self, events=events, imu=imu, frames=frames, triggers=triggers)


def known_chip(given: str | None, text: str) -> str:
    """Return the decoder's name of the camera's chip: the one given, or the one that a file's text names; or empty.

    Raises:
        ValueError: if what is given is not one.
    """
    if given is not None:
        return Device(given).chip
    match = re.search(r"(?i:davis)(128|240|346|640)(?:([ABCabc])(?![a-z]))?", text)
    if match is None:
        return ""
    size, letter = match[1], (match[2] or "").upper()
    # Sizes that came in several versions need a letter; the latest one that was sold, if there is none.
    return f"DAVIS{size}{letter or _LATEST[size]}" if size in _LATEST else f"DAVIS{size}"


_LATEST = {"240": "C", "346": "B"}


def size_of(chip: str) -> tuple[int, int]:
    """Return width and height of a chip."""
    device = Device(chip)
    return device.width, device.height


def spanned(events: EventArray) -> tuple[int, int]:
    """Return width and height that the events need."""
    return (int(events["x"].max()) + 1, int(events["y"].max()) + 1) if len(events) else (0, 0)


def inside(events: EventArray, width: int, height: int, notes: list[str]) -> EventArray:
    """Return the events of the image; a note tells of others."""
    within = (events["x"] < width) & (events["y"] < height)
    if within.all():
        return events
    notes.append(f"{np.count_nonzero(~within)} events outside of {width} x {height} pixels left out")
    return events[within]


def event_array(t: npt.ArrayLike, x: npt.ArrayLike, y: npt.ArrayLike, p: npt.ArrayLike) -> EventArray:
    """Return events from columns of one length."""
    events = np.zeros(len(np.asarray(t)), EVENT_DTYPE)
    events["t"], events["x"], events["y"], events["p"] = t, x, y, p
    return events


def imu_array(
    t: npt.NDArray[np.int64],
    accel: NumberArray,
    gyro: NumberArray,
    temperature: NumberArray,
    *,
    g: float = 1.0,
    deg_s: float = 1.0,
) -> npt.NDArray[np.void]:
    """Return samples from columns: acceleration (n, 3) in units of ``g`` times gravity, rotation (n, 3) of ``deg_s``
    deg/s."""
    imu = np.zeros(len(t), IMU_DTYPE)
    imu["t"], imu["temperature"] = t, temperature
    # The units first, as the decoder does it: the same counts are then the same numbers.
    imu["accel"] = accel.astype(np.float64) * (g * STANDARD_GRAVITY)
    imu["gyro"] = gyro.astype(np.float64) * (deg_s * RADIANS)
    return imu


def trigger_array(t: npt.NDArray[np.int64], kind: IntegerArray) -> npt.NDArray[np.void]:
    """Return triggers from columns of one length."""
    triggers = np.zeros(len(t), TRIGGER_DTYPE)
    triggers["t"], triggers["kind"] = t, kind
    return triggers


def _dated(triggers: npt.NDArray[np.void]) -> npt.NDArray[np.void]:
    """Return all but resets, whose time says nothing."""
    return triggers[triggers["kind"] != TriggerKind.TIMESTAMP_RESET]


def grey(pixels: IntegerArray, order: str) -> npt.NDArray[np.uint16]:
    """Return intensities of 16 bits from pixels (height, width, channels) of 16 bits: one, or ``RGB`` or ``BGR`` and
    alpha."""
    if pixels.shape[2] == 1:
        return pixels[:, :, 0].astype(np.uint16)
    red, green, blue = (pixels[:, :, order.index(colour)] for colour in "RGB")
    weighted = LUMA_WEIGHTS[0] * red + LUMA_WEIGHTS[1] * green + LUMA_WEIGHTS[2] * blue
    return np.rint(weighted).astype(np.uint16)
