"""AEDAT 4, DV's format: packets of FlatBuffers, compressed one by one, of streams that a piece of XML describes.

Source: docs.inivation.com, AEDAT 4.0; the schemas of dv-processing; FlatBuffers internals.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from .._core import DecodeError
from ..decoded import Frame, TriggerKind
from ..events import concatenate_events
from .flatbuffer import Malformed, Table
from .recording import Recording, event_array, grey, imu_array, known_chip, size_of, trigger_array

MAGIC = b"#!AER-DAT4.0\r\n"

_PACKET = struct.Struct("<ii")
"""Stream, size."""

_MOST_BYTES = 64 << 20
"""Of an unpacked packet; recorders make one every few milliseconds."""
_CHUNK_BYTES = 1 << 20

_EVENT = np.dtype({
    "names": ["t", "x", "y", "p"], "formats": ["<i8", "<i2", "<i2", "u1"], "offsets": [0, 8, 10, 12], "itemsize": 16,
})  # fmt: skip
_AXES = ("accel_x", "accel_y", "accel_z", "gyro_x", "gyro_y", "gyro_z")
_IMU = {"t": (0, "<i8"), "temperature": (1, "<f4"), **{axis: (2 + k, "<f4") for k, axis in enumerate(_AXES)}}
"""Of an inertial sample: number and type of its fields; g, deg/s, degrees Celsius."""
_TRIGGER = {"t": (0, "<i8"), "kind": (1, "i1")}
_KINDS = np.array([
    TriggerKind.TIMESTAMP_RESET, TriggerKind.INPUT_RISING, TriggerKind.INPUT_FALLING, TriggerKind.INPUT_PULSE,
    TriggerKind.GENERATOR_RISING, TriggerKind.GENERATOR_FALLING,
], np.uint8)  # fmt: skip
"""Of triggers from 0 on; others tell of frames."""

_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)


class _Stream(NamedTuple):
    """A stream as the header describes it."""

    number: int
    kind: str
    width: int
    height: int
    source: str


def read(path: Path, data: bytes, *, chip: str | None, **_: int | None) -> Recording:
    """Read a file's contents; see :func:`davis_rs.read_recording`."""
    begin = len(MAGIC)
    try:
        length = int.from_bytes(data[begin : begin + 4], "little") + 4
        header = Table.root(data[begin : begin + length], b"IOHE")
        unpack = _unpacker(header.number(0, "<i4"))
        # Where the packets end and a table of them begins; the file of a recorder that was killed has none.
        table = header.number(1, "<i8", -1)
        streams = _streams(header.vector(2, np.uint8).tobytes())
    except Malformed as error:
        raise DecodeError(f"{path}, byte {begin}: malformed header: {error}") from None

    first: dict[str, _Stream] = {}
    for stream in streams:
        first.setdefault(stream.kind, stream)
    kinds = {stream.number: kind for kind, stream in first.items()}
    parts: dict[str, list[Any]] = {kind: [] for kind in _PARSERS}
    at = begin + length
    cut: list[str] = []
    end = table if at <= table <= len(data) else len(data)
    others = 0
    while at < end:
        left = end - at - _PACKET.size
        number, size = _PACKET.unpack_from(data, at) if left >= 0 else (0, 0)
        if size < 0:
            raise DecodeError(f"{path}, byte {at}: expected the header of a packet, found a size of {size} bytes")
        if left < size:
            cut.append(f"byte {at}: the last packet is cut off")
            break
        kind = kinds.get(number, "")
        if kind in _PARSERS:
            try:
                body = unpack(data[at + _PACKET.size : at + _PACKET.size + size])
                parts[kind].append(_PARSERS[kind](Table.root(body, kind.encode())))
            except Malformed as error:
                raise DecodeError(f"{path}, byte {at}: malformed packet of stream {number}: {error}") from None
        else:
            others += 1
        at += _PACKET.size + size
    if table > len(data) and not cut:
        cut.append(f"byte {len(data)}: the file is cut off before its table of packets, at byte {table}")

    events = concatenate_events([event_array([], [], [], []), *parts["EVTS"]])
    pixels = first.get("EVTS") or first.get("FRME")
    chip = known_chip(chip, "" if pixels is None else pixels.source)
    width, height = size_of(chip, events, (0, 0) if pixels is None else (pixels.width, pixels.height))
    inside = (events["x"] < width) & (events["y"] < height)
    notes = []
    if outside := len(events) - int(np.count_nonzero(inside)):
        notes.append(f"{outside} events outside of {width} x {height} pixels left out")
        events = events[inside]
    if others:
        notes.append(f"{others} packets of other streams left out; read is the first of each kind")
    recording = Recording(
        path=path, format="AEDAT 4", chip=chip, width=width, height=height,
        events=events, imu=np.concatenate([_imu_of({}), *parts["IMUS"]]), frames=parts["FRME"],
        triggers=np.concatenate([_triggers_of({}), *parts["TRIG"]]), cut=tuple(cut), notes=tuple(notes),
    )  # fmt: skip
    return replace(recording, started=_date(recording.start_us))


def _date(us: int) -> datetime | None:
    """The date of microseconds since 1970, if there is one."""
    try:
        return _EPOCH + timedelta(microseconds=us) if us else None
    except OverflowError:
        return None


