"""Reads images of KTX2 files as textures: Basis Universal, and plain bytes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from .._core import DecodeError, decode_ktx2, inspect_ktx2
from .._util.budget import Budget
from .texture_file import EncodedTexture, check_size

KTX2_START = b"\xabKTX 20\xbb\r\n\x1a\n"
"""The bytes that a KTX2 file begins with."""

_DECODED_BYTES, _TEXEL_BYTES = 8, 3
"""Bytes of a texel: at most while it is decoded, with what Zstandard unpacks to, and in memory."""


def texture_of_ktx2(data: bytes | memoryview, name: str, budget: Budget) -> EncodedTexture:
    """Decode the finest level of a KTX2 file. The size in its header is charged before.

    Args:
        name: of the image, for messages.

    Raises:
        DecodeError: if it breaks a rule, is in a format that is not read, or needs more than the budget has left.
        ValueError: if it has too many texels on a side.
    """
    file = np.frombuffer(data, np.uint8)
    with _named(name):
        width, height, transfer = inspect_ktx2(file)
    check_size(width, height, name)
    size = f"{name}: a texture of {width} x {height} texels"
    budget.take(_TEXEL_BYTES * width * height, size)
    budget.check_time("decoding its textures")
    with budget.borrow(_DECODED_BYTES * width * height + len(file), f"{size}, while it is decoded,"):
        with _named(name):
            texels = decode_ktx2(file)
        alpha = None
        if texels[..., 3].min() < 255:
            budget.take(width * height, f"{size}, with alpha,")
            alpha = texels[..., 3].copy()
        return EncodedTexture(np.ascontiguousarray(texels[..., :3]), alpha, np.ones(3), transfer)


@contextmanager
def _named(name: str) -> Iterator[None]:
    """Put the image's name before what the core says of it."""
    try:
        yield
    except DecodeError as error:
        raise DecodeError(f"{name}: {error}") from None
