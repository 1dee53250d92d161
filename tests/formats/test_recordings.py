"""Recordings of other software: AEDAT 2.0, 3.1 and 4."""

from __future__ import annotations

import hashlib
import math
import struct
import sys
import tracemalloc
import warnings
from collections.abc import Iterator
from dataclasses import replace
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import davis_rs
from command_line import davis_rs as command
from davis_rs import (
    EVENT_DTYPE,
    DecodeError,
    Frame,
    RawRecording,
    RawWriter,
    Recording,
    RecordingWarning,
    open_reader,
    open_writer,
    read_events,
    read_recording,
)
from davis_rs.inspection.summary import summarize_events
from davis_rs.inspection.visual_sequence import open_visual_sequence
from davis_rs.io.dataset.writer import DatasetWriter
from davis_rs.io.files.random_access import RandomAccess
from davis_rs.io.formats.recorded import RecordedParts
from davis_rs.io.recordings import aedat2 as aedat2_module
from davis_rs.io.recordings import aedat3 as aedat3_module
from davis_rs.io.recordings.recording_file import RECORDED_KINDS
from places import SHARED
from recording_files import (
    COMPRESSIONS,
    DESCRIPTION,
    TRIGGERS_3,
    TRIGGERS_4,
    aedat2,
    aedat2_event,
    aedat2_imu,
    aedat2_sample,
    aedat3,
    aedat3_event,
    aedat3_frame,
    aedat3_imu,
    aedat3_packet,
    aedat3_special,
    aedat4,
    aedat4_events,
    aedat4_frame,
    aedat4_imu,
    aedat4_triggers,
    aedat4_xml,
    events_of,
    frame_of,
)

G = 9.80665
RECORDINGS = SHARED / "data"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("recordings")


def read(folder: Path, content: bytes, **arguments: Any) -> Recording:
    path = folder / "recording"
    path.write_bytes(content)
    return read_recording(path, **arguments)


def rows(width: int, height: int) -> st.SearchStrategy[list[tuple[int, int, int, int]]]:
    """Events in the order of a file; their times may go back."""
    row = st.tuples(st.integers(0, 2**31 - 1), st.integers(0, width - 1), st.integers(0, height - 1), st.integers(0, 1))
    return st.lists(row, max_size=20)


# --- events, in all formats ---


@given(rows=rows(240, 180))
def test_aedat2_events_come_back(folder: Path, rows: list[tuple[int, int, int, int]]) -> None:
    """Every coordinate is at its place, mirrored in both directions, to the corners."""
    rows.sort(key=lambda row: row[0])  # here a time that goes back by 2^31 us has begun anew
    recording = read(folder, aedat2([(aedat2_event(x, y, p), t) for t, x, y, p in rows]))
    np.testing.assert_array_equal(recording.events, events_of(rows))
    assert (recording.format, recording.chip, recording.width, recording.height) == ("AEDAT 2.0", "DAVIS240C", 240, 180)


@given(rows=rows(240, 180), cut=st.integers(0, 20), overflow=st.integers(0, 3))
def test_aedat3_events_come_back(folder: Path, rows: list[tuple[int, int, int, int]], cut: int, overflow: int) -> None:
    """However they are split into packets; the clock's overflows count."""
    packed = [aedat3_event(*row) for row in rows]
    content = aedat3(aedat3_packet(1, packed[:cut], size=8), aedat3_packet(1, packed[cut:], overflow=overflow, size=8))
    expected = events_of(rows)
    expected["t"][cut:] += overflow << 31
    np.testing.assert_array_equal(read(folder, content).events, expected)


@pytest.mark.parametrize("compression", range(len(COMPRESSIONS)), ids=COMPRESSIONS)
@given(rows=rows(346, 260), cut=st.integers(0, 20))
def test_aedat4_events_come_back(
    folder: Path, compression: int, rows: list[tuple[int, int, int, int]], cut: int
) -> None:
    """With every compression, and however they are split into packets."""
    events = events_of(rows)
    packets = [(0, aedat4_events(events[:cut])), (0, aedat4_events(events[cut:]))]
    recording = read(folder, aedat4(*packets, compression=compression))
    np.testing.assert_array_equal(recording.events, events)
    assert (recording.format, recording.chip, recording.width, recording.height) == ("AEDAT 4", "DAVIS346B", 346, 260)


# --- AEDAT 2.0 ---


def test_aedat2_corners(folder: Path) -> None:
    """Address 0 is the lower right corner."""
    recording = read(folder, aedat2([(0, 7), (179 << 22 | 239 << 12 | 1 << 11, 8)]))
    assert recording.events.tolist() == [(7, 239, 179, 0), (8, 0, 0, 1)]
    assert recording.started == datetime(2015, 9, 18, 9, 50, 42)
    large = read(folder, aedat2([(0, 7)], chip="Davis346blue"))
    assert (large.chip, large.events.tolist()) == ("DAVIS346B", [(7, 345, 259, 0)])
    assert read(folder, aedat2([(0, 7)], chip="Davis346cBSI")).chip == "DAVIS346C"
    assert read(folder, aedat2([(0, 7)], chip="Davis640")).width == 640


def test_aedat2_events_outside(folder: Path) -> None:
    """Addresses that no pixel of the chip has are left out, and counted."""
    recording = read(folder, aedat2([(240 << 12, 1), (5 << 12, 2), (180 << 22, 3), (1023 << 12 | 511 << 22, 4)]))
    assert recording.events.tolist() == [(2, 234, 179, 0)]
    assert "3 events outside of 240 x 180 pixels left out" in recording.notes


