"""Defines writers and readers of the formats that the Rust core encodes and decodes."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np

from ..._core import EventFileReader, EventFileWriter
from ...events.arrays import EventArray
from .blocks import BlockPosition, Blocks, blocks_of
from .destination import Destination, Limits
from .interface import EventReader, EventWriter, Failing, warn_truncated
from .reading import ReadRules

_STEP = 1 << 13
_SCANNED = 1 << 10
"""Blocks between two looks at whether Ctrl-C was pressed."""


class CoreWriter(EventWriter):
    """Writes a format of the core; ``options`` are those of :class:`davis_rs._core.EventFileWriter`."""

    def __init__(self, destination: Destination, **options: Any) -> None:
        super().__init__(destination)
        width, height = self.size
        self._core = EventFileWriter(
            destination.target,
            destination.format,
            width=width,
            height=height,
            overwrite=destination.overwrite,
            **options,
        )

    def _take(self, packet: EventArray) -> None:
        # The core checks before it writes: a packet that it refuses has left nothing.
        with Failing(self, but=(ValueError,)):
            self._encode(packet)

    def _encode(self, packet: EventArray) -> None:
        self._core.write(packet)

    def _flush(self) -> None:
        self._core.flush()

    def _close(self) -> int:
        return self._core.finish()

    def _abandon(self) -> None:
        self._core.abandon()


class CoreReader(EventReader):
    """Reads a format of the core."""

    def __init__(self, path: str | os.PathLike[str], *, format: str, limits: Limits, rules: ReadRules) -> None:
        super().__init__(path, format=format, rules=rules, extent=(limits.width, limits.height))
        # The beginning may hold the size; what does not begin as its format says is told at once.
        self._core = self._open()
        self._core.look()
        self.size = self._core.size

    @property
    def progress(self) -> float:
        return self._core.bytes / max(self._core.file_size, 1)

    def _open(self, start_us: int | None = None, stop_us: int | None = None) -> EventFileReader:
        """Return the core's reader of the whole file, or of a part of it with all events of a slice of time."""
        return EventFileReader(self.path, self.format, in_order=self.rules.in_order)

    def _packets(self, chunk: int, start_us: int | None, stop_us: int | None) -> Iterator[EventArray]:
        core = self._core = self._open(start_us, stop_us)
        # Not far past the slice's end, where that is seen by its events.
        enough = chunk if stop_us is None else min(chunk, _STEP)
        while not core.over:
            packet = core.read(enough)
            yield packet
            if self._past(packet, stop_us):
                return
        self._warn_left_over()

    def blocks(self) -> Blocks:
        core = self._core = self._open()
        tables = [np.empty((0, 9), np.int64)]
        while not core.over:
            tables.append(core.scan(_SCANNED))
        self._warn_left_over()
        byte, events, first_us, last_us, *state = np.concatenate(tables).T
        positions = np.stack([byte, np.append(byte[1:], core.file_size)[: len(byte)], *state], axis=1)
        return blocks_of(events, first_us, positions, *last_us[-1:].tolist())

    def read_block(self, position: BlockPosition, events: int) -> EventArray:
        byte, end, *state = position.tolist()
        return self._core.read_block(byte, state, end)

    def _warn_left_over(self) -> None:
        if left_over := self._core.left_over:
            byte = self._core.bytes
            warn_truncated(self.path, f"the last {left_over} bytes, from byte {byte}, are no whole record")

    def _past(self, packet: EventArray, stop_us: int | None) -> bool:
        """Return whether nothing before ``stop_us`` can follow, since the format keeps times in order."""
        return False

    def _read(self, start_us: int | None, stop_us: int | None) -> EventArray:
        if start_us is not None or stop_us is not None:
            return super()._read(start_us, stop_us)
        (events,) = self._packets(sys.maxsize, None, None)
        return events
