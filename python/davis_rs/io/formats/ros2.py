"""Writes rosbag2: bags of ROS 2 with the topics of the public Event-Camera Dataset."""

from __future__ import annotations

import errno
import os
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..._util.argument_error import ArgumentError, OverwriteError
from ..._util.extras import from_extra, require
from ...events.arrays import EventArray
from . import mcap_records, ros_messages, sqlite_records
from .destination import Destination, Limits, naming
from .interface import Format
from .parts import ALL_PARTS
from .reading import ReadRules
from .ros2_reader import METADATA, Ros2Reader, storage_files
from .ros_events import LATEST_US, pack_event_array, packet_message
from .ros_writer import RosWriter

if TYPE_CHECKING:
    from rosbags.interfaces import Connection

STORAGES = ("sqlite3", "mcap")
MESSAGES = ("dvs_msgs", "event_camera_msgs")
_FLUSH = 4 << 20
"""Bytes of messages between two commits of a database that come by themselves."""
_MOST_EVT3 = 2048
"""Pixels of a side."""


class Ros2Writer(RosWriter):
    """Writes a rosbag2; see :class:`RosWriter` for topics and times.

    A path that ends in ``.mcap`` becomes one file of MCAP, any other a folder with ``metadata.yaml``, as ``ros2 bag
    record`` makes it. A killed process leaves a bag without its metadata, up to the last megabytes or :meth:`flush`:
    :func:`davis_rs.read_events` reads it as it is, other programs after ``ros2 bag reindex`` or ``mcap recover``.

    Args:
        message_us, message_events, frame_id: see :class:`RosWriter`.
        storage: of a folder, "sqlite3" or "mcap".
        messages: of events: "dvs_msgs" (``EventArray``) or "event_camera_msgs" (``EventPacket`` in EVT 3.0, for sensors
            of up to 2048 x 2048 pixels).

    Sources: https://github.com/ros2/rosbag2; https://mcap.dev/spec.
    """

    def __init__(
        self,
        destination: Destination,
        *,
        message_us: int = 10_000,
        message_events: int = 1 << 16,
        frame_id: str = "dvs",
        storage: str | None = None,
        messages: str = "dvs_msgs",
    ) -> None:
        single = not destination.is_stream and _is_single(destination.path())
        storage = storage or ("mcap" if single else "sqlite3")
        if storage not in STORAGES or (single and storage != "mcap"):
            raise ArgumentError(
                "{storage} must be one of {}, and mcap for a file .mcap: got {!r}", ", ".join(STORAGES), storage
            )
        if messages not in MESSAGES:
            raise ArgumentError("{messages} must be one of {}: got {!r}", ", ".join(MESSAGES), messages)
        self._evt3 = messages == "event_camera_msgs"
        if self._evt3 and max(destination.size) > _MOST_EVT3:
            raise ValueError(
                f"EVT 3.0 holds sensors of up to {_MOST_EVT3} x {_MOST_EVT3} pixels: got {destination.size}"
            )
        super().__init__(
            destination,
            version=2,
            message_us=message_us,
            message_events=message_events,
            frame_id=frame_id,
        )
        with from_extra("ros"):
            from rosbags.rosbag2 import StoragePlugin, Writer
        self._connections: dict[ros_messages.Topic, Connection] = {}
        self._unflushed = 0
        self._is_sqlite = storage == "sqlite3"
        path = destination.path()
        _require_room(path, overwrite=destination.overwrite)
        _make_room(path)
        plugin = StoragePlugin[storage.upper()]
        with naming(path):
            if single:
                # rosbags makes a folder with the file in it.
                with tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.name}-") as scratch:
                    self._bag = Writer(Path(scratch) / "bag", version=9, storage_plugin=plugin)
                    self._bag.open()
                    os.replace(self._bag.storage.path, path)
                self._bag.storage.path = path
            else:
                self._bag = Writer(path, version=9, storage_plugin=plugin)
                self._bag.open()
                if self._is_sqlite:
                    # Pages of a transaction stay in memory until it is committed, so that a killed process leaves
                    # whole transactions; a power cut is not what a flush is for.
                    self._bag.storage.conn.execute("PRAGMA cache_spill = OFF")
                    self._bag.storage.conn.execute("PRAGMA synchronous = OFF")
            self._connection(self._events_topic)
            self._hand_over()

    @property
    def _events_topic(self) -> ros_messages.Topic:
        return ros_messages.EVENTS._replace(type=ros_messages.EVENT_PACKETS) if self._evt3 else ros_messages.EVENTS

    def _pack(self, events: EventArray, sequence: int) -> tuple[ros_messages.Topic, bytes]:
        if self._evt3:
            message = packet_message(self._store, events, self.size, sequence, self._frame_id)
            return self._events_topic, self._serialize(message, ros_messages.EVENT_PACKETS)
        return self._events_topic, pack_event_array(events, self.size, self._frame_id)

    def _serialize(self, message: Any, type_: str) -> bytes:
        return bytes(self._store.serialize_cdr(message, type_))

    def _connection(self, topic: ros_messages.Topic) -> Connection:
        if topic not in self._connections:
            self._connections[topic] = self._bag.add_connection(topic.name, topic.type, typestore=self._store)
        return self._connections[topic]

    def _put(self, topic: ros_messages.Topic, t_us: int, data: bytes) -> None:
        with self._telling():
            self._bag.write(self._connection(topic), max(1, t_us * 1000), data)
            self._unflushed += len(data)
            if self._unflushed > _FLUSH:
                self._hand_over()

    def _hand_over(self) -> None:
        storage = self._bag.storage
        if self._is_sqlite:
            storage.conn.commit()
        else:
            if storage.chunk.bio.tell():
                storage.close_chunk()
            storage.bio.flush()
        self._unflushed = 0

    def _flush(self) -> None:
        self._send()
        with self._telling():
            self._hand_over()

    def _close(self) -> int:
        self._send()
        path = Path(self.path)
        with self._telling():
            if path.is_dir():
                self._bag.close()
            else:
                with tempfile.TemporaryDirectory() as scratch:  # of what would stand in the folder
                    self._bag.metapath = Path(scratch) / METADATA
                    self._bag.close()
            return sum(file.stat().st_size for file in storage_files(path))

    def _abandon(self) -> None:
        with suppress(Exception):
            self._bag.abort()

    @contextmanager
    def _telling(self) -> Iterator[None]:
        """Raise an OSError with the path for what the system refuses, also through SQLite."""
        try:
            with naming(self.path):
                yield
        except sqlite3.OperationalError as error:
            number = errno.ENOSPC if "full" in str(error) else errno.EIO
            raise OSError(number, f"{os.strerror(number)} ({error})", self.path) from error


