"""Reads and encodes AEDAT 2.0, jAER's format: lines of text, then records of address and time, of eight bytes each.

An address with bit 31 clear is an event (y in bits 22-30, x 12-21, polarity 11) or, with bit 10, an external input.
With bit 31 set it is a sample of a frame or, with bits 10 and 11 too, a word of an inertial sample. Of events both
coordinates are mirrored (their origin is at the lower right), of samples of frames only y is (lower left).

Source: docs.inivation.com, AEDAT 2.0; jAER, DavisChip, DavisBaseCamera and IMUSample.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from datetime import datetime
from pathlib import Path
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from ..._core import DecodeError
from ..._util.argument_error import ArgumentError
from ..._util.array_types import IntegerArray
from ...events.arrays import EventArray
from ...events.decoded import TriggerKind
from .aedat2_frames import Samples, assemble
from .recording import event_array, imu_array, known_chip, size_of, trigger_array
from .recording_file import EMPTY, RECORDED_KINDS, Piece, RecordingFile, Remarks

MAGIC = b"#!AER-DAT2.0"

_RECORD = np.dtype([("address", ">u4"), ("t", ">i4")])
_AT_ONCE = 1 << 16
"""Records of a piece."""
_LINES = re.compile(rb"(?:#[\t\x20-\xff]*\r?\n)*")
"""Lines of the header. A record may begin with a '#' too, but has bytes that text has not, or no end of line."""
_BEGUN_LINE = re.compile(rb"(?:#[\t\x20-\xff]*\r?)?\Z")
_LAST_LINE = b"#End Of ASCII Header\r\n"

_NOT_EVENT, _READ, _EXTERNAL = 1 << 31, 3 << 10, 1 << 10
_IMU = _NOT_EVENT | _READ

_WORDS = 7
"""Of an inertial sample: acceleration x, y, z, temperature, rotation x, y, z."""

_ACCELEROMETER_RANGES, _GYROSCOPE_RANGES = (2, 4, 8, 16), (250, 500, 1000, 2000)
_PREFERENCES = {
    "accelerometer": (rb"ImuAccelScaleG(\d{1,2})", _ACCELEROMETER_RANGES, 8, "g"),
    "gyroscope": (rb"GyroFullScaleDegPerSec(\d{1,4})", _GYROSCOPE_RANGES, 1000, "deg/s"),
}
"""For each sensor: the name of its full scale in jAER's preferences, the possible ones, jAER's default, and the
unit."""


_JAER_CLASSES = {
    (128, 128): "Davis128",
    (240, 180): "DAVIS240C",
    (346, 260): "Davis346B",
    (640, 480): "Davis640",
}
"""By size of the sensor, the camera that jAER knows it by: its class in eu.seebetter.ini.chips.davis."""


def jaer_class(width: int, height: int) -> str:
    """Return the name of jAER's camera of a size.

    Raises:
        ArgumentError: for a size that no DAVIS has.
    """
    if (width, height) not in _JAER_CLASSES:
        known = ", ".join(f"{wide}x{high}" for wide, high in _JAER_CLASSES)
        raise ArgumentError(
            "{size} {}x{}: aedat2 names a camera in place of a size, and there is one of {}", width, height, known
        )
    return _JAER_CLASSES[width, height]


def header_of(width: int, height: int) -> bytes:
    """Return the lines that a file of a sensor begins with, as jAER wants them: each ends with CR and LF."""
    lines = [
        MAGIC.decode(),
        "# This is a raw AE data file - do not edit",
        "# Data format is int32 address, int32 timestamp (8 bytes total), repeated for each event",
        "# Timestamps tick is 1 us",
        f"# AEChip: eu.seebetter.ini.chips.davis.{jaer_class(width, height)}",
        "# Written by davis_rs",
    ]
    return "".join(f"{line}\r\n" for line in lines).encode() + _LAST_LINE


def records_of(events: EventArray, width: int, height: int) -> npt.NDArray[np.void]:
    """Return the records (n,) of events on a sensor, with times from 0 to 2^31 - 1."""
    records = np.empty(len(events), _RECORD)
    x, y = width - 1 - events["x"].astype(np.uint32), height - 1 - events["y"].astype(np.uint32)
    records["address"] = y << 22 | x << 12 | events["p"].astype(np.uint32) << 11
    records["t"] = events["t"]
    return records


class Aedat2File(RecordingFile):
    """Reads a file of AEDAT 2.0. The samples of its frames are held in memory until all are there, where frames are
    asked for, because nothing marks where one begins."""

    format = "AEDAT 2.0"

    def __init__(
        self,
        path: Path,
        *,
        chip: str | None = None,
        accelerometer_range_g: int | None = None,
        gyroscope_range_deg_s: int | None = None,
        **_: object,
    ) -> None:
        with path.open("rb") as file:
            header = _header(file)
        self._start = len(header)
        chip_name = known_chip(chip, _line(header, rb"AEChip:\s*(\S+)"))
        if not chip_name:
            raise DecodeError(
                f"{path}, byte 0: a file of which no line '# AEChip:' names a DAVIS that is known; "
                "its coordinates are mirrored in a size that only chip= can tell (davis_rs.read_recording)"
            )
        self.width, self.height = size_of(chip_name)
        super().__init__(path, chip_name, (self.width, self.height), started=_started(header))
        self._scale_notes: list[str] = []
        self.accelerometer_range_g = _full_scale("accelerometer", accelerometer_range_g, header, self._scale_notes)
        self.gyroscope_range_deg_s = _full_scale("gyroscope", gyroscope_range_deg_s, header, self._scale_notes)

    def pieces(self, kinds: Collection[str] = RECORDED_KINDS, remarks: Remarks | None = None) -> Iterator[Piece]:
        remarks = Remarks() if remarks is None else remarks
        imu = _ImuWords(self.accelerometer_range_g or 0, self.gyroscope_range_deg_s or 0)
        samples = [Samples(*np.zeros((5, 0), np.int64))]
        clock: _Clock | None = None
        unknown = 0
        with self.path.open("rb") as file:
            total = max(file.seek(0, 2), 1)
            at = file.seek(self._start)
            while data := file.read(_AT_ONCE * _RECORD.itemsize):
                records = np.frombuffer(data, _RECORD, len(data) // _RECORD.itemsize)
                if clock is None:
                    clock = _Clock.at_start(int(records["t"][0]) if len(records) else 0)
                position = (at, len(records), clock.base, clock.last)
                address = records["address"].astype(np.uint32)
                t = clock.unwrapped(records["t"])
                at += len(data)
                piece = EMPTY
                if "events" in kinds:
                    piece = piece._replace(events=self._events(address, t))
                if "triggers" in kinds:
                    is_external = address & (_NOT_EVENT | _EXTERNAL) == _EXTERNAL
                    triggers, strange = _triggers(t[is_external], address[is_external] & 0x3FF)
                    piece, unknown = piece._replace(triggers=triggers), unknown + strange
                if "imu" in kinds:
                    piece = piece._replace(imu=imu.take(address, t))
                if "frames" in kinds:
                    samples.append(self._samples(address, t))
                yield Piece(piece, at / total, position)
                if rest := len(data) % _RECORD.itemsize:
                    size = _RECORD.itemsize
                    remarks.cut.append(f"byte {at - rest}: the last record is cut off after {rest} of {size} bytes")
                    at -= rest
        if unknown:
            remarks.notes.append(f"{unknown} special events of unknown kinds left out")
        if "imu" in kinds:
            remarks.notes.extend(self._scale_notes)
            left = imu.finish(remarks.notes)
            if left:
                at -= left * _RECORD.itemsize
                remarks.cut.append(f"byte {at}: the last inertial sample is cut off after {left} of {_WORDS} words")
        if "frames" in kinds:
            joined = Samples(*map(np.concatenate, zip(*samples, strict=True)))
            double = "240" in self.chip
            frames = assemble(joined, self.width, self.height, samples_count_double=double, notes=remarks.notes)
            yield Piece(EMPTY._replace(frames=frames), 1.0)

    def has(self, kind: str) -> bool:
        if kind != "frames":
            return super().has(kind)
        with self.path.open("rb") as file:  # any sample of one, without putting them together
            file.seek(self._start)
            while data := file.read(_AT_ONCE * _RECORD.itemsize):
                records = np.frombuffer(data, _RECORD, len(data) // _RECORD.itemsize)
                if len(self._samples(records["address"].astype(np.uint32), records["t"]).t):
                    return True
        return False

    def counts(self, kinds: Collection[str]) -> dict[str, int | None]:
        counts = super().counts([kind for kind in kinds if kind != "frames"])
        if "frames" in kinds:
            counts["frames"] = None if self.has("frames") else 0
        return counts

    def events_at(self, position: tuple[int, ...]) -> EventArray:
        at, count, base, last = position
        with self.path.open("rb") as file:
            file.seek(at)
            records = np.fromfile(file, _RECORD, count)
        return self._events(records["address"].astype(np.uint32), _Clock(base, last).unwrapped(records["t"]))

    def _events(self, address: npt.NDArray[np.uint32], t: npt.NDArray[np.int64]) -> EventArray:
        is_event = address & (_NOT_EVENT | _EXTERNAL) == 0
        address = address[is_event]
        # What lies outside wraps around to more than any size.
        x = np.uint32(self.width - 1) - (address >> 12 & 0x3FF)
        y = np.uint32(self.height - 1) - (address >> 22 & 0x1FF)
        return event_array(t[is_event], x.astype(np.uint16), y.astype(np.uint16), address >> 11 & 1)

    def _samples(self, address: npt.NDArray[np.uint32], t: npt.NDArray[np.int64]) -> Samples:
        is_sample = (address & _NOT_EVENT != 0) & (address & _READ != _READ)
        # Of samples x is that of the image.
        sample = address[is_sample].astype(np.int64)
        x, y = sample >> 12 & 0x3FF, (self.height - 1) - (sample >> 22 & 0x1FF)
        return Samples(t[is_sample], x, y, sample >> 10 & 3, sample & 0x3FF)


class _Clock:
    """Unwraps times of more than the file's 32 bits, which begin again at -2^31. ``base`` is what that has come to so
    far, and ``last`` the stamp before."""

    def __init__(self, base: int, last: int) -> None:
        self.base, self.last = base, last

    @classmethod
    def at_start(cls, first: int) -> _Clock:
        """Return a file's clock by its first stamp: one below 0 is from a camera that had been on for 36 minutes."""
        return cls(1 << 32 if first < 0 else 0, first)

    def unwrapped(self, stamps: IntegerArray) -> npt.NDArray[np.int64]:
        """Return the times of the records that come next."""
        t = np.concatenate([np.array([self.last]), stamps.astype(np.int64)])
        anew = (t[1:] < t[:-1] - (1 << 31)).cumsum() << 32
        self.last = int(t[-1])
        t = t[1:] + self.base + anew
        self.base += int(anew[-1]) if len(anew) else 0
        return t