def test_aedat2_times_run_on_after_31_bits(folder: Path) -> None:
    """An hour of recording has times that do not go back."""
    stamps = [2**31 - 2, 2**31 - 1, -(2**31), -1, 0, 2**31 - 1, -(2**31)]
    events = read(folder, aedat2([(0, stamp) for stamp in stamps])).events
    expected = [2**31 - 2, 2**31 - 1, 2**31, 2**32 - 1, 2**32, 2**32 + 2**31 - 1, 2**32 + 2**31]
    assert events["t"].tolist() == expected


def test_aedat2_times_that_begin_below_zero(folder: Path) -> None:
    """A camera that had been on for 36 minutes begins with a stamp below 0: its clock has passed 2^31 us before."""
    events = read(folder, aedat2([(0, stamp) for stamp in (-(2**31), -5, 3)])).events
    assert events["t"].tolist() == [2**31, 2**32 - 5, 2**32 + 3]


def test_aedat2_scales(folder: Path) -> None:
    """Full scales come from the caller, or the header's preferences, or are jAER's and said to be assumed."""
    counts = [4096, -8192, 1, 340, 16384, -32768, 3]
    records = [(word, 5) for word in aedat2_imu(counts)]
    scales = (
        '#    <entry key="ImuGyroScale" value="GyroFullScaleDegPerSec250"/>\r\n'
        '#    <entry key="ImuAccelScale" value="ImuAccelScaleG2"/>\r\n'
    )
    for lines, arguments, full_scales, noted in (
        ("", {}, (8, 1000), "assumed"),
        (scales, {}, (2, 250), "preferences"),
        (scales, {"accelerometer_range_g": 16, "gyroscope_range_deg_s": 2000}, (16, 2000), None),
        (scales.replace("G2", "G3").replace("250", "251"), {}, (8, 1000), "assumed"),
        (scales + scales.replace("G2", "G4").replace("250", "500"), {}, (8, 1000), "assumed"),
    ):
        recording = read(folder, aedat2(records, lines=lines), **arguments)
        assert (recording.accelerometer_range_g, recording.gyroscope_range_deg_s) == full_scales
        (sample,) = recording.imu
        assert (sample["t"], sample["temperature"]) == (5, 36)
        np.testing.assert_allclose(sample["accel"], np.array(counts[:3]) * full_scales[0] / 32768 * G, rtol=1e-15)
        np.testing.assert_allclose(
            sample["gyro"], np.radians(np.array(counts[4:]) * full_scales[1] / 32768), rtol=1e-15
        )
        assert [noted in note for note in recording.notes] == [True, True] if noted else not recording.notes


def test_aedat2_incomplete_samples(folder: Path) -> None:
    """A sample is seven consecutive words in order; the last sample may be cut off."""
    good = [(word, 9) for word in aedat2_imu(range(7))]
    event = (aedat2_event(1, 2, 1), 9)
    broken = [*good[:3], event, *good[3:], *good[1:], good[0], good[0], good[6]]
    recording = read(folder, aedat2([*good, *broken, *good, event]))
    assert (len(recording.imu), len(recording.events), recording.cut) == (2, 2, ())
    assert "16 words of incomplete inertial samples left out" in recording.notes
    for words in range(1, 7):
        with pytest.warns(RecordingWarning, match=f"cut off after {words} of 7 words"):
            recording = read(folder, aedat2([*good, event, *good[:words]]))
        assert (len(recording.imu), len(recording.events), len(recording.cut)) == (1, 1, 1)


def test_aedat2_triggers(folder: Path) -> None:
    """Kinds are those of the wire; without a kind it is a pulse, as older versions wrote it."""
    recording = read(folder, aedat2([(0x400 | kind, 10 + kind) for kind in (2, 3, 4, 0, 5)]))
    assert recording.triggers.tolist() == [(12, 2), (13, 3), (14, 4), (10, 4)]
    assert "1 special events of unknown kinds left out" in recording.notes
    assert not len(recording.events)


def samples_of(frame: Frame, *, reset: int, by_rows: bool, flip: bool, rolling: bool, double: bool) -> list[int]:
    """Both reads of a frame in the order of a camera's wire."""
    height, width = frame.pixels.shape
    lines: list[list[list[int]]] = [[], []]
    for slow in range(height if by_rows else width):
        for read, line in enumerate(lines):
            line.append([])
            for fast in reversed(range(width if by_rows else height)):
                x, y = (fast, slow) if by_rows else (slow, fast)
                signal = reset - (int(frame.pixels[y, x]) >> (7 if double else 6))
                line[-1].append(aedat2_sample(frame.x + x, frame.y + y, read, signal if read else reset))
    for line in lines:
        line[:] = line[::-1] if flip else line
    if rolling:  # signals run two lines behind
        pauses: list[list[int]] = [[], []]
        return [word for pair in zip(lines[0] + pauses, pauses + lines[1], strict=True) for one in pair for word in one]
    return [word for read in lines for line in read for word in line]


