"""events.txt, .npy, .npz, EVT and AEDAT 4: what is written is read, and what cannot be held is refused."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from davis_rs import DecodeError, TruncatedFileWarning, iter_events, open_reader, open_writer, read_events
from davis_rs.events.arrays import EVENT_DTYPE, EventArray
from davis_rs.io.formats import FORMATS
from event_files import FORMAT_VARIANTS, SIZE, FormatVariant, assert_same, events_of, many, write_events

every_kind = pytest.mark.parametrize("kind", FORMAT_VARIANTS.values(), ids=FORMAT_VARIANTS)

# ---- what is written is read ----


@st.composite
def streams(draw: st.DrawFn) -> EventArray:
    """Event arrays in order of time, with ties and silences, from 0, around 2^31 and 2^32 us, and in Unix time."""
    start = draw(st.sampled_from([0, 4_090, 2**24 - 5, 2**31 - 5, 2**32 - 5, 2**34 - 5, 1_700_000_000_000_000, 2**62]))
    step = st.sampled_from([0, 1, 63, 999, 4096, 33_333, 2**24, 5_000_000_000])
    x, y = st.integers(0, SIZE[0] - 1), st.integers(0, SIZE[1] - 1)
    events = np.array(draw(st.lists(st.tuples(step, x, y, st.integers(0, 1)), max_size=40)), EVENT_DTYPE)
    events["t"] = start + np.cumsum(events["t"])
    return events


@pytest.mark.few(3)
@every_kind
@settings(max_examples=60)
@given(events=streams(), cuts=st.lists(st.integers(0, 40), max_size=3), flush=st.booleans())
def test_what_is_written_is_read(
    tmp_path_factory: pytest.TempPathFactory, kind: FormatVariant, events: EventArray, cuts: list[int], flush: bool
) -> None:
    """Whatever the packets and flushes; times are right to the last that the format holds; ties keep their order."""
    events = events[events["t"] <= kind.latest_us]
    folder = tmp_path_factory.mktemp("files")
    with kind.writer(folder) as writer:
        for packet in np.split(events, sorted(cuts)):
            writer.write(packet)
            if flush:
                writer.flush()
    report, path = writer.finish(), folder / kind.file
    assert (report.events, report.bytes, report.path) == (len(events), path.stat().st_size, str(path))
    assert (report.first_us, report.last_us) == ((events["t"][0], events["t"][-1]) if len(events) else (None, None))
    with open_reader(path) as reader:
        assert reader.format == kind.name
        assert reader.size == (SIZE if kind.name.startswith(("evt", "aedat")) or "size_line" in kind.options else None)
        assert_same(reader.read(), events)
        assert_same(reader.read(), events)
    assert {entry.name for entry in folder.iterdir()} == {kind.file}


@every_kind
def test_more_than_one_buffer_is_written_whole(tmp_path: Path, kind: FormatVariant) -> None:
    """300,001 events in packets of 999 and in one pass every buffer many times: none is lost or doubled."""
    events = many(300_001)
    assert_same(read_events(write_events(kind, tmp_path, events, packet=999)), events)
    assert_same(read_events(write_events(kind, tmp_path, events, overwrite=True)), events)


@every_kind
def test_slices_of_time_and_space_are_those_of_the_whole(tmp_path: Path, kind: FormatVariant) -> None:
    """A slice is what a mask over all events selects, at the ends, across chunks and where there is nothing."""
    events = many(300_000, start_us=1_000_000)
    path, t = write_events(kind, tmp_path, events), events["t"]
    for start, stop in (
        (None, int(t[1000])),
        (int(t[140_000]), int(t[140_001]) + 1),
        (int(t[131_000]), int(t[262_200])),
        (0, 5),
        (int(t[-1]), None),
        (int(t[-1]) + 1, None),
    ):
        keep = (t >= (0 if start is None else start)) & (t < (2**62 if stop is None else stop))
        assert_same(read_events(path, start_us=start, stop_us=stop), events[keep])
        keep &= (events["x"] >= 10) & (events["x"] < 60) & (events["y"] >= 20) & (events["y"] < 90)
        assert_same(read_events(path, start_us=start, stop_us=stop, roi=(10, 20, 60, 90)), events[keep])


@pytest.mark.parametrize("name", ["text", "npy", "npz", "aedat4", "aedat4 lz4", "aedat4 zstd"])
def test_a_slice_reads_its_part_of_the_file_alone(tmp_path: Path, name: str) -> None:
    """What stands elsewhere may be damaged without harm."""
    events = many(200_000)
    path, t = write_events(FORMAT_VARIANTS[name], tmp_path, events), events["t"]
    data = bytearray(path.read_bytes())
    for share in (0.2, 0.8):
        place = int(share * len(data))
        data[place : place + 3000] = b"\xa5" * 3000
    path.write_bytes(data)
    start, stop = int(t[95_000]), int(t[105_000])
    assert_same(read_events(path, start_us=start, stop_us=stop), events[(t >= start) & (t < stop)])


@every_kind
def test_chunks_join_to_the_whole(tmp_path: Path, kind: FormatVariant) -> None:
    """iter_events() hands out arrays of the size asked for, the last one shorter; progress ends at 1."""
    events = many(50_000)
    path = write_events(kind, tmp_path, events)
    parts = list(iter_events(path, chunk=7_001))
    assert [len(part) for part in parts] == [7_001] * 7 + [50_000 - 7 * 7_001]
    assert_same(np.concatenate(parts), events)
    with open_reader(path) as reader:
        assert sum(map(len, reader.iter())) == 50_000
        assert 0.99 < reader.progress <= 1
        with pytest.raises(ValueError, match="chunk must be an integer >= 1, got 0"):
            next(reader.iter(0))


@every_kind
def test_a_stream_is_written_as_a_file_is(tmp_path: Path, kind: FormatVariant) -> None:
    """A buffer gets the same events and stays open; the table of contents of AEDAT 4 needs a file's place."""
    events, buffer = many(20_000), io.BytesIO()
    with open_writer(buffer, SIZE, kind.name, **kind.options) as writer:
        writer.write(events)
    assert writer.finish().bytes == len(buffer.getvalue())
    path = tmp_path / kind.file
    path.write_bytes(buffer.getvalue())
    assert_same(read_events(path), events)
    with pytest.raises(ValueError, match="give format"):
        open_writer(buffer, SIZE)


