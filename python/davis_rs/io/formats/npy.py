"""Writes and reads NumPy's .npy: an event array as it is in memory."""

from __future__ import annotations

import io
import os
from bisect import bisect_left
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, BinaryIO

import numpy as np

from ..._core import DecodeError
from ..._util.untrusted import above_limit, decoding
from ...events.arrays import EVENT_DTYPE, EventArray, as_events
from .blocks import BLOCK, BlockPosition, Blocks, equal_blocks
from .byte_writer import ByteWriter
from .destination import Destination, naming
from .interface import EventReader, Format, warn_truncated
from .reading import ReadRules

_LONGEST_HEADER = 10_000
"""As NumPy's own limit."""

MAGIC = b"\x93NUMPY"
HEADER = 192
"""Bytes of our header, the same for any number of events."""


def npy_header(count: int, dtype: np.dtype[Any] = EVENT_DTYPE) -> bytes:
    """Return the header of an array of ``count`` events, or of another type."""
    text = f"{{'descr': {np.lib.format.dtype_to_descr(dtype)!r}, 'fortran_order': False, 'shape': ({count},), }}"
    length = HEADER - len(MAGIC) - 4
    return MAGIC + b"\x01\x00" + length.to_bytes(2, "little") + text.ljust(length - 1).encode() + b"\n"


class NpyWriter(ByteWriter):
    """Appends events, and puts their number into the header after each packet: NumPy then reads all that was written,
    also when the process was killed."""

    def __init__(self, destination: Destination) -> None:
        self._count = 0
        super().__init__(destination)

    def _open(self, destination: Destination) -> BinaryIO:
        target = destination.target
        if isinstance(target, str | os.PathLike):
            return destination.claim().open("r+b", buffering=0)
        return target

    def _begin(self) -> None:
        if not self._file.seekable():
            raise ValueError(
                f"{self.format} states the number of events at its beginning, but {self.path} is not seekable"
            )
        self._start = self._file.tell()
        self._put_beginning()

    def _put_beginning(self) -> None:
        self._put(npy_header(0))

    def _encode(self, packet: EventArray) -> None:
        with naming(self.path):
            self._put(packet.view(np.uint8).data)
            self._count += len(packet)
            self._patch(self._start, npy_header(self._count))

    def _patch(self, position: int, data: bytes) -> None:
        """Replace bytes that are there."""
        end = self._file.tell()
        self._file.seek(position)
        self._put(data)
        self._file.seek(end)

    def _size(self) -> int:
        return self._file.tell() - self._start


