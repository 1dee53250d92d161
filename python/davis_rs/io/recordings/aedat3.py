"""Reads AEDAT 3.1, cAER's format: packets of one type each, little-endian, after lines of text.

Source: docs.inivation.com, AEDAT 3.1; libcaer's events (the same structures in memory).
"""

from __future__ import annotations

import re
import struct
from collections.abc import Collection, Iterator
from datetime import datetime
from pathlib import Path
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from ..._core import DecodeError
from ..._util.budget import Budget
from ...events.arrays import EventArray
from ...events.decoded import Decoded, Frame, TriggerKind
from .recording import event_array, grey, imu_array, known_chip, size_of, trigger_array
from .recording_file import EMPTY, RECORDED_KINDS, Piece, RecordingFile, Remarks

MAGIC = b"#!AER-DAT3.1"

_END = b"#!END-HEADER\r\n"
_PACKET = struct.Struct("<hhiiiiii")
"""Type, source, size of an event, offset of its time, overflows of the clock, capacity, number, valid ones."""
_SPECIAL, _POLARITY, _FRAME, _IMU6 = range(4)

_PAIR = np.dtype([("data", "<u4"), ("t", "<i4")])
_IMU6_EVENT = np.dtype([("info", "<u4"), ("t", "<i4"), ("accel", "<f4", 3), ("gyro", "<f4", 3), ("temperature", "<f4")])
_FRAME_HEADER = struct.Struct("<Iiiiiiiii")
"""Information, times of start, end, exposure's start and end, width, height, position x, y."""
_HOLD: dict[int, str] = {_SPECIAL: "triggers", _POLARITY: "events", _FRAME: "frames", _IMU6: "imu"}
"""What packets of each type hold."""
_SIZES = {_SPECIAL: _PAIR.itemsize, _POLARITY: _PAIR.itemsize, _IMU6: _IMU6_EVENT.itemsize}

_KINDS = {
    1: TriggerKind.TIMESTAMP_RESET,
    2: TriggerKind.INPUT_RISING,
    3: TriggerKind.INPUT_FALLING,
    4: TriggerKind.INPUT_PULSE,
    12: TriggerKind.GENERATOR_RISING,
    13: TriggerKind.GENERATOR_FALLING,
}
"""Of special events; others tell of the wire (0: the clock's overflow, 5: a row alone, 14 to 17: frames)."""


_AT_ONCE = 1 << 16
"""Most events of a piece."""
_LONGEST_HEADER = 1 << 20


