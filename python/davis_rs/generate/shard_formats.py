"""Writes sequences into one file: HDF5, with a group for each, or a tar file for WebDataset.

In a tar file, a sequence's files have the same name up to the first dot.
"""

from __future__ import annotations

import io
import tarfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from .._util.extras import from_extra
from .sequence_arrays import read_sequence

if TYPE_CHECKING:
    import h5py

_LARGEST_CHUNK = 1 << 16
"""Elements of a column in a chunk; maps have one chunk each."""


def write_hdf5_shard(path: Path, folders: Sequence[Path]) -> None:
    """Write folders of sequences into a new file, in groups of their names.

    Each has ``events/{t, x, y, p}`` and ``ms_to_idx`` as DSEC's files have (``t_offset`` is 0, ``t`` is int64), the
    groups of :class:`~davis_rs.generate.sequence_arrays.SequenceArrays`, ``meta`` (JSON), and ``files/`` with all other
    files as bytes. The same folders give the same bytes.

    Raises:
        ImportError: without h5py.
        OSError, DecodeError: if a folder cannot be read, or the file cannot be written.
    """
    with from_extra("hdf5"):
        import h5py
    with h5py.File(path, "x") as file:
        for folder in folders:
            sequence = read_sequence(folder)
            group = file.create_group(folder.name)
            group["meta"] = sequence.meta.decode()
            group["t_offset"] = np.int64(0)
            t = sequence.groups["events"]["t"]
            last_ms = int(t[-1]) // 1000 if len(t) else -1
            group["ms_to_idx"] = np.searchsorted(t, np.arange(last_ms + 1) * 1000).astype(np.uint64)
            for name, columns in sequence.groups.items():
                for column, values in columns.items():
                    _add_dataset(group, f"{name}/{column}", values)
            for name, data in sequence.files.items():
                group[f"files/{name}"] = np.frombuffer(data, np.uint8)


def _add_dataset(group: h5py.Group, name: str, values: npt.NDArray[np.generic]) -> None:
    import h5py

    if values.dtype.kind in "US":  # names of shapes
        group.create_dataset(name, data=values.astype(object), dtype=h5py.string_dtype())
    elif values.dtype == object or not values.size or not values.ndim:
        group[name] = values
    else:
        chunk = (1, *values.shape[1:]) if values.ndim > 2 else (min(len(values), _LARGEST_CHUNK), *values.shape[1:])
        group.create_dataset(name, data=values, chunks=chunk, compression="gzip", compression_opts=1, shuffle=True)


def write_webdataset_shard(path: Path, folders: Sequence[Path]) -> None:
    """Write folders of sequences into a new tar file, one after the other, in the order of their names.

    A sequence has ``NAME.meta.json``, ``NAME.GROUP.npz`` for each group of
    :class:`~davis_rs.generate.sequence_arrays.SequenceArrays`, and all other files as ``NAME.files.FILE`` with
    ``.`` for ``/``. The same folders give the same bytes.

    Raises:
        OSError, DecodeError: if a folder cannot be read, or the file cannot be written.
    """
    with tarfile.open(path, "x", format=tarfile.USTAR_FORMAT) as archive:
        for folder in folders:
            sequence = read_sequence(folder)
            _add_member(archive, f"{folder.name}.meta.json", sequence.meta)
            for name, columns in sequence.groups.items():
                stream = io.BytesIO()
                np.savez_compressed(stream, **columns)  # type: ignore[arg-type]
                _add_member(archive, f"{folder.name}.{name}.npz", stream.getvalue())
            for name, data in sequence.files.items():
                _add_member(archive, f"{folder.name}.files.{name.replace('/', '.')}", data)


def _add_member(archive: tarfile.TarFile, name: str, data: bytes) -> None:
    member = tarfile.TarInfo(name)  # of no owner and time, so that the bytes are those of the data alone
    member.size = len(data)
    archive.addfile(member, io.BytesIO(data))