def _is_single(path: Path) -> bool:
    """Return whether a rosbag2 of this name is one file of MCAP, and not a folder."""
    return path.suffix.lower() == ".mcap"


def _require_room(path: Path, *, overwrite: bool) -> None:
    """Refuse what exists, but for a bag that may be replaced.

    Raises:
        FileExistsError: without ``overwrite``, and for anything else than a rosbag2.
        FileNotFoundError: if there is no folder for it.
    """
    if not os.path.lexists(path):
        if not path.parent.is_dir():
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
        return
    if not overwrite:
        raise OverwriteError(path, "it exists; {overwrite:True} replaces it")
    single = _is_single(path)
    if single and path.is_file():
        return
    entries = list(path.iterdir()) if path.is_dir() else []
    if (
        single
        or not path.is_dir()
        or not all(file == path / METADATA or file in storage_files(path) for file in entries)
    ):
        raise FileExistsError(errno.EEXIST, "will not overwrite: no rosbag2 is there", str(path))


def _make_room(path: Path) -> None:
    """Remove the folder of a rosbag2."""
    if path.is_dir():
        for file in path.iterdir():
            file.unlink()
        path.rmdir()


class Ros2Format(Format):
    """Describes rosbag2, of ROS 2."""

    name = "ros2"
    suffixes = (".mcap",)
    options = ("message_us", "message_events", "frame_id", "storage", "messages")
    holds = ALL_PARTS
    writer = Ros2Writer
    limits = Limits(latest_us=LATEST_US)

    def sniff(self, head: bytes, path: Path) -> bool:
        if head.startswith(mcap_records.MAGIC):
            return True
        return path.suffix == ".db3" and head.startswith(sqlite_records.MAGIC)

    def sniff_folder(self, path: Path) -> bool:
        return bool(storage_files(path)) or (path / METADATA).is_file()

    def require_libraries(self, **_: object) -> None:
        require("ros", "rosbags")

    def require_room(self, path: Path, *, overwrite: bool) -> None:
        _require_room(path, overwrite=overwrite)

    def make_room(self, path: Path) -> None:
        _make_room(path)

    def open_reader(self, path: str | os.PathLike[str], rules: ReadRules = ReadRules()) -> Ros2Reader:  # noqa: B008
        return Ros2Reader(Path(path), format=self.name, rules=rules)
