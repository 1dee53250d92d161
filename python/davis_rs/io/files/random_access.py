"""Reads any events of a file, by number or by time, without reading those before them."""

from __future__ import annotations

import os
import threading
import weakref
from bisect import bisect_left
from collections import OrderedDict
from itertools import pairwise
from pathlib import Path

import numpy as np

from ..._core import DecodeError
from ..._util.untrusted import MAX_PACKET_BYTES, decoding
from ...events.arrays import EVENT_DTYPE, EventArray, concatenate_events
from ..dataset.folder_format import FolderReader
from ..formats.blocks import UNKNOWN_US, Blocks, pieces
from ..formats.interface import EventReader
from ..formats.reading import EventCheck, ReadRules
from .read import open_reader
from .sensor_size import find_sensor_size

_CACHED_EVENTS = 1 << 18
"""Events of the blocks that are kept after use, 4 MiB, but always those of the last block."""


class _ProcessReader:
    """Keeps a reader in one process, with the blocks it has read last. A fork does not share it: its file position and
    its lock would be shared too."""

    def __init__(self, reader: EventReader) -> None:
        self.process = os.getpid()
        self.turn = threading.Lock()
        self.reader = reader
        self.cache: OrderedDict[int, EventArray] = OrderedDict()
        weakref.finalize(self, reader.close)


class RandomAccess:
    """Reads events by number or by time from a file of any format that can be read in blocks.

    What is kept is where the blocks are (tens of bytes for some thousand events) and a few blocks that were read last.
    Files that do not say where their events are (text, EVT, AEDAT 4, bags) are read once for it, here. Threads may
    share one, one of them reading at a time. A pickled one is small, opens the file again, and does not read all of it
    again.

    Args:
        path: an event file, or a dataset folder.
        size: (width, height) of the sensor in pixels, where neither the file nor what lies next to it says.
        max_packet_bytes: see :func:`davis_rs.open_reader`.

    Attributes:
        size: (width, height) of the sensor in pixels, None where nothing says.
        events: the number of all events.
        dataset: the folder, None for a file.

    Raises:
        OSError: if it cannot be read.
        DecodeError: if it is malformed, its times go back, or it can only be read from its beginning: a compressed
            .npz, a bag without an index, a rosbag2, a camera's bytes.
        ValueError: if ``size`` contradicts the file.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        size: tuple[int, int] | None = None,
        max_packet_bytes: int = MAX_PACKET_BYTES,
    ) -> None:
        self.path = Path(path)
        self._rules = ReadRules(max_packet_bytes=max_packet_bytes)
        reader = open_reader(path, max_packet_bytes=max_packet_bytes)
        self._file = reader.path  # of a dataset folder, its event file
        self._state = self._file_state()
        try:
            self.size = find_sensor_size(reader, size)
            with decoding(self._file):
                self._blocks: Blocks = reader.blocks()
        except BaseException:
            reader.close()
            raise
        self.dataset = reader.dataset if isinstance(reader, FolderReader) else None
        self.format = reader.format
        self.events = int(self._blocks.starts[-1])
        self._extent = reader.size or reader.extent
        self._opened: _ProcessReader | None = _ProcessReader(reader)

    def __getstate__(self) -> dict[str, object]:
        return {**self.__dict__, "_opened": None}

    def __repr__(self) -> str:
        return f"<RandomAccess to {self.path} ({self.format}), {self.events:,} events in {len(self._blocks):,} blocks>"

    @property
    def first_us(self) -> int | None:
        """Return the time of the first event in microseconds, None without one."""
        return self._block_us(0) if self.events else None

    @property
    def last_us(self) -> int | None:
        """Return the time of the last event in microseconds, None without one."""
        if not self.events:
            return None
        if self._blocks.last_us != UNKNOWN_US:
            return self._blocks.last_us
        return int(self.read(self.events - 1, self.events)["t"][0])

    def number_at(self, t_us: int) -> int:
        """Return the number of the first event at ``t_us`` or later, counted from 0; that of all events if there is
        none."""
        block = bisect_left(range(len(self._blocks)), t_us, key=self._block_us) - 1
        if block < 0:
            return 0
        return int(self._blocks.starts[block]) + int(np.searchsorted(self._block(block)["t"], t_us))

    def read(self, first: int, stop: int) -> EventArray:
        """Return events ``first`` to ``stop - 1`` as a new array of :data:`davis_rs.EVENT_DTYPE`.

        Raises:
            ValueError: if the file has fewer events.
            OSError: if the file cannot be read.
            DecodeError: if it is malformed, or not what it was when it was opened.
        """
        if not 0 <= first <= stop <= self.events:
            raise ValueError(f"{self.path} has events 0..{self.events}: asked for {first}..{stop}")
        slices = [self._block(block)[part] for block, part in pieces(self._blocks, first, stop)]
        for before, after in pairwise(slices):
            if after["t"][0] < before["t"][-1]:
                raise DecodeError(
                    f"{self._file}: times may not go back: {after['t'][0]} us comes after {before['t'][-1]} us"
                )
        return concatenate_events(slices) if slices else np.zeros(0, EVENT_DTYPE)

    def read_times(self, start_us: int, stop_us: int) -> EventArray:
        """Return events with start_us <= t < stop_us; see :meth:`read`."""
        first = self.number_at(start_us)
        return self.read(first, max(first, self.number_at(stop_us)))

    def close(self) -> None:
        """Let go of the file; it is opened again when it is needed."""
        opened, self._opened = self._opened, None
        if opened is not None and opened.process == os.getpid():
            with opened.turn:
                opened.reader.close()

    def _file_state(self) -> tuple[int, int]:
        state = os.stat(self._file)
        return state.st_size, state.st_mtime_ns

    def _open(self) -> _ProcessReader:
        opened = self._opened
        if opened is None or opened.process != os.getpid():
            if self._file_state() != self._state:
                raise DecodeError(f"{self._file} has changed since it was opened: open it again")
            reader = open_reader(self.path, max_packet_bytes=self._rules.max_packet_bytes)
            opened = self._opened = _ProcessReader(reader)
        return opened

    def _block_us(self, block: int) -> int:
        """Return the time of a block's first event."""
        if self._blocks.first_us[block] == UNKNOWN_US:
            self._blocks.first_us[block] = self._block(block)["t"][0]
        return int(self._blocks.first_us[block])

    def _block(self, block: int) -> EventArray:
        """Return the events of a block, which belong to the cache."""
        opened = self._open()
        with opened.turn:
            events = opened.cache.get(block)
            if events is None:
                events = opened.cache[block] = self._read_block(opened.reader, block)
                kept = sum(map(len, opened.cache.values()))
                while kept > _CACHED_EVENTS and len(opened.cache) > 1:
                    kept -= len(opened.cache.popitem(last=False)[1])
            opened.cache.move_to_end(block)
            return events

    def _read_block(self, reader: EventReader, block: int) -> EventArray:
        start, end = self._blocks.starts[block : block + 2].tolist()
        with decoding(self._file, f"events {start}..{end}"):
            events = reader.read_block(self._blocks.positions[block], end - start)
        first_us = int(self._blocks.first_us[block])
        if len(events) != end - start or (first_us != UNKNOWN_US and events["t"][0] != first_us):
            raise DecodeError(f"{self._file}, events {start}..{end}: the file has changed since it was opened")
        return EventCheck(self._file, self._rules, self._extent, first=start).take(events)