@pytest.mark.parametrize("rolling", [False, True])
@pytest.mark.parametrize("by_rows", [False, True])
@pytest.mark.parametrize("flip", [False, True])
@pytest.mark.parametrize(("width", "height"), [(8, 5), (1, 5), (8, 1), (1, 1)])
def test_aedat2_frames(folder: Path, rolling: bool, by_rows: bool, flip: bool, width: int, height: int) -> None:
    """Two reads make the decoder's pixels, in every order of reading; a frame whose start is missing is left out."""
    # Signals may not begin after all resets, or it is as with a global shutter.
    rolling = rolling and (height if by_rows else width) > 2
    frame = frame_of(width, height, x=3, y=4, bits=9)
    words = samples_of(frame, reset=512, by_rows=by_rows, flip=flip, rolling=rolling, double=True)
    start = width * height
    content = words[start + start // 2 + 1 :] + 3 * words
    recording = read(folder, aedat2([(word, t) for t, word in enumerate(content)]))
    assert len(recording.frames) == 3
    begin = len(content) - 3 * len(words)
    for k, found in enumerate(recording.frames):
        np.testing.assert_array_equal(found.pixels, frame.pixels)
        assert (found.x, found.y, found.global_shutter) == (3, 4, not rolling)
        assert (found.t, found.t_end) == (begin + k * len(words), begin + (k + 1) * len(words) - 1)
        assert found.t <= found.t_exposure_start < found.t_exposure_end <= found.t_end
        assert found.exposure_us == found.t_exposure_end - found.t_exposure_start


def test_aedat2_frames_are_the_decoders(folder: Path) -> None:
    """What a camera sends becomes the same picture in a recording and in the decoder, white pixels included."""
    rng = np.random.default_rng(0)
    for chip, (width, height) in (("DAVIS240C", (240, 180)), ("DAVIS346B", (346, 260))):
        reads = rng.integers(0, 1024, (2, height, width))
        reads[1].flat[::7] = 0
        columns, rows = (height, width) if chip == "DAVIS346B" else (width, height)
        words = [0x8001, 0x0008, *[0x5100, 0x5200] * 2]
        words += [0x5100 | (width - 1) >> 8, 0x5200 | (width - 1) & 0xFF]
        words += [0x5100 | (height - 1) >> 8, 0x5200 | (height - 1) & 0xFF]
        records = []
        for read_number in (0, 1):
            wire = reads[read_number] if chip == "DAVIS346B" else reads[read_number].T
            for column in range(columns):
                words += [0x000B + read_number, *(0x4000 | wire[column]).tolist(), 0x000D]
                records += [
                    (aedat2_sample(*((row, column) if chip == "DAVIS346B" else (column, row)), read_number,
                                   int(wire[column, row]), height=height), 1)
                    for row in range(rows)
                ]  # fmt: skip
        device = davis_rs.Device(chip, aps_orientation=4 if chip == "DAVIS346B" else 0)
        decoded = davis_rs.Decoder(device).push(np.array([*words, 0x000A], "<u2"))
        (recorded,) = read(folder, aedat2(records, chip=chip)).frames
        np.testing.assert_array_equal(recorded.pixels, decoded.frames[0].pixels, chip)


def test_frames_of_aedat2_are_named_without_a_number(folder: Path) -> None:
    """Nothing marks where one begins, so that a count would hold all of them in memory."""
    records = [
        (aedat2_event(1, 2, 1), 5),
        (aedat2_sample(3, 4, 0, 512), 6),
        *((word, 7) for word in aedat2_imu([1] * 7)),
    ]
    (folder / "recording").write_bytes(aedat2(records))
    assert summarize_events(folder / "recording").also == {"frames": None, "IMU samples": 1}
    assert "also        frames, 1 IMU samples\n" in command("info", folder / "recording").stdout


def test_aedat2_frames_beside_wrong_samples(folder: Path) -> None:
    """A sample whose address was damaged costs its frame at most, not the region of all of them."""
    frame = frame_of(8, 5, x=3, y=4, bits=9)
    words = samples_of(frame, reset=512, by_rows=False, flip=False, rolling=False, double=True)
    wrong = aedat2_sample(200, 150, 0, 512)
    recording = read(folder, aedat2([(word, 1) for word in [*words, *words[:20], wrong, *words[20:], *words]]))
    assert [(found.x, found.y, found.pixels.shape) for found in recording.frames] == [(3, 4, (5, 8))] * 3
    for found in recording.frames:
        np.testing.assert_array_equal(found.pixels, frame.pixels)


def test_aedat2_frames_with_holes(folder: Path) -> None:
    """A frame that lacks some samples has zeros there, one that lacks half of a read is left out; the notes say so."""
    frame = frame_of(8, 5, bits=9)
    words = samples_of(frame, reset=512, by_rows=False, flip=False, rolling=False, double=True)
    recording = read(folder, aedat2([(word, 1) for word in words[:13] + words[15:]]))
    (found,) = recording.frames
    assert np.count_nonzero(found.pixels != frame.pixels) <= 2
    assert "2 pixels of frames are 0 because a sample of theirs is missing" in recording.notes
    lost = read(folder, aedat2([(word, 1) for word in words + words[:60] + words[:19]]))
    assert len(lost.frames) == 2
    assert np.count_nonzero(lost.frames[1].pixels) <= 20
    assert "19 samples left out, of frames of which a read is less than half there" in lost.notes


# --- AEDAT 3.1 ---


def test_aedat3_holds_all_kinds(folder: Path) -> None:
    """Triggers by their numbers, samples in SI units, frames with their times and region; types unknown are passed."""
    frame = frame_of(6, 4, x=2, y=3, bits=16)
    values = (1.0, -0.5, 0.25, 90.0, -180.0, 45.0, 30.5)
    content = aedat3(
        aedat3_packet(0, [aedat3_special(100 + kind, kind) for kind in range(18)], overflow=1),
        aedat3_packet(3, [aedat3_imu(7, values)]),
        aedat3_packet(2, [aedat3_frame(frame)]),
        aedat3_packet(9, [b"abc", b"def"]),
        aedat3_packet(1, [aedat3_event(5, 1, 2, 1), aedat3_event(6, 1, 2, 1, valid=0)]),
        source="DAVIS346B",
    )
    recording = read(folder, content)
    expected = [(0 if kind == 1 else 100 + kind + 2**31, TRIGGERS_3[kind]) for kind in range(18) if kind in TRIGGERS_3]
    assert recording.triggers.tolist() == expected
    (sample,) = recording.imu
    assert (sample["t"], sample["temperature"]) == (7, 30.5)
    np.testing.assert_allclose(sample["accel"], np.array(values[:3]) * G, rtol=1e-15)
    np.testing.assert_allclose(sample["gyro"], [math.pi / 2, -math.pi, math.pi / 4], rtol=1e-15)
    (found,) = recording.frames
    assert found[:6] == frame[:6]
    np.testing.assert_array_equal(found.pixels, frame.pixels)
    assert recording.events.tolist() == [(5, 1, 2, 1)]
    assert (recording.chip, recording.width, recording.height) == ("DAVIS346B", 346, 260)
    assert recording.started == datetime(2016, 6, 3, 17, 12, 58, tzinfo=timezone(timedelta(hours=2)))
    assert any(note.startswith("1 events marked as not valid") for note in recording.notes)
    assert any(note.startswith("13 packets of other types") for note in recording.notes)


@pytest.mark.parametrize("channels", [3, 4])
def test_colour_becomes_intensity(folder: Path, channels: int) -> None:
    """With the weights of ITU-R BT.601, in both formats' orders of colours."""
    frame = frame_of(6, 4, bits=16)
    red = np.rint(0.299 * frame.pixels).astype(np.uint16)
    (found,) = read(folder, aedat3(aedat3_packet(2, [aedat3_frame(frame, channels)]))).frames
    np.testing.assert_array_equal(found.pixels, red)
    form = 2 | (channels - 1) << 3
    (found,) = read(folder, aedat4((1, aedat4_frame(frame, form=form)))).frames
    np.testing.assert_array_equal(found.pixels, red)


def test_aedat3_without_a_known_camera(folder: Path) -> None:
    """The size is then what the events need; the caller may name the chip."""
    content = aedat3(aedat3_packet(1, [aedat3_event(1, 30, 20, 0)]), source="DVS128")
    recording = read(folder, content)
    assert (recording.chip, recording.width, recording.height) == ("", 31, 21)
    with pytest.raises(ValueError, match="a chip must be one of"):
        _ = recording.device
    assert read(folder, content, chip="DAVIS640").width == 640


# --- AEDAT 4 ---


@pytest.mark.parametrize("compression", [0, 1, 3])
def test_aedat4_holds_all_kinds(folder: Path, compression: int) -> None:
    """Triggers by their numbers, samples in SI units, frames of 8 and of 16 bits; other streams are passed."""
    start = 1_589_163_147_000_000
    small, deep = frame_of(6, 4, t=start, x=2, y=3, bits=8), frame_of(6, 4, t=start + 50, bits=16)
    values = (30.5, 1.0, -0.5, 0.25, 90.0, -180.0, 45.0)
    content = aedat4(
        (3, aedat4_triggers([(start + kind, kind) for kind in range(10)])),
        (2, aedat4_imu([(start + 5, values), (start + 6, values[:4])])),
        (1, aedat4_frame(small)),
        (1, aedat4_frame(deep, form=2)),
        (4, b"whatever"),
        (0, aedat4_events(events_of([(start + 9, 1, 2, 1), (start + 8, 3, 4, 0)]))),
        compression=compression,
    )
    recording = read(folder, content)
    assert recording.triggers.tolist() == [(start + kind, TRIGGERS_4[kind]) for kind in range(6)]
    assert recording.imu["t"].tolist() == [start + 5, start + 6]
    assert recording.imu["temperature"].tolist() == [30.5, 30.5]
    np.testing.assert_allclose(recording.imu["accel"], np.array([values[1:4]] * 2) * G, rtol=1e-15)
    rotations = np.array([[math.pi / 2, -math.pi, math.pi / 4], [0, 0, 0]])
    np.testing.assert_allclose(recording.imu["gyro"], rotations, rtol=1e-15)
    for found, expected in zip(recording.frames, (small, deep), strict=True):
        assert found[:6] == expected[:6]
        np.testing.assert_array_equal(found.pixels, expected.pixels)
    assert recording.events.tolist() == [(start + 9, 1, 2, 1), (start + 8, 3, 4, 0)]
    assert recording.started == datetime(2020, 5, 11, 2, 12, 27, tzinfo=timezone.utc)
    assert recording.start_us == start
    assert [note for note in recording.notes if "1 packets of other streams" in note]


def test_aedat4_without_a_table(folder: Path) -> None:
    """A recorder that was killed leaves packets to the end of the file."""
    events = events_of([(5, 1, 2, 1)])
    np.testing.assert_array_equal(read(folder, aedat4((0, aedat4_events(events)), table=None)).events, events)


def test_aedat4_events_outside(folder: Path) -> None:
    """Events that no pixel of the stated size has are left out, and counted; so are negative coordinates."""
    raw = np.zeros(4, [("t", "<i8"), ("x", "<i2"), ("y", "<i2"), ("p", "?"), ("pad", "V3")])
    raw["x"], raw["y"] = [345, 346, 0, -1], [259, 0, 260, 0]
    recording = read(folder, aedat4((0, aedat4_events(raw))))
    assert recording.events.tolist() == [(0, 345, 259, 0)]
    assert "3 events outside of 346 x 260 pixels left out" in recording.notes


@pytest.mark.few(1)
@pytest.mark.parametrize("compression", [1, 3])
def test_packets_that_grow_without_end_are_refused(folder: Path, compression: int) -> None:
    """A few kilobytes may not fill the memory."""
    content = aedat4((0, bytes(65 << 20)), compression=compression)
    assert len(content) < 1 << 20
    with pytest.raises(DecodeError, match="a packet may have 67108864 bytes unpacked"):
        read(folder, content)
    recording = read(
        folder,
        aedat4((0, aedat4_events(np.zeros(5 << 20, davis_rs.EVENT_DTYPE))), compression=compression),
        max_packet_bytes=81 << 20,
    )
    assert len(recording.events) == 5 << 20
    with pytest.raises(DecodeError, match="max_packet_bytes"):
        davis_rs.read_events(folder / "recording")


def test_samples_that_lie_on_top_of_each_other_are_refused(folder: Path) -> None:
    """A packet may name one table any number of times: what it becomes is limited like what it unpacks to."""
    sample = aedat4_imu([(1, [1.0] * 7)])
    vector = sample.index(struct.pack("<I", 1), 20)
    count = (2 << 20) + 1
    head = bytearray(sample[:vector] + struct.pack("<I", count))
    # Tables come behind the offsets, all of which point to the one that follows them.
    offsets = (4 * np.arange(count, 0, -1) + (len(sample) - vector - 8 - 48)).astype("<u4").tobytes()
    packet = bytes(head) + offsets + sample[vector + 8 :]
    packet = struct.pack("<I", len(packet) - 4) + packet[4:]
    with pytest.raises(DecodeError, match="max_packet_bytes"):
        read(folder, aedat4((2, packet), compression=3))


def test_compressed_files_need_no_further_library(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What the package writes by default, `davis-rs decode` reads as well as `info`."""
    path, events = folder / "own.aedat4", events_of([(5, 1, 2, 1)])
    with davis_rs.open_writer(path, (240, 180)) as writer:
        writer.write(events)
    for library in ("lz4", "lz4.frame", "zstandard"):
        monkeypatch.setitem(sys.modules, library, None)
    np.testing.assert_array_equal(read_recording(path).events, events)


# --- all formats ---


def test_times_from_the_start(folder: Path) -> None:
    """What a sequence wants: the first time is 0, for all kinds; a reset of the clock keeps its own."""
    frame = frame_of(2, 2, t=1000)
    content = aedat3(
        aedat3_packet(0, [aedat3_special(2**31 - 1, 1), aedat3_special(1200, 2)]),
        aedat3_packet(2, [aedat3_frame(frame)]),
        aedat3_packet(3, [aedat3_imu(1100, [0.0] * 7)]),
        aedat3_packet(1, [aedat3_event(1300, 1, 2, 1)]),
    )
    recording = read(folder, content)
    rebased = recording.from_start()
    assert (recording.start_us, rebased.start_us) == (1000, 0)
    assert rebased.frames[0][:4] == (0, 10, 20, 30)
    assert (rebased.events["t"].tolist(), rebased.imu["t"].tolist()) == ([300], [100])
    assert rebased.triggers.tolist() == [(0, 1), (200, 3)]
    assert recording.events["t"].tolist() == [1300]
    assert read(folder, aedat3()).from_start().start_us == 0


def test_a_cut_end_is_reported(folder: Path) -> None:
    """Where, and the rest is there."""
    event = struct.pack(">Ii", aedat2_event(1, 2, 1), 5)
    with pytest.warns(RecordingWarning, match=r"byte \d+: the last record is cut off after 3 of 8 bytes"):
        assert len(read(folder, aedat2([]) + event + event[:3]).events) == 1
    packet = aedat3_packet(1, [aedat3_event(5, 1, 2, 1)] * 3)
    with pytest.warns(RecordingWarning, match="the last packet is cut off after 2 of 3 events"):
        assert len(read(folder, aedat3(packet)[:-1]).events) == 2
    with pytest.warns(RecordingWarning, match="header is cut off after 27 of 28 bytes"):
        assert len(read(folder, aedat3(packet, packet[:27])).events) == 3
    content = aedat4(*[(0, aedat4_events(events_of([(5, 1, 2, 1)])))] * 2, table=None)
    with pytest.warns(RecordingWarning, match="the last packet is cut off"):
        assert len(read(folder, content[:-1]).events) == 1
    content = aedat4(*[(0, aedat4_events(events_of([(5, 1, 2, 1)])))] * 2)
    with pytest.warns(RecordingWarning, match="the last packet is cut off"):
        assert len(read(folder, content[: -len(b"a table") - 1]).events) == 1
    content = aedat4(compression=0, table=None).replace(struct.pack("<q", -1), struct.pack("<q", 1 << 20))
    with pytest.warns(RecordingWarning, match="cut off before its table of packets, at byte 1048576"):
        read(folder, content)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "byte 0: expected one of #!AER-DAT2.0, #!AER-DAT3.1, #!AER-DAT4.0, #!DAVIS-RAW 1, found"),
        (b"#!AER-DAT3.0\r\n", "found b'#!AER-DAT3.0"),
        (b"#!AER-DAT2.0\r\n", "only chip= can tell"),
        (aedat2([], chip="DVS128"), "only chip= can tell"),
        (b"#!AER-DAT3.1\r\n", "byte 14: expected a line '#!END-HEADER', the file ends"),
        (aedat3(form="SerializedTS"), "byte 23: only the format RAW is read, found 'SerializedTS'"),
        (aedat3(bytes(28)), "expected the header of a packet, found type 0 with 0 events of 0 bytes"),
        (aedat3(aedat3_packet(1, [bytes(9)])), "found type 1 with 1 events of 9 bytes"),
        (aedat3(aedat3_packet(2, [bytes(35)])), "a frame has at least 36 bytes, found 35"),
        (aedat3(aedat3_packet(2, [aedat3_frame(frame_of(4, 4))[:-1]])), "4 x 4 pixels in 1 channels .* 67 bytes"),
        (aedat3(aedat3_packet(2, [aedat3_frame(frame_of(4, 4), 2)])), "in 2 channels"),
        (aedat4(compression=0)[:40], "the header is cut off .byte 0."),
        (aedat4(xml="<dv"), "the header's XML: .*byte 14"),
        (aedat4(xml="<!DOCTYPE dv><dv/>"), "the header's XML: .*DTD"),
        (aedat4((0, b"")), "stream 0: a packet of 0 bytes must hold a flatbuffer"),
        (aedat4((0, aedat4_triggers([]))), "stream 0: a packet must be an EVTS flatbuffer"),
        (
            aedat4((0, aedat4_events(events_of([]))[:-1])),
            "a packet of .* bytes must hold a flatbuffer, and ends before it does",
        ),
        (aedat4((1, aedat4_frame(frame_of(4, 4), form=5))), "OpenCV's type 5"),
        (aedat4() + struct.pack("<ii", 0, -1), None),
        (aedat4(table=None) + struct.pack("<ii", 0, -1), "a packet's size must be positive, not -1"),
    ],
)
def test_malformed_files(folder: Path, content: bytes, message: str | None) -> None:
    """The rule, what was found and the byte; what follows AEDAT 4's packets is not read."""
    if message is None:
        assert not len(read(folder, content).events)
        return
    with pytest.raises(DecodeError, match=message):
        read(folder, content)


def test_arguments(folder: Path) -> None:
    """A chip or a range that there is not is the caller's mistake, not the file's."""
    for arguments, message in (
        ({"chip": "DVS128"}, "a chip must be one of"),
        ({"accelerometer_range_g": 5}, r"accelerometer range must be one of \(2, 4, 8, 16\) g, got 5"),
        ({"gyroscope_range_deg_s": 0}, "gyroscope range must be one of"),
    ):
        with pytest.raises(ValueError, match=message) as caught:
            read(folder, aedat2([]), **arguments)
        assert not isinstance(caught.value, DecodeError)
    with pytest.raises(FileNotFoundError):
        read_recording(folder / "nothing")


def files_of_all() -> Iterator[bytes]:
    """A small file of each format and compression, with everything in it."""
    frame = frame_of(5, 3, bits=9)
    words = samples_of(frame, reset=512, by_rows=False, flip=False, rolling=False, double=True)
    imu = aedat2_imu(range(7))
    yield aedat2([(word, t) for t, word in enumerate([aedat2_event(1, 2, 1), *imu, 0x402, *words, *imu])])
    rows = [(t, t, t, 1) for t in range(5)]
    yield aedat3(
        aedat3_packet(1, [aedat3_event(*row) for row in rows]),
        aedat3_packet(0, [aedat3_special(1, 2)]),
        aedat3_packet(2, [aedat3_frame(frame)] * 2),
        aedat3_packet(3, [aedat3_imu(1, [1.0] * 7)] * 2),
    )
    for compression in (0, 1, 3):
        yield aedat4(
            (0, aedat4_events(events_of(rows))),
            (1, aedat4_frame(frame)),
            (2, aedat4_imu([(1, [1.0] * 7)] * 3)),
            (3, aedat4_triggers([(1, 0), (2, 1)])),
            compression=compression,
        )


@pytest.mark.parametrize("at_once", [1, 2, 5, 8, 60])
@pytest.mark.parametrize("content", list(files_of_all())[:2], ids=["2.0", "3.1"])
def test_pieces_of_any_size_are_the_whole(
    folder: Path, monkeypatch: pytest.MonkeyPatch, content: bytes, at_once: int
) -> None:
    """Samples, frames and times that go on in the next piece; events are found again by the place of their piece."""
    whole = read(folder, content)
    for module in (aedat2_module, aedat3_module):
        monkeypatch.setattr(module, "_AT_ONCE", at_once)
    parts = read(folder, content)
    for name in ("events", "imu", "triggers"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))
        assert len(getattr(parts, name)) > 0 or name == "triggers"
    assert [frame.pixels.tolist() for frame in parts.frames] == [frame.pixels.tolist() for frame in whole.frames]
    assert (parts.notes, parts.cut, len(parts.frames) > 0) == (whole.notes, whole.cut, True)
    access = RandomAccess(folder / "recording")
    for number, event in enumerate(whole.events):
        assert access.read(number, number + 1)[0] == event


def test_kinds_are_read_by_themselves(folder: Path) -> None:
    """Each alone is what it is with the others."""
    for content in files_of_all():
        whole = read(folder, content)
        with open_reader(folder / "recording") as reader:
            assert isinstance(reader, RecordedParts)
            for kind in RECORDED_KINDS:
                pieces = [piece.decoded for piece in reader.recording.pieces((kind,))]
                for other in RECORDED_KINDS:
                    count = sum(len(getattr(piece, other)) for piece in pieces)
                    assert count == (len(getattr(whole, kind)) if other == kind else 0)


def test_frames_alone_are_a_recording(folder: Path) -> None:
    """An AEDAT 4 without a stream of events is decoded and looked at; who asks for events is told."""
    frame = frame_of(5, 3, bits=8)
    (folder / "recording").write_bytes(aedat4((0, aedat4_frame(frame)), xml=aedat4_xml(["FRME"], size=(5, 3))))
    assert "0 events, 0 IMU samples, 1 frames, 0 triggers" in command("decode", folder / "recording").stdout
    assert len(open_visual_sequence(folder / "recording").frame_times) == 1
    with pytest.raises(DecodeError, match="has no stream of events"):
        davis_rs.read_events(folder / "recording")


def test_events_are_read_in_bounded_memory(tmp_path: Path) -> None:
    """Of files that are longer: a piece at a time, whatever else lies between the events."""
    count = 1 << 20
    records = np.zeros(count, [("address", ">u4"), ("t", ">i4")])
    records["address"], records["t"] = aedat2_event(1, 2, 1), np.arange(count)
    (tmp_path / "a.aedat").write_bytes(aedat2([]) + records.tobytes())
    pairs = np.zeros(count, [("data", "<u4"), ("t", "<i4")])
    pairs["data"], pairs["t"] = 1 << 17 | 2 << 2 | 3, np.arange(count)
    packet = struct.pack("<hhiiiiii", 1, 1, 8, 4, 0, count, count, count) + pairs.tobytes()
    (tmp_path / "b.aedat").write_bytes(aedat3(packet))
    for name in ("a.aedat", "b.aedat"):
        tracemalloc.start()
        assert sum(len(events) for events in davis_rs.iter_events(tmp_path / name, chunk=10_000)) == count
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 12 << 20  # the events alone have 16 MiB


def test_a_cameras_bytes_are_a_recording(tmp_path: Path) -> None:
    """What was sent comes back, with what the file says of its camera."""
    events = events_of([(5, 1, 2, 1), (9, 3, 4, 0)])
    with RawWriter(tmp_path / "e.davis", DESCRIPTION) as writer:
        writer.write(davis_rs.Encoder("DAVIS240C").encode(events))
    recording = read_recording(tmp_path / "e.davis")
    np.testing.assert_array_equal(recording.events, events)
    assert (recording.chip, recording.width, recording.height, recording.cut) == ("DAVIS240C", 240, 180, ())
    assert recording.started == RawRecording(tmp_path / "e.davis").started
    with pytest.raises(ValueError, match="is of a DAVIS240C: leave out chip="):
        read_recording(tmp_path / "e.davis", chip="DAVIS346B")
    content = (tmp_path / "e.davis").read_bytes()
    (tmp_path / "e.davis").write_bytes(content.replace(b'"complete": true', b'"complete":false'))
    with pytest.warns(RecordingWarning, match="was not finished; what is there is read"):
        assert len(read_recording(tmp_path / "e.davis").events) == 2


@pytest.mark.parametrize("content", list(files_of_all()), ids=["2.0", "3.1", "4", "4 LZ4", "4 ZSTD"])
@given(data=st.data())
def test_malformed_bytes_never_crash(folder: Path, content: bytes, data: st.DataObject) -> None:
    """Bytes changed, left out and cut off give a recording or a DecodeError, in a few megabytes."""
    changed = bytearray(content)
    # The header's text takes most of the bytes and says little.
    places = st.integers(0, len(content) - 1) | st.integers(1, min(len(content), 400)).map(lambda k: len(content) - k)
    for place, byte in data.draw(st.lists(st.tuples(places, st.integers(0, 255)), max_size=4)):
        changed[place] = byte
    if data.draw(st.booleans()):
        del changed[data.draw(places) :]
    if changed and data.draw(st.booleans()):
        del changed[data.draw(st.integers(0, len(changed) - 1))]
    tracemalloc.start()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RecordingWarning)
            recording = read(folder, bytes(changed))
        assert len(recording.events) <= len(changed)
    except DecodeError:
        pass
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak < 16 << 20