@every_kind
def test_the_callers_arrays_are_only_read(tmp_path: Path, kind: FormatVariant) -> None:
    """Read-only arrays are taken, and one that is filled anew after write() changes nothing that was written."""
    events, reused = many(1000), np.zeros(100, EVENT_DTYPE)
    expected = events.tobytes()
    events.flags.writeable = False
    with kind.writer(tmp_path) as writer:
        writer.write(events[:500])
        for start in range(500, 1000, 100):
            reused[:] = events[start : start + 100]
            writer.write(reused)
            reused[:] = 0
    assert events.tobytes() == expected
    assert_same(read_events(tmp_path / kind.file), events)


@pytest.mark.parametrize("file", ["e.txt", "e.dat", "e"])
@every_kind
def test_a_format_is_known_by_its_content(tmp_path: Path, kind: FormatVariant, file: str) -> None:
    """Whatever the name says."""
    path = write_events(kind, tmp_path, many(10)).rename(tmp_path / file)
    with open_reader(path) as reader:
        assert (reader.format, len(reader.read())) == (kind.name, 10)


def test_the_start_of_an_aedat_is_unix_time(tmp_path: Path) -> None:
    """start_us is added to all times, which are read as they stand there; one too late for it is refused."""
    path, start_us = tmp_path / "e.aedat4", 1_700_000_000_000_000
    with open_writer(path, SIZE, start_us=start_us) as writer:
        writer.write(many(10))
        with pytest.raises(ValueError, match="event 0 of the packet is at 9223372036854775807 us"):
            writer.write(events_of((2**63 - 1, 0, 0, 0)))
    np.testing.assert_array_equal(read_events(path)["t"], many(10)["t"] + start_us)


def test_numpy_reads_what_is_written(tmp_path: Path) -> None:
    """.npy and .npz hold the exact dtype; a compressed archive, and other dtypes with the four fields, are read."""
    events = many(1000)
    loaded = np.load(write_events(FORMAT_VARIANTS["npy"], tmp_path, events))
    assert_same(loaded, events)
    with np.load(write_events(FORMAT_VARIANTS["npz"], tmp_path, events)) as archive:
        assert archive.files == ["events"]
        assert_same(archive["events"], events)
    other = np.zeros(len(events), [("x", "<i2"), ("y", "<i2"), ("t", "<i8"), ("p", "?")])
    for field in ("t", "x", "y", "p"):
        other[field] = events[field]
    np.save(tmp_path / "o.npy", other)
    np.savez(tmp_path / "o.npz", anything=other)
    np.savez_compressed(tmp_path / "c.npz", events=other, t=other["t"])
    for name in ("o.npy", "o.npz", "c.npz"):
        assert_same(read_events(tmp_path / name, start_us=100), events[events["t"] >= 100])
        assert open_reader(tmp_path / name).events == 1000


