"""Unpacks compressed chunks and messages of bags, with a limit on what they unpack to."""

from __future__ import annotations

import bz2
import os
import sys
from collections.abc import Callable
from typing import Any

from ..._core import DecodeError
from ..._util.untrusted import above_limit, decoding

_AT_ONCE = 1 << 20


def unpack_bz2(path: str | os.PathLike[str], data: bytes, limit: int) -> bytes:
    """Return what a bzip2 stream unpacks to.

    Raises:
        DecodeError: if it is malformed, or has more than ``limit`` bytes.
    """
    return _unpack(path, data, limit, bz2.BZ2Decompressor)


def unpack_lz4(path: str | os.PathLike[str], data: bytes, limit: int) -> bytes:
    """Return what an LZ4 frame unpacks to.

    Raises:
        DecodeError: if it is malformed, or has more than ``limit`` bytes.
    """
    import lz4.frame

    return _unpack(path, data, limit, lz4.frame.LZ4FrameDecompressor)


def unpack_zstd(path: str | os.PathLike[str], data: bytes, limit: int) -> bytes:
    """Return what a Zstandard frame unpacks to.

    Raises:
        DecodeError: if it is malformed, or has more than ``limit`` bytes.
    """
    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd  # which rosbags brings

    return _unpack(path, data, limit, zstd.ZstdDecompressor)


def _unpack(path: str | os.PathLike[str], data: bytes, limit: int, decompressor: Callable[[], Any]) -> bytes:
    unpacked = bytearray()
    with decoding(path, "a compressed chunk"):
        stream = decompressor()
        while not stream.eof:
            piece = stream.decompress(data, max_length=_AT_ONCE)
            if not piece and stream.needs_input:
                raise DecodeError(f"{os.fspath(path)}: a compressed chunk has no end")
            data = b""
            unpacked += piece
            if len(unpacked) > limit:
                raise above_limit(path, "a chunk", limit)
    return bytes(unpacked)
