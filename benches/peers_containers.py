"""Rows of the bench beside other programs: HDF5, Parquet, bags, and voxel grids.

``ROWS`` is what is measured. ``python benches/peers_containers.py EVENTS.npy [WORD ...]`` measures them by itself, on
an array of ``davis_rs.EVENT_DTYPE``: each row in a process of its own, one thread, the file in the page cache without
fsync; the best of three.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

EventArray = npt.NDArray[np.void]
SIZE = (240, 180)
PACKET = 100_000


class Row(NamedTuple):
    """A program that writes a file of events, and perhaps one that reads it as it likes best."""

    format: str
    program: str
    suffix: str
    write: Callable[[Path, EventArray], object]
    read: Callable[[Path], object] | None


def _ours(format: str, suffix: str, **options: Any) -> Row:
    def write(path: Path, events: EventArray) -> None:
        from davis_rs import open_writer

        with open_writer(path, SIZE, format, **options) as writer:
            for packet in _packets(events):
                writer.write(packet)

    def read(path: Path) -> object:
        from davis_rs import read_events

        return read_events(path)

    told = ", ".join(f"{name} {value}" for name, value in options.items())
    return Row(f"{format}{f' ({told})' if told else ''}", "davis_rs", suffix, write, read)


def _h5py_write(path: Path, events: EventArray, **filters: Any) -> None:
    """As most converters do it: append to resizable datasets, packet by packet."""
    import h5py

    with h5py.File(path, "w") as file:
        types = {"t": "<i8", "x": "<u2", "y": "<u2", "p": "u1"}
        columns = {
            name: file.create_dataset(f"events/{name}", (0,), dtype, maxshape=(None,), chunks=(1 << 17,), **filters)
            for name, dtype in types.items()
        }
        for packet in _packets(events):
            for name, column in columns.items():
                column.resize((len(column) + len(packet),))
                column[-len(packet) :] = packet[name]


def _h5py_zstd(path: Path, events: EventArray) -> None:
    import hdf5plugin

    _h5py_write(path, events, **hdf5plugin.Blosc("zstd", 1, hdf5plugin.Blosc.SHUFFLE))


def _h5py_read(path: Path) -> object:
    import h5py
    import hdf5plugin  # noqa: F401 - its filters

    with h5py.File(path) as file:
        return [file[f"events/{name}"][:] for name in "txyp"]


def _pyarrow_write(path: Path, events: EventArray) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.table({name: np.ascontiguousarray(events[name]) for name in ("t", "x", "y", "p")})
    encoding = {"t": "DELTA_BINARY_PACKED"}
    pq.write_table(table, path, compression="zstd", use_dictionary=["x", "y", "p"], column_encoding=encoding)


def _polars_read(path: Path) -> object:
    import polars

    return polars.read_parquet(path)


_PACKED = np.dtype([("x", "<u2"), ("y", "<u2"), ("sec", "<u4"), ("nsec", "<u4"), ("p", "u1")])


def _rosbags_write(path: Path, events: EventArray) -> None:
    """Message bytes packed by NumPy."""
    from rosbags.rosbag1 import Writer

    from davis_rs.formats.bag_messages import EVENTS, typestore

    path.unlink(missing_ok=True)
    with Writer(path) as bag:
        connection = bag.add_connection(*EVENTS, typestore=typestore())
        for packet in _packets(events):
            packed = np.empty(len(packet), _PACKED)
            packed["x"], packed["y"], packed["p"] = packet["x"], packet["y"], packet["p"]
            packed["sec"], rest = np.divmod(packet["t"], 1_000_000)
            packed["nsec"] = rest * 1000
            head = np.array([0, 0, 0, 0, SIZE[1], SIZE[0], len(packet)], "<u4").tobytes()
            bag.write(connection, int(packet["t"][-1]) * 1000 + 1, head + packed.tobytes())


def _rosbags_read(path: Path) -> object:
    from rosbags.rosbag1 import Reader

    with Reader(path) as bag:
        parts = []
        for _, _, data in bag.messages():
            name = int.from_bytes(data[12:16], "little")
            packed = np.frombuffer(data, _PACKED, offset=28 + name)
            part = np.empty(len(packed), [("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")])
            part["t"] = packed["sec"] * np.int64(1_000_000) + packed["nsec"] // 1000
            for field in "xyp":
                part[field] = packed[field]
            parts.append(part)
        return np.concatenate(parts)


def _our_grid(_: Path, events: EventArray) -> object:
    from davis_rs.represent import voxel_grid

    return voxel_grid(events, SIZE, 5)


def _tonics_grid(_: Path, events: EventArray) -> object:
    from tonic.functional import to_voxel_grid_numpy

    from davis_rs.dtypes import to_structured

    layout = np.dtype([("x", "i2"), ("y", "i2"), ("t", "i8"), ("p", "i1")])
    return to_voxel_grid_numpy(to_structured(events, layout), (*SIZE, 2), n_time_bins=5)


ROWS = [
    _ours("dsec", ".h5"),
    _ours("dsec", ".h5", compression="lz4"),
    _ours("dsec", ".h5", compression="none"),
    _ours("e2vid", ".h5"),
    Row("h5py, raw", "h5py", ".h5", _h5py_write, _h5py_read),
    Row("h5py, Blosc zstd 1", "h5py", ".h5", _h5py_zstd, _h5py_read),
    _ours("parquet", ".parquet"),
    Row("parquet, whole table", "pyarrow / polars", ".parquet", _pyarrow_write, _polars_read),
    _ours("bag", ".bag"),
    Row("bag, packed by NumPy", "rosbags", ".bag", _rosbags_write, _rosbags_read),
    Row("voxel grid, 5 bins", "davis_rs", "", _our_grid, None),
    Row("voxel grid, 5 bins", "tonic", "", _tonics_grid, None),
]


def _packets(events: EventArray) -> Iterable[EventArray]:
    return (events[start : start + PACKET] for start in range(0, len(events), PACKET))


def _one_thread() -> None:
    """Tell the libraries of this process."""
    import numcodecs.blosc
    import pyarrow

    numcodecs.blosc.set_nthreads(1)
    pyarrow.set_cpu_count(1)


def measure(row: Row, events: EventArray, rounds: int = 3) -> dict[str, float]:
    """Mev/s by wall and by processor time, bytes an event, and the process's peak memory over that before."""
    _one_thread()
    best: dict[str, float] = {}

    def timed(name: str, act: Callable[[], object]) -> None:
        wall, processor = time.perf_counter(), time.process_time()
        act()
        wall, processor = time.perf_counter() - wall, time.process_time() - processor
        for key, seconds in ((name, wall), (f"{name} (processor time)", processor)):
            best[key] = max(best.get(key, 0.0), len(events) / 1e6 / seconds)

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"events{row.suffix}"
        for _ in range(rounds):
            path.unlink(missing_ok=True)
            timed("write", lambda: row.write(path, events))
        if path.exists():
            best["bytes an event"] = path.stat().st_size / len(events)
        best["peak MB"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        if row.read is not None:
            read = row.read
            for _ in range(rounds):
                timed("read", lambda: read(path))
    return best


def main(arguments: list[str]) -> None:
    """Measure the rows whose format or program has one of the words in it; all without a word."""
    if arguments[:1] == ["--row"]:
        events = np.load(arguments[2])
        print(json.dumps(measure(ROWS[int(arguments[1])], events)))
        return
    path, words = arguments[0], arguments[1:]
    for number, row in enumerate(ROWS):
        if words and not any(word in f"{row.format} {row.program}" for word in words):
            continue
        command = [sys.executable, __file__, "--row", str(number), path]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        name = f"{row.format:26} {row.program:18} "
        if done.returncode:
            print(name + done.stderr.splitlines()[-1])
            continue
        figures = json.loads(done.stdout)
        print(name + "  ".join(f"{what} {value:.4g}" for what, value in figures.items()), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
