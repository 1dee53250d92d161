"""events.txt from Python: bytes, errors and their classes, and what happens to files and arrays."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from davis_rs import EVENT_DTYPE, DecodeError, EventWriter, open_writer
from davis_rs.events.arrays import EventArray
from davis_rs.io.formats import FORMATS
from strategies import EPOCH_US, EXAMPLES


def text_writer(path: str | Path) -> EventWriter:
    """A writer for the largest sensor that there is."""
    return open_writer(path, (65_535, 65_535), "text")


def read_text(path: str | Path) -> EventArray:
    return FORMATS["text"].open_reader(path).read()


def events_of(*events: tuple[int, int, int, int]) -> EventArray:
    return np.array(list(events), EVENT_DTYPE)


SOME = events_of((0, 0, 0, 0), (3_811, 96, 133, 0), (3_811, 95, 133, 1), (1_000_000, 239, 9, 1))
SOME_TEXT = "0.000000000 0 0 0\n0.003811000 96 133 0\n0.003811000 95 133 1\n1.000000000 239 9 1\n"


def line(t: int, x: int, y: int, p: int) -> str:
    return f"{t // 1_000_000}.{t % 1_000_000:06d}000 {x} {y} {p}\n"


@st.composite
def streams(draw: st.DrawFn) -> EventArray:
    """Event arrays in order of time, from 0, late, and with equal times."""
    start = draw(st.sampled_from([0, 999_999, 1_000_000_000, EPOCH_US, 1 << 62]))
    side = st.sampled_from([0, 1, 9, 10, 239, 65_534])
    steps = draw(st.lists(st.tuples(st.integers(0, 2_000_000), side, side, st.integers(0, 1)), max_size=30))
    events = np.array(steps, EVENT_DTYPE)
    events["t"] = start + np.cumsum(events["t"])
    return events


# ---- what is written is read ----


@EXAMPLES
@given(streams(), st.lists(st.integers(0, 30), max_size=4))
def test_bytes_are_the_datasets_and_do_not_depend_on_packets(
    tmp_path_factory: pytest.TempPathFactory, events: EventArray, cuts: list[int]
) -> None:
    """Seconds with nine decimals, x, y, polarity; any split into packets writes the same; and it reads back."""
    path = tmp_path_factory.mktemp("text") / "events.txt"
    with text_writer(path) as writer:
        for packet in np.split(events, sorted(cuts)):
            writer.write(packet)
    assert writer.finish().events == len(events)
    assert path.read_bytes() == "".join(line(*event) for event in events.tolist()).encode()
    again = read_text(path)
    assert again.dtype == EVENT_DTYPE
    np.testing.assert_array_equal(again, events)


def test_an_empty_file_holds_no_events(tmp_path: Path) -> None:
    """A sequence without events is a file without lines, and reads as an empty event array."""
    path = tmp_path / "events.txt"
    assert text_writer(path).finish().events == 0
    assert path.read_bytes() == b""
    assert read_text(path).dtype == EVENT_DTYPE
    assert read_text(path).shape == (0,)


def test_more_than_one_buffer_is_written_whole(tmp_path: Path) -> None:
    """100,000 events in packets of 1 to 99,999 pass through the writer's buffer many times: none is lost or doubled."""
    events = np.zeros(100_000, EVENT_DTYPE)
    events["t"] = np.arange(100_000) * 7
    events["x"] = np.arange(100_000) % 65_535
    path = tmp_path / "events.txt"
    with text_writer(path) as writer:
        writer.write(events[:1])
        writer.write(events[1:])
    np.testing.assert_array_equal(read_text(path), events)


def test_flush_hands_everything_over_and_finish_counts(tmp_path: Path) -> None:
    """After flush() another reader sees all events so far; finish() returns how many there are, as often as asked."""
    path = tmp_path / "events.txt"
    writer = text_writer(str(path))
    writer.write(SOME[:2])
    writer.flush()
    np.testing.assert_array_equal(read_text(str(path)), SOME[:2])
    writer.write(SOME[2:])
    assert writer.finish().events == 4
    assert writer.finish().events == 4
    assert path.read_text() == SOME_TEXT


def write_and_fail(path: Path) -> None:
    with text_writer(path) as writer:
        writer.write(SOME)
        raise KeyError


def test_leaving_with_an_error_still_writes_the_last_packet(tmp_path: Path) -> None:
    """The context manager finishes the file and lets the error through."""
    path = tmp_path / "events.txt"
    with pytest.raises(KeyError):
        write_and_fail(path)
    assert path.read_text() == SOME_TEXT


