"""Formats in other people's containers (HDF5, Parquet, bags): what is written is read, and what a crash leaves."""

from __future__ import annotations

import errno
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from davis_rs import DecodeError, open_writer, read_events
from davis_rs.events.arrays import EVENT_DTYPE, EventArray
from davis_rs.io.files.read import open_reader
from davis_rs.io.formats import FORMATS, EventWriter, TruncatedFileWarning
from event_files import FORMAT_VARIANTS, SIZE, assert_same, events_of, many
from long_form import long_values
from places import ROOT

pytest.importorskip("h5py")
pytest.importorskip("numcodecs")
pytest.importorskip("hdf5plugin")
pytest.importorskip("pyarrow")
pytest.importorskip("rosbags")

FILE_NAMES = {
    "dsec": "e.h5",
    "e2vid": "e.h5",
    "mvsec": "e.h5",
    "parquet": "e.parquet",
    "bag": "e.bag",
    "ros2": "e.mcap",
}

every_format = pytest.mark.parametrize("name", sorted(FILE_NAMES))


def write(path: Path, name: str, events: EventArray, *, packet: int = 1 << 30) -> None:
    with open_writer(path, SIZE, name, overwrite=True) as writer:
        for start in range(0, len(events), packet):
            writer.write(events[start : start + packet])


# ---- what is written is read ----


@st.composite
def streams(draw: st.DrawFn) -> EventArray:
    """Event arrays in order of time, with ties, from 0, around 2^31 and 2^32 us, and in Unix time."""
    start = draw(st.sampled_from([0, 2**31 - 5, 2**32 - 5, 1_700_000_000_000_000]))
    steps = draw(
        st.lists(
            st.tuples(
                st.sampled_from([0, 1, 999, 1000, 33_333]),
                st.integers(0, SIZE[0] - 1),
                st.integers(0, SIZE[1] - 1),
                st.integers(0, 1),
            ),
            max_size=40,
        )
    )
    events = np.array(steps, EVENT_DTYPE)
    events["t"] = start + np.cumsum(events["t"])
    return events


@pytest.mark.few(2)
@every_format
@settings(max_examples=30)
@given(events=streams(), cuts=st.lists(st.integers(0, 40), max_size=3), flush=st.booleans())
def test_what_is_written_is_read(
    tmp_path_factory: pytest.TempPathFactory, name: str, events: EventArray, cuts: list[int], flush: bool
) -> None:
    """Whatever the packets and flushes; times past 2^31 and 2^32 us stay right, ties keep their order."""
    if name == "dsec" and len(events) and events["t"][-1] >= 2**32 > events["t"][0]:
        events["t"] += 2**32  # DSEC's times have 32 bits; the refusal has a test of its own
    path = tmp_path_factory.mktemp("files") / FILE_NAMES[name]
    with open_writer(path, SIZE, name) as writer:
        for packet in np.split(events, sorted(cuts)):
            writer.write(packet)
            if flush:
                writer.flush()
    report = writer.finish()
    assert (report.events, report.bytes) == (len(events), path.stat().st_size)
    with open_reader(path) as reader:
        assert reader.format == name
        # A bag says its size with its first events.
        assert reader.size == (SIZE if name not in ("bag", "ros2") or len(events) else None)
        assert_same(reader.read(), events)


@every_format
def test_more_than_one_chunk_is_written_whole(tmp_path: Path, name: str) -> None:
    """300,001 events in packets of 999 pass the chunk, row group or message many times: none is lost or doubled."""
    events, path = many(300_001), tmp_path / FILE_NAMES[name]
    write(path, name, events, packet=999)
    assert_same(read_events(path), events)


