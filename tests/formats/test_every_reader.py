"""Whatever takes events takes every kind of file that holds some."""

from __future__ import annotations

import struct
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import davis_rs
from command_line import davis_rs as command
from davis_rs import DecodeError, RawWriter, open_writer, read_events
from davis_rs.calibrate.sensor import measure_recording
from davis_rs.events.arrays import concatenate_events
from davis_rs.inspection.statistics import measure_stream
from davis_rs.inspection.summary import summarize_events
from davis_rs.inspection.visual_sequence import open_visual_sequence
from davis_rs.io.files.random_access import RandomAccess
from davis_rs.io.files.read import open_reader
from davis_rs.io.files.sensor_size import sensor_size
from davis_rs.io.formats import FORMATS, TruncatedFileWarning
from event_files import SIZE, assert_same, many
from recording_files import (
    DESCRIPTION,
    aedat2,
    aedat2_event,
    aedat3,
    aedat3_event,
    aedat3_packet,
    aedat4,
    aedat4_events,
    aedat4_xml,
    evt21,
    write_ecf,
)

for module in ("h5py", "hdf5plugin", "numcodecs", "pyarrow", "rosbags"):
    pytest.importorskip(module)

EVENTS = many(300, start_us=1000)
ROWS = EVENTS.tolist()

Make = Callable[[Path], Path]


def written(name: str, format: str | None = None, **options: Any) -> Make:
    """A file by the writer of its format; those that do not say the size lie next to a meta.json that does."""

    def make(folder: Path) -> Path:
        (folder / "meta.json").write_text('{"sensor": {"width": 240, "height": 180}}')
        with open_writer(folder / name, SIZE, format, **options) as writer:
            writer.write(EVENTS[:100])
            writer.write(EVENTS[100:])
        return folder / name

    return make


def dataset(events: str) -> Make:
    return written("folder", "folder", events=events)


def bytes_of(name: str, content: bytes) -> Make:
    def make(folder: Path) -> Path:
        (folder / name).write_bytes(content)
        return folder / name

    return make


def compressed_npz(folder: Path) -> Path:
    np.savez_compressed(written("unused.npy")(folder).with_name("e.npz"), events=EVENTS)
    return folder / "e.npz"


def bag_without_index(folder: Path) -> Path:
    path = written("e.bag")(folder)
    content = bytearray(path.read_bytes())
    struct.pack_into("<Q", content, content.index(b"index_pos=") + len(b"index_pos="), 0)
    path.write_bytes(content)
    return path


def database_of_ros2(folder: Path) -> Path:
    return next(written("e", "ros2")(folder).glob("*.db3"))


def camera_bytes(folder: Path) -> Path:
    with RawWriter(folder / "e.davis", DESCRIPTION) as writer:
        writer.write(davis_rs.Encoder("DAVIS240C").encode(EVENTS))
    return folder / "e.davis"


FILE_MAKERS: dict[str, Make] = {
    "text": written("e.txt"),
    "text with size": written("e.txt", size_line=True),
    "npy": written("e.npy"),
    "npz": written("e.npz"),
    "npz compressed": compressed_npz,
    "evt2": written("e.raw", "evt2"),
    "evt21": bytes_of("e.raw", evt21(EVENTS)),
    "evt3": written("e.raw"),
    "aedat4": written("e.aedat4"),
    "aedat4 of DV": bytes_of("e.aedat4", aedat4((0, aedat4_events(EVENTS)), xml=aedat4_xml(size=SIZE))),
    "dsec": written("e.h5"),
    "e2vid": written("e.h5", "e2vid"),
    "mvsec": written("e.h5", "mvsec"),
    "ecf": lambda folder: write_ecf(folder / "e.h5", EVENTS),
    "parquet": written("e.parquet"),
    "bag": written("e.bag"),
    "bag without an index": bag_without_index,
    "ros2 file": written("e.mcap"),
    "ros2 folder": written("e", "ros2"),
    "ros2 database": database_of_ros2,
    "aedat2": written("e.aedat2"),
    "aedat2 of jAER": bytes_of("e.aedat", aedat2([(aedat2_event(x, y, p), t) for t, x, y, p in ROWS])),
    "aedat3": bytes_of("e.aedat", aedat3(*(aedat3_packet(1, [aedat3_event(*row)]) for row in ROWS))),
    "camera": camera_bytes,
    **{f"folder of {name}": dataset(name) for name in ("text", "npz", "dsec")},
}
ONE_WAY = {
    "npz compressed": "the archive is compressed",
    "bag without an index": "the bag has no index",
    "ros2 file": "holds nothing to find a place by",
    "ros2 folder": "holds nothing to find a place by",
    "ros2 database": "holds nothing to find a place by",
    "camera": "times in a camera's stream follow from those before them",
}
"""Kinds that are only read from their beginning, and why."""

