"""Guards against bytes that others wrote: what may be opened, how much is taken, how libraries' errors are told."""

from __future__ import annotations

import errno
import os
import stat
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tokenize import TokenError
from typing import TypeVar

from .._core import DecodeError
from .argument_error import ArgumentError
from .budget import Budget

_Item = TypeVar("_Item")

MAX_PACKET_BYTES = 64 << 20
"""What a packet, chunk or message of a compressed file may unpack to, unless told otherwise."""

MAX_TEXT_BYTES = 1 << 30
"""What a text that is held in memory may have: a trajectory, a calibration, a plan, a dataset's metadata."""


def check_max_packet_bytes(max_packet_bytes: int) -> int:
    """Refuse a limit that is none.

    Raises:
        ValueError: if it is not positive.
    """
    if not 1 <= max_packet_bytes < 2**62:
        raise ArgumentError("{max_packet_bytes} must be a positive number of bytes: got {}", max_packet_bytes)
    return max_packet_bytes


def above_limit(path: str | os.PathLike[str], name: str, limit: int) -> DecodeError:
    """Make the error for a part of a compressed file that has more bytes than it may."""
    message = f"{name} may have {limit} bytes unpacked, this has more; max_packet_bytes (--max-packet-bytes) allows it"
    return DecodeError(f"{os.fspath(path)}: {message}")


def regular_file(path: str | os.PathLike[str]) -> Path:
    """Return the path of a regular file. Rejects pipes and devices, which may never reach their end.

    Raises:
        OSError: if there is none, or it is something else.
        DecodeError: if Git LFS has a pointer in its place.
    """
    status = os.stat(path)
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), os.fspath(path))
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "not a regular file", os.fspath(path))
    if status.st_size < _MOST_POINTER_BYTES:
        with open(path, "rb") as file:
            if file.read(len(_POINTER_START)) == _POINTER_START:
                rule = "not the file itself, but a pointer of Git LFS (git lfs pull in its repository brings the file)"
                raise DecodeError(f"{os.fspath(path)}: {rule}")
    return Path(path)


_POINTER_START, _MOST_POINTER_BYTES = b"version https://git-lfs.github.com/spec/", 1024
"""How a pointer of Git LFS begins, and how long it may be (its specification, git-lfs/docs/spec.md)."""


def read_limited(path: str | os.PathLike[str], limit: int = MAX_TEXT_BYTES) -> bytes:
    """Read the contents of a file that is held in memory.

    Raises:
        OSError: if it cannot be read, or is no regular file.
        DecodeError: if it is longer than ``limit`` bytes.
    """
    with regular_file(path).open("rb") as file:
        data = file.read(limit + 1)
    if len(data) > limit:
        raise DecodeError(f"{os.fspath(path)}: it may have {limit} bytes, this has more")
    return data


def read_charged(path: str | os.PathLike[str], budget: Budget) -> bytes:
    """Read the contents of a file that is held in memory, charged to the budget of the source that names it.

    Raises:
        OSError: if it cannot be read, or is no regular file.
        DecodeError: if it is longer than the budget has bytes left.
    """
    with regular_file(path).open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        budget.take(size, f"the file {os.fspath(path)}")
        return file.read(size)


def read_text(path: str | os.PathLike[str], limit: int = MAX_TEXT_BYTES) -> str:
    """Read a file in UTF-8, with or without a byte-order mark.

    Raises:
        OSError: if it cannot be read, or is no regular file.
        DecodeError: if it is longer than ``limit`` bytes, or not UTF-8.
    """
    data = read_limited(path, limit)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        byte = f"{data[error.start]:#04x}"
        raise DecodeError(f"{os.fspath(path)}: not a text file, byte {error.start} is {byte}") from None


@contextmanager
def decoding(path: str | os.PathLike[str], where_inside: str = "") -> Iterator[None]:
    """Wrap a library that reads untrusted bytes. Its errors about the bytes become a :class:`DecodeError` with the
    file, the place and what the library said.

    The system's refusals (an OSError with a number that is not about values), a missing library and warnings that are
    errors stay as they are.

    Args:
        where_inside: where in the file, such as ``"events 0..100"``.
    """
    try:
        yield
    except (DecodeError, ImportError, Warning):
        raise
    except Exception as error:
        by_library = type(error).__module__.partition(".")[0] in _LIBRARIES
        if isinstance(error, OSError):
            about_bytes = error.errno in (None, errno.EINVAL)
        else:
            about_bytes = by_library or isinstance(error, _ABOUT_BYTES)
        if not about_bytes:
            raise
        where = f"{os.fspath(path)}, {where_inside}" if where_inside else os.fspath(path)
        raise DecodeError(f"{where}: {error}" if str(error) else f"{where}: {type(error).__name__}") from error


_ABOUT_BYTES = (
    ArithmeticError, AssertionError, AttributeError, EOFError, LookupError, RuntimeError, SyntaxError, TypeError,
    ValueError, TokenError, struct.error, zlib.error,
)  # fmt: skip
"""What Python and its libraries raise about bytes that they did not expect; RecursionError and NotImplementedError are
RuntimeErrors, UnicodeDecodeError is a ValueError."""

_LIBRARIES = {
    "DracoPy",
    "PIL",
    "backports",
    "compression",
    "cv2",
    "h5py",
    "pyarrow",
    "rosbags",
    "sqlite3",
    "yaml",
    "zipfile",
}
"""Libraries that have error classes of their own."""


def guarded(path: str | os.PathLike[str], items: Iterator[_Item]) -> Iterator[_Item]:
    """Yield the same items, each made within :func:`decoding`."""
    while True:
        with decoding(path):
            try:
                item = next(items)
            except StopIteration:
                return
        yield item