@every_format
def test_slices_of_time_and_space_are_those_of_the_whole(tmp_path: Path, name: str) -> None:
    """A slice is what a mask over all events selects, at the ends, across chunks and where there is nothing."""
    events, path = many(300_000, start_us=1_000_000), tmp_path / FILE_NAMES[name]
    write(path, name, events)
    t = events["t"]
    for start, stop in (
        (None, int(t[1000])),
        (int(t[140_000]), int(t[140_001]) + 1),
        (int(t[131_000]), int(t[262_200])),
        (0, 5),
        (int(t[-1]), None),
        (int(t[-1]) + 1, None),
    ):
        keep = np.ones(len(t), np.bool_)
        keep &= t >= (0 if start is None else start)
        keep &= t < (2**62 if stop is None else stop)
        assert_same(read_events(path, start_us=start, stop_us=stop), events[keep])
        region = (10, 20, 60, 90)
        keep &= (events["x"] >= 10) & (events["x"] < 60) & (events["y"] >= 20) & (events["y"] < 90)
        assert_same(read_events(path, start_us=start, stop_us=stop, roi=region), events[keep])


@every_format
def test_chunks_join_to_the_whole(tmp_path: Path, name: str) -> None:
    """iter() hands out arrays of the size asked for, the last one shorter, and progress ends at 1."""
    events, path = many(50_000), tmp_path / FILE_NAMES[name]
    write(path, name, events)
    with open_reader(path) as reader:
        parts = list(reader.iter(7_001))
        assert reader.progress == 1.0
    assert [len(part) for part in parts] == [7_001] * 7 + [50_000 - 7 * 7_001]
    assert_same(np.concatenate(parts), events)


@every_format
def test_the_callers_arrays_are_only_read(tmp_path: Path, name: str) -> None:
    """Read-only arrays are taken, and one that is filled anew after write() changes nothing that was written."""
    events, path = many(1000), tmp_path / FILE_NAMES[name]
    expected, reused = events.tobytes(), np.zeros(100, EVENT_DTYPE)
    events.flags.writeable = False
    with open_writer(path, SIZE, name) as writer:
        writer.write(events[:500])
        for start in range(500, 1000, 100):
            reused[:] = events[start : start + 100]
            writer.write(reused)
            reused[:] = 0
    assert events.tobytes() == expected
    assert read_events(path).tolist() == events.tolist()


# ---- what is refused ----


@every_format
@pytest.mark.parametrize(
    ("event", "words"),
    [
        ((5, 0, 0, 1), "event 1"),  # out of order
        ((11, 240, 0, 1), "event 1"),
        ((11, 0, 180, 1), "event 1"),
        ((11, 0, 0, 2), "event 1"),
        ((-1, 0, 0, 1), "event 1"),
    ],
)
def test_a_bad_event_is_refused_with_its_whole_packet(
    tmp_path: Path, name: str, event: tuple[int, int, int, int], words: str
) -> None:
    """The message has the index; the packet leaves nothing, and the writer goes on."""
    path = tmp_path / FILE_NAMES[name]
    good, after = events_of((10, 1, 2, 1)), events_of((12, 3, 4, 0))
    with open_writer(path, SIZE, name) as writer:
        writer.write(good)
        with pytest.raises(ValueError, match=words):
            writer.write(events_of((10, 1, 1, 1), event))
        writer.write(after)
    assert read_events(path).tolist() == [*good.tolist(), *after.tolist()]


@pytest.mark.parametrize(
    ("name", "first", "beyond"),
    [
        ("dsec", 0, 2**32),
        ("dsec", 2**32 + 1234, 2**33 + 704),
        ("e2vid", 0, 2**31 * 1_000_000),
        ("mvsec", 0, 2**31 * 1_000_000),
        ("bag", 0, 2**32 * 1_000_000),
        ("ros2", 0, 2**31 * 1_000_000),
    ],
)
def test_times_that_a_format_cannot_hold_are_refused(tmp_path: Path, name: str, first: int, beyond: int) -> None:
    """The last time that it holds is right; the next one is refused with index and value, and never wraps."""
    path = tmp_path / FILE_NAMES[name]
    fits = events_of((first, 0, 0, 1), (beyond - 1, 1, 1, 0))
    with open_writer(path, SIZE, name) as writer:
        writer.write(fits[:1])
        with pytest.raises(ValueError, match=rf"event 1.*{beyond}"):
            writer.write(events_of((beyond - 1, 1, 1, 0), (beyond, 1, 1, 0)))
        writer.write(fits[1:])
    assert read_events(path).tolist() == fits.tolist()