class Aedat3File(RecordingFile):
    """Reads a file of AEDAT 3.1. Of a chip that is not known, the size is not known either."""

    format = "AEDAT 3.1"

    def __init__(self, path: Path, *, chip: str | None = None, **_: object) -> None:
        with path.open("rb") as file:
            data = file.read(_LONGEST_HEADER)
        end = data.find(_END)
        if end < 0:
            ends = "the header does not" if len(data) == _LONGEST_HEADER else "the file ends"
            raise DecodeError(f"{path}, byte {len(data)}: expected a line '#!END-HEADER', {ends}")
        header = data[:end].decode("latin-1")
        form = re.search(r"#Format: *([^\r\n]*)", header)
        if form is not None and form[1].strip() != "RAW":
            raise DecodeError(f"{path}, byte {form.start(1)}: only the format RAW is read, found {form[1]!r}")
        source = re.search(r"#Source \d+: *([^\r\n]*)", header)
        known = known_chip(chip, "" if source is None else source[1])
        super().__init__(path, known, size_of(known) if known else None, started=_started(header))
        self._start = end + len(_END)

    def pieces(self, kinds: Collection[str] = RECORDED_KINDS, remarks: Remarks | None = None) -> Iterator[Piece]:
        remarks = Remarks() if remarks is None else remarks
        wanted = {kind for kind, what in _HOLD.items() if what in kinds}
        everything = set(kinds) == set(RECORDED_KINDS)
        left_out, budget = _SkippedCounts(), Budget(self.path)
        with self.path.open("rb") as file:
            total = file.seek(0, 2)
            at = file.seek(self._start)
            while at < total:
                header = file.read(_PACKET.size)
                if len(header) < _PACKET.size:
                    remarks.cut.append(
                        f"byte {at}: the last packet's header is cut off after {len(header)} of {_PACKET.size} bytes"
                    )
                    break
                kind, _source, size, _offset, overflow, _capacity, number, _valid = _PACKET.unpack(header)
                if kind < 0 or size <= 0 or number < 0 or overflow < 0 or _SIZES.get(kind, size) != size:
                    raise DecodeError(
                        f"{self.path}, byte {at}: expected the header of a packet, found type {kind} with {number} "
                        f"events of {size} bytes at overflow {overflow}"
                    )
                at += _PACKET.size
                there = min(number, (total - at) // size)
                if kind in wanted:
                    for first in range(0, there, 1 if kind == _FRAME else _AT_ONCE):
                        count = 1 if kind == _FRAME else min(_AT_ONCE, there - first)
                        position = (at + first * size, kind, size, overflow, count)
                        with budget.borrow(count * size, f"a packet at byte {at}"):
                            decoded = self._part(file, position, left_out)
                        yield Piece(decoded, (position[0] + count * size) / total, position)
                elif everything:
                    left_out.others += 1
                if there < number:
                    remarks.cut.append(
                        f"byte {at + there * size}: the last packet is cut off after {there} of {number} events"
                    )
                    break
                at = file.seek(at + number * size)
        if left_out.invalid:
            remarks.notes.append(f"{left_out.invalid} events marked as not valid left out")
        if left_out.others:
            others = f"{left_out.others} packets of other types, or special events of other kinds, left out"
            remarks.notes.append(others)

    def events_at(self, position: tuple[int, ...]) -> EventArray:
        with self.path.open("rb") as file:
            return self._part(file, position, _SkippedCounts()).events

    def _part(self, file: BinaryIO, position: tuple[int, ...], left_out: _SkippedCounts) -> Decoded:
        """Return the events of one kind that stand at a place, or those of them that a cut file still has."""
        at, kind, size, overflow, count = position
        file.seek(at)
        data, base = file.read(count * size), overflow << 31
        if kind == _FRAME:
            frame = _frame(f"{self.path}, byte {at}", data, base)
            left_out.invalid += frame is None
            return EMPTY._replace(frames=[] if frame is None else [frame])
        records = np.frombuffer(data, _IMU6_EVENT if kind == _IMU6 else _PAIR, len(data) // size)
        valid = records[records["info" if kind == _IMU6 else "data"] & 1 == 1]
        left_out.invalid += len(records) - len(valid)
        if kind == _IMU6:
            return EMPTY._replace(imu=_imu(valid, base))
        if kind == _POLARITY:
            word = valid["data"]
            t = valid["t"].astype(np.int64) + base
            return EMPTY._replace(events=event_array(t, word >> 17, word >> 2 & 0x7FFF, word >> 1 & 1))
        triggers = _triggers(valid, base)
        left_out.others += len(valid) - len(triggers)
        return EMPTY._replace(triggers=triggers)


class _SkippedCounts:
    """Counts what was passed over: events that are not valid, and what is of other types."""

    def __init__(self) -> None:
        self.invalid = self.others = 0


def _imu(samples: npt.NDArray[np.void], base: int) -> npt.NDArray[np.void]:
    t = samples["t"].astype(np.int64) + base
    return imu_array(t, samples["accel"], samples["gyro"], samples["temperature"])


def _triggers(pairs: npt.NDArray[np.void], base: int) -> npt.NDArray[np.void]:
    kinds = np.zeros(128, np.uint8)
    kinds[list(_KINDS)] = list(_KINDS.values())
    kind = kinds[pairs["data"] >> 1 & 0x7F]
    # The decoder's time of a reset is 0; here it is the highest that there is.
    t = np.where(kind == TriggerKind.TIMESTAMP_RESET, 0, pairs["t"].astype(np.int64) + base)
    return trigger_array(t[kind > 0], kind[kind > 0])


def _frame(position: str, data: bytes, base: int) -> Frame | None:
    """Return a frame, or None if it is marked as not valid."""
    if len(data) < _FRAME_HEADER.size:
        raise DecodeError(f"{position}: a frame has at least {_FRAME_HEADER.size} bytes, found {len(data)}")
    info, start, end, exposed, covered, width, height, x, y = _FRAME_HEADER.unpack_from(data)
    if not info & 1:
        return None
    channels = info >> 1 & 7
    if channels not in (1, 3, 4) or min(width, height) < 1 or min(x, y) < 0 or (
        _FRAME_HEADER.size + 2 * width * height * channels > len(data)
    ):  # fmt: skip
        raise DecodeError(
            f"{position}: a frame of {width} x {height} pixels in {channels} channels at ({x}, {y}) "
            f"does not fit into {len(data)} bytes"
        )
    pixels = np.frombuffer(data, "<u2", width * height * channels, _FRAME_HEADER.size)
    times = (start + base, exposed + base, covered + base, end + base)
    image = grey(pixels.reshape(height, width, channels), "RGB")
    return Frame(*times, x, y, image, exposure_us=float(covered - exposed))


def _started(header: str) -> datetime | None:
    """Read '#Start-Time: 2016-06-03 17:12:58 (TZ+0200)'."""
    match = re.search(r"#Start-Time: *(\d+-\d+-\d+ \d+:\d+:\d+) *(?:\(TZ *([+-]\d{4})\))?", header)
    try:
        if match is None:
            return None
        if match[2] is None:
            return datetime.strptime(match[1], "%Y-%m-%d %H:%M:%S")
        return datetime.strptime(f"{match[1]} {match[2]}", "%Y-%m-%d %H:%M:%S %z")
    except ValueError:
        return None
