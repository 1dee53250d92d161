"""Writes ground truth at each event, as columns next to the events' own: HDF5 or npz."""

from __future__ import annotations

import json
import shutil
import zipfile
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..._util.extras import from_extra, require
from ...events.arrays import EventArray
from ...render.truth import EventTruthArray
from .files import EVENT_TRUTH

COLUMNS: Mapping[str, str] = {
    "t": "<i8",
    "x": "<u2",
    "y": "<u2",
    "p": "|u1",
    "depth": "<f4",
    "flow_x": "<f4",
    "flow_y": "<f4",
    "shape": "<u2",
}
"""Times in microseconds, pixels, polarity 0 or 1; depth in metres, flow in pixels per second, the shape's number."""

_CHUNK = 1 << 16


class EventTruthFile(ABC):
    """Writes events with their truth, packet by packet, in memory that does not grow.

    Args:
        path: a file that does not exist.
        shape_names: of the shapes; number 1 is the first.

    Raises:
        OSError: if it cannot be written.
    """

    @abstractmethod
    def __init__(self, path: Path, shape_names: Sequence[str]) -> None: ...

    def write(self, events: EventArray, truth: EventTruthArray) -> None:
        """Append events (n,) and their truth (n,)."""
        if not len(events):
            return
        flow = truth["flow"]
        own = {name: events[name] for name in ("t", "x", "y", "p")}
        seen = {"depth": truth["depth"], "flow_x": flow[:, 0], "flow_y": flow[:, 1], "shape": truth["shape"]}
        self._append({name: np.ascontiguousarray(values, COLUMNS[name]) for name, values in {**own, **seen}.items()})

    @abstractmethod
    def close(self) -> None:
        """Finish the file."""

    @abstractmethod
    def _append(self, columns: Mapping[str, npt.NDArray[np.generic]]) -> None: ...


class Hdf5Truth(EventTruthFile):
    """Writes a data set for each column, and the shapes' names as the attribute ``shape_names``. What was written can
    be read after each packet."""

    def __init__(self, path: Path, shape_names: Sequence[str]) -> None:
        with from_extra("hdf5"):
            import h5py
        self._file = h5py.File(path, "x")
        for name, kind in COLUMNS.items():
            self._file.create_dataset(
                name,
                (0,),
                kind,
                maxshape=(None,),
                chunks=(_CHUNK,),
                compression="gzip",
                compression_opts=1,
                shuffle=True,
            )
        self._file.attrs["shape_names"] = json.dumps(list(shape_names))
        self._count = 0
        self._file.flush()

    def _append(self, columns: Mapping[str, npt.NDArray[np.generic]]) -> None:
        first = self._count
        self._count += len(columns["t"])
        for name, values in columns.items():
            self._file[name].resize((self._count,))
            self._file[name][first:] = values
        self._file.flush()

    def close(self) -> None:
        self._file.close()


class NpzTruth(EventTruthFile):
    """Writes one array a column, and ``shape_names``. Columns are kept in files of their own, ``NAME.part.COLUMN``,
    until the archive is made of them: an archive is whole or not there."""

    def __init__(self, path: Path, shape_names: Sequence[str]) -> None:
        self._path, self._names = path, np.array(list(shape_names))
        self._column_paths = {name: path.with_name(f"{path.name}.part.{name}") for name in COLUMNS}
        self._open = ExitStack()
        self._files = {
            name: self._open.enter_context(path_of_column.open("wb", buffering=0))
            for name, path_of_column in self._column_paths.items()
        }
        self._count = 0

    def _append(self, columns: Mapping[str, npt.NDArray[np.generic]]) -> None:
        for name, values in columns.items():
            self._files[name].write(values.data)
        self._count += len(columns["t"])

    def close(self) -> None:
        self._open.close()
        whole = self._path.with_name(f"{self._path.name}.part")
        with zipfile.ZipFile(whole, "w", allowZip64=True) as archive:
            for name, kind in COLUMNS.items():
                header = {"descr": np.lib.format.dtype_to_descr(np.dtype(kind)), "fortran_order": False}
                with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                    np.lib.format.write_array_header_1_0(member, {**header, "shape": (self._count,)})
                    with self._column_paths[name].open("rb") as column:
                        shutil.copyfileobj(column, member, 1 << 20)
            with archive.open("shape_names.npy", "w") as member:
                np.lib.format.write_array(member, self._names, allow_pickle=False)
        whole.replace(self._path)
        for column_path in self._column_paths.values():
            column_path.unlink()


def open_event_truth(folder: Path, kind: str, shape_names: Sequence[str]) -> EventTruthFile:
    """Return the file of a dataset folder that holds truth at events.

    Args:
        kind: ``h5`` or ``npz``.
    """
    return {"h5": Hdf5Truth, "npz": NpzTruth}[kind](folder / EVENT_TRUTH[kind], shape_names)


def require_event_truth(kind: str | None) -> None:
    """Check that the library is there that a file of truth at events needs, of ``h5``, ``npz`` or None.

    Raises:
        ImportError: with the extra that brings it.
    """
    if kind == "h5":
        require("hdf5", "h5py")