# --- real ones ---


def real(name: str) -> Path:
    path = RECORDINGS / name
    if not path.exists():
        pytest.skip(f"needs {name}")
    return path


@pytest.fixture(scope="module")
def boxes() -> Recording:
    """2 s of a DAVIS240C before boxes."""
    with pytest.warns(RecordingWarning, match="byte 1748084: the last inertial sample is cut off after 6 of 7 words"):
        return read_recording(real("davis240c_translBoxes.aedat"))


@pytest.fixture(scope="module")
def street() -> Recording:
    """0.17 s of a DAVIS346 above a street."""
    return read_recording(real("davis346_sample.aedat4"))


def test_real_aedat2(boxes: Recording) -> None:
    """Counts; and gravity is what it should be, by the full scale in the header's preferences."""
    assert (len(boxes.events), len(boxes.imu), len(boxes.frames), len(boxes.triggers)) == (162_771, 4_833, 0, 0)
    assert (boxes.chip, boxes.width, boxes.height) == ("DAVIS240C", 240, 180)
    assert (boxes.accelerometer_range_g, boxes.gyroscope_range_deg_s) == (8, 1000)
    assert np.linalg.norm(boxes.imu["accel"].mean(axis=0)) == pytest.approx(G, rel=0.02)
    assert 25 < boxes.imu["temperature"].mean() < 35
    assert boxes.start_us == 294_976_755
    assert (boxes.events["x"].max(), boxes.events["y"].max()) == (239, 179)