def test_a_dataset_folder_is_its_events(tmp_path: Path) -> None:
    """read_events() of a folder reads events.txt in it."""
    (tmp_path / "events.txt").write_text("0.000001000 2 3 1\n")
    assert read_events(tmp_path).tolist() == [(1, 2, 3, 1)]


# ---- what is refused ----


@every_kind
@pytest.mark.parametrize(
    ("event", "rule"),
    [
        ((5, 0, 0, 1), "must not decrease .*: event 1 of the packet is at 5 us, after 10 us"),
        ((11, 240, 0, 1), "x must be below the sensor's width 240: event 1 of the packet has 240"),
        ((11, 0, 180, 1), "y must be below the sensor's height 180: event 1 of the packet has 180"),
        ((11, 0, 0, 2), "polarity must be 0 or 1: event 1 of the packet has 2"),
        ((-1, 0, 0, 1), "start at 0 or later: event 1 of the packet is at -1 us"),
    ],
)
def test_a_bad_event_is_refused_with_its_whole_packet(
    tmp_path: Path, kind: FormatVariant, event: tuple[int, int, int, int], rule: str
) -> None:
    """Index, value and rule; the packet leaves nothing, and the writer goes on."""
    good, after = events_of((10, 1, 2, 1)), events_of((12, 3, 4, 0))
    with kind.writer(tmp_path) as writer:
        writer.write(good)
        with pytest.raises(ValueError, match=rule):
            writer.write(events_of((10, 1, 1, 1), event))
        writer.write(after)
    assert read_events(tmp_path / kind.file).tolist() == [*good.tolist(), *after.tolist()]


@pytest.mark.parametrize("name", ["evt2", "evt3"])
def test_times_that_a_format_cannot_hold_are_refused(tmp_path: Path, name: str) -> None:
    """The last time that it holds is right; the next one is refused with index and value, and never wraps. A silence
    of days costs EVT 3.0 ten bytes each 2^24 us, and no more."""
    kind = FORMAT_VARIANTS[name]
    last = kind.latest_us
    with kind.writer(tmp_path) as writer:
        writer.write(events_of((0, 0, 0, 1)))
        with pytest.raises(ValueError, match=rf"at most {last} us .* event 1 of the packet is at {last + 1} us"):
            writer.write(events_of((last, 1, 1, 0), (last + 1, 1, 1, 0)))
        writer.write(events_of((last, 1, 1, 0)))
    assert read_events(tmp_path / kind.file).tolist() == [(0, 0, 0, 1), (last, 1, 1, 0)]
    assert writer.finish().bytes < 700_000


@pytest.mark.parametrize(("name", "side"), [("evt2", 2048), ("evt3", 2048), ("aedat4", 32_768), ("text", 65_535)])
def test_sensors_that_a_format_cannot_hold_are_refused(tmp_path: Path, name: str, side: int) -> None:
    """The largest one is held, corner to corner; a larger one leaves no file."""
    kind = FORMAT_VARIANTS[name]
    for size in ((side + 1, 10), (10, side + 1), (0, 10)):
        with pytest.raises(ValueError, match=f"{name} holds sensors of 1 x 1 to {side} x {side}|must lie in 1..65535"):
            kind.writer(tmp_path, size)
    assert not list(tmp_path.iterdir())
    corner = events_of((0, side - 1, side - 1, 1))
    with kind.writer(tmp_path, (side, side)) as writer:
        writer.write(corner)
    assert_same(read_events(tmp_path / kind.file), corner)


def test_wrong_options_leave_no_file(tmp_path: Path) -> None:
    """Of the format, of its compression, of the suffix, of the name."""
    with pytest.raises(TypeError, match="size_line"):
        open_writer(tmp_path / "e.raw", SIZE, size_line=True)
    with pytest.raises(ValueError, match=r"compression must be none, lz4 or zstd: got .gzip."):
        open_writer(tmp_path / "e.aedat4", SIZE, compression="gzip")
    with pytest.raises(ValueError, match=r"level must lie in -7\.\.22: got 23"):
        open_writer(tmp_path / "e.aedat4", SIZE, compression="zstd", level=23)
    with pytest.raises(ValueError, match=r"is no event format \(.*\.raw.*\): give format"):
        open_writer(tmp_path / "e.xyz", SIZE)
    with pytest.raises(ValueError, match=r"format must be one of .*evt3.*: got 'evt4'"):
        open_writer(tmp_path / "e.raw", SIZE, "evt4")
    assert not list(tmp_path.iterdir())


