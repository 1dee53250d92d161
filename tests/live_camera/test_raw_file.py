"""Recordings of a camera's bytes, and the files that decoded streams go to."""

from __future__ import annotations

import dataclasses
import json
from contextlib import suppress
from datetime import datetime, timezone
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import davis_rs
from davis_rs import DavisDescription, DecodeError, RawRecording, RawWriter
from davis_rs.io.files.backward import TimeOrder
from davis_rs.io.files.decoded_output import decoded_output
from davis_rs.usb.davis import Davis
from davis_rs.usb.virtual_backend import VirtualBackend
from davis_rs.usb.virtual_davis import VirtualDavis, paced
from streams import CHIPS, assert_same, contents, decode, encode, join

SIZE = (240, 180)


def description(chip: str = "DAVIS240C") -> DavisDescription:
    with Davis.open(backend=VirtualBackend(VirtualDavis(paced(b""), chip=chip))) as davis:
        return davis.description


@pytest.mark.parametrize("chip", CHIPS)
def test_a_recording_comes_back(tmp_path: Path, chip: str) -> None:
    """Camera, start and every byte; decoded from the file it is what was sent."""
    words = encode(chip, contents(chip))
    started = datetime(2026, 1, 2, 3, 4, 5, 678901, tzinfo=timezone.utc)
    path = tmp_path / "recording.raw"
    with RawWriter(path, description(chip), started=started) as writer:
        for at in range(0, len(words), 1000):
            writer.write(words[at : at + 1000])
    recording = RawRecording(path)
    assert (recording.camera, recording.started, recording.complete) == (description(chip), started, True)
    assert b"".join(recording.chunks(777)) == words
    decoder = recording.decoder()
    assert_same(join([decoder.push(chunk) for chunk in recording.chunks(777)]), davis_rs.Decoder(chip).push(words))


def test_a_recording_that_was_killed_is_good_as_far_as_it_goes(tmp_path: Path) -> None:
    """Its header says so; nothing that stands at the end of a file is needed."""
    path = tmp_path / "recording.raw"
    with suppress(KeyboardInterrupt), RawWriter(path, description()) as writer:
        writer.write(b"\x01\x00")
        raise KeyboardInterrupt
    recording = RawRecording(path)
    assert not recording.complete
    assert list(recording.chunks()) == [b"\x01\x00"]
    with pytest.raises(FileExistsError):
        RawWriter(path, description())
    path.write_bytes(path.read_bytes()[:1024])
    assert list(RawRecording(path).chunks()) == []


def test_losses_are_in_the_header(tmp_path: Path) -> None:
    """A recording with a gap does not pass for a whole one."""
    writer = RawWriter(tmp_path / "recording.raw", description())
    assert writer.finish(lost_bytes=123) == 0
    assert RawRecording(tmp_path / "recording.raw").lost_bytes == 123


def header(**changes: object) -> bytes:
    camera = {**dataclasses.asdict(description()), **changes}
    meta = {"complete": True, "lost_bytes": 0, "started": "2026-01-02T03:04:05+00:00", "camera": camera}
    return (b"#!DAVIS-RAW 1\n" + json.dumps(meta).encode()).ljust(1023) + b"\n"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", r"byte 0: expected '#!DAVIS-RAW 1'"),
        (b"#!AER-DAT2.0\r\n" + bytes(2000), "byte 0: expected"),
        (header()[:500], "byte 500: the header has 1024 bytes"),
        (b"#!DAVIS-RAW 1\n" + b"{" * 1010, "byte 14: malformed header"),
        (b"#!DAVIS-RAW 1\n" + b"[1]".ljust(1010), "byte 14: malformed header"),
        (header(chip="DAVIS999"), "DAVIS999"),
        (header(columns=0), "dvs_columns"),
        (header(columns="240"), "malformed header"),
        (header(colour="red"), "colour"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, content: bytes, message: str) -> None:
    """With the byte, and before anything is decoded."""
    path = tmp_path / "recording.raw"
    path.write_bytes(content)
    with pytest.raises(DecodeError, match=message):
        RawRecording(path)


def events_at(times: list[int]) -> np.ndarray[tuple[int], np.dtype[np.void]]:
    events = np.zeros(len(times), davis_rs.EVENT_DTYPE)
    events["t"], events["x"] = times, range(len(times))
    return events


