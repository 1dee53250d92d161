"""HDF5's chunks before HDF5 unpacks them: its filters take memory for whatever a chunk claims, or unpacks to."""

from __future__ import annotations

import itertools
import math
import os
import zlib
from typing import TYPE_CHECKING

from ..._core import DecodeError
from ..._util.untrusted import above_limit

if TYPE_CHECKING:
    import h5py

_DEFLATE, _SHUFFLE, _FLETCHER = 1, 2, 3
_LZF, _BLOSC, _LZ4, _BITSHUFFLE, _ZSTD = 32000, 32001, 32004, 32008, 32015
"""Numbers of filters. Source: HDF5's registry of filters."""
_LONGEST_RATIO = {_DEFLATE: 1032, _LZF: 88}
"""What a byte can become, of formats that do not state what they unpack to."""


def check_dataset(
    path: str | os.PathLike[str], dataset: h5py.Dataset, rows: int, limit: int, row: tuple[int | None, ...] = ()
) -> None:
    """Refuse a dataset that does not hold its first ``rows`` values in the file itself, one by one in chunks that are
    within the limit. ``row`` is the shape that a value must have, None for any number.

    Raises:
        DecodeError: for the first rule that is broken.
    """
    name, file = dataset.name, os.fspath(path)
    found = dataset.shape[1:]
    fits = dataset.ndim == 1 + len(row) and all(want in (None, side) for want, side in zip(row, found, strict=True))
    if not fits or dataset.dtype.kind not in "biuf":
        form = f"of rows {row}".replace("None", "any") if row else "one-dimensional"
        raise DecodeError(f"{file}: {name} must be {form}, of numbers: found {dataset.shape}, {dataset.dtype}")
    size = math.prod(found) * dataset.dtype.itemsize
    if row and size > limit:
        raise above_limit(path, f"a row of {name}", limit)
    if dataset.is_virtual or dataset.external or not os.path.samefile(dataset.file.filename, path):
        raise DecodeError(f"{file}: {name} lies in another file: it must be in this one")
    if dataset.chunks is None:
        if dataset.id.get_storage_size() < rows * size:
            raise DecodeError(f"{file}: {name} says {rows} values, and does not hold them")
        return
    if math.prod(dataset.chunks) * dataset.dtype.itemsize > limit:
        raise above_limit(path, f"a chunk of {name}", limit)
    chunks = math.prod(-(-side // step) for side, step in zip((rows, *found), dataset.chunks, strict=True))
    if dataset.id.get_num_chunks() < chunks:
        raise DecodeError(f"{file}: {name} says {rows} values, and does not hold all of their chunks")


def check_chunks(path: str | os.PathLike[str], dataset: h5py.Dataset, start: int, end: int, limit: int) -> None:
    """Refuse a chunk among those of the values ``start`` .. ``end`` that may unpack to more than the limit.

    Raises:
        DecodeError: with the chunk's first value; and for a compression of which that is not known.
    """
    properties = dataset.id.get_create_plist()
    filters = [properties.get_filter(k)[0] for k in range(properties.get_nfilters())]
    packing = [number for number in filters if number not in (_SHUFFLE, _FLETCHER)]
    if not packing:
        return
    if len(packing) > 1 or packing[0] not in (_DEFLATE, _LZF, _BLOSC, _LZ4, _BITSHUFFLE, _ZSTD):
        raise DecodeError(
            f"{os.fspath(path)}: {dataset.name} is compressed by HDF5's filters {packing}: expected one of gzip, lzf, "
            "Blosc, LZ4, bitshuffle and Zstandard"
        )
    in_chunk = dataset.chunks[0]
    rest = [range(0, side, step) for side, step in zip(dataset.shape[1:], dataset.chunks[1:], strict=True)]
    for first, *others in itertools.product(range(start - start % in_chunk, end, in_chunk), *rest):
        _, data = dataset.id.read_direct_chunk((first, *others))
        if _unpacked(packing[0], data, limit) > limit:
            raise above_limit(path, f"the chunk of {dataset.name} at {first}", limit)


def _unpacked(number: int, data: bytes, limit: int) -> int:
    """What a chunk unpacks to, or more; where it is above the limit, any number above it."""
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
    """The size that a frame's header states (RFC 8878, 3.1.1.1); 0 where it states none, which the filter refuses."""
    descriptor = frame[4] if len(frame) > 4 else 0
    single = descriptor >> 5 & 1
    begin = 5 + (1 - single) + (0, 1, 2, 4)[descriptor & 3]
    length = (single, 2, 4, 8)[descriptor >> 6]
    return int.from_bytes(frame[begin : begin + length], "little") + (256 if length == 2 else 0)
