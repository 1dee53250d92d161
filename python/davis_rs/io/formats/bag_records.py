"""Reads the records of a bag without an index, from its beginning to its last whole one."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

from ..._util.budget import Budget
from .unpack import unpack_bz2, unpack_lz4

if TYPE_CHECKING:
    from rosbags.rosbag1.reader import Header

_HEAD = len(b"#ROSBAG V2.0\n")
_CONNECTION_HELD = 300
"""Bytes in memory of a connection, apart from its names."""


class ScannedMessage(NamedTuple):
    """A message, and the fraction of the file that lies behind it."""

    topic: str
    type: str
    t_ns: int
    data: bytes
    fraction: float


def unpackers(path: Path, limit: int) -> dict[str, Callable[[bytes], bytes]]:
    """Return how the data of a chunk are unpacked, by the name of the compression; to at most ``limit`` bytes."""
    return {
        "none": lambda data: data,
        "bz2": lambda data: unpack_bz2(path, data, limit),
        "lz4": lambda data: unpack_lz4(path, data, limit),
    }


def scan_messages(path: Path, limit: int) -> Iterator[ScannedMessage]:
    """Yield all whole messages, in the file's order; a chunk may unpack to ``limit`` bytes.

    A chunk and the names of connections are held in memory, and charged to the file's budget.

    Source: http://wiki.ros.org/Bags/Format/2.0.
    """
    from rosbags.rosbag1.reader import RecordType

    size, budget = path.stat().st_size, Budget(path)
    unpack = unpackers(path, limit)
    connections: dict[int, tuple[str, str]] = {}
    with path.open("rb") as file:
        file.seek(_HEAD)
        for header, data in _records(file, size):
            if header.get_uint8("op") != RecordType.CHUNK:
                continue
            chunk = unpack[header.get_string("compression")](data)
            fraction = file.tell() / size
            with budget.borrow(len(chunk), "a chunk"):
                for header, data in _records(io.BytesIO(chunk), len(chunk)):
                    operation, connection = header.get_uint8("op"), header.get_uint32("conn")
                    if operation == RecordType.CONNECTION:
                        names = _named(header, data)
                        if connection not in connections:
                            budget.take(_CONNECTION_HELD + sum(map(len, names)), "the names of connections")
                        connections[connection] = names
                    elif operation == RecordType.MSGDATA and connection in connections:
                        yield ScannedMessage(*connections[connection], header.get_time("time"), data, fraction)


def _records(stream: BinaryIO, size: int) -> Iterator[tuple[Header, bytes]]:
    """Yield (header, data) of each record of a stream of ``size`` bytes, as long as they are whole."""
    from rosbags.rosbag1.reader import Header, ReaderError, read_bytes, read_uint32

    while True:
        # Lengths that go beyond the end are not asked of the system, which would find memory for them.
        begin = stream.read(4)
        if len(begin) < 4 or int.from_bytes(begin, "little") > size - stream.tell():
            return
        stream.seek(-4, io.SEEK_CUR)
        try:
            header = Header.read(stream)
            length = read_uint32(stream)
            if length > size - stream.tell():
                return
            yield header, read_bytes(stream, length)
        except ReaderError:
            return


def _named(header: Header, data: bytes) -> tuple[str, str]:
    """Return topic and type of a connection."""
    from rosbags.rosbag1.reader import Header as Fields
    from rosbags.typesys.msg import normalize_msgtype

    fields = Fields.read(io.BytesIO(len(data).to_bytes(4, "little") + data))
    return header.get_string("topic"), normalize_msgtype(fields.get_string("type"))
