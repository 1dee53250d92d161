"""Reading FlatBuffers without a schema compiler: a few kinds of fields, each access checked against the buffer.

Source: flatbuffers.dev, FlatBuffers internals.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt


class Malformed(Exception):
    """A place of a buffer that does not lie in it."""


class Table:
    """A table: its fields by number, in the order of the schema.

    Args:
        buffer: all of it.
        at: where the table begins.

    Raises:
        Malformed: if it, or what it points to, is not in the buffer; also from every method.
    """

    def __init__(self, buffer: bytes, at: int) -> None:
        self._buffer, self._at = buffer, at
        vtable = at - self._scalar("<i4", at)
        self._offsets = _array(buffer, "<u2", vtable + 4, max(self._scalar("<u2", vtable) // 2 - 2, 0))

    @classmethod
    def root(cls, buffer: bytes, identifier: bytes) -> Table:
        """The first table of a size-prefixed buffer, whose four letters must be these."""
        if (length := int.from_bytes(buffer[:4], "little") + 4) > len(buffer):
            raise Malformed(f"a buffer of {length} bytes ends after {len(buffer)}")
        if buffer[8:12] != identifier:
            raise Malformed(f"expected {identifier!r}, found {buffer[8:12]!r}")
        return cls(buffer, 4 + int(_array(buffer, "<u4", 4, 1)[0]))

    def number(self, field: int, dtype: str, default: int = 0) -> int:
        """An integer."""
        place = self._place(field)
        return default if place is None else self._scalar(dtype, place)

    def vector(self, field: int, dtype: npt.DTypeLike) -> npt.NDArray[Any]:
        """A vector of numbers or structures, without a copy."""
        place = self._place(field)
        if place is None:
            return np.zeros(0, dtype)
        begin = place + self._scalar("<u4", place)
        return _array(self._buffer, dtype, begin + 4, self._scalar("<u4", begin))

    def columns(self, field: int, dtypes: dict[str, tuple[int, str]]) -> dict[str, npt.NDArray[Any]]:
        """A vector of tables as columns: of each name the field's number and type; 0 where a table lacks it."""
        place = self._place(field)
        offsets = self.vector(field, "<u4")
        columns = {name: np.zeros(len(offsets), dtype) for name, (_, dtype) in dtypes.items()}
        if place is None or not len(offsets):
            return columns
        begin = place + self._scalar("<u4", place) + 4
        tables = begin + 4 * np.arange(len(offsets)) + offsets
        vtables = tables - self._gather("<i4", tables)
        lengths = self._gather("<u2", vtables)
        for name, (number, dtype) in dtypes.items():
            has = lengths >= 6 + 2 * number
            within = self._gather("<u2", vtables[has] + 4 + 2 * number)
            columns[name][np.flatnonzero(has)[within > 0]] = self._gather(
                dtype, tables[has][within > 0] + within[within > 0]
            )
        return columns

    def _place(self, field: int) -> int | None:
        """Where a field is, or None if the table lacks it."""
        offset = int(self._offsets[field]) if field < len(self._offsets) else 0
        return self._at + offset if offset else None

    def _scalar(self, dtype: str, at: int) -> int:
        return int(_array(self._buffer, dtype, at, 1)[0])

    def _gather(self, dtype: str, places: npt.NDArray[np.int64]) -> npt.NDArray[Any]:
        """Values at many places, at any alignment."""
        size = np.dtype(dtype).itemsize
        if len(places) and (places.min() < 0 or places.max() + size > len(self._buffer)):
            raise Malformed("a table points out of the buffer")
        everything = np.frombuffer(self._buffer, np.uint8)
        gathered = everything[places[:, None] + np.arange(size)].view(dtype)[:, 0]
        return gathered.astype(np.int64) if gathered.dtype.kind in "iu" else gathered


def _array(buffer: bytes, dtype: npt.DTypeLike, at: int, count: int) -> npt.NDArray[Any]:
    size = np.dtype(dtype).itemsize * count
    if at < 0 or at + size > len(buffer):
        raise Malformed(f"{count} values at byte {at} do not lie within {len(buffer)} bytes")
    return np.frombuffer(buffer, dtype, count, at)
