"""Packs named arrays as the bytes of a file of the cache, with a checksum, and unpacks them."""

from __future__ import annotations

import hashlib
import io
import math
import zipfile
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

_HASH_BYTES = 32
_SUFFIX = ".npy"
_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def packed_arrays(arrays: Mapping[str, npt.NDArray[Any]]) -> bytes:
    """Return an ``.npz`` without compression, after its checksum."""
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)  # type: ignore[arg-type]
    data = buffer.getvalue()
    return hashlib.sha256(data).digest() + data


def unpacked_arrays(data: bytes) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays of :func:`packed_arrays`, of numbers.

    A checksum tells damage; it does not tell who wrote the file. So no array is made that its bytes are not there for.

    Raises:
        ValueError: for anything else.
    """
    if hashlib.sha256(memoryview(data)[_HASH_BYTES:]).digest() != data[:_HASH_BYTES]:
        raise ValueError("its checksum is wrong")
    arrays = {}
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:  # which may stand behind other bytes: here the checksum
            for member in archive.infolist():
                if member.compress_type != zipfile.ZIP_STORED or member.file_size > len(data):
                    raise ValueError("it holds arrays that are compressed")
                arrays[member.filename.removesuffix(_SUFFIX)] = _array(archive.read(member))
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError, OSError) as error:
        raise ValueError(str(error)) from error
    return arrays


def _array(data: bytes) -> npt.NDArray[Any]:
    file = io.BytesIO(data)
    version = np.lib.format.read_magic(file)
    if version not in _HEADERS:
        raise ValueError(f"version {version} of an array's format is not known")
    shape, fortran_order, dtype = _HEADERS[version](file)
    if dtype.kind not in "biuf":
        raise ValueError(f"it holds an array of {dtype}")
    if min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize != len(data) - file.tell():
        raise ValueError(f"it holds an array of {shape} that has other bytes")
    return np.frombuffer(data, dtype, offset=file.tell()).reshape(shape, order="F" if fortran_order else "C")
