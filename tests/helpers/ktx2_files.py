"""KTX2 files made in code: blocks of Basis Universal, and plain bytes.

Source: Khronos Group, KTX File Format Specification 2.0, with its BasisLZ bitstream; UASTC texture specification.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt

ETC1S, UASTC = 163, 166
"""Colour models of Basis Universal."""
_LENGTHS = (17, 18, 19, 20, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15, 16)
"""The order in which a table stores the codes of its lengths."""


def ktx2(
    width: int,
    height: int,
    level: bytes,
    *,
    vulkan: int = 0,
    model: int = UASTC,
    channels: Sequence[int] = (0,),
    transfer: int = 2,
    flags: int = 0,
    scheme: int = 0,
    unpacked: int | None = None,
    shared: bytes = b"",
    metadata: Iterable[tuple[str, str]] = (),
) -> bytes:
    """A file of one level. ``channels`` are those of the descriptor's samples."""
    samples = b"".join(struct.pack("<HBBIII", 0, 63, channel, 0, 0, 2**32 - 1) for channel in channels)
    described = struct.pack(
        "<IIHHBBBBII4x", 28 + len(samples), 0, 2, 24 + len(samples), model, 1, transfer, flags, 771, 0
    )
    said = b""
    for key, value in metadata:
        entry = f"{key}\0{value}\0".encode()
        said += struct.pack("<I", len(entry)) + entry + b"\0" * (-len(entry) % 4)
    places, at = [], 104
    for part in (described + samples, said, shared, level):
        places += [at if part else 0, len(part)]
        at += len(part)
    head = struct.pack(
        "<12s9I4I2Q", b"\xabKTX 20\xbb\r\n\x1a\n", vulkan, 1, width, height, 0, 0, 1, 1, scheme, *places[:6]
    )
    index = struct.pack("<3Q", *places[6:], len(level) if unpacked is None else unpacked)
    return head + index + described + samples + said + shared + level


def uastc(colours: npt.NDArray[np.uint8]) -> bytes:
    """Blocks of one colour (rows, columns, 4) each, by mode 8 of UASTC, whose code is 10111."""
    blocks = (0x17 | int.from_bytes(bytes(colour), "little") << 5 for colour in colours.reshape(-1, 4))
    return b"".join(block.to_bytes(16, "little") for block in blocks)


class _Bits:
    """Numbers of some bits each, from the low bits of bytes to the high ones."""

    def __init__(self) -> None:
        self.value, self.count = 0, 0

    def put(self, number: int, bits: int) -> None:
        self.value |= number << self.count
        self.count += bits

    def symbol(self, rank: int, bits: int) -> None:
        """The code of a symbol, its high bit first."""
        self.put(int(f"{rank:0{bits}b}"[::-1], 2), bits)

    def table(self, lengths: Sequence[int]) -> None:
        """The lengths of a table's codes, of which there are one or two kinds."""
        kinds = sorted(set(lengths))
        self.put(len(lengths), 14)
        self.put(len(_LENGTHS), 5)
        for length in _LENGTHS:
            self.put(int(length in kinds), 3)
        for length in lengths:
            self.put(kinds.index(length), 1)

    def bytes(self) -> bytes:
        return self.value.to_bytes((self.count + 7) // 8, "little")


def _bits_of(values: Sequence[object]) -> int:
    assert len(values) > 1
    assert len(values) & (len(values) - 1) == 0, "a power of two, so that all codes have one length"
    return len(values).bit_length() - 1


def etc1s_shared(
    endpoints: Sequence[tuple[int, int, int, int]], selectors: Sequence[Sequence[int]], slices: Sequence[bytes]
) -> bytes:
    """What the blocks of an ETC1S file share.

    Args:
        endpoints: red, green, blue from 0 to 31, and the number of a table of contrast.
        selectors: the 16 numbers from 0 to 3 of each pattern, row by row.
        slices: of the one image: colours, and opacity if it has one.
    """
    colours, patterns, tables = _Bits(), _Bits(), _Bits()
    for lengths in ([5] * 32,) * 3 + ([3] * 8,):
        colours.table(lengths)
    colours.put(0, 1)  # colours, not greys
    last = [16, 16, 16, 0]
    for endpoint in endpoints:
        colours.symbol((endpoint[3] - last[3]) % 8, 3)
        for number, before in zip(endpoint[:3], last[:3], strict=True):
            colours.symbol((number - before) % 32, 5)
        last = list(endpoint)
    patterns.put(0b100, 3)  # of this file, and whole
    for selector in selectors:
        for number in selector:
            patterns.put(number, 2)
    tables.table([0] * 255 + [1])  # each endpoint is a step from the last one
    tables.table([_bits_of(endpoints)] * len(endpoints))
    tables.table([_bits_of(selectors)] * len(selectors))
    tables.table([1])
    tables.put(1, 13)
    parts = [one.bytes() for one in (colours, patterns, tables)]
    places = [(0, 0), *((sum(map(len, slices[:number])), len(one)) for number, one in enumerate(slices))]
    image = struct.pack("<5I", 0, *places[1], *(places[2] if len(slices) > 1 else (0, 0)))
    head = struct.pack("<2H4I", len(endpoints), len(selectors), *map(len, parts), 0)
    return head + image + b"".join(parts)


def etc1s_slice(
    blocks: Sequence[Sequence[tuple[int, int]]], endpoints: Sequence[object], selectors: Sequence[object]
) -> bytes:
    """A slice: the endpoint and the selector of each block, row by row."""
    bits, last = _Bits(), 0
    for row, numbers in enumerate(blocks):
        for column, (endpoint, selector) in enumerate(numbers):
            if row % 2 == 0 and column % 2 == 0:
                bits.symbol(0, 1)
            bits.symbol((endpoint - last) % len(endpoints), _bits_of(endpoints))
            bits.symbol(selector, _bits_of(selectors))
            last = endpoint
    return bits.bytes()
