"""Packs displacement of pixels as 16-bit PNG, as KITTI and DSEC have it."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import numpy.typing as npt

_STEPS = {"kitti": 64, "dsec": 128}
"""Of a pixel."""

_ZERO = 1 << 15


def encode_displacement(pixels: npt.NDArray[np.float32], encoding: str) -> bytes:
    """Return a PNG of three channels of 16 bits: u and v as 2^15 + steps, and 1 where there is a vector.

    There is none where nothing is seen, where the point ends behind the camera, and where it goes farther than 16 bits
    tell: 512 pixels (kitti) or 256 (dsec).

    Args:
        pixels: (H, W, 2), NaN for none.
        encoding: ``kitti`` (1/64 px) or ``dsec`` (1/128 px).

    Source: the development kit of KITTI's stereo and flow benchmark 2015; DSEC's documentation of its flow. The file is
    by ISO/IEC 15948 (PNG), because Pillow writes no colour image of 16 bits.
    """
    height, width, _ = pixels.shape
    steps = np.rint(pixels.astype(np.float64) * _STEPS[encoding]) + _ZERO
    valid = ((steps >= 0) & (steps < 1 << 16)).all(-1, keepdims=True)
    image = np.concatenate([np.where(valid, steps, 0), valid], -1).astype(">u2")
    rows = np.zeros((height, 1 + 6 * width), np.uint8)  # each begins with its filter, 0 for none
    rows[:, 1:] = image.reshape(height, -1).view(np.uint8)
    header = struct.pack(">2I5B", width, height, 16, 2, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(rows.tobytes(), 6)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )
