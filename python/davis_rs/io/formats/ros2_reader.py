"""Reads rosbag2: folders and single files, in SQLite or MCAP."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ..._core import DecodeError
from ..._util.untrusted import decoding, guarded
from ...events.arrays import EventArray
from . import ros_messages as topics
from .bag_records import ScannedMessage
from .interface import warn_truncated
from .mcap_records import McapScan
from .reading import ReadRules
from .ros_events import PacketDecoder, unpack_event_array
from .ros_reader import RawMessage, RosReader, Wanted
from .sqlite_records import SqliteScan
from .unpack import unpack_zstd

METADATA = "metadata.yaml"
_ZSTD = b"\x28\xb5\x2f\xfd"


def storage_files(path: Path) -> list[Path]:
    """Return the files of a rosbag2 that hold its messages, in their order: those of a folder, or the file itself."""
    if not path.is_dir():
        return [path]

    def numbers(file: Path) -> list[int]:
        return [int(number) for number in re.findall(r"\d+", file.stem)]

    return sorted((file for file in path.iterdir() if file.suffix in (".mcap", ".db3")), key=numbers)


class Ros2Reader(RosReader):
    """Reads a rosbag2; see :class:`RosReader`. Events are ``dvs_msgs/EventArray`` or ``event_camera_msgs/EventPacket``.

    What a killed writer has left is read up to its last whole message, with a
    :class:`~davis_rs.io.formats.TruncatedFileWarning`. Chunks and messages may be compressed, whole files not.

    Raises:
        ImportError: without rosbags, with the extra that brings it.
        DecodeError: if it is no rosbag2.
    """

    version = 2
    event_types = (topics.EVENTS.type, topics.EVENT_PACKETS)

    def __init__(self, path: Path, *, format: str, rules: ReadRules) -> None:
        self._store = topics.typestore(2)
        self._done = 0.0
        self._limit = rules.max_packet_bytes
        self.path = path
        files = storage_files(path)
        if not files:
            raise DecodeError(f"{path}: a rosbag2 must have a file .mcap or .db3 (ones that end in .zstd: unpack them)")
        with decoding(path):
            self._scans: list[McapScan | SqliteScan] = [
                (McapScan if file.suffix == ".mcap" else SqliteScan)(file, self._limit) for file in files
            ]
            self._topics = {name: type_ for scan in self._scans for name, type_ in scan.topics().items()}
            size = self._first_size()
        super().__init__(path, format=format, size=size, rules=rules)
        if not all(scan.whole for scan in self._scans) or (path.is_dir() and not (path / METADATA).exists()):
            warn_truncated(path, "the bag was never finished; what is whole in it is read")

    @property
    def progress(self) -> float:
        return self._done

    def _names(self) -> set[str]:
        return set(self._topics)

    def _packets(self, chunk: int, start_us: int | None, stop_us: int | None) -> Iterator[EventArray]:
        yield from super()._packets(chunk, start_us, stop_us)
        self._done = 1.0

    def _deserialize(self, raw: RawMessage) -> Any:
        return self._store.deserialize_cdr(raw.data, raw.type)

    def _unpack(self, raw: RawMessage, packets: PacketDecoder) -> tuple[EventArray, tuple[int, int]]:
        if raw.type == topics.EVENT_PACKETS:
            with decoding(self.path, f"a message of {raw.topic}"):
                return packets.unpack(self._deserialize(raw))
        return unpack_event_array(self.path, raw.data)

    def _raw(self, wanted: Wanted, start_us: int | None = None, stop_us: int | None = None) -> Iterator[RawMessage]:
        if not any(wanted(name, type_) for name, type_ in self._topics.items()):
            return
        events = any(wanted("", type_) for type_ in self.event_types)  # progress is told of events
        for number, scan in enumerate(self._scans):
            for message in guarded(self.path, scan.messages()):
                if wanted(message.topic, message.type):
                    if events:
                        self._done = (number + message.fraction) / len(self._scans)
                    yield self._unpacked(message)

    def _unpacked(self, message: ScannedMessage) -> RawMessage:
        data = message.data
        if data.startswith(_ZSTD):  # where CDR has 00 00 or 00 01
            data = unpack_zstd(self.path, data, self._limit)
        return RawMessage(message.topic, message.type, message.t_ns, data)
