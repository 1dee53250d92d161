"""Promises of the writers of event files: what a kill, a full disk, a vanished folder or a closed pipe leaves."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from davis_rs import TruncatedFileWarning, open_writer, read_events
from davis_rs.events.arrays import EventArray
from davis_rs.io.formats import EventWriter
from event_files import FORMAT_VARIANTS, SIZE, FormatVariant, assert_same, events_of, many, write_events
from long_form import long_values

every_kind = pytest.mark.parametrize("kind", FORMAT_VARIANTS.values(), ids=FORMAT_VARIANTS)

KILLED = """
import sys
import numpy as np
from davis_rs import open_writer
events = np.load(sys.argv[3])
print("ready", flush=True)
with open_writer(sys.argv[1], (240, 180), sys.argv[2], **eval(sys.argv[4])) as writer:
    for start in range(0, len(events), 777):
        writer.write(events[start : start + 777])
        print(start + 777, flush=True)
    input()
"""


def read_what_is_left(path: Path) -> EventArray:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", TruncatedFileWarning)
        return read_events(path)


@pytest.mark.few(6)
@every_kind
@pytest.mark.parametrize("delay_ms", [3, *long_values(0, 17, 60)])
def test_a_killed_writer_leaves_every_packet_that_was_written(
    tmp_path: Path, kind: FormatVariant, delay_ms: int
) -> None:
    """kill -9 at any moment, without a flush: all packets whose write() had returned read back, bit by bit. A .npz is
    written next to its path, where nothing is until it is finished."""
    events, path = many(500_000), tmp_path / kind.file
    np.save(tmp_path / "events.npy", events)
    command = [sys.executable, "-c", KILLED, str(path), kind.name, str(tmp_path / "events.npy"), repr(kind.options)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        first = process.stdout.readline()
        time.sleep(delay_ms / 1000)
        process.send_signal(signal.SIGKILL)
        written = int((first + process.stdout.read()).split("\n")[-2])
    if kind.name == "npz":
        assert not path.exists()
        path = tmp_path / "e.npz.part"
    left = read_what_is_left(path)
    assert len(left) >= min(written, len(events))
    assert_same(left, events[: len(left)])


def test_numpy_reads_what_a_killed_writer_left(tmp_path: Path) -> None:
    """The header of a .npy is right after every packet, without a flush."""
    writer = open_writer(tmp_path / "e.npy", SIZE)
    for count in (10, 20, 30):
        writer.write(many(30)[count - 10 : count])
        assert_same(np.load(tmp_path / "e.npy"), many(30)[:count])
    writer.finish()


def write_and_count(writer: EventWriter, events: EventArray, written: list[int]) -> None:
    """Write in packets, and note how many events each write() has taken."""
    for start in range(0, len(events), 1_000):
        writer.write(events[start : start + 1_000])
        written.append(start + 1_000)


@every_kind
def test_a_full_disk_is_told_at_once_and_loses_nothing(small_disk: Path, kind: FormatVariant) -> None:
    """OSError with ENOSPC and path from the write() that meets it; what was written before reads back; nothing more is
    taken."""
    events, written = many(1_000_000), [0]
    writer = kind.writer(small_disk)
    with pytest.raises(OSError, match=kind.file) as refused:
        write_and_count(writer, events, written)
    assert refused.value.errno == errno.ENOSPC
    with pytest.raises(OSError, match="earlier write"):
        writer.write(events_of((2**30, 0, 0, 0)))
    with pytest.raises(OSError, match="earlier write"):
        writer.finish()
    path = small_disk / kind.file
    left = read_what_is_left(path if path.exists() else small_disk / "e.npz.part")
    assert len(left) >= written[-1] > 50_000
    assert_same(left, events[: len(left)])


@pytest.mark.few(2)
@every_kind
def test_a_file_that_may_not_grow_is_told_through_the_context_manager(
    tmp_path: Path, kind: FormatVariant, run_python: Callable[..., str]
) -> None:
    """`with` passes the OSError on as it was, and does not raise a second one in its place."""
    program = """
import resource, sys, numpy, davis_rs
resource.setrlimit(resource.RLIMIT_FSIZE, (3_000, resource.RLIM_INFINITY))
events = numpy.zeros(5_000, davis_rs.EVENT_DTYPE)
events["t"] = numpy.cumsum(numpy.arange(5_000) * 7 % 5)
events["x"] = numpy.arange(5_000) * 37 % 240
try:
    with davis_rs.open_writer(sys.argv[1], (240, 180), sys.argv[2], **eval(sys.argv[3])) as writer:
        writer.write(events)
except OSError as error:
    print(error.errno, error.__context__ is None or not isinstance(error.__context__, ValueError))