class _ImuWords:
    """Inertial samples, whose words follow each other directly; those of one may lie in two pieces."""

    def __init__(self, accelerometer: int, gyroscope: int) -> None:
        self._scales = {"g": accelerometer / 32768, "deg_s": gyroscope / 32768}
        self._address, self._t = np.zeros(0, np.uint32), np.zeros(0, np.int64)
        self._words = self._whole = 0

    def take(self, address: npt.NDArray[np.uint32], t: npt.NDArray[np.int64]) -> npt.NDArray[np.void]:
        """Return the samples that end in these records."""
        self._words += int(np.count_nonzero(address & _IMU == _IMU))
        address, t = np.concatenate([self._address, address]), np.concatenate([self._t, t])
        kept = max(len(address) - _WORDS + 1, 0)
        self._address, self._t = address[kept:].copy(), t[kept:].copy()
        code = _codes(address)
        begins = np.flatnonzero(code[:kept] == 0)
        words = begins[:, None] + np.arange(_WORDS)
        words = words[(code[words] == np.arange(_WORDS)).all(axis=1)]
        self._whole += len(words)
        counts = (address[words] >> 12 & 0xFFFF).astype(np.uint16).view(np.int16)
        return imu_array(t[words[:, 0]], counts[:, :3], counts[:, 4:], counts[:, 3] / 340 + 35, **self._scales)

    def finish(self, notes: list[str]) -> int:
        """Return how many words of a sample stand at the end of the file."""
        code = _codes(self._address)
        begins = np.flatnonzero(code == 0)
        left = len(code) - int(begins[-1]) if len(begins) else 0
        if left and (code[-left:] != np.arange(left)).any():
            left = 0
        if broken := self._words - _WORDS * self._whole - left:
            notes.append(f"{broken} words of incomplete inertial samples left out")
        return left


