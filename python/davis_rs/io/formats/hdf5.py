"""Writes and reads events in HDF5: what the layouts of DSEC and of e2vid share."""

from __future__ import annotations

import os
from abc import abstractmethod
from bisect import bisect_left
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Protocol

import numpy as np
import numpy.typing as npt

from ..._core import DecodeError, fill_events
from ..._util.array_types import UncheckedArray
from ..._util.budget import Budget
from ..._util.extras import from_extra, require
from ..._util.untrusted import decoding
from ...events.arrays import EVENT_DTYPE, EventArray
from .blocks import BLOCK, BlockPosition, Blocks, equal_blocks
from .destination import Destination, Target
from .hdf5_chunks import Rows
from .hdf5_dataset import CHUNK, GrowingDataset, check_compression
from .hdf5_flushed_file import Hdf5File
from .hdf5_links import find_inside
from .interface import EventReader, EventWriter, Format, warn_truncated
from .reading import ReadRules, possible_size

if TYPE_CHECKING:
    import h5py

SIGNATURE = b"\x89HDF\r\n\x1a\n"
COMPLETE = "complete"
"""A root attribute of ours: 0 until the file is finished."""

_FLUSH = 16 * CHUNK
"""Events between two flushes that come by themselves."""


class Hdf5Writer(EventWriter):
    """Writes events as columns.

    A killed process leaves a file that reads up to the last flush, which comes by itself every million events.

    Args:
        compression: "zstd", "lz4" (both through Blosc; readers need hdf5plugin) or "none".
        level: of the compression, 1..9.
    """

    def __init__(
        self,
        destination: Destination,
        *,
        compression: str,
        level: int,
    ) -> None:
        destination.path("HDF5 needs a file: it")
        super().__init__(destination)
        check_compression(compression, level)
        self._compression, self._level = compression, level
        self._columns: dict[str, GrowingDataset] = {}
        self._rows = 0
        self._hdf5 = Hdf5File(destination.claim())
        try:
            root = self._hdf5.file.attrs
            root["sensor_resolution"] = np.array([self.size[1], self.size[0]], np.int64)
            root[COMPLETE] = np.uint8(0)
            self._create()
            self._hdf5.flush()
        except BaseException:
            self._abandon()
            raise

    def _column(self, name: str, dtype: npt.DTypeLike, *, bits: bool = False, chunk: int = CHUNK) -> GrowingDataset:
        return GrowingDataset(
            self._hdf5,
            name,
            dtype,
            compression=self._compression,
            level=self._level,
            bits=bits,
            chunk=chunk,
        )

    @abstractmethod
    def _create(self) -> None:
        """Make the datasets."""

    @abstractmethod
    def _append(self, packet: EventArray) -> None:
        """Append events to the columns, which have room for them in their chunk."""

    @abstractmethod
    def _settle(self) -> None:
        """Bring all datasets and attributes to the same number of events."""

    def _encode(self, packet: EventArray) -> None:
        with self._telling():
            start = 0
            while start < len(packet):
                # Up to the end of the chunk, so that a flush finds it whole.
                piece = packet[start : start + CHUNK - self._rows % CHUNK]
                self._append(piece)
                self._rows += len(piece)
                start += len(piece)
                if self._rows % _FLUSH == 0:
                    self._flush()

    def _flush(self) -> None:
        with self._telling():
            self._settle()
            self._hdf5.flush()

    def _close(self) -> int:
        with self._telling():
            self._settle()
            self._hdf5.file.attrs.modify(COMPLETE, np.uint8(1))
            return self._hdf5.close()

    def _abandon(self) -> None:
        with suppress(OSError, RuntimeError):
            self._hdf5.close()

    @contextmanager
    def _telling(self) -> Iterator[None]:
        """Raise the system's own error for the one that HDF5 makes of it."""
        try:
            yield
        except (OSError, RuntimeError) as error:
            self._hdf5.check()
            raise OSError(f"{self.path}: {error}") from error


class EventRows(Protocol):
    """Reads a dataset of events, or of one of their columns, of which the file has ``chunk`` rows in one piece."""

    @property
    def chunk(self) -> int | None: ...

    def read(self, start: int, end: int) -> UncheckedArray: ...