def test_sensors_that_a_format_cannot_hold_are_refused(tmp_path: Path) -> None:
    """e2vid's coordinates are int16."""
    with pytest.raises(ValueError, match="32768"):
        open_writer(tmp_path / "e.h5", (32_769, 10), "e2vid")
    assert not (tmp_path / "e.h5").exists()


@every_format
def test_an_existing_file_stays_unless_told_otherwise(tmp_path: Path, name: str) -> None:
    """FileExistsError, and the bytes as they were; with overwrite=True the new events alone."""
    path = tmp_path / FILE_NAMES[name]
    write(path, name, many(10))
    before = path.read_bytes()
    with pytest.raises(FileExistsError):
        open_writer(path, SIZE, name)
    assert path.read_bytes() == before
    with open_writer(path, SIZE, name, overwrite=True) as writer:
        writer.write(many(5))
    assert len(read_events(path)) == 5


@every_format
def test_a_folder_that_is_not_there_is_a_system_error(tmp_path: Path, name: str) -> None:
    with pytest.raises(FileNotFoundError):
        open_writer(tmp_path / "nowhere" / FILE_NAMES[name], SIZE, name)


@every_format
def test_a_missing_file_and_a_broken_one_are_told_apart(tmp_path: Path, name: str) -> None:
    """OSError for what is not there, DecodeError with the path for what is cut or scrambled."""
    path = tmp_path / FILE_NAMES[name]
    with pytest.raises(FileNotFoundError):
        read_events(path)
    write(path, name, many(10_000))
    whole = path.read_bytes()
    head = whole[:4200] if name == "bag" else whole[:64]
    path.write_bytes(head + b"\xa5" * (len(whole) - len(head)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", TruncatedFileWarning)
        with pytest.raises(DecodeError, match=path.name):
            read_events(path)


# ---- what a crash leaves ----

_KILLED = """
import sys
import time
import numpy as np
from davis_rs import open_writer
events = np.load(sys.argv[3])
print("ready", flush=True)
with open_writer(sys.argv[1], (240, 180), sys.argv[2]) as writer:
    for start in range(0, len(events), 20_000):
        writer.write(events[start : start + 20_000])
        writer.flush()
        print(start + 20_000, flush=True)
    time.sleep(100)
"""


@pytest.mark.few(2)
@pytest.mark.parametrize("name", ["dsec", "e2vid", "bag"])
@pytest.mark.parametrize("delay_ms", [20, 190, *long_values(1, 53, 111, 307)])
def test_a_killed_writer_leaves_all_that_was_flushed(tmp_path: Path, name: str, delay_ms: int) -> None:
    """kill -9 at any moment: every packet whose flush() had returned reads back, bit by bit, and a warning is given."""
    events, path = many(2_000_000), tmp_path / FILE_NAMES[name]
    np.save(tmp_path / "events.npy", events)
    command = [sys.executable, "-c", _KILLED, str(path), name, str(tmp_path / "events.npy")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        first = process.stdout.readline()
        time.sleep(delay_ms / 1000)
        process.send_signal(signal.SIGKILL)
        flushed = int((first + process.stdout.read()).split("\n")[-2])
    with pytest.warns(TruncatedFileWarning, match=path.name):
        left = read_events(path)
    assert len(left) >= flushed
    assert_same(left, events[: len(left)])


def test_a_killed_parquet_writer_leaves_the_path_as_it_was(tmp_path: Path) -> None:
    """Parquet has no readable beginning, so it is written next to the path, which never holds half a file."""
    path = tmp_path / "e.parquet"
    write(path, "parquet", many(10))
    writer = open_writer(path, SIZE, overwrite=True)
    writer.write(many(3_000_000))
    writer.flush()
    assert len(read_events(path)) == 10
    assert (tmp_path / "e.parquet.part").stat().st_size > 1000
    writer.finish()
    assert len(read_events(path)) == 3_000_000
    assert not (tmp_path / "e.parquet.part").exists()


def write_and_flush(writer: EventWriter, events: EventArray, flushed: list[int]) -> None:
    """Write in packets; note how many events each flush() has handed over."""
    for start in range(0, len(events), 10_000):
        writer.write(events[start : start + 10_000])
        writer.flush()
        flushed.append(start + 10_000)


@pytest.mark.parametrize("name", ["dsec", "e2vid", "mvsec", "bag", "ros2"])
def test_a_full_disk_is_told_and_loses_nothing(small_disk: Path, name: str) -> None:
    """OSError with ENOSPC from the call that meets it; what was flushed before reads back; nothing more is taken."""
    events, path = many(1_000_000), small_disk / FILE_NAMES[name]
    flushed: list[int] = []
    writer = open_writer(path, SIZE, name)
    with pytest.raises(OSError, match=path.name) as refused:
        write_and_flush(writer, events, flushed)
    assert refused.value.errno == errno.ENOSPC
    with pytest.raises(OSError, match="earlier write"):
        writer.write(events[:1])
    with pytest.raises(OSError, match="earlier write"):
        writer.finish()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", TruncatedFileWarning)
        left = read_events(path)
    assert len(left) >= flushed[-1]
    assert_same(left, events[: len(left)])


def test_a_full_disk_leaves_what_was_at_a_parquets_path(small_disk: Path) -> None:
    """OSError with ENOSPC, and the file that was to be replaced is still there."""
    path = small_disk / "e.parquet"
    write(path, "parquet", many(10))
    rng = np.random.default_rng(1)
    events = many(2_000_000)
    events["x"] = rng.integers(0, 240, len(events))
    writer = open_writer(path, SIZE, overwrite=True)
    with pytest.raises(OSError, match=r"e\.parquet") as refused:
        write_and_flush(writer, events, [])
    assert refused.value.errno == errno.ENOSPC
    assert len(read_events(path)) == 10


@every_format
def test_a_writer_that_was_left_in_an_error_keeps_what_it_has(tmp_path: Path, name: str) -> None:
    """An exception of the caller's inside of `with` finishes the file: nothing that was written is lost."""
    path = tmp_path / FILE_NAMES[name]
    with suppress(KeyError), open_writer(path, SIZE, name) as writer:
        writer.write(many(10))
        raise KeyError
    assert len(read_events(path)) == 10


def test_every_format_is_tested_fuzzed_and_documented() -> None:
    """One that is registered is in the tables of these tests, among the targets of the fuzzer, and in the documents."""
    names = set(FORMATS) - {"folder"}  # a dataset folder, which has files of the other formats
    assert {name for name in names if FORMATS[name].writable} == set(FILE_NAMES) | {
        kind.name for kind in FORMAT_VARIANTS.values()
    }
    targets = (ROOT / "tests/fuzz/targets.py").read_text()
    documents = "".join((ROOT / f"docs/{name}.md").read_text() for name in ("formats", "containers"))
    for name in names:
        assert f'    "{name}": ' in targets, name
        assert f"`{name}`" in documents, name


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("name", "module", "extra"),
    [("dsec", "h5py", "hdf5"), ("e2vid", "h5py", "hdf5"), ("parquet", "pyarrow", "parquet"), ("bag", "rosbags", "ros")],
)
def test_a_missing_library_is_told_with_its_extra(
    tmp_path: Path, run_python: Callable[..., str], name: str, module: str, extra: str
) -> None:
    """ImportError says what to install, before a file is made; `import davis_rs` does without all of them."""
    told = run_python(
        "import sys\n"
        f"sys.modules[{module!r}] = None\n"
        "import davis_rs\n"
        "try:\n"
        "    davis_rs.open_writer(sys.argv[1], (240, 180), sys.argv[2])\n"
        "except ImportError as error:\n"
        "    print(error)\n",
        str(tmp_path / FILE_NAMES[name]),
        name,
    )
    assert f"davis_rs[{extra}]" in told
    assert list(tmp_path.iterdir()) == []
