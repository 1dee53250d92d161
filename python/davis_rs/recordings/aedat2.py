"""AEDAT 2.0, jAER's format: records of address and time, eight bytes each, big-endian, after lines of text.

An address with bit 31 clear is an event (y in bits 22-30, x 12-21, polarity 11) or, with bit 10, an external input.
With bit 31 set it is a sample of a frame or, with bits 10 and 11 too, a word of an inertial sample. Of events both
coordinates are mirrored (their origin is at the lower right), of samples of frames only y is (lower left).

Source: docs.inivation.com, AEDAT 2.0; jAER, DavisChip, DavisBaseCamera and IMUSample.
"""

from __future__ import annotations

import re
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .._core import DecodeError
from ..decoded import TriggerKind
from ..events import EventArray
from .aedat2_frames import Samples, assemble
from .recording import Recording, event_array, imu_array, known_chip, size_of, trigger_array

MAGIC = b"#!AER-DAT2.0"

_RECORD = np.dtype([("address", ">u4"), ("t", ">i4")])
_LINES = re.compile(rb"(?:#[\t\x20-\xff]*\r?\n)*")
"""Lines of the header. A record may begin with a '#' too, but has bytes that text has not, or no end of line."""
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


def read(
    path: Path,
    *,
    chip: str | None,
    accelerometer_range_g: int | None,
    gyroscope_range_deg_s: int | None,
    **_: Any,
) -> Recording:
    """Read a file; see :func:`davis_rs.read_recording`."""
    data = path.read_bytes()
    start = _start(data)
    header = data[:start]
    chip = known_chip(chip, _line(header, rb"AEChip:\s*(\S+)"))
    if not chip:
        raise DecodeError(
            f"{path}, byte 0: a file of which no line '# AEChip:' names a DAVIS that is known; "
            "its coordinates are mirrored in a size that only chip= can tell"
        )
    width, height = size_of(chip, event_array([], [], [], []))
    records = np.frombuffer(data, _RECORD, (len(data) - start) // _RECORD.itemsize, start)
    address = records["address"].astype(np.uint32)
    t = _unwrapped(records["t"])
    notes: list[str] = []
    cut: list[str] = []
    if rest := (len(data) - start) % _RECORD.itemsize:
        cut.append(f"byte {len(data) - rest}: the last record is cut off after {rest} of {_RECORD.itemsize} bytes")

    is_event = address & (_NOT_EVENT | _EXTERNAL) == 0
    events = _events(address[is_event], t[is_event], width, height, notes)

    is_external = address & (_NOT_EVENT | _EXTERNAL) == _EXTERNAL
    triggers = _triggers(t[is_external], address[is_external] & 0x3FF, notes)

    accelerometer = _full_scale("accelerometer", accelerometer_range_g, header, notes)
    gyroscope = _full_scale("gyroscope", gyroscope_range_deg_s, header, notes)
    imu, left = _imu(address, t, accelerometer, gyroscope, notes)
    if left:
        at = start + (len(records) - left) * _RECORD.itemsize
        cut.append(f"byte {at}: the last inertial sample is cut off after {left} of {_WORDS} words")

    is_sample = (address & _NOT_EVENT != 0) & (address & _READ != _READ)
    # Of samples x is that of the image.
    sample = address[is_sample]
    x, y = (sample >> 12 & 0x3FF).astype(np.int64), (height - 1) - (sample >> 22 & 0x1FF).astype(np.int64)
    samples = Samples(t[is_sample], x, y, sample >> 10 & 3, sample & 0x3FF)
    frames = assemble(samples, width, height, samples_count_double="240" in chip, notes=notes)
    return Recording(
        path=path, format="AEDAT 2.0", chip=chip, width=width, height=height,
        events=events, imu=imu, frames=frames, triggers=triggers, started=_started(header),
        accelerometer_range_g=accelerometer, gyroscope_range_deg_s=gyroscope, cut=tuple(cut), notes=tuple(notes),
    )  # fmt: skip


def _start(data: bytes) -> int:
    """The offset at which the header ends."""
    lines = _LINES.match(data)
    end = 0 if lines is None else lines.end()
    last = data.find(_LAST_LINE, 0, end)
    return end if last < 0 else last + len(_LAST_LINE)


def _line(header: bytes, pattern: bytes) -> str:
    """What a pattern finds in the header, or nothing."""
    match = re.search(pattern, header)
    return "" if match is None else match[1].decode("latin-1").strip()


def _started(header: bytes) -> datetime | None:
    """Read '# created Fri Sep 18 09:50:42 CEST 2015'; the zone is only a name, so it is not used."""
    words = _line(header, rb"# created ([^\r\n]*)").split()
    try:
        return datetime.strptime(" ".join([*words[1:4], words[-1]]), "%b %d %H:%M:%S %Y") if words else None
    except ValueError:
        return None


def _unwrapped(stamps: npt.NDArray[Any]) -> npt.NDArray[np.int64]:
    """Times beyond 2^31 us, where the file's 32 bits begin again at -2^31."""
    t = stamps.astype(np.int64)
    anew = t[1:] < t[:-1] - (1 << 31)
    if anew.any():
        t[1:] += anew.cumsum() << 32
    return t


def _events(
    address: npt.NDArray[np.uint32], t: npt.NDArray[np.int64], width: int, height: int, notes: list[str]
) -> EventArray:
    # What lies outside wraps around to more than any size.
    x, y = np.uint32(width - 1) - (address >> 12 & 0x3FF), np.uint32(height - 1) - (address >> 22 & 0x1FF)
    inside = (x < width) & (y < height)
    if inside.all():
        return event_array(t, x, y, address >> 11 & 1)
    notes.append(f"{np.count_nonzero(~inside)} events outside of {width} x {height} pixels left out")
    return event_array(t[inside], x[inside], y[inside], address[inside] >> 11 & 1)


def _triggers(t: npt.NDArray[np.int64], kind: npt.NDArray[np.uint32], notes: list[str]) -> npt.NDArray[Any]:
    # Older versions did not write the kind.
    kind = np.where(kind == 0, TriggerKind.INPUT_PULSE, kind)
    known = (kind >= TriggerKind.INPUT_FALLING) & (kind <= TriggerKind.INPUT_PULSE)
    if unknown := int(np.count_nonzero(~known)):
        notes.append(f"{unknown} special events of unknown kinds left out")
    return trigger_array(t[known], kind[known])


def _full_scale(sensor: str, given: int | None, header: bytes, notes: list[str]) -> int:
    """The one given, or the one of the header, or jAER's default."""
    pattern, ranges, default, unit = _PREFERENCES[sensor]
    if given is not None:
        if given not in ranges:
            raise ValueError(f"{sensor} range must be one of {ranges} {unit}, got {given}")
        return given
    found = {int(value) for value in re.findall(pattern, header)} & set(ranges)
    if len(found) == 1:
        value = found.pop()
        notes.append(f"{sensor} range +-{value} {unit}, from the preferences in the header")
        return value
    notes.append(f"{sensor} range assumed to be jAER's default, +-{default} {unit}: the file does not say")
    return default


def _imu(
    address: npt.NDArray[np.uint32], t: npt.NDArray[np.int64], accelerometer: int, gyroscope: int, notes: list[str]
) -> tuple[npt.NDArray[Any], int]:
    """Whole samples, and how many words of one stand at the end of the file."""
    is_word = address & _IMU == _IMU
    code = np.where(is_word, (address >> 28 & 7).astype(np.int64), _WORDS)
    # The words of a sample follow each other directly. Pad as if the file went on with something else.
    code = np.append(code, np.full(_WORDS, _WORDS))
    begins = np.flatnonzero(code == 0)
    in_order = code[begins[:, None] + np.arange(_WORDS)] == np.arange(_WORDS)
    whole = in_order.all(axis=1)
    words = begins[whole][:, None] + np.arange(_WORDS)
    left = len(address) - int(begins[-1]) if len(begins) else _WORDS
    if left >= _WORDS or not in_order[-1, :left].all():
        left = 0
    if broken := int(np.count_nonzero(is_word)) - words.size - left:
        notes.append(f"{broken} words of incomplete inertial samples left out")
    counts = (address[words] >> 12 & 0xFFFF).astype(np.uint16).view(np.int16)
    imu = imu_array(
        t[words[:, 0]], counts[:, :3], counts[:, 4:], counts[:, 3] / 340 + 35,
        g=accelerometer / 32768, deg_s=gyroscope / 32768,
    )  # fmt: skip
    return imu, left
