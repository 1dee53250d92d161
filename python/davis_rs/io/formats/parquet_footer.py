"""Checks Parquet's metadata and page headers before Arrow acts on them.

Arrow ends the process where types contradict each other, and takes memory for whatever a page claims to unpack to.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from ..._core import DecodeError
from ..._util.budget import Budget
from ..._util.untrusted import above_limit, decoding
from .thrift import CompactReader, Malformed

MAGIC = b"PAR1"

_TYPES = (0, 1, 2)
"""Booleans, and integers of 32 and 64 bits. Source: parquet.thrift, as all numbers of fields here."""
_CODECS = (0, 1, 2, 4, 5, 6, 7)
"""None, Snappy, gzip, Brotli, LZ4, Zstandard, LZ4 raw."""
_LONGEST_PAGE_HEADER = 1 << 16


@dataclass(frozen=True)
class Column:
    """A column of a row group: its name, the bytes of its pages, and its values' least and largest, where stated."""

    name: str
    begin: int
    end: int
    least: int | None
    largest: int | None


@dataclass(frozen=True)
class RowGroup:
    """Rows that are stored together."""

    rows: int
    columns: list[Column]

    @property
    def bytes(self) -> int:
        """How many bytes of the file its columns have."""
        return sum(column.end - column.begin for column in self.columns)


def read_row_groups(path: Path, names: tuple[str, ...], budget: Budget) -> list[RowGroup]:
    """Read the row groups of a file, with the columns of these names.

    Args:
        budget: of the file: the metadata's bytes and values are charged to it.

    Raises:
        OSError: if it cannot be read.
        DecodeError: if the metadata are malformed, contradict themselves, or are not those of integers, or if the
            budget does not hold them.
    """
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(size - 8, 0))
        end = file.read(8)
        length = int.from_bytes(end[:4], "little")
        if end[4:] != MAGIC or length > size - 12:
            raise DecodeError(f"{path}: it does not end with Parquet's metadata: it was never finished, or was cut")
        budget.take(length, "Parquet's metadata")
        file.seek(size - 8 - length)
        footer = file.read(length)
    try:
        metadata = CompactReader(footer, lambda values: budget.count(values, "values of Parquet's metadata")).struct()
    except Malformed:
        raise DecodeError(f"{path}, byte {size - 8 - length}: Parquet's metadata are malformed") from None
    with decoding(path, "Parquet's metadata"):
        leaves = [element for element in metadata[2] if not element.get(5)]
        groups = [_row_group(group, k, leaves, names, size) for k, group in enumerate(metadata[4])]
        if metadata[3] != sum(group.rows for group in groups):
            raise ValueError(f"{metadata[3]} rows are not those of the row groups together")
    return groups


def _row_group(group: dict[int, Any], number: int, leaves: list[Any], names: tuple[str, ...], size: int) -> RowGroup:
    where = f"row group {number}"
    chunks, rows = group[1], group[3]
    if len(chunks) != len(leaves) or rows < 0:
        raise ValueError(f"{where} has {len(chunks)} columns for {len(leaves)} of the schema, and {rows} rows")
    columns = []
    for chunk, leaf in zip(chunks, leaves, strict=True):
        column, name = chunk[3], b".".join(chunk[3][3]).decode()
        if column[1] != leaf[1] or column[3][-1:] != [leaf[4]]:
            raise ValueError(f"{where}: column {name} is not of the type or name that the schema has")
        if name not in names:
            continue
        if column[1] not in _TYPES or column[4] not in _CODECS:
            raise ValueError(
                f"{where}: column {name} must hold integers in a known compression: "
                f"found type {column[1]}, codec {column[4]}"
            )
        if column[5] != rows:
            raise ValueError(f"{where}: column {name} has {column[5]} values for {rows} rows")
        begin = min(place for place in (column[9], column.get(11, 0)) if place > 0)
        end = begin + column[7]
        if not begin <= end <= size:
            raise ValueError(f"{where}: column {name} lies at bytes {begin} to {end} of {size}")
        statistics = column.get(12, {})
        least, largest = statistics.get(6), statistics.get(5)
        columns.append(Column(name, begin, end, _integer(least), _integer(largest)))
    return RowGroup(rows, columns)


def _integer(value: bytes | None) -> int | None:
    return None if value is None else int.from_bytes(value, "little", signed=True)


def check_pages(path: Path, group: RowGroup, limit: int) -> None:
    """Refuse a page of a row group that unpacks to more than the limit, or lies outside of its column.

    Raises:
        DecodeError: with column and byte.
    """
    with path.open("rb") as file:
        for column in group.columns:
            place = column.begin
            while place < column.end:
                length, unpacked, packed = _page(file, place, path)
                if unpacked > limit:
                    raise above_limit(path, f"the page of column {column.name} at byte {place}", limit)
                place += length + packed
            if place != column.end:
                raise DecodeError(f"{path}: column {column.name} ends at byte {column.end}, its last page at {place}")


def _page(file: BinaryIO, place: int, path: Path) -> tuple[int, int, int]:
    """Return a page's lengths: of its header, unpacked, and packed."""
    file.seek(place)
    header = CompactReader(file.read(_LONGEST_PAGE_HEADER))
    try:
        fields = header.struct()
    except Malformed:
        fields = {}
    unpacked, packed = fields.get(2, -1), fields.get(3, -1)
    if not (isinstance(unpacked, int) and isinstance(packed, int) and unpacked >= 0 and packed >= 0):
        raise DecodeError(f"{path}, byte {place}: the header of a page is malformed")
    return header.at, unpacked, packed