@pytest.mark.parametrize("operation", ["write", "flush"])
def test_a_finished_writer_takes_no_more(tmp_path: Path, operation: str) -> None:
    """Writing or flushing after finish() is a ValueError that names the file, which stays as it is."""
    path = tmp_path / "events.txt"
    writer = text_writer(path)
    writer.write(SOME)
    writer.finish()
    with pytest.raises(ValueError, match=r"events\.txt is finished"):
        writer.write(SOME) if operation == "write" else writer.flush()
    assert path.read_text() == SOME_TEXT


# ---- arrays ----


def read_only(events: EventArray) -> EventArray:
    events = events.copy()
    events.flags.writeable = False
    return events


def packed(events: EventArray) -> EventArray:
    return events.astype([("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")])


def other_types(events: EventArray) -> EventArray:
    return events.astype([("t", ">f8"), ("x", "i4"), ("y", ">u2"), ("p", "?")])


@pytest.mark.parametrize(
    "layout",
    [
        read_only,
        lambda events: np.repeat(events, 3)[::3],
        lambda events: events[::-1].copy()[::-1],
        packed,
        other_types,
    ],
    ids=["read-only", "strided", "reversed", "packed", "other types"],
)
def test_any_layout_of_events_is_written_and_left_alone(
    tmp_path: Path, layout: Callable[[EventArray], EventArray]
) -> None:
    """Views and other dtypes are written by their values; the caller's array keeps its values and flags."""
    array = layout(SOME)
    before = (array.tolist(), array.flags.writeable, array.dtype)
    with text_writer(tmp_path / "events.txt") as writer:
        writer.write(array)
    assert (array.tolist(), array.flags.writeable, array.dtype) == before
    assert (tmp_path / "events.txt").read_text() == SOME_TEXT


def test_what_was_read_belongs_to_the_caller(tmp_path: Path) -> None:
    """The array may be written to, and the file does not follow."""
    path = tmp_path / "events.txt"
    path.write_text(SOME_TEXT)
    events = read_text(path)
    events["t"] += 5
    np.testing.assert_array_equal(read_text(path), SOME)


# ---- packets that are refused ----


@pytest.mark.parametrize(
    ("packet", "rule"),
    [
        (events_of((5, 0, 0, 1), (4, 0, 0, 1)), r"must not decrease .*: event 1 of the packet is at 4 us, after 5 us"),
        (events_of((2, 0, 0, 1)), r"must not decrease .*: event 0 of the packet is at 2 us, after 3 us"),
        (events_of((3, 0, 0, 1), (9, 0, 0, 2)), "polarity must be 0 or 1: event 1 of the packet has 2"),
        (SOME[["t", "x", "y"]], "one-dimensional structured array with fields t, x, y, p"),
        (SOME.reshape(2, 2), "one-dimensional structured array with fields t, x, y, p"),
    ],
    ids=["back within", "back between", "polarity", "no polarity", "two dimensions"],
)
def test_a_refused_packet_leaves_nothing_of_itself(tmp_path: Path, packet: EventArray, rule: str) -> None:
    """The error says which event; the file holds the packets before and after it and nothing else."""
    path = tmp_path / "events.txt"
    with text_writer(path) as writer:
        writer.write(events_of((3, 1, 1, 1)))
        with pytest.raises(ValueError, match=rule):
            writer.write(packet)
        writer.write(events_of((3, 2, 2, 0)))
    assert path.read_text() == "0.000003000 1 1 1\n0.000003000 2 2 0\n"


def test_times_before_zero_are_refused(tmp_path: Path) -> None:
    """A sequence starts at t = 0: the text has no sign."""
    writer = text_writer(tmp_path / "events.txt")
    with pytest.raises(ValueError, match="start at 0 or later: event 0 of the packet is at -1 us"):
        writer.write(events_of((-1, 0, 0, 0)))


# ---- the system's refusals ----


def test_an_existing_file_is_never_overwritten(tmp_path: Path) -> None:
    """FileExistsError with the path, for a file, a folder, a dangling link; a device has nothing to lose."""
    (tmp_path / "file").write_text("precious")
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    for path in (tmp_path / "file", tmp_path / "folder", tmp_path / "link"):
        with pytest.raises(FileExistsError, match=path.name) as caught:
            text_writer(path)
        assert caught.value.errno == errno.EEXIST
    assert (tmp_path / "file").read_text() == "precious"
    assert not (tmp_path / "nowhere").exists()
    text_writer("/dev/null").finish()