class NpyReader(EventReader):
    """Reads a one-dimensional structured array with the fields t, x, y and p; a slice of time by bisection, so that
    times may not decrease.

    Args:
        start: where the array begins in the file.
        end: where it ends at the latest, None for the file's end.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        format: str,
        rules: ReadRules,
        start: int = 0,
        end: int | None = None,
    ) -> None:
        super().__init__(path, format=format, rules=rules)
        with self.path.open("rb") as file:
            file.seek(start)
            self._dtype, self._count = read_header(file, self.path, rules.max_packet_bytes)
            self._offset = file.tell()
            size = file.seek(0, os.SEEK_END)
        there = (size if end is None else min(size, end)) - self._offset
        self._events = min(self._count, there // self._dtype.itemsize)
        self._done = 0

    @property
    def events(self) -> int:
        return self._events

    @property
    def progress(self) -> float:
        return self._done / max(self._events, 1)

    def _packets(self, chunk: int, start_us: int | None, stop_us: int | None) -> Iterator[EventArray]:
        first = 0 if start_us is None else self._find(start_us)
        last = self._events if stop_us is None else self._find(stop_us)
        with self.path.open("rb") as file:
            file.seek(self._offset + first * self._dtype.itemsize)
            while first < last:
                packet = np.fromfile(file, self._dtype, min(chunk, last - first))
                first += len(packet)
                self._done = first
                yield to_events(packet, self.path)
        if last == self._events:
            self._warn_missing()

    def _read(self, start_us: int | None, stop_us: int | None) -> EventArray:
        packets = list(self._packets(max(self._events, 1), start_us, stop_us))
        return packets[0] if packets else np.zeros(0, EVENT_DTYPE)

    def blocks(self) -> Blocks:
        self._warn_missing()
        return equal_blocks(self._events, BLOCK)

    def read_block(self, position: BlockPosition, events: int) -> EventArray:
        with self.path.open("rb") as file:
            file.seek(self._offset + int(position[0]) * self._dtype.itemsize)
            return to_events(np.fromfile(file, self._dtype, events), self.path)

    def _warn_missing(self) -> None:
        if self._events < self._count:
            missing = self._count - self._events
            warn_truncated(self.path, f"the last {missing} of {self._count} events, from byte {self._end}, are missing")

    @property
    def _end(self) -> int:
        return self._offset + self._events * self._dtype.itemsize

    def _find(self, t_us: int) -> int:
        """Return the first event at or after ``t_us``."""
        if not self._events:
            return 0
        times = np.memmap(self.path, self._dtype, "r", self._offset, (self._events,))["t"]
        return bisect_left(times, t_us)


class NpyFormat(Format):
    """Describes .npy files, each an array of :data:`davis_rs.EVENT_DTYPE`; they are written to a file or a seekable
    stream, without options.

    Source: NumPy, NEP 1 (a simple file format for NumPy arrays).
    """

    name = "npy"
    suffixes = (".npy",)
    writer = NpyWriter
    states_size = False

    def sniff(self, head: bytes, path: Path) -> bool:
        return head.startswith(MAGIC)

    def open_reader(self, path: str | os.PathLike[str], rules: ReadRules = ReadRules()) -> EventReader:  # noqa: B008
        return NpyReader(path, format=self.name, rules=rules)


def read_header(file: IO[bytes], path: Path, max_event_bytes: int) -> tuple[np.dtype[np.void], int]:
    """Return dtype and number of events of the array that begins here.

    Raises:
        DecodeError: if none begins here, or it is not one of events, or one of its events has more bytes than
            ``max_event_bytes``.
    """
    read = {1: (np.lib.format.read_array_header_1_0, 2), 2: (np.lib.format.read_array_header_2_0, 4)}
    position = file.tell()
    begin = file.read(len(MAGIC) + 2)
    with decoding(path, f"byte {position}"):
        if not begin.startswith(MAGIC):
            raise ValueError(f"an array must begin with {MAGIC!r}, found {begin!r}")
        version = begin[len(MAGIC) :]
        if version not in (b"\x01\x00", b"\x02\x00"):
            raise ValueError(f"version {tuple(version)} of the format is not known")
        read_rest, digits = read[version[0]]
        size = file.read(digits)
        length = int.from_bytes(size, "little")
        # NumPy evaluates the text, and would take any length from an archive that is compressed.
        if length > _LONGEST_HEADER:
            raise ValueError(f"the array's header may have {_LONGEST_HEADER} bytes, not {length}")
        shape, _, dtype = read_rest(io.BytesIO(size + file.read(length)))
    if len(shape) != 1 or shape[0] < 0 or dtype.hasobject or not {"t", "x", "y", "p"} <= set(dtype.names or ()):
        raise DecodeError(
            f"{path}, byte {position}: events must be a one-dimensional array with fields t, x, y, p; "
            f"found shape {shape} and dtype {dtype}"
        )
    for name in ("t", "x", "y", "p"):
        if dtype[name].kind not in "biuf" or dtype[name].shape:
            raise DecodeError(f"{path}, byte {position}: the field {name} must hold one number, found {dtype[name]}")
    if dtype.itemsize > max_event_bytes:
        raise above_limit(path, "an event", max_event_bytes)
    return dtype, shape[0]


def to_events(array: EventArray, path: Path) -> EventArray:
    """Return ``array`` as events.

    Raises:
        DecodeError: if it holds what events cannot.
    """
    try:
        # A dtype that was read is equal to ours but for its alignment, without which NumPy would join arrays otherwise.
        return as_events(array).view(EVENT_DTYPE)
    except ValueError as error:
        raise DecodeError(f"{path}: {error}") from None
