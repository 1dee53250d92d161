"""Reads events of Metavision's HDF5 files: ``CD/events``, of which each chunk is compressed by ECF."""

from __future__ import annotations

import os
import re
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ..._core import DecodeError, decode_ecf
from ..._util.array_types import UncheckedArray
from ..._util.budget import Budget
from ..._util.untrusted import decoding
from ...events.arrays import EVENT_DTYPE, EventArray
from .destination import Limits
from .hdf5 import Hdf5Format, Hdf5Reader
from .hdf5_chunks import check_storage, fill_from_chunks, stored_chunk
from .reading import possible_size

if TYPE_CHECKING:
    import h5py

_ECF = 0x8ECF
"""The number of HDF5's filter."""


class EcfRows:
    """Reads events of a dataset. The chunk that the last ones came from is kept, so that the next ones are there.

    Args:
        path: the file, in which all events must lie.
        rows: events of the dataset that may be read.
        limit: bytes that a chunk may have, as HDF5 has its events in memory.
        budget: of the file, to which the chunk that is kept is charged.

    Raises:
        DecodeError: here, for a dataset that is not one of events (x, y, p, t), or is compressed in another way.
    """

    def __init__(
        self, path: str | os.PathLike[str], dataset: h5py.Dataset, rows: int, limit: int, budget: Budget
    ) -> None:
        name, fields = dataset.name, dataset.dtype.names
        if dataset.ndim != 1 or fields is None or not {"t", "x", "y", "p"} <= set(fields):
            raise DecodeError(f"{path}: {name} must have t, x, y and p: found {dataset.shape}, {dataset.dtype}")
        check_storage(path, dataset, rows, limit)
        properties = dataset.id.get_create_plist()
        filters = [properties.get_filter(k)[0] for k in range(properties.get_nfilters())]
        if filters != [_ECF]:
            raise DecodeError(f"{path}: {name} is compressed by HDF5's filters {filters}: expected ECF ({_ECF}) alone")
        self._path, self._dataset, self._rows = path, dataset, rows
        self._chunk = int(dataset.chunks[0])
        self._first, self._kept = -1, np.zeros(0, EVENT_DTYPE)
        budget.take(self._chunk * EVENT_DTYPE.itemsize, f"a chunk of {name}")

    @property
    def chunk(self) -> int:
        """Events of a chunk."""
        return self._chunk

    def read(self, start: int, end: int) -> EventArray:
        """Return events ``start`` to ``end``, an array of its own.

        Raises:
            DecodeError: for a chunk that is damaged.
        """
        events = np.empty(max(0, end - start), EVENT_DTYPE)
        fill_from_chunks(events, start, self._chunk, self._chunk_at)
        return events

    def _chunk_at(self, first: int) -> EventArray:
        if first != self._first:
            where = f"{self._dataset.name}, the chunk at {first}"
            with decoding(self._path, where):
                skipped, data = stored_chunk(self._path, self._dataset, (first,))
                if skipped:
                    raise ValueError("it is not compressed, which Metavision does not write")
                self._first, self._kept = -1, decode_ecf(np.frombuffer(data, np.uint8), self._chunk)
            expected = min(self._chunk, self._rows - first)
            if len(self._kept) < expected:
                raise DecodeError(f"{self._path}: {where}: it has {len(self._kept)} events of {expected}")
            self._first = first
        return self._kept


class EcfReader(Hdf5Reader):
    """Reads the events of Metavision's HDF5 files, with the times that the file has. Triggers are not read."""

    names = ("CD/events",)

    def _event_rows(self, dataset: h5py.Dataset) -> EcfRows:
        return EcfRows(self.path, dataset, self._count, self.rules.max_packet_bytes, self._budget)

    def _fill(self, events: EventArray, start: int, end: int) -> None:
        (rows,) = self._datasets
        events[:] = rows.read(start, end)

    def _times(self, values: UncheckedArray) -> npt.NDArray[np.int64]:
        times: npt.NDArray[np.int64] = values["t"]
        return times

    def _size(self) -> tuple[int, int] | None:
        geometry = self._file.attrs.get("geometry")
        text = geometry.decode("ascii", "replace") if isinstance(geometry, bytes) else str(geometry)
        sides = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text)
        return None if sides is None else possible_size(int(sides[1]), int(sides[2]))


class EcfFormat(Hdf5Format):
    """Describes Metavision's HDF5: events in ``CD/events``. It is only read.

    Source: Prophesee, HDF5 event files, in Metavision's documentation; `hdf5_ecf`, the codec of HDF5's filter 0x8ECF.
    """

    name = "ecf"
    writable = False
    limits = Limits(width=2048, height=2048)
    marks = ("CD/events",)
    default_compression = "none"
    reader = EcfReader
