"""Reads a bag's index and its chunks by rosbags, within bounds, because rosbags trusts what a bag says of sizes."""

from __future__ import annotations

import io
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from ..._core import DecodeError
from ..._util.budget import Budget
from ..._util.extras import from_extra
from .bag_records import unpackers

if TYPE_CHECKING:
    from rosbags.rosbag1 import Reader
    from rosbags.rosbag1.reader import Chunk, IndexData

_KEPT = 4
"""Chunks that are kept."""
_ENTRIES_AT = 51
"""Where a part of the index says how many bytes its entries have."""
_ENTRY, _ENTRY_HELD = 12, 160
"""Bytes of an entry of the index, in the file and in memory."""


def bag_index(path: Path, limit: int) -> Reader:
    """Return a reader of a bag of ROS 1, still to be opened, that takes memory for no more than the bag holds.

    No read goes beyond the file's end, all parts of the index together are no longer than the file, and a chunk unpacks
    to at most ``limit`` bytes. Otherwise a few bytes could ask for any amount of memory. Opening it raises a
    :class:`~davis_rs.DecodeError` for an index that says more.

    Raises:
        ImportError: without rosbags, with the extra that brings it.
    """
    with from_extra("ros"):
        from rosbags.rosbag1 import Reader
        from rosbags.rosbag1.reader import decompressors

    size, budget = path.stat().st_size, Budget(path)
    limited = {id(decompressors[name]): unpack for name, unpack in unpackers(path, limit).items()}
    chunks = _ChunkCache(budget)

    class BoundedReader(Reader):  # type: ignore[misc] # rosbags is not looked into
        index_bytes = 0

        def read_chunk(self) -> Chunk:
            chunk = super().read_chunk()
            if chunk.datapos + chunk.datasize > size:
                raise DecodeError(f"{path}: a chunk of {chunk.datasize} bytes goes beyond the file's end")
            unpack = limited[id(chunk.decompressor)]
            return chunk._replace(decompressor=partial(chunks.get, chunk.datapos, unpack))

        def read_index_data(self, pos: int, indexes: dict[int, list[IndexData]]) -> None:
            begin = self.bio.tell()
            entries = int.from_bytes(self.bio.read(_ENTRIES_AT + 4)[_ENTRIES_AT:], "little")
            self.bio.seek(begin)
            self.index_bytes += _ENTRIES_AT + 4 + entries
            if self.index_bytes > size:
                raise DecodeError(f"{path}: damaged: all parts of the index have more bytes than the file")
            budget.take(entries // _ENTRY * _ENTRY_HELD, "the index")
            super().read_index_data(pos, indexes)

        def messages(self, *arguments: Any, **named: Any) -> Iterator[tuple[Any, int, bytes]]:
            chunks.begin()
            yield from super().messages(*arguments, **named)

    return BoundedReader(_BoundedPath(path))


class _ChunkCache:
    """Keeps the last chunks that were unpacked, because messages of chunks that overlap in time stand in turns in each.

    An index can ask for its chunks in turns as often as it likes. So the time in which chunks are unpacked again within
    one pass over the messages is charged.
    """

    def __init__(self, budget: Budget) -> None:
        self._budget = budget
        self._kept: OrderedDict[int, bytes] = OrderedDict()
        self._seen: set[int] = set()

    def begin(self) -> None:
        """Begin another pass."""
        self._seen.clear()

    def get(self, position: int, unpack: Callable[[bytes], bytes], packed: bytes) -> bytes:
        """Return what the chunk at a place unpacks to."""
        if position in self._kept:
            self._kept.move_to_end(position)
            return self._kept[position]
        started = time.monotonic()
        data = unpack(packed)
        if position in self._seen:
            self._budget.spend(time.monotonic() - started, "the unpacking of the same chunks, again and again,")
        self._seen.add(position)
        while len(self._kept) >= _KEPT:
            self._budget.give_back(len(self._kept.popitem(last=False)[1]))
        self._budget.take(len(data), "a chunk")
        self._kept[position] = data
        return data


class _BoundedFile(io.BufferedReader):
    """Wraps a file of which no more is asked than it has: a read takes memory for what is asked."""

    def __init__(self, path: Path) -> None:
        raw = io.FileIO(path)
        super().__init__(raw)
        self._end = raw.seek(0, io.SEEK_END)
        raw.seek(0)

    def read(self, size: int | None = -1, /) -> bytes:
        left = max(0, self._end - self.tell())
        return super().read(left if size is None or size < 0 else min(size, left))


class _BoundedPath:
    """Presents a path as rosbags takes one, whose file is :class:`_BoundedFile`."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __str__(self) -> str:
        return str(self._path)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._path, name)

    def open(self, *_: Any, **__: Any) -> BinaryIO:
        return _BoundedFile(self._path)