def test_unusable_paths_are_the_right_os_error(tmp_path: Path) -> None:
    """Python's own subclass with errno and path, for the writer and for the reader."""
    (tmp_path / "file").write_text("")
    for open_it in (text_writer, read_text):
        with pytest.raises(FileNotFoundError, match=r"missing/events\.txt") as caught:
            open_it(tmp_path / "missing" / "events.txt")
        assert caught.value.errno == errno.ENOENT
        with pytest.raises(NotADirectoryError, match=r"file/events\.txt"):
            open_it(tmp_path / "file" / "events.txt")
    with pytest.raises(IsADirectoryError, match=tmp_path.name):
        read_text(tmp_path)
    with pytest.raises(TypeError):
        text_writer(3)  # type: ignore[arg-type]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_forbidden_folder_is_a_permission_error(tmp_path: Path) -> None:
    """PermissionError with the path."""
    tmp_path.chmod(0o500)
    with pytest.raises(PermissionError, match=r"events\.txt"):
        text_writer(tmp_path / "events.txt")
    tmp_path.chmod(0o700)


@pytest.mark.few(1)
@pytest.mark.parametrize("operation", ["write", "flush", "finish", "__exit__"])
def test_a_file_that_may_not_grow_is_reported(tmp_path: Path, run_python: Callable[..., str], operation: str) -> None:
    """A system that takes no more bytes is an OSError with errno and path, from whichever call meets it; what it took
    before stays, and nothing is glued to its cut last line."""
    program = """
import resource, sys, numpy, davis_rs
path, operation = sys.argv[1:]
resource.setrlimit(resource.RLIMIT_FSIZE, (1_000, resource.RLIM_INFINITY))
writer = davis_rs.open_writer(path, (240, 180), "text")
events = numpy.zeros(60_000 if operation == "write" else 100, davis_rs.EVENT_DTYPE)
events["t"] = numpy.arange(len(events))
try:
    writer.write(events)
    if operation != "write":
        getattr(writer, operation)()
except OSError as error:
    print(error.errno, path in str(error))
resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
try:
    writer.write(events[-1:])
except (OSError, ValueError) as error:
    print(str(error).endswith(("nothing more is taken", "written to it any more")))
"""
    path = tmp_path / "events.txt"
    assert run_python(program, str(path), operation) == f"{errno.EFBIG} True\nTrue\n"
    text = path.read_text()
    expected = "".join(line(t, 0, 0, 0) for t in range(100))
    assert text[:1_000] == expected[:1_000]
    assert len(text) == 1_000


# ---- malformed files ----


@pytest.mark.parametrize(
    ("second_line", "rule"),
    [
        ("1.0 2 3\n", "a line must be 'timestamp x y polarity'"),
        ("1.0 2 3 1 4\n", "a line must be 'timestamp x y polarity'"),
        ("\n", "a line must be 'timestamp x y polarity'"),
        ("1 2 3 1\n", "one to nine decimals"),
        ("nan 2 3 1\n", "one to nine decimals"),
        ("1.0000005 2 3 1\n", "whole microseconds"),
        ("1.0 -2 3 1\n", "x must be an integer in 0..65535"),
        ("1.0 2 65536 1\n", "y must be an integer in 0..65535"),
        ("1.0 2 3 -1\n", "polarity must be 0 or 1"),
        ("0.4 2 3 1\n", "must not decrease"),
        ("1.0 2 3 \xff\n", "polarity must be 0 or 1"),
    ],
)
def test_a_malformed_line_is_a_decode_error_that_says_where(tmp_path: Path, second_line: str, rule: str) -> None:
    """DecodeError (a ValueError, no OSError) with path, rule, line and byte."""
    path = tmp_path / "events.txt"
    path.write_bytes(b"0.500000000 1 1 0\n" + second_line.encode("latin-1"))
    with pytest.raises(DecodeError, match=rule) as caught:
        read_text(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert str(caught.value).endswith("(line 2, byte 18)")
    assert isinstance(caught.value, ValueError)


def test_the_datasets_own_lines_are_read(tmp_path: Path) -> None:
    """Lines as the public dataset has them, with fewer decimals, CRLF or no last newline, to the microsecond."""
    path = tmp_path / "events.txt"
    path.write_text("0.003811000 96 133 0\n0.003820000 127 171 0\r\n1700000000.123457 5 6 1")
    expected = [(3_811, 96, 133, 0), (3_820, 127, 171, 0), (EPOCH_US + 123_457, 5, 6, 1)]
    assert read_text(path).tolist() == expected


def test_a_writer_that_nobody_finished_loses_nothing(tmp_path: Path) -> None:
    """The last packet of a forgotten writer is written when it goes."""
    writer = text_writer(tmp_path / "events.txt")
    writer.write(np.array([(5, 1, 2, 1)], EVENT_DTYPE))
    del writer
    assert (tmp_path / "events.txt").read_text() == "0.000005000 1 2 1\n"
