"""The records of a bag without an index, from its beginning to its last whole one."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

if TYPE_CHECKING:
    from rosbags.rosbag1.reader import Header

_HEAD = len(b"#ROSBAG V2.0\n")


class ScannedMessage(NamedTuple):
    """A message, and the share of the file that lies behind it."""

    topic: str
    type: str
    t_ns: int
    data: bytes
    share: float


def scan_messages(path: Path) -> Iterator[ScannedMessage]:
    """All whole messages, in the file's order.

    Source: http://wiki.ros.org/Bags/Format/2.0.
    """
    from rosbags.rosbag1.reader import RecordType, decompressors

    size = path.stat().st_size
    connections: dict[int, tuple[str, str]] = {}
    with path.open("rb") as file:
        file.seek(_HEAD)
        for header, data in _records(file):
            if header.get_uint8("op") != RecordType.CHUNK:
                continue
            chunk = decompressors[header.get_string("compression")](data)
            share = file.tell() / size
            for header, data in _records(io.BytesIO(chunk)):
                operation, connection = header.get_uint8("op"), header.get_uint32("conn")
                if operation == RecordType.CONNECTION:
                    connections[connection] = _named(header, data)
                elif operation == RecordType.MSGDATA and connection in connections:
                    yield ScannedMessage(*connections[connection], header.get_time("time"), data, share)


def _records(stream: BinaryIO) -> Iterator[tuple[Header, bytes]]:
    """(header, data) of each record, as long as they are whole."""
    from rosbags.rosbag1.reader import Header, ReaderError, read_bytes, read_uint32

    while True:
        try:
            header = Header.read(stream)
            yield header, read_bytes(stream, read_uint32(stream))
        except ReaderError:
            return


def _named(header: Header, data: bytes) -> tuple[str, str]:
    """Topic and type of a connection."""
    from rosbags.rosbag1.reader import Header as Fields
    from rosbags.typesys.msg import normalize_msgtype

    fields = Fields.read(io.BytesIO(len(data).to_bytes(4, "little") + data))
    return header.get_string("topic"), normalize_msgtype(fields.get_string("type"))
