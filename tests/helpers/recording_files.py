"""Files of AEDAT, EVT 2.1 and ECF, written by the rules of the formats, and the camera of a camera's bytes."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import davis_rs
from davis_rs import DavisDescription, Frame, TriggerKind
from davis_rs.events.arrays import EventArray

DESCRIPTION = DavisDescription(
    chip="DAVIS240C", serial="1", product=0x841B, firmware=4, logic_version=18, logic_patch=1, columns=240,
    rows=180, dvs_orientation=0, aps_columns=240, aps_rows=180, aps_orientation=0, has_global_shutter=True,
    imu_type=1, imu_flips=0, is_master=True, logic_mhz=90.0, adc_mhz=30.0, usb_mhz=30.0,
)  # fmt: skip
"""A camera whose bytes are recorded."""

Field = tuple[str, float] | bytes | list[Any] | None
"""Of a FlatBuffers table: a number with its format, a vector (its count first), a vector of tables, or nothing."""


# --- AEDAT 2.0 ---


def aedat2(records: Sequence[tuple[int, int]], *, chip: str = "DAVIS240C", lines: str = "") -> bytes:
    """Records of address and time after jAER's header."""
    header = (
        "#!AER-DAT2.0\r\n# This is a raw AE data file - do not edit\r\n# created Fri Sep 18 09:50:42 CEST 2015\r\n"
        f"# AEChip: eu.seebetter.ini.chips.davis.{chip}\r\n{lines}"
    )
    return header.encode() + b"".join(struct.pack(">Ii", *record) for record in records)


def aedat2_event(x: int, y: int, p: int, *, width: int = 240, height: int = 180) -> int:
    return (height - 1 - y) << 22 | (width - 1 - x) << 12 | p << 11


def aedat2_imu(values: Sequence[int]) -> list[int]:
    """Of ax ay az temperature gx gy gz in counts."""
    return [1 << 31 | code << 28 | (value & 0xFFFF) << 12 | 3 << 10 for code, value in enumerate(values)]


def aedat2_sample(x: int, y: int, read: int, value: int, *, height: int = 180) -> int:
    return 1 << 31 | (height - 1 - y) << 22 | x << 12 | read << 10 | value


# --- AEDAT 3.1 ---


def aedat3(*packets: bytes, source: str = "DAVIS240C", form: str = "RAW") -> bytes:
    header = (
        f"#!AER-DAT3.1\r\n#Format: {form}\r\n#Source 1: {source}\r\n"
        "#Start-Time: 2016-06-03 17:12:58 (TZ+0200)\r\n#!END-HEADER\r\n"
    )
    return header.encode() + b"".join(packets)


def aedat3_packet(kind: int, events: Sequence[bytes], *, overflow: int = 0, size: int | None = None) -> bytes:
    size = len(events[0]) if size is None else size
    return struct.pack("<hhiiiiii", kind, 1, size, 4, overflow, len(events), len(events), len(events)) + b"".join(
        events
    )


def aedat3_event(t: int, x: int, y: int, p: int, *, valid: int = 1) -> bytes:
    return struct.pack("<Ii", x << 17 | y << 2 | p << 1 | valid, t)


def aedat3_special(t: int, kind: int) -> bytes:
    return struct.pack("<Ii", kind << 1 | 1, t)


def aedat3_imu(t: int, values: Sequence[float]) -> bytes:
    """Of acceleration in g, rotation in deg/s, temperature."""
    return struct.pack("<Ii7f", 1, t, *values)


def aedat3_frame(frame: Frame, channels: int = 1) -> bytes:
    """A frame; in colour the pixels are red, and nothing else."""
    height, width = frame.pixels.shape
    pixels = np.zeros((height, width, channels), "<u2")
    pixels[:, :, 0] = frame.pixels
    times = (frame.t, frame.t_end, frame.t_exposure_start, frame.t_exposure_end)
    return struct.pack("<I8i", channels << 1 | 1, *times, width, height, frame.x, frame.y) + pixels.tobytes()


# --- AEDAT 4 ---


