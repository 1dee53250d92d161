"""Reads ROS 1 bags: ours, and those of the public Event-Camera Dataset."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._core import DecodeError, unpack_event_message
from ..._util.untrusted import decoding, guarded
from ...events.arrays import EventArray, concatenate_events
from . import ros_messages as topics
from .bag_index import bag_index
from .bag_records import scan_messages
from .blocks import BlockPosition, Blocks, blocks_of, refuse
from .interface import warn_truncated
from .reading import ReadRules
from .ros_events import PacketDecoder
from .ros_reader import RawMessage, RosReader, Wanted

if TYPE_CHECKING:
    from rosbags.rosbag1 import Reader


class BagReader(RosReader):
    """Reads a bag of ROS 1; see :class:`RosReader`.

    A bag without an index (its writer was killed) is read from its beginning to its last whole message, with a
    :class:`~davis_rs.io.formats.TruncatedFileWarning`.

    Args:
        caller: bags of this caller stamp a message with its last event's time, so that slices need not read all.

    Raises:
        ImportError: without rosbags, with the extra that brings it.
        DecodeError: if it is no bag, or has no events.
    """

    version = 1
    event_types = (topics.EVENTS.type, topics.EVENT_PACKETS)

    def __init__(self, path: Path, *, format: str, caller: str, rules: ReadRules) -> None:
        path.open("rb").close()  # the system's own error, where there is one
        self.path = path
        self._done = 0.0
        self._scanned: set[str] | None = None
        self._limit = rules.max_packet_bytes
        self._caller = caller
        self._reader: Reader | None = bag_index(path, self._limit)
        try:
            with decoding(path, "the index"):
                try:
                    self._reader.open()
                except Exception as error:
                    if "not indexed" not in str(error):
                        raise
                    self._reader = None
            if self._reader is None:
                warn_truncated(path, "the bag was never finished and has no index; what is whole in it is read")
            with decoding(path):
                size = self._first_size()
        except BaseException:
            self.close()
            raise
        super().__init__(path, format=format, size=size, rules=rules)

    @property
    def progress(self) -> float:
        return self._done

    def close(self) -> None:
        if self._reader is not None and self._reader.bio is not None:
            self._reader.close()

    def _names(self) -> set[str]:
        if self._reader is not None:
            return {connection.topic for connection in self._reader.connections}
        if self._scanned is None:
            self._scanned = {message.topic for message in scan_messages(self.path, self._limit)}
        return self._scanned

    def _packets(self, chunk: int, start_us: int | None, stop_us: int | None) -> Iterator[EventArray]:
        yield from super()._packets(chunk, start_us, stop_us)
        self._done = 1.0

    def _deserialize(self, raw: RawMessage) -> Any:
        return topics.typestore(1).deserialize_ros1(raw.data, raw.type)

    def blocks(self) -> Blocks:
        """Read the bag once: a block is all messages of one of its times."""
        if self._reader is None:
            refuse(self.path, "the bag has no index")
        times: list[list[int]] = []  # time of the messages in ns, number of their events, first event's time
        last_us, number = 0, 0
        for raw in guarded(self.path, self._raw(_is_events)):
            if raw.type == topics.EVENT_PACKETS:
                refuse(self.path, "times of encoded packets follow from those before them")
            events = self._event_array(raw)[0]
            if not len(events):
                continue
            first_us = int(events["t"][0])
            if first_us < last_us:
                raise DecodeError(
                    f"{self.path}: times may not go back: event {number} is at {first_us} us, after {last_us} us"
                )
            last_us, number = int(events["t"][-1]), number + len(events)
            if times and times[-1][0] == raw.t_ns:
                times[-1][1] += len(events)
            else:
                times.append([raw.t_ns, len(events), first_us])
        table = np.array(times, np.int64).reshape(-1, 3)
        return blocks_of(table[:, 1], table[:, 2], table[:, 0], last_us)

    def read_block(self, position: BlockPosition, events: int) -> EventArray:
        if self._reader is None:
            refuse(self.path, "the bag has no index")
        connections = [c for c in self._reader.connections if _is_events(c.topic, c.msgtype)]
        messages = self._reader.messages(connections, start=int(position[0]), stop=int(position[0]) + 1)
        raws = (RawMessage(c.topic, c.msgtype, t_ns, data) for c, t_ns, data in messages)
        return concatenate_events([self._event_array(raw)[0] for raw in raws])

    def _unpack(self, raw: RawMessage, packets: PacketDecoder) -> tuple[EventArray, tuple[int, int]]:
        if raw.type == topics.EVENT_PACKETS:
            return packets.unpack(self._deserialize(raw))
        return self._event_array(raw)

    def _event_array(self, raw: RawMessage) -> tuple[EventArray, tuple[int, int]]:
        try:
            return unpack_event_message(raw.data)
        except DecodeError as error:
            raise DecodeError(f"{self.path}: {error}") from error

    def _raw(self, wanted: Wanted, start_us: int | None = None, stop_us: int | None = None) -> Iterator[RawMessage]:
        events = any(wanted("", type_) for type_ in self.event_types)  # progress is told of events
        if self._reader is None:
            for message in scan_messages(self.path, self._limit):
                if wanted(message.topic, message.type):
                    if events:
                        self._done = message.fraction
                    yield RawMessage(message.topic, message.type, message.t_ns, message.data)
            return
        connections = [c for c in self._reader.connections if wanted(c.topic, c.msgtype)]
        if not connections:
            return
        ours = all(getattr(c.ext, "callerid", None) == self._caller for c in connections)
        start_ns = None if start_us is None or not ours else start_us * 1000
        first, last = self._reader.start_time, max(self._reader.end_time, self._reader.start_time + 1)
        for connection, t_ns, data in self._reader.messages(connections, start=start_ns):
            if events:
                self._done = (t_ns - first) / (last - first)
            yield RawMessage(connection.topic, connection.msgtype, t_ns, data)
            # A message of ours holds nothing before the one ahead of it.
            if ours and stop_us is not None and t_ns > stop_us * 1000:
                return


def _is_events(_: str, type_: str) -> bool:
    return type_ in BagReader.event_types