class Hdf5Reader(EventReader):
    """Reads columns of events; slices of time are found by bisection.

    Raises:
        DecodeError: if columns are missing, or differ in length in a file that was finished.
    """

    names: ClassVar[tuple[str, ...]]
    """The datasets of t, x, y and p; or the one of all."""
    row: ClassVar[tuple[int, ...]] = ()
    """The shape of their values."""

    def __init__(self, path: str | os.PathLike[str], *, format: str, rules: ReadRules) -> None:
        self.path = Path(path)
        self._file = open_hdf5(path)
        try:
            with decoding(path):
                datasets = [find_inside(path, self._file, name) for name in self.names]
                missing = [name for name, dataset in zip(self.names, datasets, strict=True) if dataset is None]
                if missing:
                    raise DecodeError(f"{os.fspath(path)}: no dataset {', '.join(missing)}")
                super().__init__(path, format=format, size=self._size(), rules=rules)
                self._done = 0
                self._budget = Budget(path)
                lengths = {dataset.name: len(dataset) for dataset in datasets}
                self._count = min(lengths.values())
                self._datasets = [self._event_rows(dataset) for dataset in datasets]
                finished = self._file.attrs.get(COMPLETE, 1) != 0
                if finished and len(set(lengths.values())) > 1:
                    raise DecodeError(f"{path}: datasets of events differ in length: {lengths}")
            if not finished:
                warn_truncated(path, f"the file was never finished; {self._count} events are in it")
        except BaseException:
            self._file.close()
            raise

    @property
    def events(self) -> int:
        return self._count

    @property
    def progress(self) -> float:
        return self._done / self._count if self._count else 1.0

    def close(self) -> None:
        self._file.close()

    def _find(self, name: str) -> Any:
        """Return the dataset or group of a name, None where there is none."""
        return find_inside(self.path, self._file, name)

    def _rows_of(self, dataset: h5py.Dataset, rows: int, row: tuple[int | None, ...] = ()) -> Rows:
        """Return the rows of a dataset of the file, within its limits."""
        return Rows(self.path, dataset, rows, self.rules.max_packet_bytes, self._budget, row)

    def _event_rows(self, dataset: h5py.Dataset) -> EventRows:
        """Return the rows of a dataset of events."""
        return self._rows_of(dataset, self._count, self.row)

    @abstractmethod
    def _times(self, values: UncheckedArray) -> npt.NDArray[np.int64]:
        """Return microseconds from what the dataset of times holds."""

    def _size(self) -> tuple[int, int] | None:
        resolution = self._file.attrs.get("sensor_resolution")
        if resolution is None or len(resolution) < 2:
            return None
        return possible_size(int(resolution[1]), int(resolution[0]))

    def _packets(self, chunk: int, start_us: int | None, stop_us: int | None) -> Iterator[EventArray]:
        first, end = self._place(start_us, 0), self._place(stop_us, self._count)
        while first < end:
            # Cut where the file's own chunks are, so that none is decompressed twice.
            step = self._datasets[0].chunk or chunk
            stop = min(end, first + chunk)
            if stop < end and stop - stop % step > first:
                stop -= stop % step
            yield self._slice(first, stop)
            first = self._done = stop

    def _read(self, start_us: int | None, stop_us: int | None) -> EventArray:
        return self._slice(self._place(start_us, 0), self._place(stop_us, self._count))

    def blocks(self) -> Blocks:
        chunk = self._datasets[0].chunk
        return equal_blocks(self._count, BLOCK if chunk is None else max(chunk, BLOCK // 4))

    def read_block(self, position: BlockPosition, events: int) -> EventArray:
        return self._slice(int(position[0]), int(position[1]))

    def _place(self, t_us: int | None, default: int) -> int:
        if t_us is None:
            return default
        times = self._datasets[0]

        def time(row: int) -> int:
            return int(self._times(times.read(row, row + 1))[0])

        return bisect_left(range(self._count), t_us, key=time)

    def _slice(self, start: int, stop: int) -> EventArray:
        events = np.zeros(max(0, stop - start), EVENT_DTYPE)
        # Piece by piece, so that what is decompressed is still in the processor's cache when it is put together.
        while start < stop:
            end = min(stop, start - start % CHUNK + CHUNK)
            self._fill(events[len(events) - (stop - start) :][: end - start], start, end)
            start = end
        return events

    def _fill(self, events: EventArray, start: int, end: int) -> None:
        with decoding(self.path, f"events {start}..{end}"):  # a filter that fails on what it is given, or is missing
            t, x, y, p = self._columns(start, end)
        x, y = self._coordinate("x", x, start), self._coordinate("y", y, start)
        # Some have -1 for 0.
        wrong = ~((p == 0) | (p == 1) | (p == -1))
        if wrong.any():
            at = int(wrong.argmax())
            raise DecodeError(f"{self.path}: p of event {start + at} is {p[at]}, not 0 or 1")
        fill_events(events, self._times(t), x, y, (p > 0).view(np.uint8))

    def _columns(self, start: int, end: int) -> tuple[UncheckedArray, ...]:
        """Return t, x, y and p of some events, as the file has them."""
        return tuple(rows.read(start, end) for rows in self._datasets)

    def _coordinate(self, name: str, column: UncheckedArray, start: int) -> npt.NDArray[np.uint16]:
        if column.dtype == np.uint16:
            return column
        if column.dtype.kind not in "iu":
            raise DecodeError(f"{self.path}: {name} must hold integers, found {column.dtype}")
        wrong = (column < 0) | (column > 65_535)
        if wrong.any():
            at = int(wrong.argmax())
            raise DecodeError(f"{self.path}: {name} of event {start + at} is {column[at]}, not in 0..65535")
        return column.astype(np.uint16)


def open_hdf5(path: str | os.PathLike[str]) -> h5py.File:
    """Return an HDF5 file for reading, with the compressions of hdf5plugin.

    Raises:
        ImportError: if a library is missing, with the extra that brings it.
        OSError: if it cannot be read.
        DecodeError: if HDF5 finds it broken.
    """
    with from_extra("hdf5"):
        import h5py
        import hdf5plugin  # noqa: F401
    Path(path).open("rb").close()  # the system's own error, where there is one
    with decoding(path):
        try:
            return h5py.File(path, "r")
        except OSError as error:  # HDF5 gives its own findings the system's numbers
            raise DecodeError(f"{os.fspath(path)}: {error}") from error


class Hdf5Format(Format):
    """Describes a layout of events in HDF5."""

    suffixes = (".h5", ".hdf5")
    options = ("compression", "level")
    default_compression: ClassVar[Literal["none", "lz4", "zstd"]]
    marks: ClassVar[tuple[str, ...]]
    """Datasets that tell the layout."""
    writer: ClassVar[type[Hdf5Writer]]
    reader: ClassVar[type[Hdf5Reader]]

    def require_libraries(self, *, compression: str | None = None, **_: object) -> None:
        require("hdf5", "h5py")
        if (compression or self.default_compression) != "none":
            require("hdf5", "hdf5plugin", "numcodecs")

    def open_writer(
        self,
        target: Target,
        size: tuple[int, int],
        *,
        overwrite: bool,
        compression: str | None = None,
        level: int = 1,
        **options: Any,
    ) -> EventWriter:
        self.require_libraries(compression=compression)
        compression = self.default_compression if compression is None else compression
        return super().open_writer(target, size, overwrite=overwrite, compression=compression, level=level, **options)

    def open_reader(self, path: str | os.PathLike[str], rules: ReadRules = ReadRules()) -> EventReader:  # noqa: B008
        return self.reader(Path(path), format=self.name, rules=rules)

    def sniff(self, head: bytes, path: Path) -> bool:
        if not head.startswith(SIGNATURE):
            return False
        try:
            with open_hdf5(path) as file, decoding(path):
                return all(find_inside(path, file, name) is not None for name in self.marks)
        except (ImportError, DecodeError):
            return True  # whose reader says what is wrong