every_kind = pytest.mark.parametrize("kind", FILE_MAKERS)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """One of each kind, in a folder of its own."""
    return {kind: make(tmp_path_factory.mktemp("kind")) for kind, make in FILE_MAKERS.items()}


def test_every_format_is_there(files: dict[str, Path]) -> None:
    """What is registered is tried here."""
    found = set()
    for path in files.values():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", TruncatedFileWarning)
            with open_reader(path) as reader:
                found.add(reader.format)
    assert found | {"folder"} == set(FORMATS)


@pytest.mark.few(12)
@pytest.mark.filterwarnings("ignore::davis_rs.io.formats.TruncatedFileWarning")
@pytest.mark.filterwarnings("ignore::davis_rs.io.files.sensor_size.SensorSizeWarning")
@every_kind
def test_functions_take_every_kind(files: dict[str, Path], tmp_path: Path, kind: str) -> None:
    """The same events, whoever reads them; by number where the format can, and else with the reason."""
    path = files[kind]
    assert_same(read_events(path), EVENTS)
    assert_same(concatenate_events(list(davis_rs.iter_events(path, chunk=77))), EVENTS)
    between = EVENTS[(EVENTS["t"] >= 1050) & (EVENTS["t"] < 1100)]
    assert_same(read_events(path, start_us=1050, stop_us=1100), between)
    with open_reader(path) as reader:
        assert sensor_size(reader) == SIZE
    summary = summarize_events(path)
    assert (summary.events, summary.size, summary.size_known) == (len(EVENTS), SIZE, True)
    assert measure_stream(path).events == len(EVENTS)
    assert measure_recording(path).statistics.events == len(EVENTS)
    seen = open_visual_sequence(path)
    assert (len(seen.events), seen.size) == (len(EVENTS), SIZE)
    assert davis_rs.convert(path, tmp_path / "e.aedat4", parts=()).events == len(EVENTS)
    assert_same(read_events(tmp_path / "e.aedat4"), EVENTS)
    if kind in ONE_WAY:
        for opens in (RandomAccess, lambda path: davis_rs.EventWindows(path, "count", count=50)):
            with pytest.raises(DecodeError, match=f"{ONE_WAY[kind]}.*convert it"):
                opens(path)
    else:
        assert_same(RandomAccess(path).read(120, 130), EVENTS[120:130])
        windows = davis_rs.EventWindows(path, "count", count=50)
        assert (len(windows), windows.size) == (6, SIZE)
        assert_same(windows[4].events, EVENTS[200:250])


@pytest.mark.few(8)
@every_kind
def test_commands_take_every_kind(files: dict[str, Path], tmp_path: Path, kind: str) -> None:
    """All that take an event file end well, and count alike."""
    path, out = files[kind], tmp_path / "out"
    for words, count in (
        (["info", path], "300"),
        (["convert", path, out, "--parts", "none"], "300 events"),
        (["compare", path, out], "300"),
        (["calibrate", "sensor", path], "threshold"),
        (["view", path, "--html", tmp_path / "e.html"], "300"),
    ):
        done = command(*words, *([] if words[0] == "view" else ["--quiet"]))
        assert (done.returncode, count in done.stdout) == (0, True), (words, done)
    done = command("decode", path, "-o", tmp_path / "d.aedat4")
    assert (done.returncode, "300 events" in done.stdout) == (0, True), done
    assert len(read_events(tmp_path / "d.aedat4")) == len(EVENTS)
