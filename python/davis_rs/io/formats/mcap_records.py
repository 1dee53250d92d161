"""Reads the messages of an MCAP file, from its beginning to its last whole record, finished or not."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from ..._core import DecodeError
from ..._util.budget import Budget
from ..._util.untrusted import above_limit
from .bag_records import ScannedMessage
from .unpack import unpack_lz4, unpack_zstd

MAGIC = b"\x89MCAP0\r\n"
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END, _FOOTER = 3, 4, 5, 6, 15, 2
_HEAD = struct.Struct("<BQ")
_FOOTER_HEAD, _FOOTER_BODY = _HEAD.pack(_FOOTER, 20), struct.Struct("<QQI")
_NAME_HELD, _MESSAGE_HELD = 300, 200
"""Bytes in memory of a schema or a channel, and of a message, apart from their own bytes."""


class McapScan:
    """Reads messages in the file's order, those of a chunk in order of time; a chunk may unpack to ``limit`` bytes.

    A chunk, its messages and all names of channels are held in memory, and charged to the file's budget.

    Attributes:
        whole: whether the file was finished; that of a killed writer has no end.

    Source: MCAP format specification, https://mcap.dev/spec.
    """

    def __init__(self, path: Path, limit: int) -> None:
        self._path, self._limit, self._budget = path, limit, Budget(path)
        self._size = path.stat().st_size
        self.whole = True
        with path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise DecodeError(f"{path}: an MCAP file must begin with {MAGIC!r}")
            self._topics = self._summary(file)
        if self._topics is None:
            self._topics = {message.topic: message.type for message in self.messages()}

    def topics(self) -> dict[str, str]:
        """Return the types of all topics."""
        return dict(self._topics or {})

    def messages(self) -> Iterator[ScannedMessage]:
        """Yield all messages."""
        with _ChannelNames(self._budget) as names, self._path.open("rb") as file:
            file.seek(len(MAGIC))
            for kind, length in self._records(file):
                if kind in (_DATA_END, _FOOTER):
                    return
                fraction = file.tell() / self._size
                if kind == _CHUNK:
                    yield from self._in_order(self._chunk(file, length), names, fraction)
                elif kind in (_SCHEMA, _CHANNEL, _MESSAGE):
                    if length > self._limit:
                        raise above_limit(self._path, "a record", self._limit)
                    yield from names.take(kind, memoryview(file.read(length)), fraction)

    def _summary(self, file: BinaryIO) -> dict[str, str] | None:
        """Return topics and types as the summary at the file's end has them; None without one."""
        end = self._size - len(_FOOTER_HEAD) - _FOOTER_BODY.size - len(MAGIC)
        self.whole = False
        if end < len(MAGIC):
            return None
        file.seek(end)
        tail = file.read()
        if not (tail.startswith(_FOOTER_HEAD) and tail.endswith(MAGIC)):
            return None
        self.whole = True
        start, _, _ = _FOOTER_BODY.unpack_from(tail, len(_FOOTER_HEAD))
        if not len(MAGIC) <= start < end:
            return None
        file.seek(start)
        with _ChannelNames(self._budget) as names:
            for kind, length in self._records(file):
                if kind in (_SCHEMA, _CHANNEL):
                    if length > self._limit:
                        raise above_limit(self._path, "a record", self._limit)
                    list(names.take(kind, memoryview(file.read(length)), 1.0))
            return names.topics() or None

    def _in_order(self, chunk: bytes, names: _ChannelNames, fraction: float) -> Iterator[ScannedMessage]:
        """Yield the messages of a chunk in order of time."""
        held = 0
        messages = []
        try:
            self._budget.take(len(chunk), "a chunk")
            held += len(chunk)
            for message in _inside(self._path, chunk, names, fraction):
                size = _MESSAGE_HELD + len(message.data)
                self._budget.take(size, "the messages of a chunk")
                held += size
                messages.append(message)
            yield from sorted(messages, key=lambda message: message.t_ns)
        finally:
            self._budget.give_back(held)

    def _records(self, file: BinaryIO) -> Iterator[tuple[int, int]]:
        """Yield (kind, length) of each record that is whole, with the file at its content."""
        while True:
            head = file.read(_HEAD.size)
            if len(head) < _HEAD.size:
                return
            kind, length = _HEAD.unpack(head)
            begin = file.tell()
            if length > self._size - begin:
                return
            yield kind, length
            file.seek(begin + length)

    def _chunk(self, file: BinaryIO, length: int) -> bytes:
        """Return the records of a chunk, unpacked."""
        head = file.read(min(length, 64))
        _, _, unpacked, _, name_length = struct.unpack_from("<QQQII", head)
        compression = head[32 : 32 + name_length].decode()
        (packed,) = struct.unpack_from("<Q", head, 32 + name_length)
        if max(unpacked, packed) > self._limit:
            raise above_limit(self._path, "a chunk", self._limit)
        if packed > length - 40 - name_length:
            raise DecodeError(f"{self._path}: a chunk says {packed} bytes, and does not hold them")
        file.seek(40 + name_length - len(head), 1)
        data = file.read(packed)
        if compression == "":
            return data
        if compression == "lz4":
            return unpack_lz4(self._path, data, self._limit)
        if compression == "zstd":
            return unpack_zstd(self._path, data, self._limit)
        raise DecodeError(f"{self._path}: chunks compressed by {compression!r}: expected lz4 or zstd")


