"""Rows of ``peers.py``: HDF5, Parquet, bags, and voxel grids."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from peers_row import SIZE, EventArray, Row, ours, packets


def _h5py_write(path: Path, events: EventArray, **filters: Any) -> None:
    """Appends to resizable datasets, packet by packet, as most converters do."""
    import h5py

    with h5py.File(path, "w") as file:
        types = {"t": "<i8", "x": "<u2", "y": "<u2", "p": "u1"}
        columns = {
            name: file.create_dataset(f"events/{name}", (0,), dtype, maxshape=(None,), chunks=(1 << 17,), **filters)
            for name, dtype in types.items()
        }
        for packet in packets(events):
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

    from davis_rs.io.formats.ros_messages import EVENTS, typestore

    path.unlink(missing_ok=True)
    with Writer(path) as bag:
        connection = bag.add_connection(EVENTS.name, EVENTS.type, typestore=typestore())
        for packet in packets(events):
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
    from davis_rs.events.represent import voxel_grid

    return voxel_grid(events, SIZE, 5)


def _tonics_grid(_: Path, events: EventArray) -> object:
    from tonic.functional import to_voxel_grid_numpy

    from davis_rs.events.dtypes import to_structured

    layout = np.dtype([("x", "i2"), ("y", "i2"), ("t", "i8"), ("p", "i1")])
    return to_voxel_grid_numpy(to_structured(events, layout), (*SIZE, 2), n_time_bins=5)


ROWS = [
    ours("dsec", ".h5"),
    ours("dsec", ".h5", compression="lz4"),
    ours("dsec", ".h5", compression="none"),
    ours("e2vid", ".h5"),
    Row("h5py, raw", "h5py", ".h5", _h5py_write, _h5py_read),
    Row("h5py, Blosc zstd 1", "h5py", ".h5", _h5py_zstd, _h5py_read),
    ours("parquet", ".parquet"),
    Row("parquet, whole table", "pyarrow / polars", ".parquet", _pyarrow_write, _polars_read),
    ours("bag", ".bag"),
    Row("bag, packed by NumPy", "rosbags", ".bag", _rosbags_write, _rosbags_read),
    Row("voxel grid, 5 bins", "davis_rs", "", _our_grid, None),
    Row("voxel grid, 5 bins", "tonic", "", _tonics_grid, None),
]