@given(st.lists(st.lists(st.integers(0, 6), max_size=6), max_size=5))
def test_runs_never_go_back_in_time(packets: list[list[int]]) -> None:
    """Splitting loses nothing and splits only where it must; dropping leaves the running maxima; refusing is exact."""
    times = [t for packet in packets for t in packet]
    backward = [k for k in range(1, len(times)) if times[k] < times[k - 1]]

    split = TimeOrder("split")
    runs: list[list[int]] = [[]]
    for packet in packets:
        first, *later = split.push(events_at(packet))
        runs[-1] += first["t"].tolist()
        runs += [run["t"].tolist() for run in later]
    assert [t for run in runs for t in run] == times
    assert all(run == sorted(run) for run in runs)
    assert split.splits == len(runs) - 1 == len(backward)

    drop = TimeOrder("drop")
    kept = [t for packet in packets for run in drop.push(events_at(packet)) for t in run["t"].tolist()]
    assert kept == [t for k, t in enumerate(times) if t == max(times[: k + 1])]
    assert drop.dropped == len(times) - len(kept)

    refuse = TimeOrder("refuse")
    if backward:
        with pytest.raises(ValueError, match=f"event {backward[0]} is at {times[backward[0]]} us"):
            [refuse.push(events_at(packet)) for packet in packets]
    else:
        assert [refuse.push(events_at(packet))[0]["t"].tolist() for packet in packets] == packets


def test_text_splits_into_files(tmp_path: Path) -> None:
    """A clock that was reset gives two sequences; what the format has no place for is told."""
    sent = contents("DAVIS240C", events=500)
    output = decoded_output(tmp_path / "events.txt", SIZE, backward="split")
    output.write(sent)
    output.write(sent)
    said = "\n".join(output.finish())
    for name in ("events.txt", "events-1.txt"):
        np.testing.assert_array_equal(davis_rs.read_events(tmp_path / name), sent.events)
    assert "1000 events" in said
    assert "in 2 files" in said
    assert "598 IMU samples, 4 frames, 10 triggers" in said


def test_text_drops_or_refuses(tmp_path: Path) -> None:
    """As asked for; what was written before a refusal stays."""
    sent = contents("DAVIS240C", events=500)
    dropping = decoded_output(tmp_path / "dropped.txt", SIZE, backward="drop")
    dropping.write(sent)
    dropping.write(sent)
    last = sent.events["t"] == sent.events["t"].max()
    assert f"{500 - last.sum()} events dropped" in "\n".join(dropping.finish())
    refusing = decoded_output(tmp_path / "refused.txt", SIZE)
    refusing.write(sent)
    with pytest.raises(ValueError, match="times may not go back: event 500"):
        refusing.write(sent)
    assert "500 events" in refusing.finish()[0]
    with pytest.raises(ValueError, match=r"the suffix of .*events\.csv.* is no event format"):
        decoded_output(tmp_path / "events.csv", SIZE)


def test_arrays_hold_everything(tmp_path: Path) -> None:
    """Events, samples, triggers and frames with their times, from several pieces."""
    words = encode("DAVIS346B", contents("DAVIS346B"))
    decoder = davis_rs.Decoder("DAVIS346B")
    output = decoded_output(tmp_path / "all.npz", SIZE)
    for at in range(0, len(words), 4096):
        output.write(decoder.push(words[at : at + 4096]))
    output.finish()
    whole = davis_rs.Decoder("DAVIS346B").push(words)
    with np.load(tmp_path / "all.npz") as arrays:
        np.testing.assert_array_equal(arrays["events"], whole.events)
        np.testing.assert_array_equal(arrays["imu"], whole.imu)
        np.testing.assert_array_equal(arrays["triggers"], whole.triggers)
        assert arrays["frame_regions"].tolist() == [[0, 0, 346, 260]] * 2
        for k, frame in enumerate(whole.frames):
            np.testing.assert_array_equal(arrays[f"frame_{k}"], frame.pixels)
            assert arrays["frame_times"][k].tolist() == list(frame[:4])
    assert len(decode("DAVIS346B", words).frames) == 2