class FlatBuffer:
    """Writes tables one after the other; the first is the root."""

    def __init__(self, identifier: bytes) -> None:
        self.out = bytearray(struct.pack("<II", 0, 0) + identifier)

    def table(self, fields: Sequence[Field]) -> int:
        """Append a table and what it points to; returns where it is."""
        body, slots, vectors = bytearray(4), [], []
        for field in fields:
            slots.append(0 if field is None else len(body))
            if isinstance(field, tuple):
                body += struct.pack(f"<{field[0]}", field[1])
            elif field is not None:
                vectors.append((len(body), field))
                body += bytes(4)
        vtable = len(self.out)
        self.out += struct.pack(f"<HH{len(slots)}H", 4 + 2 * len(slots), len(body), *slots)
        at = len(self.out)
        body[:4] = struct.pack("<i", at - vtable)
        self.out += body
        for slot, vector in vectors:
            self._point(at + slot, len(self.out))
            if isinstance(vector, bytes):
                self.out += vector
                continue
            first = len(self.out) + 4
            self.out += struct.pack("<I", len(vector)) + bytes(4 * len(vector))
            for k, child in enumerate(vector):
                self._point(first + 4 * k, self.table(child))
        return at

    def _point(self, slot: int, to: int) -> None:
        self.out[slot : slot + 4] = struct.pack("<I", to - slot)

    def finish(self, fields: Sequence[Field]) -> bytes:
        """The buffer with a root of these fields, its size first."""
        self._point(4, self.table(fields))
        self.out[:4] = struct.pack("<I", len(self.out) - 4)
        return bytes(self.out)


STREAM_TYPES = ("EVTS", "FRME", "IMUS", "TRIG")

COMPRESSIONS = ("none", "lz4", "lz4 high", "zstd", "zstd high")


def compress(body: bytes, compression: int) -> bytes:
    import lz4.frame
    import zstandard

    if compression == 0:
        return body
    if compression < 3:
        return bytes(lz4.frame.compress(body, compression_level=9 * (compression - 1)))
    return zstandard.ZstdCompressor(level=3 if compression == 3 else 19).compress(body)


def aedat4_xml(
    kinds: Sequence[str] = STREAM_TYPES, *, source: str = "DAVIS346_00000002", size: tuple[int, int] = (346, 260)
) -> str:
    info = f'<attr key="source">{source}</attr><attr key="sizeX">{size[0]}</attr><attr key="sizeY">{size[1]}</attr>'
    streams = "".join(
        f'<node name="{k}"><attr key="typeIdentifier">{kind}</attr><node name="info">{info}</node></node>'
        for k, kind in enumerate(kinds)
    )
    return f'<dv version="2.0"><node name="outInfo">{streams}</node></dv>'


def aedat4(
    *packets: tuple[int, bytes], compression: int = 0, xml: str | None = None, table: bytes | None = b"a table"
) -> bytes:
    """Packets of stream and body after a header, and a table (which nothing reads) after them, if there is one."""
    text = (aedat4_xml() if xml is None else xml).encode()
    bodies = [(stream, compress(body, compression)) for stream, body in packets]
    content = b"".join(struct.pack("<ii", stream, len(body)) + body for stream, body in bodies)

    def header(position: int) -> bytes:
        fields: list[Field] = [("i", compression), ("q", position), struct.pack("<I", len(text)) + text]
        return b"#!AER-DAT4.0\r\n" + FlatBuffer(b"IOHE").finish(fields)

    position = -1 if table is None else len(header(0)) + len(content)
    return header(position) + content + (table or b"")


def aedat4_events(events: Any) -> bytes:
    packed = np.zeros(len(events), {"names": ["t", "x", "y", "p"], "formats": ["<i8", "<i2", "<i2", "u1"],
                                    "offsets": [0, 8, 10, 12], "itemsize": 16})  # fmt: skip
    for name in "txyp":
        packed[name] = events[name].astype(packed.dtype[name])
    return FlatBuffer(b"EVTS").finish([struct.pack("<I", len(events)) + packed.tobytes()])


def aedat4_imu(samples: Sequence[tuple[int, Sequence[float]]]) -> bytes:
    """Of a time and temperature, acceleration in g, rotation in deg/s; the magnetometer is left out."""
    return FlatBuffer(b"IMUS").finish([[[("q", t), *(("f", value) for value in values)] for t, values in samples]])


def aedat4_triggers(triggers: Sequence[tuple[int, int]]) -> bytes:
    """Of time and type; a type of 0 is the default, and not written."""
    return FlatBuffer(b"TRIG").finish([[[("q", t), ("b", kind)] if kind else [("q", t)] for t, kind in triggers]])


def aedat4_frame(frame: Frame, *, form: int = 0) -> bytes:
    """A frame of OpenCV's type ``form``; in colour the pixels are red, and nothing else."""
    height, width = frame.pixels.shape
    channels = (form >> 3) + 1
    pixels = np.zeros((height, width, channels), "<u2" if form & 7 else "u1")
    pixels[:, :, 2 if channels > 1 else 0] = frame.pixels if form & 7 else frame.pixels >> 8
    times = (frame.t_exposure_start, frame.t, frame.t_end, frame.t_exposure_start, frame.t_exposure_end)
    numbers = [("b", form), ("h", width), ("h", height), ("h", frame.x), ("h", frame.y)]
    vector = struct.pack("<I", pixels.nbytes) + pixels.tobytes()
    return FlatBuffer(b"FRME").finish([*(("q", t) for t in times), *numbers, vector])


