"""Rows of ``peers.py``: events.txt, .npy, .npz, EVT, AEDAT 4, and what the machine can do."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from peers_row import SIZE, EventArray, Row, ours, packets


def _copy(_: Path, events: EventArray) -> object:
    return events.copy()


def _write_raw(path: Path, events: EventArray) -> None:
    with path.open("wb", buffering=0) as file:
        for packet in packets(events):
            file.write(packet.view(np.uint8).data)


def _polars_table(events: EventArray) -> Any:
    import polars

    return polars.DataFrame({name: np.ascontiguousarray(events[name]) for name in "txyp"})


def _polars_write(path: Path, table: Any) -> None:
    import polars

    table.with_columns(t=polars.col("t") / 1e6).write_csv(path, separator=" ", include_header=False, float_precision=9)


def _polars_read(path: Path) -> object:
    import polars

    types = {"t": polars.Float64, "x": polars.UInt16, "y": polars.UInt16, "p": polars.UInt8}
    return polars.read_csv(path, separator=" ", has_header=False, schema=types)


def _pandas_read(path: Path) -> object:
    import pandas

    types = {0: "f8", 1: "u2", 2: "u2", 3: "u1"}
    return pandas.read_csv(path, sep=" ", header=None, dtype=types)


def _savetxt(path: Path, events: EventArray) -> None:
    columns = np.stack([events["t"] / 1e6, events["x"], events["y"], events["p"]], axis=1)
    np.savetxt(path, columns, ["%.9f", "%d", "%d", "%d"])


def _faerys(events: EventArray) -> Any:
    import faery

    array = np.empty(len(events), faery.EVENTS_DTYPE)
    for mine, theirs in (("t", "t"), ("x", "x"), ("y", "y"), ("p", "on")):
        array[theirs] = events[mine]
    return array


def _faery(format: str, suffix: str, **options: Any) -> Row:
    def write(path: Path, array: Any) -> None:
        import faery

        faery.events_stream_from_array(array, SIZE).to_file(path, **options)

    def read(path: Path) -> object:
        import faery

        return np.concatenate(list(faery.events_stream_from_file(path)))

    return Row(format, "faery", suffix, write, read, _faerys)


def _expelliarmus(version: str) -> Row:
    def prepare(events: EventArray) -> Any:
        return events.astype([("t", "<i8"), ("x", "<i2"), ("y", "<i2"), ("p", "u1")])

    def write(path: Path, array: Any) -> None:
        from expelliarmus import Wizard

        Wizard(encoding=version).save(path, array)

    def read(path: Path) -> object:
        from expelliarmus import Wizard

        return Wizard(encoding=version).read(path)

    return Row(version, "expelliarmus", ".raw", write, read, prepare)


def _dv_store(events: EventArray) -> Any:
    """Events as dv-processing has them, by way of a file of ours: it takes none from an array."""
    import tempfile

    import dv_processing as dv

    from davis_rs import open_writer

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "events.aedat4"
        with open_writer(path, SIZE, compression="none") as writer:
            writer.write(events)
        return _dv_read(path, dv)


def _dv_read(path: Path, dv: Any) -> Any:
    recording, stores = dv.io.MonoCameraRecording(str(path)), []
    while (batch := recording.getNextEventBatch()) is not None:
        stores.append(batch)
    return stores


def _dv(compression: str) -> Row:
    def write(path: Path, stores: Any) -> None:
        import dv_processing as dv

        config = dv.io.MonoCameraWriter.EventOnlyConfig("bench", SIZE, getattr(dv.CompressionType, compression.upper()))
        writer = dv.io.MonoCameraWriter(str(path), config)
        for store in stores:
            writer.writeEvents(store)

    def read(path: Path) -> object:
        import dv_processing as dv

        return _dv_read(path, dv)

    return Row(f"aedat4 ({compression})", "dv-processing", ".aedat4", write, read, _dv_store)


def _aedat() -> Row:
    def read(path: Path) -> object:
        import aedat

        return np.concatenate([packet["events"] for packet in aedat.Decoder(path)])

    return ours("aedat4", ".aedat4", compression="lz4")._replace(program="aedat (reads ours)", read=read)


ROWS = [
    Row("memcpy", "numpy", "", _copy, None),
    Row("write(2)", "numpy", ".bin", _write_raw, lambda path: path.read_bytes()),
    ours("text", ".txt"),
    Row("text, whole table", "polars", ".txt", _polars_write, _polars_read, _polars_table),
    Row("text, a tenth", "np.savetxt / pandas", ".txt", _savetxt, _pandas_read, lambda events: events[::10].copy()),
    ours("npy", ".npy"),
    ours("npz", ".npz"),
    Row("npy, whole array", "np.save / np.load", ".npy", np.save, np.load),
    ours("evt2", ".raw"),
    _faery("evt2", ".raw", version="evt2"),
    _expelliarmus("evt2"),
    ours("evt3", ".raw"),
    _faery("evt3", ".raw", version="evt3"),
    _expelliarmus("evt3"),
    *(
        row
        for compression in ("none", "lz4", "zstd")
        for row in (
            ours("aedat4", ".aedat4", compression=compression),
            *(
                [_faery(f"aedat4 ({compression})", ".aedat4", compression=(compression, 1))]
                if compression != "none"
                else []
            ),
            _dv(compression),
        )
    ),
    _aedat(),
]