# ---- files that are not whole ----


@pytest.mark.filterwarnings("ignore::davis_rs.TruncatedFileWarning")
@every_kind
def test_a_file_that_ends_anywhere_gives_its_whole_records(tmp_path: Path, kind: FormatVariant) -> None:
    """What is left of 30 events is a beginning of them, none of it made up, and the more the longer the file is."""
    events = many(30)
    whole = write_events(kind, tmp_path, events, packet=10).read_bytes()
    cut, before = tmp_path / "cut", 0
    for length in range(1, len(whole), 7):
        cut.write_bytes(whole[:length])
        try:
            left = FORMATS[kind.name].open_reader(cut).read()
        except DecodeError:
            assert before == 0  # the header itself is cut
            continue
        assert_same(left, events[: len(left)])
        assert len(left) >= before
        before = len(left)
    assert before >= 20


@pytest.mark.parametrize(
    ("name", "cut", "message"),
    [
        ("text", 3, r"the last 19 bytes, from byte \d+, are no whole record"),
        ("npy", 3, "the last 1 of 30 events, from byte 656, are missing"),
        ("evt2", 3, "the last 1 bytes, from byte 2"),
        ("evt3", 1, "the last 1 bytes, from byte 2"),
    ],
)
def test_a_cut_last_record_is_reported(tmp_path: Path, name: str, cut: int, message: str) -> None:
    """TruncatedFileWarning with path and byte; all but the last event are returned."""
    events = many(30)
    path = write_events(FORMAT_VARIANTS[name], tmp_path, events)
    path.write_bytes(path.read_bytes()[:-cut])
    with pytest.warns(TruncatedFileWarning, match=rf"{path}: {message}"):
        assert_same(read_events(path), events[:29])


def test_a_cut_packet_is_reported(tmp_path: Path) -> None:
    """An AEDAT 4 file whose last packet is cut gives the packets before it, and says where it begins."""
    events, buffer = many(30), io.BytesIO()
    writer = open_writer(buffer, SIZE, "aedat4")
    writer.write(events[:10])
    whole = len(buffer.getvalue())
    writer.write(events[10:])
    path = tmp_path / "e.aedat4"
    path.write_bytes(buffer.getvalue()[:-1])
    with pytest.warns(TruncatedFileWarning, match=f"from byte {whole}, are no whole record"):
        assert_same(read_events(path), events[:10])


def test_unknown_contents_are_a_decode_error(tmp_path: Path) -> None:
    """With the path and the first bytes; an empty file is what its suffix says."""
    path = tmp_path / "e.raw"
    path.write_bytes(b"\xff\xfe nothing")
    with pytest.raises(DecodeError, match=r"e\.raw is in no known event format .*\\xff\\xfe nothing"):
        read_events(path)
    (tmp_path / "e.txt").touch()
    assert len(read_events(tmp_path / "e.txt")) == 0
    for name in ("e.npy", "e.aedat4", "e.npz"):
        (tmp_path / name).touch()
        with pytest.raises(DecodeError, match=name):
            read_events(tmp_path / name)


@pytest.mark.parametrize("dtype", [[("t", "<i8"), ("x", "<u2")], [("t", "O"), ("x", "<u2"), ("y", "<u2"), ("p", "?")]])
def test_arrays_that_are_no_events_are_a_decode_error(tmp_path: Path, dtype: list[tuple[str, str]]) -> None:
    """With path and byte; object arrays are not unpickled."""
    np.save(tmp_path / "e.npy", np.zeros(3, dtype), allow_pickle=True)
    with pytest.raises(DecodeError, match=r"e\.npy, byte 0: events must be a one-dimensional array with fields"):
        read_events(tmp_path / "e.npy")


def test_values_that_events_cannot_hold_are_a_decode_error(tmp_path: Path) -> None:
    """Times in fractions of a microsecond are not rounded."""
    array = np.zeros(3, [("t", "<f8"), ("x", "<u2"), ("y", "<u2"), ("p", "?")])
    array["t"] = 0.5
    np.save(tmp_path / "e.npy", array)
    with pytest.raises(DecodeError, match=r"e\.npy: event field 't' holds values that int64 cannot hold exactly"):
        read_events(tmp_path / "e.npy")
