"""Bytes that others wrote: what may be opened, how much is taken, and how libraries' errors about them are told."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ._core import DecodeError

MAX_PACKET_BYTES = 64 << 20
"""What a packet, chunk or message of a compressed file may unpack to, unless told otherwise."""

MAX_TEXT_BYTES = 256 << 20
"""What a text that is held in memory may have: a trajectory, a calibration, a plan, a dataset's metadata."""


def check_max_packet_bytes(max_packet_bytes: int) -> int:
    """The limit itself.

    Raises:
        ValueError: if it is not positive.
    """
    if not 1 <= max_packet_bytes < 2**62:
        raise ValueError(f"max_packet_bytes must be a positive number of bytes: got {max_packet_bytes}")
    return max_packet_bytes


def regular_file(path: str | os.PathLike[str]) -> Path:
    """The path, of a file that ends: not of a pipe, which may wait for ever, or of a device, which may go on for ever.

    Raises:
        OSError: if there is none, or it is something else.
    """
    mode = os.stat(path).st_mode
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), os.fspath(path))
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, "not a regular file", os.fspath(path))
    return Path(path)


def read_text(path: str | os.PathLike[str], limit: int = MAX_TEXT_BYTES) -> str:
    """The contents of a file in UTF-8, with or without a byte-order mark.

    Raises:
        OSError: if it cannot be read, or is no regular file.
        DecodeError: if it is longer than ``limit`` bytes, or not UTF-8.
    """
    with regular_file(path).open("rb") as file:
        data = file.read(limit + 1)
    if len(data) > limit:
        raise DecodeError(f"{os.fspath(path)}: a text may have {limit} bytes, this has more")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DecodeError(f"{os.fspath(path)}, byte {error.start}: not UTF-8") from None


@contextmanager
def decoding(
    path: str | os.PathLike[str], place: str = "", *, errors: tuple[type[Exception], ...] = ()
) -> Iterator[None]:
    """Around a library that reads untrusted bytes: what it raises about them becomes a :class:`DecodeError` with the
    file, the place and what the library said.

    The system's refusals (an OSError with a number that is not about values) stay as they are.

    Args:
        place: where in the file, such as ``"events 0..100"``.
        errors: the library's own classes of errors beside Python's.
    """
    about_bytes = (*_ABOUT_BYTES, *errors)
    try:
        yield
    except DecodeError:
        raise
    except OSError as error:
        if error.errno not in (None, errno.EINVAL):
            raise
        raise DecodeError(_told(path, place, error)) from error
    except about_bytes as error:
        raise DecodeError(_told(path, place, error)) from error


_ABOUT_BYTES: tuple[type[Exception], ...] = (
    ArithmeticError, AssertionError, AttributeError, EOFError, LookupError, MemoryError, RuntimeError, SyntaxError,
    TypeError, ValueError,
)  # fmt: skip
"""What Python's libraries raise about bytes that they did not expect; RecursionError and NotImplementedError are
RuntimeErrors, UnicodeDecodeError is a ValueError."""


def _told(path: str | os.PathLike[str], place: str, error: Exception) -> str:
    where = f"{os.fspath(path)}, {place}" if place else os.fspath(path)
    said = str(error)
    return f"{where}: {said if said else type(error).__name__}"
