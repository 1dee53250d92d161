"""Writes ROS 1 bags with the topics of the public Event-Camera Dataset."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..._core import pack_event_message
from ..._util.argument_error import ArgumentError
from ..._util.extras import from_extra, require
from ...events.arrays import EventArray
from . import ros_messages as messages
from .bag_reader import BagReader
from .destination import Destination, Limits, naming
from .interface import Format
from .parts import ALL_PARTS
from .reading import ReadRules
from .ros_writer import RosWriter

if TYPE_CHECKING:
    from rosbags.interfaces import Connection


CALLER = "/davis_rs"
"""Who a bag's connections name: in such a bag a message's time is that of its last event."""

_LATEST_US = 2**32 * 1_000_000 - 1


class BagWriter(RosWriter):
    """Writes a bag of ROS 1, with events as ``dvs_msgs/EventArray``; see :class:`RosWriter` for topics and times.

    A killed process leaves a bag without an index, up to the last megabyte or :meth:`flush`:
    :func:`davis_rs.read_events` reads it as it is, other programs after ``rosbag reindex``.

    Args:
        message_us, message_events, frame_id: see :class:`RosWriter`.
        compression: "none", "lz4" or "bz2".

    Sources: http://wiki.ros.org/Bags/Format/2.0; the topics, Mueggler et al., IJRR 2017.
    """

    def __init__(
        self,
        destination: Destination,
        *,
        message_us: int = 10_000,
        message_events: int = 1 << 16,
        compression: str = "none",
        frame_id: str = "dvs",
    ) -> None:
        if compression not in ("none", "lz4", "bz2"):
            raise ArgumentError("{compression} must be one of none, lz4, bz2: got {!r}", compression)
        with from_extra("ros"):
            from rosbags.rosbag1 import Writer
        super().__init__(
            destination,
            version=1,
            message_us=message_us,
            message_events=message_events,
            frame_id=frame_id,
        )
        self._connections: dict[str, Connection] = {}
        path = destination.claim()
        path.unlink()
        self._bag = Writer(path)
        if compression != "none":
            self._bag.set_compression(Writer.CompressionFormat[compression.upper()])
        with naming(path):
            self._bag.open()
            self._connection(messages.EVENTS)
            self._bag.bio.flush()
        self._whole = path.stat().st_size

    def _pack(self, events: EventArray, sequence: int) -> tuple[messages.Topic, bytes]:
        return messages.EVENTS, pack_event_message(events, self.size, sequence % 2**32, self._frame_id)

    def _serialize(self, message: Any, type_: str) -> bytes:
        return bytes(self._store.serialize_ros1(message, type_))

    def _connection(self, topic: messages.Topic) -> Connection:
        if topic.name not in self._connections:
            self._connections[topic.name] = self._bag.add_connection(
                topic.name, topic.type, typestore=self._store, callerid=CALLER
            )
        return self._connections[topic.name]

    def _put(self, topic: messages.Topic, t_us: int, data: bytes) -> None:
        chunks = len(self._bag.chunks)
        with naming(self.path):
            self._bag.write(self._connection(topic), max(1, t_us * 1000), data)
            if len(self._bag.chunks) > chunks:
                self._hand_over()

    def _hand_over(self) -> None:
        self._bag.bio.flush()
        self._whole = self._bag.bio.tell()

    def _flush(self) -> None:
        self._send()
        with naming(self.path):
            self._bag.write_chunk(self._bag.chunks[-1])
            self._hand_over()

    def _close(self) -> int:
        self._send()
        with naming(self.path):
            self._bag.close()
            return Path(self.path).stat().st_size

    def _abandon(self) -> None:
        """Cut the bag back to its last whole chunk, and end it with an index if there is room for one."""
        bag = self._bag
        with suppress(OSError):
            bag.abort()
        with suppress(OSError):
            os.truncate(self.path, self._whole)
            bag.bio = Path(self.path).open("r+b")  # noqa: SIM115 - the bag closes it
            bag.bio.seek(0, os.SEEK_END)
            bag.chunks = [chunk for chunk in bag.chunks if 0 <= chunk.pos < self._whole]
            bag.close()
        with suppress(OSError):
            bag.abort()


class BagFormat(Format):
    """Describes bags of ROS 1."""

    name = "bag"
    suffixes = (".bag",)
    options = ("message_us", "message_events", "compression", "frame_id")
    holds = ALL_PARTS
    writer = BagWriter
    limits = Limits(latest_us=_LATEST_US)

    def sniff(self, head: bytes, path: Path) -> bool:
        return head.startswith(b"#ROSBAG V2.0\n")

    def require_libraries(self, **_: object) -> None:
        require("ros", "rosbags")

    def open_reader(self, path: str | os.PathLike[str], rules: ReadRules = ReadRules()) -> BagReader:  # noqa: B008
        return BagReader(Path(path), format=self.name, caller=CALLER, rules=rules)
