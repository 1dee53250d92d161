"""Parquet's metadata and page headers before Arrow acts on them: it ends the process at types that there are not, and
takes memory for whatever a page claims to unpack to."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from .._core import DecodeError
from ..untrusted import above_limit

if TYPE_CHECKING:
    import pyarrow.parquet as pq

_TYPES = {"BOOLEAN", "INT32", "INT64"}
_COMPRESSIONS = {"UNCOMPRESSED", "SNAPPY", "GZIP", "BROTLI", "LZ4", "LZ4_RAW", "ZSTD"}
_LONGEST_HEADER = 1 << 16

_TRUE, _FALSE, _BYTE, _I16, _I32, _I64, _DOUBLE, _BINARY, _STRUCT = 1, 2, 3, 4, 5, 6, 7, 8, 12
"""Types of Thrift's compact protocol."""


def check_metadata(path: Path, metadata: pq.FileMetaData, names: tuple[str, ...]) -> None:
    """Refuse columns of a type or a compression that events do not have.

    Raises:
        DecodeError: with row group and column.
    """
    for group in range(metadata.num_row_groups):
        row_group = metadata.row_group(group)
        found = []
        for k in range(row_group.num_columns):
            column = row_group.column(k)
            if column.path_in_schema not in names:
                continue
            found.append(column.path_in_schema)
            where = f"{path}: column {column.path_in_schema} of row group {group}"
            if column.physical_type not in _TYPES:
                raise DecodeError(f"{where} must hold integers: found {column.physical_type}")
            if column.compression not in _COMPRESSIONS:
                raise DecodeError(f"{where} is compressed by {column.compression}")
            if column.num_values != row_group.num_rows:
                raise DecodeError(f"{where} has {column.num_values} values for {row_group.num_rows} rows")
        if sorted(found) != sorted(names):
            raise DecodeError(f"{path}: row group {group} must have the columns {', '.join(names)} once: found {found}")
    if metadata.num_rows != sum(metadata.row_group(k).num_rows for k in range(metadata.num_row_groups)):
        raise DecodeError(f"{path}: the number of rows, {metadata.num_rows}, is not that of the row groups together")


def check_pages(path: Path, metadata: pq.FileMetaData, group: int, names: tuple[str, ...], limit: int) -> None:
    """Refuse a page of a row group that unpacks to more than the limit, or lies outside of its column.

    Raises:
        DecodeError: with column and byte.
    """
    row_group = metadata.row_group(group)
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        for k in range(row_group.num_columns):
            column = row_group.column(k)
            if column.path_in_schema not in names:
                continue
            place = column.data_page_offset
            if column.has_dictionary_page and 0 < column.dictionary_page_offset < place:
                place = column.dictionary_page_offset
            end = place + column.total_compressed_size
            where = f"{path}: column {column.path_in_schema} of row group {group}"
            if not 0 < place <= end <= size:
                raise DecodeError(f"{where} lies at bytes {place} to {end} of {size}")
            while place < end:
                length, unpacked, packed = _page(file, place, where)
                if unpacked > limit:
                    raise above_limit(path, f"the page of column {column.path_in_schema} at byte {place}", limit)
                place += length + packed
            if place != end:
                raise DecodeError(f"{where} ends at byte {end}, its last page at byte {place}")


def _page(file: BinaryIO, place: int, where: str) -> tuple[int, int, int]:
    """Of a page: its header's length, what it unpacks to, and what it has packed.

    Source: parquet.thrift, PageHeader.
    """
    file.seek(place)
    header = _Compact(file.read(_LONGEST_HEADER))
    try:
        fields = header.struct()
    except (IndexError, RecursionError):
        raise DecodeError(f"{where}: the page's header at byte {place} is malformed") from None
    unpacked, packed = fields.get(2, -1), fields.get(3, -1)
    if unpacked < 0 or packed < 0:
        raise DecodeError(f"{where}: the page at byte {place} has {packed} bytes, which unpack to {unpacked}")
    return header.at, unpacked, packed


class _Compact:
    """Thrift's compact protocol, as far as it takes to get past a structure.

    Source: Apache Thrift, compact protocol encoding.
    """

    def __init__(self, data: bytes) -> None:
        self._data = data
        self.at = 0

    def struct(self) -> dict[int, int]:
        """Passes a structure; returns its integers by their field's number.

        Raises:
            IndexError: if it does not end, or is none.
        """
        numbers: dict[int, int] = {}
        field = 0
        while head := self._byte():
            kind, delta = head & 15, head >> 4
            field = field + delta if delta else self._zigzag()
            value = self._value(kind)
            if value is not None:
                numbers[field] = value
        return numbers

    def _value(self, kind: int) -> int | None:
        if kind in (_TRUE, _FALSE):
            return None
        if kind == _BYTE:
            self._skip(1)
        elif kind in (_I16, _I32, _I64):
            return self._zigzag()
        elif kind == _DOUBLE:
            self._skip(8)
        elif kind == _BINARY:
            self._skip(self._varint())
        elif kind == _STRUCT:
            self.struct()
        else:
            raise IndexError  # a header of a page has no lists
        return None

    def _byte(self) -> int:
        self.at += 1
        return self._data[self.at - 1]

    def _skip(self, count: int) -> None:
        self.at += count
        if self.at > len(self._data):
            raise IndexError

    def _varint(self) -> int:
        value = 0
        for shift in range(0, 70, 7):
            byte = self._byte()
            value |= (byte & 127) << shift
            if byte < 128:
                return value
        raise IndexError

    def _zigzag(self) -> int:
        value = self._varint()
        return value >> 1 ^ -(value & 1)