def test_real_recording_through_the_wire(boxes: Recording) -> None:
    """Encoded to a camera's words and decoded again it is the same recording, and nothing in the words is odd."""
    assert boxes.accelerometer_range_g is not None
    assert boxes.gyroscope_range_deg_s is not None
    ranges = (boxes.accelerometer_range_g // 2, boxes.gyroscope_range_deg_s // 250)
    accel_range, gyro_range = (factor.bit_length() - 1 for factor in ranges)
    encoder = davis_rs.Encoder(boxes.device, accel_range=accel_range, gyro_range=gyro_range)
    decoder = davis_rs.Decoder(boxes.device)
    decoded = decoder.push(encoder.encode(*boxes.decoded))
    np.testing.assert_array_equal(decoded.events, boxes.events)
    np.testing.assert_array_equal(decoded.imu, boxes.imu)
    assert not any(decoder.stats.values())


def test_real_aedat4(street: Recording) -> None:
    """Events, samples and pixels, each as dv-processing 2.0.4 reads them: the digests are of its arrays."""
    assert (len(street.events), len(street.imu), len(street.frames)) == (6_676, 160, 4)
    assert (street.chip, street.width, street.height) == ("DAVIS346B", 346, 260)
    events, imu = street.events, street.imu
    assert digest(*(events[name] for name in "txyp")) == "e849f4cd83e99fc05f85e5ec8eb1c9ca"
    begins = np.array([frame.t_exposure_start for frame in street.frames])
    pixels = [(frame.pixels >> 8).astype(np.uint8) for frame in street.frames]
    assert digest(begins, *pixels) == "035170b83951bf995399064d5326f15d"
    in_g, in_degrees = (imu["accel"] / G).astype("<f4"), np.degrees(imu["gyro"]).astype("<f4")
    assert digest(imu["t"], in_g, in_degrees, imu["temperature"].astype("<f4")) == "e953c5b60ee23da892d9fa495ba72073"


def digest(*columns: np.ndarray[Any, Any]) -> str:
    return hashlib.sha256(b"".join(np.ascontiguousarray(column).tobytes() for column in columns)).hexdigest()[:32]


def test_real_aedat4_replayed(street: Recording) -> None:
    """A camera of its kind could have sent it: its events and triggers come back from the wire."""
    recording = replace(street.from_start(), frames=[])
    decoded = davis_rs.Decoder(recording.device).push(davis_rs.Encoder(recording.device).encode(recording.events))
    np.testing.assert_array_equal(decoded.events, recording.events)


# --- writing AEDAT 2.0 ---


def test_aedat2_is_written_byte_for_byte(tmp_path: Path) -> None:
    """The header's lines end with CR and LF and name jAER's class; a record is address and time, big-endian."""
    events = np.array([(7, 0, 0, 0), (7, 239, 179, 1), (2**31 - 1, 3, 5, 1)], EVENT_DTYPE)
    with open_writer(tmp_path / "e.aedat", (240, 180)) as writer:
        writer.write(events)
    assert writer.finish().format == "aedat2"
    content = (tmp_path / "e.aedat").read_bytes()
    header, records = content[:-24], content[-24:]
    assert header.startswith(b"#!AER-DAT2.0\r\n")
    assert all(line.startswith(b"#") for line in header.split(b"\r\n")[:-1])
    assert b"# AEChip: eu.seebetter.ini.chips.davis.DAVIS240C\r\n" in header
    words = [aedat2_event(int(x), int(y), int(p)) for _, x, y, p in events.tolist()]
    times = [7, 7, 2**31 - 1]
    assert records == b"".join(struct.pack(">Ii", word, t) for word, t in zip(words, times, strict=True))
    assert np.array_equal(read_events(tmp_path / "e.aedat"), events)
    late = np.array([(2**31, 0, 0, 0)], EVENT_DTYPE)
    with open_writer(tmp_path / "f.aedat", (240, 180)) as writer, pytest.raises(ValueError, match="2147483648"):
        writer.write(late)


@pytest.mark.parametrize("size", [(128, 128), (346, 260), (640, 480)])
def test_aedat2_of_each_camera_comes_back(tmp_path: Path, size: tuple[int, int]) -> None:
    corners = [(1, 0, 0, 1), (2, size[0] - 1, 0, 0), (3, 0, size[1] - 1, 1), (4, size[0] - 1, size[1] - 1, 0)]
    with open_writer(tmp_path / "e.aedat2", size) as writer:
        writer.write(np.array(corners, EVENT_DTYPE))
    recording = read_recording(tmp_path / "e.aedat2")
    assert (recording.width, recording.height) == size
    assert recording.events.tolist() == corners


def test_aedat2_of_another_size_is_refused_before_a_file_is_made(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="size 320x240: aedat2 names a camera in place of a size, and there is one of"):
        open_writer(tmp_path / "e.aedat", (320, 240))
    assert not (tmp_path / "e.aedat").exists()
    out = tmp_path / "out"
    with pytest.raises(ValueError, match="size 320x240"):
        DatasetWriter(out, (320, 240), events_format="aedat2")
    assert not out.exists()