def _codes(address: npt.NDArray[np.uint32]) -> npt.NDArray[np.int64]:
    """Return which word of an inertial sample each record is, :data:`_WORDS` where it is something else."""
    return np.where(address & _IMU == _IMU, (address >> 28 & 7).astype(np.int64), _WORDS)


def _header(file: BinaryIO) -> bytes:
    """Return the lines that a file begins with."""
    data = b""
    while more := file.read(max(len(data), 1 << 16)):
        data += more
        end = len(_lines(data))
        if _BEGUN_LINE.match(data, end) is None:
            break
    lines = _lines(data)
    last = lines.find(_LAST_LINE)
    return lines if last < 0 else lines[: last + len(_LAST_LINE)]


def _lines(data: bytes) -> bytes:
    lines = _LINES.match(data)
    return b"" if lines is None else lines[0]


def _line(header: bytes, pattern: bytes) -> str:
    """Return what a pattern finds in the header, or nothing."""
    match = re.search(pattern, header)
    return "" if match is None else match[1].decode("latin-1").strip()


def _started(header: bytes) -> datetime | None:
    """Read '# created Fri Sep 18 09:50:42 CEST 2015'; the zone is only a name, so it is not used."""
    words = _line(header, rb"# created ([^\r\n]*)").split()
    try:
        return datetime.strptime(" ".join([*words[1:4], words[-1]]), "%b %d %H:%M:%S %Y") if words else None
    except ValueError:
        return None


def _triggers(t: npt.NDArray[np.int64], kind: npt.NDArray[np.uint32]) -> tuple[npt.NDArray[np.void], int]:
    """Return triggers, and how many there are of unknown kinds."""
    # Older versions did not write the kind.
    kind = np.where(kind == 0, TriggerKind.INPUT_PULSE, kind)
    known = (kind >= TriggerKind.INPUT_FALLING) & (kind <= TriggerKind.INPUT_PULSE)
    return trigger_array(t[known], kind[known]), int(np.count_nonzero(~known))


def _full_scale(sensor: str, given: int | None, header: bytes, notes: list[str]) -> int:
    """Return the one given, or the one of the header, or jAER's default."""
    pattern, ranges, default, unit = _PREFERENCES[sensor]
    if given is not None:
        if given not in ranges:
            raise ValueError(f"{sensor} range must be one of {ranges} {unit}, got {given}")
        return given
    stated = {int(value) for value in re.findall(pattern, header)} & set(ranges)
    if len(stated) == 1:
        value = stated.pop()
        notes.append(f"{sensor} range +-{value} {unit}, from the preferences in the header")
        return value
    notes.append(f"{sensor} range assumed to be jAER's default, +-{default} {unit}: the file does not say")
    return default
