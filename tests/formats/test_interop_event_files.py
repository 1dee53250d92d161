"""Other people's readers read our event files, and ours reads theirs: EVT, AEDAT 4, events.txt (extra ``interop``)."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from davis_rs import open_reader, open_writer, read_events
from davis_rs.events.arrays import EVENT_DTYPE, EventArray
from event_files import FORMAT_VARIANTS, SIZE, FormatVariant, assert_same, many, write_events

AEDATS = [kind for kind in FORMAT_VARIANTS.values() if kind.name == "aedat4"]
LATE_US = 2**33
"""Past 2^32 us, and past many rounds of EVT 3.0's time."""


def with_silence(events: EventArray) -> EventArray:
    """50 minutes without an event in the middle."""
    events = events.copy()
    events["t"][len(events) // 2 :] += 3_000_000_000
    return events


STREAMS = {
    "from 0": many(100_000),
    "late": many(1_000, start_us=LATE_US),
    "with a silence": with_silence(many(100_000)),
}
every_stream = pytest.mark.parametrize("events", STREAMS.values(), ids=STREAMS)
both_evt = pytest.mark.parametrize("name", ["evt2", "evt3"])
every_aedat = pytest.mark.parametrize("kind", AEDATS, ids=[str(kind.options["compression"]) for kind in AEDATS])


def assert_columns(array: Any, events: EventArray, t: str, p: str) -> None:
    """Times, coordinates and polarities are those of ``events``, in their order."""
    np.testing.assert_array_equal(np.asarray(array[t]).astype(np.int64), events["t"])
    np.testing.assert_array_equal(array["x"], events["x"])
    np.testing.assert_array_equal(array["y"], events["y"])
    np.testing.assert_array_equal(np.asarray(array[p]).astype(np.uint8), events["p"])


# ---- faery ----


def read_with_faery(path: Path) -> Any:
    faery = pytest.importorskip("faery")
    return np.concatenate(list(faery.events_stream_from_file(path)))


def write_with_faery(path: Path, events: EventArray, **options: Any) -> None:
    faery = pytest.importorskip("faery")
    array = np.empty(len(events), faery.EVENTS_DTYPE)
    for ours, theirs in (("t", "t"), ("x", "x"), ("y", "y"), ("p", "on")):
        array[theirs] = events[ours]
    faery.events_stream_from_array(array, SIZE).to_file(path, **options)


@both_evt
@every_stream
def test_faery_reads_our_evt(tmp_path: Path, name: str, events: EventArray) -> None:
    """All events in their order, over the rounds of the time as well."""
    assert_columns(read_with_faery(write_events(FORMAT_VARIANTS[name], tmp_path, events)), events, "t", "on")


@both_evt
@every_stream
def test_we_read_faerys_evt(tmp_path: Path, name: str, events: EventArray) -> None:
    """Its header takes the first time off all others (`t0`), which is not dropped."""
    path = tmp_path / "e.raw"
    write_with_faery(path, events, version=name)
    assert_same(read_events(path), events)
    assert open_reader(path).size == SIZE


@every_aedat
def test_faery_reads_our_aedat(tmp_path: Path, kind: FormatVariant) -> None:
    """All three compressions."""
    events = STREAMS["from 0"]
    assert_columns(read_with_faery(write_events(kind, tmp_path, events, packet=3_000)), events, "t", "on")


def test_we_read_faerys_aedat(tmp_path: Path) -> None:
    """Its default compression."""
    write_with_faery(tmp_path / "e.aedat4", STREAMS["from 0"])
    assert_same(read_events(tmp_path / "e.aedat4"), STREAMS["from 0"])


# ---- expelliarmus ----


def expelliarmus(name: str) -> Any:
    return pytest.importorskip("expelliarmus").Wizard(encoding=name)


@pytest.mark.long
@every_stream
def test_expelliarmus_reads_our_evt2(tmp_path: Path, events: EventArray) -> None:
    """All events in their order, past 2^32 us as well."""
    assert_columns(expelliarmus("evt2").read(write_events(FORMAT_VARIANTS["evt2"], tmp_path, events)), events, "t", "p")


def test_expelliarmus_reads_our_evt3(tmp_path: Path) -> None:
    """Coordinates, polarities and order are right, and times up to the first 4096 us. Beyond, expelliarmus 1.1.12 adds
    the high time to its own count of the low one's rounds, in any file whose high time changes."""
    events = STREAMS["from 0"].copy()
    read = expelliarmus("evt3").read(write_events(FORMAT_VARIANTS["evt3"], tmp_path, events))
    read["t"] %= 4096
    events["t"] %= 4096
    assert_columns(read, events, "t", "p")


def test_we_read_expelliarmus_evt2(tmp_path: Path) -> None:
    """As it writes it."""
    events = STREAMS["from 0"]
    array = events.astype([("t", "<i8"), ("x", "<i2"), ("y", "<i2"), ("p", "u1")])
    expelliarmus("evt2").save(tmp_path / "e.raw", array)
    assert_same(read_events(tmp_path / "e.raw"), events)


# ---- aedat, dv-processing, tonic ----


@every_aedat
def test_aedat_reads_ours(tmp_path: Path, kind: FormatVariant) -> None:
    """The stream's description and all events."""
    aedat = pytest.importorskip("aedat")
    events = STREAMS["from 0"]
    decoder = aedat.Decoder(write_events(kind, tmp_path, events, packet=3_000))
    assert decoder.id_to_stream() == {0: {"type": "events", "width": SIZE[0], "height": SIZE[1]}}
    assert_columns(np.concatenate([packet["events"] for packet in decoder]), events, "t", "on")


@every_aedat
@pytest.mark.parametrize("table", [True, False], ids=["finished", "killed"])
def test_dv_processing_reads_ours(tmp_path: Path, kind: FormatVariant, table: bool) -> None:
    """All events, a slice of time by the table of contents, and a file without one, as a killed writer leaves it."""
    dv = pytest.importorskip("dv_processing")
    events, path, buffer = STREAMS["from 0"], tmp_path / "e.aedat4", io.BytesIO()
    if table:
        write_events(kind, tmp_path, events, packet=3_000)
    else:
        open_writer(buffer, SIZE, kind.name, **kind.options).write(events)
        path.write_bytes(buffer.getvalue())
    recording = dv.io.MonoCameraRecording(str(path))
    assert recording.getEventResolution() == SIZE
    store = dv.EventStore()
    while (batch := recording.getNextEventBatch()) is not None:
        store.add(batch)
    assert_columns(store.numpy(), events, "timestamp", "polarity")
    keep = (events["t"] >= 20_000) & (events["t"] < 30_000)
    assert_columns(recording.getEventsTimeRange(20_000, 30_000).numpy(), events[keep], "timestamp", "polarity")


@pytest.mark.parametrize("compression", ["NONE", "LZ4", "ZSTD"])
def test_we_read_dv_processings(tmp_path: Path, compression: str) -> None:
    """As it writes them, in packets, in Unix time."""
    dv = pytest.importorskip("dv_processing")
    path, events = tmp_path / "e.aedat4", many(2_000, start_us=1_700_000_000_000_000)
    config = dv.io.MonoCameraWriter.EventOnlyConfig("davis", SIZE, getattr(dv.CompressionType, compression))
    writer = dv.io.MonoCameraWriter(str(path), config)
    for packet in np.split(events, 4):
        store = dv.EventStore()
        for t, x, y, p in packet.tolist():
            store.push_back(t, x, y, bool(p))
        writer.writeEvents(store)
    del writer
    assert_same(read_events(path), events)
    assert open_reader(path).size == SIZE
    start, stop = events["t"][700], events["t"][1300]
    keep = (events["t"] >= start) & (events["t"] < stop)
    assert_same(read_events(path, start_us=int(start), stop_us=int(stop)), events[keep])


def test_tonic_reads_our_aedat(tmp_path: Path) -> None:
    """Through its own reader of AEDAT 4."""
    tonic_io = pytest.importorskip("tonic.io")
    pytest.importorskip("aedat")
    events = STREAMS["from 0"]
    assert_columns(tonic_io.read_aedat4(write_events(FORMAT_VARIANTS["aedat4"], tmp_path, events)), events, "t", "p")


# ---- events.txt ----


def test_pandas_reads_our_text(tmp_path: Path) -> None:
    """As the readers of the public dataset do it: four columns, times in seconds."""
    pandas = pytest.importorskip("pandas")
    events = STREAMS["from 0"]
    path = write_events(FORMAT_VARIANTS["text"], tmp_path, events)
    table = pandas.read_csv(path, sep=" ", header=None, names=["t", "x", "y", "p"])
    table["t"] = np.rint(table["t"] * 1e6)
    assert_columns(table, events, "t", "p")


def test_polars_reads_our_text_and_we_its(tmp_path: Path) -> None:
    """Both ways, nine decimals."""
    polars = pytest.importorskip("polars")
    events = STREAMS["from 0"]
    path = write_events(FORMAT_VARIANTS["text"], tmp_path, events)
    table = polars.read_csv(path, separator=" ", has_header=False, new_columns=["t", "x", "y", "p"])
    table.write_csv(tmp_path / "theirs.txt", separator=" ", include_header=False, float_precision=9)
    assert (tmp_path / "theirs.txt").read_bytes() == path.read_bytes()
    assert_same(read_events(tmp_path / "theirs.txt"), events)
    assert_columns(
        {name: np.rint(table["t"] * 1e6) if name == "t" else table[name] for name in "txyp"}, events, "t", "p"
    )


def test_numpy_reads_our_text(tmp_path: Path) -> None:
    """np.loadtxt, without any other library."""
    events = many(1_000)
    columns = np.loadtxt(write_events(FORMAT_VARIANTS["text"], tmp_path, events))
    read = np.zeros(len(events), EVENT_DTYPE)
    read["t"] = np.rint(columns[:, 0] * 1e6)
    read["x"], read["y"], read["p"] = columns[:, 1:].T
    assert_same(read, events)