def _unpacker(compression: int) -> Callable[[bytes], bytes]:
    """What unpacks a packet's body."""
    if compression == 0:
        return lambda body: body
    if compression in (1, 2):
        return _unpack_lz4
    if compression in (3, 4):
        return _unpack_zstd
    raise Malformed(f"compression must be 0 to 4, found {compression}")


def _unpack_lz4(body: bytes) -> bytes:
    import lz4.frame

    decompressor = lz4.frame.LZ4FrameDecompressor()
    unpacked = bytearray()
    try:
        while not decompressor.eof:
            chunk = decompressor.decompress(body, max_length=_CHUNK_BYTES)
            body = b""
            _extend(unpacked, chunk)
            if not chunk and not decompressor.eof:
                raise Malformed("the LZ4 frame has no end")
    except RuntimeError as error:
        raise Malformed(str(error)) from None
    return bytes(unpacked)


def _unpack_zstd(body: bytes) -> bytes:
    import zstandard

    unpacked = bytearray()
    try:
        with zstandard.ZstdDecompressor(max_window_size=_MOST_BYTES).stream_reader(body) as reader:
            while chunk := reader.read(_CHUNK_BYTES):
                _extend(unpacked, chunk)
    except zstandard.ZstdError as error:
        raise Malformed(str(error)) from None
    return bytes(unpacked)


def _extend(unpacked: bytearray, chunk: bytes) -> None:
    if len(unpacked) + len(chunk) > _MOST_BYTES:
        raise Malformed(f"a packet may have {_MOST_BYTES} bytes unpacked, this has more")
    unpacked += chunk


def _streams(xml: bytes) -> list[_Stream]:
    """What the header's XML says of the streams, in the order of their numbers."""
    from xml.etree import ElementTree

    try:
        text = xml.decode()
        if "<!" in text:
            raise Malformed("the description of the streams has declarations, which could make much of little")
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise Malformed(f"the description of the streams is not XML: {error}") from None
    streams = []
    for node in root.iterfind("./node[@name='outInfo']/node"):
        number, info = node.get("name", ""), node.find("./node[@name='info']")
        if number.isascii() and number.isdigit() and len(number) < 10:
            sizes = (_attribute(info, name) for name in ("sizeX", "sizeY"))
            width, height = (int(size) if size.isascii() and size.isdigit() and len(size) < 6 else 0 for size in sizes)
            source = _attribute(info, "source")
            streams.append(_Stream(int(number), _attribute(node, "typeIdentifier"), width, height, source))
    return sorted(streams)


def _attribute(node: Any, name: str) -> str:
    found = None if node is None else node.find(f"./attr[@key='{name}']")
    return "" if found is None else found.text or ""


def _events(table: Table) -> npt.NDArray[Any]:
    raw = table.vector(0, _EVENT)
    # Coordinates that are negative become larger than any size.
    return event_array(raw["t"], raw["x"].view(np.uint16), raw["y"].view(np.uint16), raw["p"] != 0)


def _imu(table: Table) -> npt.NDArray[Any]:
    return _imu_of(table.columns(0, _IMU))


def _imu_of(columns: dict[str, npt.NDArray[Any]]) -> npt.NDArray[Any]:
    column = {name: columns.get(name, np.zeros(0, dtype)) for name, (_, dtype) in _IMU.items()}
    accel, gyro = (np.stack([column[axis] for axis in axes], axis=1) for axes in (_AXES[:3], _AXES[3:]))
    return imu_array(column["t"], accel, gyro, column["temperature"])


def _triggers(table: Table) -> npt.NDArray[Any]:
    return _triggers_of(table.columns(0, _TRIGGER))


def _triggers_of(columns: dict[str, npt.NDArray[Any]]) -> npt.NDArray[Any]:
    t, kind = columns.get("t", np.zeros(0, np.int64)), columns.get("kind", np.zeros(0, np.int8))
    known = (kind >= 0) & (kind < len(_KINDS))
    return trigger_array(t[known], _KINDS[kind[known]])


def _frame(table: Table) -> Frame:
    t, start, end, exposed, covered = (table.number(field, "<i8") for field in range(5))
    form = table.number(5, "i1")
    width, height, x, y = (table.number(field, "<i2") for field in range(6, 10))
    exposure = table.number(11, "<i8")
    # A type of OpenCV: in its low bits the depth, above it the number of channels less one.
    depth, channels = form & 7, (form >> 3) + 1
    if depth not in (0, 2) or channels not in (1, 3, 4):
        raise Malformed(f"frames must have 8 or 16 bits in 1, 3 or 4 channels, found OpenCV's type {form}")
    values = table.vector(10, np.uint8)
    if min(width, height) < 1 or min(x, y) < 0 or len(values) != width * height * channels * (2 if depth else 1):
        raise Malformed(f"{len(values)} bytes do not make {width} x {height} pixels of type {form} at ({x}, {y})")
    # Eight bits are the upper ones of sixteen.
    pixels = values.view("<u2") if depth else values.astype(np.uint16) << 8
    # Newer files have the exposure's start and its length alone.
    exposed = exposed or t
    covered = covered or exposed + exposure
    image = grey(pixels.reshape(height, width, channels), "BGR")
    return Frame(start or exposed, exposed, covered, end or covered, x, y, image, exposure_us=float(covered - exposed))


_PARSERS: dict[str, Callable[[Table], Any]] = {"EVTS": _events, "FRME": _frame, "IMUS": _imu, "TRIG": _triggers}
