"""Reads Thrift's compact protocol, as Parquet's metadata and page headers are written in it.

Source: Apache Thrift, compact protocol encoding.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

_TRUE, _FALSE, _BYTE, _I16, _I32, _I64, _DOUBLE, _BINARY, _LIST, _SET, _STRUCT = 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12
_DEEPEST = 16
"""Structures within structures; Parquet's are five deep."""


class Malformed(Exception):
    """Bytes that are no structure of this protocol."""


class CompactReader:
    """Reads structures as dictionaries by their fields' numbers.

    Args:
        data: the bytes.
        count: is called with a number of values before they are read, so that a budget can refuse them: a value of one
            byte takes far more in memory.

    Attributes:
        at: how many bytes are read.
    """

    def __init__(self, data: bytes, count: Callable[[int], object] = lambda _: None) -> None:
        self._data, self._count = data, count
        self.at = 0

    def struct(self, depth: int = 0) -> dict[int, Any]:
        """Return the structure that begins here: numbers as int, text as bytes, lists and structures as they are.

        Raises:
            Malformed: if it does not end within the bytes, is nested too deeply, or is none.
        """
        if depth > _DEEPEST:
            raise Malformed
        fields: dict[int, Any] = {}
        number = 0
        while head := self._byte():
            self._count(1)
            kind, delta = head & 15, head >> 4
            number = number + delta if delta else self._zigzag()
            fields[number] = kind == _TRUE if kind in (_TRUE, _FALSE) else self._value(kind, depth)
        return fields

    def _value(self, kind: int, depth: int) -> Any:
        if kind in (_TRUE, _FALSE, _BYTE):  # truth values within a list
            return self._byte()
        if kind in (_I16, _I32, _I64):
            return self._zigzag()
        if kind == _DOUBLE:
            return self._bytes(8)
        if kind == _BINARY:
            return self._bytes(self._varint())
        if kind in (_LIST, _SET):
            head = self._byte()
            count = head >> 4 if head >> 4 < 15 else self._varint()
            if count > len(self._data) - self.at:  # each takes a byte at least
                raise Malformed
            self._count(count)
            return [self._value(head & 15, depth + 1) for _ in range(count)]
        if kind == _STRUCT:
            return self.struct(depth + 1)
        raise Malformed

    def _byte(self) -> int:
        return self._bytes(1)[0]

    def _bytes(self, count: int) -> bytes:
        begin, self.at = self.at, self.at + count
        if self.at > len(self._data):
            raise Malformed
        return self._data[begin : self.at]

    def _varint(self) -> int:
        value = 0
        for shift in range(0, 70, 7):
            byte = self._byte()
            value |= (byte & 127) << shift
            if byte < 128:
                return value
        raise Malformed

    def _zigzag(self) -> int:
        value = self._varint()
        return value >> 1 ^ -(value & 1)
