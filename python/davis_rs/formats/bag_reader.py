"""Reading ROS 1 bags: ours, and those of the public Event-Camera Dataset."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .._core import DecodeError, unpack_event_message
from ..events import EventArray
from ..untrusted import decoding, guarded
from . import bag_messages as topics
from .bag_records import scan_messages, unpackers
from .extras import from_extra
from .interface import EventReader, warn_truncated
from .reading import ReadRules

if TYPE_CHECKING:
    from rosbags.rosbag1 import Reader


class BagReader(EventReader):
    """Reads the events of all ``dvs_msgs/EventArray`` of a bag, in the order of the bag's times, and its other topics.

    Stamps are ROS times; those of wall-clock recordings have nanoseconds and are rounded to the nearest microsecond.
    A bag without an index (its writer was killed) is read from its beginning to its last whole message, with a
    :class:`~davis_rs.formats.TruncatedFileWarning`.

    Args:
        caller: bags of this caller stamp a message with its last event's time, so that slices need not read all.

    Raises:
        ImportError: without rosbags, with the extra that brings it.
        DecodeError: if it is no bag, or has no events.
    """

    def __init__(self, path: Path, *, format: str, caller: str, rules: ReadRules) -> None:
        with from_extra("ros"):
            from rosbags.rosbag1 import Reader
        path.open("rb").close()  # the system's own error, where there is one
        self._reader: Reader | None = Reader(path)
        self._done = 0.0
        self._limit = rules.max_packet_bytes
        with decoding(path, "the index"):
            try:
                self._reader.open()
            except Exception as error:
                if "not indexed" not in str(error):
                    raise
                self._reader = None
        if self._reader is None:
            warn_truncated(path, "the bag was never finished and has no index; what is whole in it is read")
        else:
            self._limit_chunks(self._reader)
        self._caller = caller
        self.path = path
        try:
            with decoding(path):
                size = self._first_size()
        except BaseException:
            self.close()
            raise
        super().__init__(path, format=format, size=size, rules=rules)

    def _limit_chunks(self, reader: Reader) -> None:
        """Have a bag's chunks unpacked to no more than the limit."""
        from rosbags.rosbag1.reader import decompressors

        path = Path(reader.path)
        limited = unpackers(path, self._limit)
        names = {id(decompressor): name for name, decompressor in decompressors.items()}
        size = path.stat().st_size
        for place, chunk in reader.chunks.items():
            if chunk.datasize > size:
                raise DecodeError(f"{path}: a chunk of {chunk.datasize} bytes goes beyond the file's end")
            reader.chunks[place] = chunk._replace(decompressor=limited[names[id(chunk.decompressor)]])

    @property
    def progress(self) -> float:
        return self._done

    def close(self) -> None:
        if self._reader is not None and self._reader.bio is not None:
            self._reader.close()

    def images(self, topic: str = topics.IMAGES[0]) -> Iterator[tuple[int, npt.NDArray[np.uint8]]]:
        """Intensity frames as (t_us, uint8 (height, width)).

        Raises:
            DecodeError: for an encoding other than mono8 or 8UC1.
        """
        for t_us, message in self.messages(topic):
            yield t_us, self._pixels(message, np.dtype("u1"), ("mono8", "8UC1"))

    def depth_maps(self, topic: str = topics.DEPTH[0]) -> Iterator[tuple[int, npt.NDArray[np.float32]]]:
        """Depth maps as (t_us, float32 (height, width) in metres).

        Raises:
            DecodeError: for an encoding other than 32FC1.
        """
        for t_us, message in self.messages(topic):
            yield t_us, self._pixels(message, np.dtype("f4"), ("32FC1",))

    def imu(self, topic: str = topics.INERTIAL[0]) -> Iterator[topics.ImuSample]:
        """IMU samples."""
        for t_us, message in self.messages(topic):
            a, w = message.linear_acceleration, message.angular_velocity
            yield topics.ImuSample(t_us, np.array([a.x, a.y, a.z]), np.array([w.x, w.y, w.z]))

    def poses(self, topic: str = topics.POSES[0]) -> Iterator[topics.PoseSample]:
        """Poses, of whatever frames the bag's topic is in."""
        for t_us, message in self.messages(topic):
            p, q = message.pose.position, message.pose.orientation
            yield topics.PoseSample(t_us, np.array([p.x, p.y, p.z]), np.array([q.x, q.y, q.z, q.w]))

    def camera(self, topic: str = topics.CAMERA[0]) -> topics.Calibration | None:
        """The first calibration, None where there is none.

        Raises:
            DecodeError: for a distortion model other than plumb_bob.
        """
        for _, message in self.messages(topic):
            if message.distortion_model != "plumb_bob":
                raise DecodeError(f"{self.path}: distortion model {message.distortion_model!r}, expected 'plumb_bob'")
            k = message.K.tolist()
            return topics.Calibration(message.width, message.height, k[0], k[4], k[2], k[5], *message.D.tolist()[:5])
        return None

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        """All messages of a topic as (t_us of its header's stamp, message as rosbags has it)."""
        store = topics.typestore()
        for _, type_, _, data in guarded(self.path, self._raw(lambda name, _: name == topic)):
            with decoding(self.path, f"a message of {topic}"):
                message = store.deserialize_ros1(data, type_)
                t_us = topics.stamp_us(message.header.stamp)
            yield t_us, message

    def _packets(self, chunk: int, start_us: int | None, stop_us: int | None) -> Iterator[EventArray]:
        for *_, data in self._raw(_is_events, start_us, stop_us):
            events = self._unpack(data)[0]
            for start in range(0, len(events), chunk):
                yield events[start : start + chunk]
        self._done = 1.0

    def _unpack(self, data: bytes) -> tuple[EventArray, tuple[int, int]]:
        try:
            return unpack_event_message(data)
        except DecodeError as error:
            raise DecodeError(f"{self.path}: {error}") from error

    def _first_size(self) -> tuple[int, int] | None:
        for *_, data in self._raw(_is_events):
            width, height = self._unpack(data)[1]
            return (width, height) if width and height else None
        return None

    def _raw(
        self, wanted: Any, start_us: int | None = None, stop_us: int | None = None
    ) -> Iterator[tuple[str, str, int, bytes]]:
        """(topic, type, time in ns, bytes) of the messages whose (topic, type) is wanted."""
        if self._reader is None:
            for message in scan_messages(self.path, self._limit):
                if wanted(message.topic, message.type):
                    self._done = message.share
                    yield message.topic, message.type, message.t_ns, message.data
            return
        connections = [c for c in self._reader.connections if wanted(c.topic, c.msgtype)]
        if not connections:
            return
        ours = all(getattr(c.ext, "callerid", None) == self._caller for c in connections)
        start_ns = None if start_us is None or not ours else start_us * 1000
        first, last = self._reader.start_time, max(self._reader.end_time, self._reader.start_time + 1)
        for connection, t_ns, data in self._reader.messages(connections, start=start_ns):
            self._done = (t_ns - first) / (last - first)
            yield connection.topic, connection.msgtype, t_ns, data
            # A message of ours holds nothing before the one ahead of it.
            if ours and stop_us is not None and t_ns > stop_us * 1000:
                return

    def _pixels(self, message: Any, dtype: np.dtype[Any], encodings: tuple[str, ...]) -> npt.NDArray[Any]:
        if message.encoding not in encodings:
            raise DecodeError(f"{self.path}: image encoding {message.encoding!r}, expected {' or '.join(encodings)}")
        row = message.width * dtype.itemsize
        if message.step < row or message.data.size != message.step * message.height:
            raise DecodeError(
                f"{self.path}: an image of {message.width} x {message.height} has {message.data.size} bytes"
            )
        rows = np.ascontiguousarray(message.data.reshape(message.height, message.step)[:, :row])
        return rows.view(dtype.newbyteorder(">" if message.is_bigendian else "<")).astype(dtype)


def _is_events(_: str, type_: str) -> bool:
    return type_ == topics.EVENTS[1]
