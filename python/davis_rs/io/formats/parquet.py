"""Writes and reads events in Parquet: columns t, x, y, p, times as differences."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..._core import DecodeError, fill_events
from ..._util.argument_error import ArgumentError
from ..._util.array_types import UncheckedArray
from ..._util.budget import Budget
from ..._util.extras import from_extra, require
from ..._util.untrusted import decoding
from ...events.arrays import EVENT_DTYPE, EventArray
from .blocks import UNKNOWN_US, BlockPosition, Blocks, blocks_of
from .destination import Destination, Limits, naming
from .interface import CHUNK, EventReader, EventWriter, Format
from .parquet_footer import MAGIC, RowGroup, check_pages, read_row_groups
from .reading import ReadRules

if TYPE_CHECKING:
    import pyarrow as pa

SIZE_KEY = b"davis_rs.size"
"""The schema's metadata that holds the sensor's size, as b"240x180"."""


class ParquetWriter(EventWriter):
    """Writes columns t (int64, us), x, y (uint16) and p (bool).

    Parquet is unreadable without its end. So a file is written next to its path, as NAME.part, and takes its name when
    it is finished: a killed process leaves the path as it was. A stream gets the same bytes in order.

    Args:
        level: of zstd, 1..22.
        row_group: events that are compressed together, and held in memory until then.

    Source: https://parquet.apache.org/docs/file-format; DELTA_BINARY_PACKED for t.
    """

    def __init__(
        self,
        destination: Destination,
        *,
        level: int = 1,
        row_group: int = CHUNK,
    ) -> None:
        if row_group < 1:
            raise ArgumentError("{row_group} must be at least 1: got {}", row_group)
        super().__init__(destination)
        with from_extra("parquet"):
            import pyarrow as pa
            import pyarrow.parquet as pq
        types = {"t": pa.int64(), "x": pa.uint16(), "y": pa.uint16(), "p": pa.bool_()}
        size_text = f"{self.size[0]}x{self.size[1]}".encode()
        self._schema = pa.schema(
            [pa.field(name, type_, nullable=False) for name, type_ in types.items()], metadata={SIZE_KEY: size_text}
        )
        self._row_group = row_group
        dtypes = {"t": np.int64, "x": np.uint16, "y": np.uint16, "p": np.bool_}
        self._columns: dict[str, UncheckedArray] = {name: np.empty(row_group, dtype) for name, dtype in dtypes.items()}
        self._count = 0
        self._file = None if destination.is_stream else destination.claim_part()
        self._sink = (
            pa.PythonFile(destination.target, "w") if self._file is None else pa.OSFile(str(self._file.part), "wb")
        )
        self._writer = pq.ParquetWriter(
            self._sink,
            self._schema,
            compression="zstd",
            compression_level=level,
            use_dictionary=["x", "y"],
            column_encoding={"t": "DELTA_BINARY_PACKED"},
            write_statistics=["t"],
        )

    def _encode(self, packet: EventArray) -> None:
        start = 0
        while start < len(packet):
            piece = packet[start : start + self._row_group - self._count]
            for name, column in self._columns.items():
                np.copyto(column[self._count : self._count + len(piece)], piece[name], casting="unsafe")
            start += len(piece)
            self._count += len(piece)
            if self._count == self._row_group:
                self._write_group()

    def _write_group(self) -> None:
        import pyarrow as pa

        if not self._count:
            return
        count, self._count = self._count, 0
        columns = [pa.array(self._columns[name][:count]) for name in self._schema.names]
        with naming(self.path):
            self._writer.write_table(pa.Table.from_arrays(columns, schema=self._schema), row_group_size=count)

    def _flush(self) -> None:
        self._write_group()
        with naming(self.path):
            self._sink.flush()

    def _close(self) -> int:
        self._write_group()
        with naming(self.path):
            self._writer.close()
            size = int(self._sink.tell())
            self._sink.flush()
            if self._file is not None:
                self._sink.close()
                self._file.commit()
        return size

    def _abandon(self) -> None:
        # Its end would be written into the file: what is there stays as it is, also when the writer is finalised.
        if self._file is not None:
            self._writer.is_open = False
            with suppress(OSError):
                self._sink.close()


class ParquetReader(EventReader):
    """Reads columns t, x, y, p of any integer type (p boolean as well), in microseconds; row groups outside of a slice
    of time are skipped by their statistics.

    Raises:
        DecodeError: if it is not Parquet, was never finished, or lacks a column.
    """

    _COLUMNS = ("t", "x", "y", "p")

    def __init__(self, path: Path, *, format: str, rules: ReadRules) -> None:
        with from_extra("parquet"):
            import pyarrow.parquet as pq
        self._budget = Budget(path)
        self._row_groups = read_row_groups(path, self._COLUMNS, self._budget)
        with decoding(path):
            self._file = pq.ParquetFile(path)
            schema = self._file.schema_arrow
        missing = [name for name in self._COLUMNS if name not in schema.names]
        if missing:
            raise DecodeError(f"{path}: no column {', '.join(missing)}; there are {', '.join(schema.names)}")
        size = _size((schema.metadata or {}).get(SIZE_KEY, b""))
        super().__init__(path, format=format, size=size, rules=rules)
        self._done = 0

    @property
    def events(self) -> int:
        return sum(group.rows for group in self._row_groups)

    @property
    def progress(self) -> float:
        return self._done / self.events if self.events else 1.0

    def close(self) -> None:
        self._file.close()

    def _packets(self, chunk: int, start_us: int | None, stop_us: int | None) -> Iterator[EventArray]:
        for batch in self._batches(self._groups(start_us, stop_us), chunk):
            events = np.empty(batch.num_rows, EVENT_DTYPE)
            self._fill(events, batch)
            yield events

    def _read(self, start_us: int | None, stop_us: int | None) -> EventArray:
        return self._read_groups(self._groups(start_us, stop_us))

    def _read_groups(self, groups: list[int]) -> EventArray:
        rows = sum(self._row_groups[group].rows for group in groups)
        try:
            events = np.empty(rows, EVENT_DTYPE)
        except (MemoryError, ValueError):
            raise DecodeError(f"{self.path}: it states {rows} events, which do not fit into memory") from None
        filled = 0
        for batch in self._batches(groups, 1 << 18):
            self._fill(events[filled : filled + batch.num_rows], batch)
            filled += batch.num_rows
        if filled != rows:
            raise DecodeError(f"{self.path}: it states {rows} events, but holds {filled}")
        return events

    def blocks(self) -> Blocks:
        groups = [(number, group) for number, group in enumerate(self._row_groups) if group.rows]
        first_us = [_least_us(group) for _, group in groups]
        return blocks_of([group.rows for _, group in groups], first_us, [number for number, _ in groups])

    def read_block(self, position: BlockPosition, events: int) -> EventArray:
        return self._read_groups([int(position[0])])

    def _groups(self, start_us: int | None, stop_us: int | None) -> list[int]:
        groups = enumerate(self._row_groups)
        return [number for number, group in groups if _touches(group, start_us, stop_us)]

    def _batches(self, groups: list[int], chunk: int) -> Iterator[pa.RecordBatch]:
        self._done = 0
        for group in groups:
            row_group = self._row_groups[group]
            check_pages(self.path, row_group, self.rules.max_packet_bytes)
            with self._budget.borrow(row_group.bytes, f"row group {group}"):  # Arrow reads all of it before the first
                for batch in self._file.iter_batches(chunk, row_groups=[group], columns=list(self._COLUMNS)):
                    yield batch
                    self._done += batch.num_rows
        self._done = self.events

    def _fill(self, events: EventArray, batch: pa.RecordBatch) -> None:
        t, x, y, p = (self._column(batch, name) for name in self._COLUMNS)
        fill_events(events, t, x, y, p)

    def _column(self, batch: pa.RecordBatch, name: str) -> UncheckedArray:
        """Return a column of the type that events have."""
        column = batch.column(batch.schema.get_field_index(name))
        if column.null_count:
            raise DecodeError(f"{self.path}: {column.null_count} values of {name} are missing")
        values = column.to_numpy(zero_copy_only=False)
        dtype = EVENT_DTYPE[name]
        if values.dtype == np.bool_ and name == "p":
            return values.view(np.uint8)
        if values.dtype == dtype and name != "p":
            return values
        if values.dtype.kind not in "iub":
            raise DecodeError(f"{self.path}: column {name} must hold integers, found {column.type}")
        limit = 1 if name == "p" else np.iinfo(dtype).max
        wrong = (values < 0) | (values > limit)
        if wrong.any():
            at = int(wrong.argmax())
            raise DecodeError(f"{self.path}: {name} of event {self._done + at} is {values[at]}, not in 0..{limit}")
        return values.astype(dtype)


class ParquetFormat(Format):
    """Describes Parquet files with a column for each of t, x, y and p."""

    name = "parquet"
    suffixes = (".parquet", ".pq")
    options = ("level", "row_group")
    writer = ParquetWriter
    limits = Limits()

    def sniff(self, head: bytes, path: Path) -> bool:
        return head.startswith(MAGIC)

    def require_libraries(self, **_: object) -> None:
        require("parquet", "pyarrow")

    def open_reader(self, path: str | os.PathLike[str], rules: ReadRules = ReadRules()) -> EventReader:  # noqa: B008
        return ParquetReader(Path(path), format=self.name, rules=rules)


def _touches(group: RowGroup, start_us: int | None, stop_us: int | None) -> bool:
    """Return whether a row group may hold events of a slice of time, by its statistics."""
    t = next(column for column in group.columns if column.name == "t")
    if t.least is None or t.largest is None:
        return True
    return (start_us is None or t.largest >= start_us) and (stop_us is None or t.least < stop_us)


def _least_us(group: RowGroup) -> int:
    """Return the time of a row group's first event, where its statistics tell."""
    least = next(column for column in group.columns if column.name == "t").least
    return UNKNOWN_US if least is None else least


def _size(text: bytes) -> tuple[int, int] | None:
    width, _, height = text.partition(b"x")
    if not (width.isdigit() and height.isdigit() and len(text) < 20):
        return None
    return (int(width), int(height)) if int(width) and int(height) else None