# --- what to write ---


def events_of(rows: Sequence[tuple[int, int, int, int]]) -> Any:
    return np.array(rows, davis_rs.EVENT_DTYPE) if rows else np.zeros(0, davis_rs.EVENT_DTYPE)


def frame_of(width: int, height: int, *, t: int = 1000, x: int = 0, y: int = 0, bits: int = 10) -> Frame:
    """A frame of a ramp in the upper ``bits`` of 16."""
    pixels = np.arange(width * height).reshape(height, width) % (1 << bits) << (16 - bits)
    return Frame(t, t + 10, t + 20, t + 30, x, y, pixels.astype(np.uint16), exposure_us=10.0)


TRIGGERS_3 = {
    1: TriggerKind.TIMESTAMP_RESET,
    2: TriggerKind.INPUT_RISING,
    3: TriggerKind.INPUT_FALLING,
    4: TriggerKind.INPUT_PULSE,
    12: TriggerKind.GENERATOR_RISING,
    13: TriggerKind.GENERATOR_FALLING,
}
TRIGGERS_4 = {
    0: TriggerKind.TIMESTAMP_RESET,
    1: TriggerKind.INPUT_RISING,
    2: TriggerKind.INPUT_FALLING,
    3: TriggerKind.INPUT_PULSE,
    4: TriggerKind.GENERATOR_RISING,
    5: TriggerKind.GENERATOR_FALLING,
}


# --- EVT 2.1 ---


def evt21(events: EventArray, *, size: tuple[int, int] = (240, 180)) -> bytes:
    """A file with a word for each event: of 32 pixels one bit is set, which is not the first where it can be."""
    words, high = [], -1
    for t, x, y, p in events.tolist():
        if t >> 6 != high:
            high = t >> 6
            words.append(8 << 60 | (high & 0x0FFF_FFFF) << 32)
        bit = min(x, 5)
        words.append(p << 60 | (t & 63) << 54 | (x - bit) << 43 | y << 32 | 1 << bit)
    header = f"% evt 2.1\n% format EVT21;height={size[1]};width={size[0]}\n% end\n"
    return header.encode() + b"".join(struct.pack("<Q", word) for word in words)


# --- ECF ---


def ecf_chunk(events: EventArray, *, packed: bool = False) -> bytes:
    """A chunk with a run for each event, or with pixels and polarities packed."""
    t, x, y, p = (events[name].astype(np.int64).tolist() for name in ("t", "x", "y", "p"))
    chunk = struct.pack("<IQ", len(events) << 2 | packed << 1, t[0])
    for before, now in zip([t[0], *t], t, strict=False):
        way = now - before
        if way >= 15:
            while way:
                chunk += bytes([0xF0 | way & 15])
                way >>= 4
        chunk += bytes([way << 4 | 1])
    if packed:
        values = [row << 12 | column << 1 | on for column, row, on in zip(x, y, p, strict=True)]
        values += [0] * (-len(values) % 4)
        for a, b, c, d in zip(*(values[k::4] for k in range(4)), strict=True):
            chunk += struct.pack("<III", a << 8 | b & 0xFF, b >> 8 << 16 | c & 0xFFFF, c >> 16 << 24 | d)
        return chunk
    chunk += b"".join(struct.pack("<H", row << 5 | 1) for row in y)
    chunk += b"".join(struct.pack("<H", column << 5) for column in x)
    return chunk + bytes(on << 7 | 1 for on in p)


def write_ecf(
    path: Path, events: EventArray, *, size: tuple[int, int] = (240, 180), chunk: int = 64, filter: int = 0x8ECF
) -> Path:
    """Write Metavision's HDF5; every other chunk is packed."""
    import h5py

    layout = np.dtype({"names": ["x", "y", "p", "t"], "formats": ["<u2", "<u2", "<i2", "<i8"], "offsets": [0, 2, 4, 8]})
    with h5py.File(path, "w") as file:
        file.attrs["geometry"] = f"{size[0]}x{size[1]}"
        properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        properties.set_chunk((chunk,))
        properties.set_filter(filter, h5py.h5z.FLAG_OPTIONAL)
        space = h5py.h5s.create_simple((len(events),), (h5py.h5s.UNLIMITED,))
        group = file.create_group("CD").id
        dataset = h5py.h5d.create(group, b"events", h5py.h5t.py_create(layout), space, properties)
        for number, start in enumerate(range(0, len(events), chunk)):
            dataset.write_direct_chunk((start,), ecf_chunk(events[start : start + chunk], packed=number % 2 == 1))
    return path
