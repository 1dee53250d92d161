"""Decodes the buffer views that glTF files compress by ``EXT_meshopt_compression``.

The bytes are untrusted: no read goes beyond the data, and what is decoded is charged before.

Source: Khronos Group, EXT_meshopt_compression, appendices A (bitstream) and B (filters).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from ..._util.budget import Budget

_BLOCK_BYTES, _MOST_IN_BLOCK, _GROUP = 8192, 256, 16
_LEAST_TAIL = 32
_VALUE_BYTES = 40
"""About what an index takes while it is a Python number in a list."""
_BETWEEN_CHECKS = 1 << 16
"""How many triangles or indices are decoded between two looks at the clock."""

_QUARTERS = [bytes(byte >> shift & 3 for shift in (6, 4, 2, 0)) for byte in range(256)]
_HALVES = [bytes((byte >> 4, byte & 15)) for byte in range(256)]
_SENTINEL_KINDS = {1: (4, _QUARTERS, 3), 2: (8, _HALVES, 15)}
"""For each kind of group: bytes of its short deltas, what each byte holds, and the delta that means a whole byte."""


def decode_meshopt(
    data: bytes | memoryview, mode: str, filter_name: str, count: int, stride: int, budget: Budget
) -> bytes:
    """Decode a buffer view.

    Args:
        mode: ``ATTRIBUTES``, ``TRIANGLES`` or ``INDICES``.
        filter_name: ``NONE``, ``OCTAHEDRAL``, ``QUATERNION`` or ``EXPONENTIAL``.
        count, stride: elements, and bytes of each. The result has count x stride bytes.
        budget: charged for the result, which stays in use, and for the time.

    Raises:
        ValueError: for a stream that breaks the format's rules, naming the rule.
        DecodeError: if the budget is not enough.
    """
    data = bytes(data)
    if filter_name not in _FILTERS or (mode != "ATTRIBUTES" and filter_name != "NONE"):
        raise ValueError(f"there is no filter {filter_name[:40]!r} of {mode[:40]!r}")
    budget.take(count * stride, f"{count} elements of {stride} bytes")
    if mode == "ATTRIBUTES":
        if stride % 4 or not 4 <= stride <= 256:
            raise ValueError(f"attributes must have a stride of 4, 8 ... 256 bytes, got {stride}")
        decoded = _attributes(data, count, stride, budget)
        return _FILTERS[filter_name](decoded).tobytes() if count else b""
    if mode not in ("TRIANGLES", "INDICES"):
        raise ValueError(f"there is no mode {mode[:40]!r}")
    if stride not in (2, 4) or (mode == "TRIANGLES" and count % 3):
        raise ValueError(f"{mode.lower()} must have a stride of 2 or 4 bytes and be whole, got {count} of {stride}")
    with budget.borrow(_VALUE_BYTES * count, f"{count} indices, while they are decoded,"):
        values = (_triangles if mode == "TRIANGLES" else _indices)(data, count, budget)
        return np.array(values, np.uint64).astype(f"<u{stride}").tobytes()


def _attributes(data: bytes, count: int, stride: int, budget: Budget) -> npt.NDArray[np.uint8]:
    """Return elements (count, stride)."""
    tail = max(stride, _LEAST_TAIL)
    if len(data) < 1 + tail or data[0] != 0xA0:
        raise ValueError("attributes must begin with the byte 0xa0 and end with an element")
    end = len(data) - tail
    last = np.frombuffer(data[len(data) - stride :], np.uint8)
    most = min(_BLOCK_BYTES // stride & ~15, _MOST_IN_BLOCK)
    values = np.empty((count, stride), np.uint8)
    at = 1
    for start in range(0, count, most):
        budget.check_time("decoding its compressed attributes")
        size = min(most, count - start)
        groups = -(-size // _GROUP)
        planes = []
        for _ in range(stride):
            plane, at = _plane(data, at, end, groups)
            planes.append(np.frombuffer(plane, np.uint8)[:size])
        deltas = np.stack(planes, 1)
        deltas = np.where(deltas & 1, ~(deltas >> 1), deltas >> 1)
        values[start : start + size] = last + np.cumsum(deltas, 0, dtype=np.uint8)
        last = values[start + size - 1]
    if at != end:
        raise ValueError(f"{end - at} bytes of attributes are left over")
    return values


def _plane(data: bytes, at: int, end: int, groups: int) -> tuple[bytes, int]:
    """Return the deltas of one byte of a block's elements, and where the next ones begin."""
    headers = at
    at += -(-groups // 4)
    if at > end:
        raise ValueError("attributes end within a block")
    deltas = []
    for group in range(groups):
        kind = data[headers + (group >> 2)] >> 2 * (group & 3) & 3
        if kind == 0:
            deltas.append(bytes(_GROUP))
            continue
        if kind == 3:
            group_bytes, at = data[at : at + _GROUP], at + _GROUP
        else:
            size, table, sentinel = _SENTINEL_KINDS[kind]
            group_bytes = b"".join([table[byte] for byte in data[at : at + size]])
            at += size
            whole = group_bytes.count(sentinel)
            if whole and at + whole <= end:
                mended, position = bytearray(group_bytes), -1
                for byte in data[at : at + whole]:
                    position = group_bytes.index(sentinel, position + 1)
                    mended[position] = byte
                group_bytes = bytes(mended)
            at += whole
        if at > end:
            raise ValueError("attributes end within a group")
        deltas.append(group_bytes)
    return b"".join(deltas), at


class _VarintReader:
    """Reads numbers of 7 bits a byte, and indices as differences to the last one."""

    def __init__(self, data: bytes, at: int, end: int) -> None:
        self._data, self.at, self._end = data, at, end
        self.last = 0

    def byte(self) -> int:
        if self.at >= self._end:
            raise ValueError("indices end too early")
        self.at += 1
        return self._data[self.at - 1]

    def number(self) -> int:
        value = 0
        for shift in (0, 7, 14, 21, 28):
            byte = self.byte()
            value |= (byte & 127) << shift
            if byte < 128:
                return value & 0xFFFFFFFF
        raise ValueError("a number of indices has more than 32 bits")

    def index(self) -> int:
        value = self.number()
        self.last = self.last + (~(value >> 1) if value & 1 else value >> 1) & 0xFFFFFFFF
        return self.last


def _triangles(data: bytes, count: int, budget: Budget) -> list[int]:
    triangles = count // 3
    end = len(data) - 16
    if end < 1 + triangles or data[0] != 0xE1:
        raise ValueError("triangles must begin with the byte 0xe1, have a code each, and end with a table")
    table = data[end:]
    numbers = _VarintReader(data, 1 + triangles, end)
    following = 0
    # Rings of the last 16 edges and vertices; what is not there yet is 0.
    edges, vertices = [(0, 0)] * 16, [0] * 16
    edge = vertex = 0
    indices: list[int] = []
    for number in range(triangles):
        if number % _BETWEEN_CHECKS == 0:
            budget.check_time("decoding its compressed triangles")
        code = data[1 + number]
        high, low = code >> 4, code & 15
        if high < 15:
            a, b = edges[edge - 1 - high & 15]
            new = True
            if low == 0:
                c = following
                following += 1
            elif low < 13:
                c = vertices[vertex - 1 - low & 15]
                new = False
            elif low == 15:
                c = numbers.index()
            else:
                c = numbers.last = numbers.last + (1 if low == 14 else -1) & 0xFFFFFFFF
            if new:
                vertices[vertex & 15] = c
                vertex += 1
        else:
            pair = table[low] if low < 14 else numbers.byte()
            second, third = pair >> 4, pair & 15
            if low >= 14 and pair == 0:
                following = 0
            if low == 15:
                a = -1
            else:
                a = following
                following += 1
            b = vertices[vertex - second & 15]
            if second == 0:
                b = following
                following += 1
            c = vertices[vertex - third & 15]
            if third == 0:
                c = following
                following += 1
            if low == 15:
                a = numbers.index()
            if low >= 14 and second == 15:
                b = numbers.index()
            if low >= 14 and third == 15:
                c = numbers.index()
            edges[edge & 15] = (b, a)
            edge += 1
            for value, pushed in ((a, True), (b, second in (0, 15)), (c, third in (0, 15))):
                if pushed:
                    vertices[vertex & 15] = value
                    vertex += 1
        edges[edge & 15] = (c, b)
        edges[edge + 1 & 15] = (a, c)
        edge += 2
        indices += (a, b, c)
    if numbers.at != end:
        raise ValueError(f"{end - numbers.at} bytes of triangles are left over")
    return [index & 0xFFFFFFFF for index in indices]


def _indices(data: bytes, count: int, budget: Budget) -> list[int]:
    end = len(data) - 4
    if end < 1 or data[0] != 0xD1:
        raise ValueError("indices must begin with the byte 0xd1 and end with four bytes")
    numbers = _VarintReader(data, 1, end)
    last = [0, 0]
    indices = []
    for number in range(count):
        if number % _BETWEEN_CHECKS == 0:
            budget.check_time("decoding its compressed indices")
        value = numbers.number()
        delta = ~(value >> 2) if value & 2 else value >> 2
        last[value & 1] = last[value & 1] + delta & 0xFFFFFFFF
        indices.append(last[value & 1])
    if numbers.at != end:
        raise ValueError(f"{end - numbers.at} bytes of indices are left over")
    return indices


def _as_is(elements: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    return elements


def _octahedral(elements: npt.NDArray[np.uint8]) -> npt.NDArray[np.signedinteger]:
    """Return unit vectors of two octahedral coordinates and what stands for 1; the fourth number stays."""
    if elements.shape[1] not in (4, 8):
        raise ValueError(f"the filter OCTAHEDRAL needs a stride of 4 or 8 bytes, got {elements.shape[1]}")
    kind = "<i1" if elements.shape[1] == 4 else "<i2"
    given = elements.view(kind)
    values = given.astype(np.float32)
    unit = np.where(values[:, 2:3] == 0, 1, values[:, 2:3])
    xy = values[:, :2] / unit
    z = 1 - np.abs(xy).sum(1, keepdims=True)
    xy = xy - np.copysign(np.minimum(z, 0), xy)
    vectors = np.concatenate([xy, z], 1)
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    octahedral = given.copy()
    octahedral[:, :3] = np.rint(vectors / np.where(length == 0, 1, length) * np.iinfo(kind).max)
    return octahedral


def _quaternion(elements: npt.NDArray[np.uint8]) -> npt.NDArray[np.signedinteger]:
    """Return quaternions of three components each, what stands for 1, and the number of the largest component."""
    if elements.shape[1] != 8:
        raise ValueError(f"the filter QUATERNION needs a stride of 8 bytes, got {elements.shape[1]}")
    given = elements.view("<i2")
    unit = (given[:, 3:] | 3).astype(np.float32)
    small = given[:, :3].astype(np.float32) / unit * np.float32(np.sqrt(0.5))
    largest = np.sqrt(np.maximum(1 - (small**2).sum(1, keepdims=True), 0))
    values = np.clip(np.rint(np.concatenate([largest, small], 1) * 32767), -32768, 32767).astype("<i2")
    quaternions = np.empty_like(given)
    order = ((given[:, 3:] & 3) + np.arange(4)) % 4
    np.put_along_axis(quaternions, order.astype(np.int64), values, 1)
    return quaternions


def _exponential(elements: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
    """Return floats of 8 bits of exponent and 24 bits of mantissa each."""
    given = elements.view("<i4")
    return np.ldexp((given << 8 >> 8).astype(np.float32), given >> 24).astype("<f4")


_FILTERS: dict[str, Callable[[npt.NDArray[np.uint8]], npt.NDArray[np.generic]]] = {
    "NONE": _as_is,
    "OCTAHEDRAL": _octahedral,
    "QUATERNION": _quaternion,
    "EXPONENTIAL": _exponential,
}