class _Channel(NamedTuple):
    topic: str
    schema: int


class _ChannelNames:
    """Knows what channels and schemas are called, as far as they were read; its ``with`` charges them to the budget.

    A few bytes of a compressed chunk can make a name as long as the limit allows, and there may be 65,536 of each.
    """

    def __init__(self, budget: Budget) -> None:
        self._budget, self._held = budget, 0
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, _Channel] = {}

    def __enter__(self) -> _ChannelNames:
        return self

    def __exit__(self, *_: object) -> None:
        self._budget.give_back(self._held)

    def _keep(self, name: str, before: str | None) -> str:
        """Charge a name, in place of the one that its number had before."""
        change = len(name) + _NAME_HELD if before is None else len(name) - len(before)
        self._budget.take(change, "the names of channels and schemas")
        self._held += change
        return name

    def topics(self) -> dict[str, str]:
        """Return the types of the topics so far."""
        return {channel.topic: self._schemas.get(channel.schema, "") for channel in self._channels.values()}

    def take(self, kind: int, content: memoryview, fraction: float) -> Iterator[ScannedMessage]:
        """Note a schema or a channel; hand out a message."""
        if kind == _SCHEMA:
            (number,) = struct.unpack_from("<H", content)
            self._schemas[number] = self._keep(_string(content, 2)[0], self._schemas.get(number))
        elif kind == _CHANNEL:
            number, schema = struct.unpack_from("<HH", content)
            before = self._channels.get(number)
            topic = self._keep(_string(content, 4)[0], None if before is None else before.topic)
            self._channels[number] = _Channel(topic, schema)
        elif kind == _MESSAGE:
            number, _, t_ns, _ = struct.unpack_from("<HIQQ", content)
            channel = self._channels.get(number)
            if channel is not None:
                type_ = self._schemas.get(channel.schema, "")
                yield ScannedMessage(channel.topic, type_, t_ns, bytes(content[22:]), fraction)


def _inside(path: Path, chunk: bytes, names: _ChannelNames, fraction: float) -> Iterator[ScannedMessage]:
    """Yield the messages of a chunk, in its own order."""
    position, content = 0, memoryview(chunk)
    while position < len(chunk):
        if len(chunk) - position < _HEAD.size:
            raise DecodeError(f"{path}: a chunk ends in the middle of a record")
        kind, length = _HEAD.unpack_from(chunk, position)
        position += _HEAD.size
        if length > len(chunk) - position:
            raise DecodeError(f"{path}: a record of {length} bytes goes beyond its chunk")
        yield from names.take(kind, content[position : position + length], fraction)
        position += length


def _string(content: memoryview, position: int) -> tuple[str, int]:
    """Return a string, and where it ends."""
    (length,) = struct.unpack_from("<I", content, position)
    end = position + 4 + length
    if end > len(content):
        raise ValueError(f"a string of {length} bytes goes beyond its record")
    return bytes(content[position + 4 : end]).decode(), end