"""
    told = run_python(program, str(tmp_path / kind.file), kind.name, repr(kind.options))
    assert told == f"{errno.EFBIG} True\n"


@every_kind
def test_a_folder_that_is_not_there_is_told(tmp_path: Path, kind: FormatVariant) -> None:
    """FileNotFoundError with the path, before anything is written."""
    with pytest.raises(FileNotFoundError, match=kind.file):
        kind.writer(tmp_path / "nowhere")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
@every_kind
def test_a_folder_that_is_read_only_is_told(tmp_path: Path, kind: FormatVariant) -> None:
    """PermissionError with the path."""
    tmp_path.chmod(0o500)
    with pytest.raises(PermissionError, match=kind.file):
        kind.writer(tmp_path)
    tmp_path.chmod(0o700)


@every_kind
def test_a_disk_that_is_read_only_is_told(small_disk: Path, kind: FormatVariant) -> None:
    """OSError with EROFS and the path, for root as well."""
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    with pytest.raises(OSError, match=kind.file) as refused:
        kind.writer(small_disk)
    assert refused.value.errno == errno.EROFS


def test_a_folder_that_vanishes_is_told_where_the_name_is_given(tmp_path: Path) -> None:
    """A .npz takes its name at the end: FileNotFoundError from finish() if there is no folder for it any more."""
    folder = tmp_path / "folder"
    folder.mkdir()
    writer = FORMAT_VARIANTS["npz"].writer(folder)
    writer.write(many(10))
    (folder / "e.npz.part").unlink()
    folder.rmdir()
    with pytest.raises(FileNotFoundError, match=r"e\.npz"):
        writer.finish()


@pytest.mark.parametrize("kind", [kind for kind in FORMAT_VARIANTS.values() if not kind.name.startswith("np")])
def test_a_pipe_is_written_to_and_told_when_closed(tmp_path: Path, kind: FormatVariant) -> None:
    """A named pipe takes all formats that go forward only; BrokenPipeError once its reader has gone."""
    events, path = many(100_000), tmp_path / kind.file
    os.mkfifo(path)
    received: list[bytes] = []
    reader = threading.Thread(target=lambda: received.append(path.read_bytes()))
    reader.start()
    write_events(kind, tmp_path, events)
    reader.join()
    (tmp_path / "copy").write_bytes(received[0])
    assert_same(read_events(tmp_path / "copy"), events)
    opened = threading.Event()

    def hang_up() -> None:
        with path.open("rb"):
            opened.wait()

    reader = threading.Thread(target=hang_up)
    reader.start()
    writer = kind.writer(tmp_path)
    opened.set()
    reader.join()
    with pytest.raises(BrokenPipeError, match=kind.file):
        writer.write(events)


@pytest.mark.parametrize("name", ["npy", "npz"])
def test_what_cannot_be_gone_back_in_is_refused_where_it_must_be(name: str) -> None:
    """NumPy's formats tell the number of events at their beginning."""
    read_end, write_end = os.pipe()
    with os.fdopen(write_end, "wb") as pipe, pytest.raises(ValueError, match="is not seekable"):
        open_writer(pipe, SIZE, name)
    os.close(read_end)


@every_kind
def test_an_existing_file_stays_unless_told_otherwise(tmp_path: Path, kind: FormatVariant) -> None:
    """FileExistsError, and the bytes as they were; with overwrite=True the new events alone, however long the old."""
    path = write_events(kind, tmp_path, many(1000))
    before = path.read_bytes()
    with pytest.raises(FileExistsError, match=r"overwrite=True replaces it"):
        kind.writer(tmp_path)
    assert path.read_bytes() == before
    write_events(kind, tmp_path, many(5), overwrite=True)
    assert_same(read_events(path), many(5))


def test_an_archive_that_appeared_meanwhile_is_not_overwritten(tmp_path: Path) -> None:
    """A .npz takes its name at the end, and not from a file that was not there at the beginning."""
    writer = FORMAT_VARIANTS["npz"].writer(tmp_path)
    writer.write(many(10))
    (tmp_path / "e.npz").write_text("precious")
    with pytest.raises(FileExistsError, match=r"e\.npz"):
        writer.finish()
    assert (tmp_path / "e.npz").read_text() == "precious"


@every_kind
def test_an_error_of_the_callers_still_finishes_the_file(tmp_path: Path, kind: FormatVariant) -> None:
    """The context manager finishes the file and lets the error through."""

    def fail() -> None:
        with kind.writer(tmp_path) as writer:
            writer.write(many(10))
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert_same(read_events(tmp_path / kind.file), many(10))


@every_kind
@pytest.mark.parametrize("operation", ["write", "flush"])
def test_a_finished_writer_takes_no_more(tmp_path: Path, kind: FormatVariant, operation: str) -> None:
    """ValueError with the path; finishing again only reports."""
    writer = kind.writer(tmp_path)
    writer.write(many(10))
    assert writer.finish() == writer.finish()
    with pytest.raises(ValueError, match=rf"{kind.file} is finished"):
        writer.write(many(10)) if operation == "write" else writer.flush()
    assert_same(read_events(tmp_path / kind.file), many(10))


class Full:
    """A stream that has room for ``room`` bytes."""

    def __init__(self, room: int) -> None:
        self.room = room

    def write(self, data: bytes) -> int:
        if self.room < len(data):
            raise OSError(errno.ENOSPC, "no room", "somewhere")
        self.room -= len(data)
        return len(data)


@pytest.mark.parametrize("name", ["text", "evt2", "evt3", "aedat4"])
def test_an_error_of_a_stream_comes_as_it_was_raised(name: str) -> None:
    """A stream's own exception, not one made of its message."""
    writer = open_writer(Full(2_000), SIZE, name)  # type: ignore[arg-type]
    with pytest.raises(OSError, match="no room") as caught:
        writer.write(many(5_000))
    assert (caught.value.errno, caught.value.filename) == (errno.ENOSPC, "somewhere")
