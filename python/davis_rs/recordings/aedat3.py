"""AEDAT 3.1, cAER's format: packets of one type each, little-endian, after lines of text.

Source: docs.inivation.com, AEDAT 3.1; libcaer's events (the same structures in memory).
"""

from __future__ import annotations

import re
import struct
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .._core import DecodeError
from ..decoded import Frame, TriggerKind
from ..events import concatenate_events
from .recording import Recording, event_array, grey, imu_array, inside, known_chip, size_of, trigger_array

MAGIC = b"#!AER-DAT3.1"

_END = b"#!END-HEADER\r\n"
_PACKET = struct.Struct("<hhiiiiii")
"""Type, source, size of an event, offset of its time, overflows of the clock, capacity, number, valid ones."""
_SPECIAL, _POLARITY, _FRAME, _IMU6 = range(4)

_PAIR = np.dtype([("data", "<u4"), ("t", "<i4")])
_IMU6_EVENT = np.dtype([("info", "<u4"), ("t", "<i4"), ("accel", "<f4", 3), ("gyro", "<f4", 3), ("temperature", "<f4")])
_FRAME_HEADER = struct.Struct("<Iiiiiiiii")
"""Information, times of start, end, exposure's start and end, width, height, position x, y."""
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


class _Parts:
    """What packets give, by type."""

    def __init__(self) -> None:
        self.events = [event_array([], [], [], [])]
        self.imu = [_imu(np.zeros(0, _IMU6_EVENT), 0)]
        self.triggers = [_triggers(np.zeros(0, _PAIR), 0)]
        self.frames: list[Frame] = []
        self.invalid = self.others = 0


def read(path: Path, *, chip: str | None, **_: Any) -> Recording:
    """Read a file; see :func:`davis_rs.read_recording`."""
    data = path.read_bytes()
    end = data.find(_END)
    if end < 0:
        raise DecodeError(f"{path}, byte {len(data)}: expected a line '#!END-HEADER', the file ends")
    header = data[:end].decode("latin-1")
    form = re.search(r"#Format: *([^\r\n]*)", header)
    if form is not None and form[1].strip() != "RAW":
        raise DecodeError(f"{path}, byte {form.start(1)}: only the format RAW is read, found {form[1]!r}")
    source = re.search(r"#Source \d+: *([^\r\n]*)", header)
    chip = known_chip(chip, "" if source is None else source[1])

    parts = _Parts()
    cut: list[str] = []
    at = end + len(_END)
    while at < len(data):
        if len(data) - at < _PACKET.size:
            cut.append(f"byte {at}: the last packet's header is cut off after {len(data) - at} of {_PACKET.size} bytes")
            break
        kind, _source, size, _offset, overflow, _capacity, number, _valid = _PACKET.unpack_from(data, at)
        if kind < 0 or size <= 0 or number < 0 or overflow < 0 or _SIZES.get(kind, size) != size:
            raise DecodeError(
                f"{path}, byte {at}: expected the header of a packet, found type {kind} with {number} events of "
                f"{size} bytes at overflow {overflow}"
            )
        at += _PACKET.size
        there = min(number, (len(data) - at) // size)
        _take(parts, f"{path}, byte", data, at, kind, size, overflow << 31, there)
        if there < number:
            cut.append(f"byte {at + there * size}: the last packet is cut off after {there} of {number} events")
            break
        at += number * size

    events = concatenate_events(parts.events)
    width, height = size_of(chip, events)
    notes = [f"{parts.invalid} events marked as not valid left out"] if parts.invalid else []
    if parts.others:
        notes.append(f"{parts.others} packets of other types, or special events of other kinds, left out")
    events = inside(events, width, height, notes)
    return Recording(
        path=path, format="AEDAT 3.1", chip=chip, width=width, height=height,
        events=events, imu=np.concatenate(parts.imu), frames=parts.frames, triggers=np.concatenate(parts.triggers),
        started=_started(header), cut=tuple(cut), notes=tuple(notes),
    )  # fmt: skip


def _take(parts: _Parts, place: str, data: bytes, at: int, kind: int, size: int, base: int, number: int) -> None:
    """Add the events of a packet."""
    if kind == _FRAME:
        for k in range(number):
            frame = _frame(place, data, at + k * size, size, base)
            if frame is None:
                parts.invalid += 1
            else:
                parts.frames.append(frame)
    elif kind == _IMU6:
        samples = np.frombuffer(data, _IMU6_EVENT, number, at)
        valid = samples[samples["info"] & 1 == 1]
        parts.imu.append(_imu(valid, base))
        parts.invalid += number - len(valid)
    elif kind in (_SPECIAL, _POLARITY):
        pairs = np.frombuffer(data, _PAIR, number, at)
        valid = pairs[pairs["data"] & 1 == 1]
        parts.invalid += number - len(valid)
        if kind == _POLARITY:
            word = valid["data"]
            t = valid["t"].astype(np.int64) + base
            parts.events.append(event_array(t, word >> 17, word >> 2 & 0x7FFF, word >> 1 & 1))
        else:
            parts.triggers.append(_triggers(valid, base))
            parts.others += len(valid) - len(parts.triggers[-1])
    else:
        parts.others += 1


def _imu(samples: npt.NDArray[Any], base: int) -> npt.NDArray[Any]:
    t = samples["t"].astype(np.int64) + base
    return imu_array(t, samples["accel"], samples["gyro"], samples["temperature"])


def _triggers(pairs: npt.NDArray[Any], base: int) -> npt.NDArray[Any]:
    kinds = np.zeros(128, np.uint8)
    kinds[list(_KINDS)] = list(_KINDS.values())
    kind = kinds[pairs["data"] >> 1 & 0x7F]
    # The decoder's time of a reset is 0; here it is the highest that there is.
    t = np.where(kind == TriggerKind.TIMESTAMP_RESET, 0, pairs["t"].astype(np.int64) + base)
    return trigger_array(t[kind > 0], kind[kind > 0])


def _frame(place: str, data: bytes, at: int, size: int, base: int) -> Frame | None:
    """A frame, or None if it is marked as not valid."""
    if size < _FRAME_HEADER.size:
        raise DecodeError(f"{place} {at}: a frame has at least {_FRAME_HEADER.size} bytes, found {size}")
    info, start, end, exposed, covered, width, height, x, y = _FRAME_HEADER.unpack_from(data, at)
    if not info & 1:
        return None
    channels = info >> 1 & 7
    if channels not in (1, 3, 4) or min(width, height) < 1 or min(x, y) < 0 or (
        _FRAME_HEADER.size + 2 * width * height * channels > size
    ):  # fmt: skip
        raise DecodeError(
            f"{place} {at}: a frame of {width} x {height} pixels in {channels} channels at ({x}, {y}) "
            f"does not fit into {size} bytes"
        )
    pixels = np.frombuffer(data, "<u2", width * height * channels, at + _FRAME_HEADER.size)
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
