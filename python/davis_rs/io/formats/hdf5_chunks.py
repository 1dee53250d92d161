"""Reads rows of HDF5's datasets, each chunk of which is checked and unpacked once.

HDF5's filters take memory for whatever a chunk claims, or unpacks to. HDF5 forgets a chunk of more than 1 MiB at once,
so that it would be unpacked again for each piece that is read of it.
"""

from __future__ import annotations

import itertools
import math
import os
import zlib
from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING

import numpy as np

from ..._core import DecodeError
from ..._util.array_types import UncheckedArray
from ..._util.budget import Budget
from ..._util.untrusted import above_limit, decoding

if TYPE_CHECKING:
    import h5py

_DEFLATE, _SHUFFLE, _FLETCHER = 1, 2, 3
_LZF, _BLOSC, _LZ4, _BITSHUFFLE, _ZSTD = 32000, 32001, 32004, 32008, 32015
"""Numbers of filters. Source: HDF5's registry of filters."""
_PARAMETERS = {_BLOSC: 4, _BITSHUFFLE: 3}
"""How many parameters a filter reads without looking how many there are: fewer crash the process."""
_LONGEST_RATIO = {_DEFLATE: 1032, _LZF: 88}
"""What a byte can become, of formats that do not state what they unpack to."""


class Rows:
    """Reads rows of a dataset. The chunk that the last ones came from is kept, so that the next ones are there.

    What is kept is charged to the budget; it is given back on :meth:`close`, or at the end of a ``with`` block.

    Args:
        path: the file, in which all rows must lie.
        rows: of the dataset, that may be read.
        limit: bytes that a row, and a chunk that is unpacked, may have.
        budget: of the file.
        row: the shape that a row must have, None for any number.

    Raises:
        DecodeError: here, for a dataset of another shape, or not of numbers; for one that does not hold its rows in the
            file itself; for chunks above the limit or the budget, and filters that are not known.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        dataset: h5py.Dataset,
        rows: int,
        limit: int,
        budget: Budget,
        row: tuple[int | None, ...] = (),
    ) -> None:
        check_dataset(path, dataset, rows, limit, row)
        self._path, self._dataset, self._limit, self._budget = path, dataset, limit, budget
        self.dtype: np.dtype[np.generic] = dataset.dtype
        self._filters = _filters(path, dataset)
        self._first = -1
        self._kept: UncheckedArray = np.zeros(0, self.dtype)
        self._charged = 0
        if any(number not in (_SHUFFLE, _FLETCHER) for number in self._filters):
            self._positions = list(
                itertools.product(
                    *(range(0, side, step) for side, step in zip(dataset.shape[1:], dataset.chunks[1:], strict=True))
                )
            )
            self._chunk_bytes = math.prod(dataset.chunks) * self.dtype.itemsize
            self._charged = len(self._positions) * self._chunk_bytes
            budget.take(self._charged, f"a chunk of {dataset.name}")

    @property
    def chunk(self) -> int | None:
        """Return the rows of a chunk, None where there are none."""
        chunks = self._dataset.chunks
        return None if chunks is None else int(chunks[0])

    def read(self, start: int, end: int) -> UncheckedArray:
        """Return rows ``start`` to ``end``, an array of its own.

        Raises:
            DecodeError: for a chunk that is damaged, or may unpack to more than the limit.
        """
        if not self._charged:
            with decoding(self._path, f"{self._dataset.name}, {start}..{end}"):
                whole: UncheckedArray = self._dataset[start:end]
            return whole
        rows = np.empty((max(0, end - start), *self._dataset.shape[1:]), self.dtype)
        fill_from_chunks(rows, start, self._dataset.chunks[0], self._chunk_at)
        return rows

    def close(self) -> None:
        """Forget what is kept."""
        self._first, self._kept = -1, self._kept[:0]
        self._budget.give_back(self._charged)
        self._charged = 0

    def __enter__(self) -> Rows:
        return self

    def __exit__(self, _: type[BaseException] | None, __: BaseException | None, ___: TracebackType | None) -> None:
        self.close()

    def _chunk_at(self, first: int) -> UncheckedArray:
        """Return the rows of the chunk, or of all chunks side by side, that begins at a row."""
        if first != self._first:
            self._first, self._kept = -1, self._kept[:0]
            with decoding(self._path, f"{self._dataset.name}, the chunk at {first}"):
                if len(self._positions) == 1:
                    self._kept = self._unpack((first, *self._positions[0]))
                else:
                    shape = (min(self._dataset.chunks[0], len(self._dataset) - first), *self._dataset.shape[1:])
                    self._kept = np.empty(shape, self.dtype)
                    for position in self._positions:
                        columns = self._unpack((first, *position))
                        inside = (slice(o, o + n) for o, n in zip((0, *position), columns.shape, strict=True))
                        self._kept[tuple(inside)] = columns
            self._first = first
        return self._kept

    def _unpack(self, position: tuple[int, ...]) -> UncheckedArray:
        """Return what a chunk holds, as far as it lies within the dataset."""
        dataset = self._dataset
        inside = tuple(
            slice(o, min(o + step, side)) for o, step, side in zip(position, dataset.chunks, dataset.shape, strict=True)
        )
        skipped, data = stored_chunk(self._path, dataset, position)
        filters = [number for k, number in enumerate(self._filters) if not skipped >> k & 1]
        if filters in ([_DEFLATE], [_SHUFFLE, _DEFLATE]) and self._is_plain():
            with self._budget.borrow(2 * self._chunk_bytes, f"a chunk of {dataset.name}"):
                values = self._inflated(data, shuffled=len(filters) > 1).reshape(dataset.chunks)
            return values[tuple(slice(one.stop - one.start) for one in inside)]
        for number in filters:
            if number not in (_SHUFFLE, _FLETCHER) and _unpacked(number, data, self._limit) > self._limit:
                raise above_limit(self._path, f"the chunk of {dataset.name} at {position[0]}", self._limit)
        unfiltered: UncheckedArray = dataset[inside]
        return unfiltered

    def _is_plain(self) -> bool:
        """Return whether values lie in the file as they do in an array."""
        import h5py

        return self.dtype.kind in "iuf" and self._dataset.id.get_type() == h5py.h5t.py_create(self.dtype)

    def _inflated(self, data: bytes, *, shuffled: bool) -> UncheckedArray:
        """Return the values of a chunk of gzip's: here, because HDF5 unpacks it without a limit, so that it would have
        to be unpacked before."""
        stream = zlib.decompressobj()
        values = stream.decompress(data, self._chunk_bytes + 1)
        if len(values) != self._chunk_bytes or not stream.eof:
            raise DecodeError(
                f"{os.fspath(self._path)}: a chunk of {self._dataset.name} is damaged: it does not unpack to its "
                f"{self._chunk_bytes} bytes"
            )
        if shuffled:  # first bytes of all values, then second ones, and so on
            values = np.frombuffer(values, np.uint8).reshape(self.dtype.itemsize, -1).T.tobytes()
        return np.frombuffer(values, self.dtype)


def fill_from_chunks(rows: UncheckedArray, start: int, chunk: int, chunk_at: Callable[[int], UncheckedArray]) -> None:
    """Fill an array with the rows of a dataset from ``start`` on; ``chunk_at`` gives the chunk that begins at a row."""
    end = start + len(rows)
    for first in range(start - start % chunk, end, chunk):
        begin, stop = max(start, first), min(end, first + chunk)
        rows[begin - start : stop - start] = chunk_at(first)[begin - first : stop - first]


def stored_chunk(path: str | os.PathLike[str], dataset: h5py.Dataset, position: tuple[int, ...]) -> tuple[int, bytes]:
    """Return a chunk as it lies in the file, after a mask that has a bit for each filter that it went past.

    Raises:
        DecodeError: if it says more bytes than the file has.
    """
    stored = dataset.id.get_chunk_info_by_coord(position)
    if stored.size > os.path.getsize(path):
        message = f"a chunk of {dataset.name} is damaged: it says {stored.size} bytes, more than the file has"
        raise DecodeError(f"{os.fspath(path)}: {message}")
    skipped, data = dataset.id.read_direct_chunk(position)
    return int(skipped), data


def check_dataset(
    path: str | os.PathLike[str], dataset: h5py.Dataset, rows: int, limit: int, row: tuple[int | None, ...] = ()
) -> None:
    """Refuse a dataset that does not hold its first ``rows`` values in the file itself, one by one in chunks that are
    within the limit. ``row`` is the shape that a value must have, None for any number.

    Raises:
        DecodeError: for the first rule that is broken.
    """
    row_shape = dataset.shape[1:]
    fits = dataset.ndim == 1 + len(row) and all(want in (None, side) for want, side in zip(row, row_shape, strict=True))
    if not fits or dataset.dtype.kind not in "biuf":
        form = f"of rows {row}".replace("None", "any") if row else "one-dimensional"
        file = os.fspath(path)
        raise DecodeError(f"{file}: {dataset.name} must be {form}, of numbers: found {dataset.shape}, {dataset.dtype}")
    check_storage(path, dataset, rows, limit)


def check_storage(path: str | os.PathLike[str], dataset: h5py.Dataset, rows: int, limit: int) -> None:
    """Refuse a dataset that does not hold its first ``rows`` values in the file itself, whatever they are, in chunks
    that are within the limit.

    Raises:
        DecodeError: for the first rule that is broken.
    """
    name, file = dataset.name, os.fspath(path)
    row_shape = dataset.shape[1:]
    size = math.prod(row_shape) * dataset.dtype.itemsize
    if row_shape and size > limit:
        raise above_limit(path, f"a row of {name}", limit)
    if dataset.is_virtual or dataset.external or not os.path.samefile(dataset.file.filename, path):
        raise DecodeError(f"{file}: {name} lies in another file: it must be in this one")
    if dataset.chunks is None:
        if dataset.id.get_storage_size() < rows * size:
            raise DecodeError(f"{file}: {name} says {rows} values, and does not hold them")
        return
    if math.prod(dataset.chunks) * dataset.dtype.itemsize > limit:
        raise above_limit(path, f"a chunk of {name}", limit)
    chunks = math.prod(-(-side // step) for side, step in zip((rows, *row_shape), dataset.chunks, strict=True))
    if dataset.id.get_num_chunks() < chunks:
        raise DecodeError(f"{file}: {name} says {rows} values, and does not hold all of their chunks")


def _filters(path: str | os.PathLike[str], dataset: h5py.Dataset) -> list[int]:
    """Return the numbers of a dataset's filters, in the order in which they were applied.

    Raises:
        DecodeError: for a compression of which it is not known what it unpacks to.
    """
    properties = dataset.id.get_create_plist()
    listed = [properties.get_filter(k) for k in range(properties.get_nfilters())]
    for number, _, parameters, _ in listed:
        if len(parameters) < _PARAMETERS.get(number, 0):
            raise DecodeError(
                f"{os.fspath(path)}: {dataset.name} has {len(parameters)} parameters of HDF5's filter {number}: "
                f"expected {_PARAMETERS[number]} or more"
            )
    filters = [number for number, *_ in listed]
    packing = [number for number in filters if number not in (_SHUFFLE, _FLETCHER)]
    if len(packing) > 1 or not set(packing) <= {_DEFLATE, _LZF, _BLOSC, _LZ4, _BITSHUFFLE, _ZSTD}:
        raise DecodeError(
            f"{os.fspath(path)}: {dataset.name} is compressed by HDF5's filters {packing}: expected one of gzip, lzf, "
            "Blosc, LZ4, bitshuffle and Zstandard"
        )
    return filters


def _unpacked(number: int, data: bytes, limit: int) -> int:
    """Return what a chunk unpacks to, or more; where it is above the limit, any number above it."""
    if number == _BLOSC:
        return int.from_bytes(data[4:8], "little")
    if number in (_LZ4, _BITSHUFFLE):
        return int.from_bytes(data[:8], "big")
    if number == _ZSTD:
        return _zstd_size(data)
    most = len(data) * _LONGEST_RATIO[number]
    if number != _DEFLATE or most <= limit:
        return most
    unpacked, stream = 0, zlib.decompressobj()
    while data and unpacked <= limit and not stream.eof:
        unpacked += len(stream.decompress(data, 1 << 20))
        data = stream.unconsumed_tail
    return unpacked


def _zstd_size(frame: bytes) -> int:
    """Return the size that a frame's header states (RFC 8878, 3.1.1.1); 0 where it states none, which the filter
    refuses."""
    descriptor = frame[4] if len(frame) > 4 else 0
    single = descriptor >> 5 & 1
    begin = 5 + (1 - single) + (0, 1, 2, 4)[descriptor & 3]
    length = (single, 2, 4, 8)[descriptor >> 6]
    return int.from_bytes(frame[begin : begin + length], "little") + (256 if length == 2 else 0)
