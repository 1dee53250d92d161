"""Reads the topics of the public bags: what bags of ROS 1 and ROS 2 share."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from ..._core import DecodeError
from ..._util.array_types import UncheckedArray
from ..._util.untrusted import decoding, guarded
from ...events.arrays import EventArray
from . import ros_messages as topics
from .interface import EventReader
from .parts import Calibration, ImuSample, PoseSample
from .ros_events import PacketDecoder


class RawMessage(NamedTuple):
    """A message as its bag has it."""

    topic: str
    type: str
    t_ns: int
    data: bytes


Wanted = Callable[[str, str], bool]
"""Whether the messages of a (topic, type) are wanted."""


class RosReader(EventReader):
    """Reads the events of all messages of events of a bag, in the order of the bag's times, and its other topics.

    A topic that is not named is the public Event-Camera Dataset's or, where a bag lacks it, that of its simulator or of
    MVSEC. Stamps are ROS times; those of wall-clock recordings have nanoseconds and are rounded to the nearest
    microsecond.
    """

    version: ClassVar[Literal[1, 2]]
    event_types: ClassVar[tuple[str, ...]]
    """Types of messages that hold events."""

    def images(self, topic: str | None = None) -> Iterator[tuple[int, npt.NDArray[np.uint8]]]:
        """Yield intensity frames as (t_us, uint8 (height, width)).

        Raises:
            DecodeError: for an encoding other than mono8 or 8UC1.
        """
        for t_us, message in self._of(topics.IMAGES, topic):
            yield t_us, self._pixels(message, np.dtype("u1"), ("mono8", "8UC1"))

    def depth_maps(self, topic: str | None = None) -> Iterator[tuple[int, npt.NDArray[np.float32]]]:
        """Yield depth maps as (t_us, float32 (height, width) in metres).

        Raises:
            DecodeError: for an encoding other than 32FC1.
        """
        for t_us, message in self._of(topics.DEPTH, topic):
            yield t_us, self._pixels(message, np.dtype("f4"), ("32FC1",))

    def flow_maps(self, topic: str | None = None) -> Iterator[tuple[int, npt.NDArray[np.float32]]]:
        """Yield maps of optical flow as (t_us, float32 (height, width, 2) in pixels per second).

        Raises:
            DecodeError: for an encoding other than 32FC2.
        """
        for t_us, message in self._of(topics.FLOW, topic):
            yield t_us, self._pixels(message, np.dtype("f4"), ("32FC2",), channels=2)

    def imu(self, topic: str | None = None) -> Iterator[ImuSample]:
        """Yield IMU samples."""
        for t_us, message in self._of(topics.INERTIAL, topic):
            a, w = message.linear_acceleration, message.angular_velocity
            yield ImuSample(t_us, np.array([a.x, a.y, a.z]), np.array([w.x, w.y, w.z]))

    def poses(self, topic: str | None = None) -> Iterator[PoseSample]:
        """Yield poses, of whatever frames the bag's topic is in."""
        for t_us, message in self._of(topics.POSES, topic):
            p, q = message.pose.position, message.pose.orientation
            yield PoseSample(t_us, np.array([p.x, p.y, p.z]), np.array([q.x, q.y, q.z, q.w]))

    def cameras(self, topic: str | None = None) -> Iterator[tuple[int, Calibration]]:
        """Yield the first calibration as (t_us, calibration), nothing where there is none.

        Raises:
            DecodeError: for a distortion model other than plumb_bob.
        """
        for t_us, message in self._of(topics.CAMERA, topic):
            # The original simulator leaves the model unnamed, with a distortion of zeros.
            if message.distortion_model not in ("plumb_bob", ""):
                raise DecodeError(f"{self.path}: distortion model {message.distortion_model!r}, expected 'plumb_bob'")
            k, d = (getattr(message, "K" if self.version == 1 else "k"), getattr(message, "D", None))
            d = message.d if d is None else d
            k, d = k.tolist(), d.tolist()[:5]
            yield t_us, Calibration(message.width, message.height, k[0], k[4], k[2], k[5], *d)
            return

    def camera(self, topic: str | None = None) -> Calibration | None:
        """Return the first calibration, None where there is none; see :meth:`cameras`."""
        return next((calibration for _, calibration in self.cameras(topic)), None)

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        """Yield all messages of a topic as (t_us of its header's stamp, message as rosbags has it)."""
        for raw in guarded(self.path, self._raw(lambda name, _: name == topic)):
            with decoding(self.path, f"a message of {topic}"):
                message = self._deserialize(raw)
                t_us = topics.stamp_us(message.header.stamp)
            yield t_us, message

    @abstractmethod
    def _names(self) -> set[str]:
        """Return the topics that there are."""

    @abstractmethod
    def _raw(self, wanted: Wanted, start_us: int | None = None, stop_us: int | None = None) -> Iterator[RawMessage]:
        """Yield the messages that are wanted; of a slice of time where it can be told."""

    @abstractmethod
    def _deserialize(self, raw: RawMessage) -> Any:
        """Return a message as rosbags has it."""

    @abstractmethod
    def _unpack(self, raw: RawMessage, packets: PacketDecoder) -> tuple[EventArray, tuple[int, int]]:
        """Return the events of a message, and the sensor's size as it says it."""

    def _of(self, kind: topics.Topic, topic: str | None) -> Iterator[tuple[int, Any]]:
        if topic is None:
            names = self._names()
            topic = next((name for name in (kind.name, *kind.others) if name in names), kind.name)
        return self.messages(topic)

    def _is_events(self, _: str, type_: str) -> bool:
        return type_ in self.event_types

    def _packets(self, chunk: int, start_us: int | None, stop_us: int | None) -> Iterator[EventArray]:
        packets = PacketDecoder(self.path)
        for raw in self._raw(self._is_events, start_us, stop_us):
            events = self._unpack(raw, packets)[0]
            for start in range(0, len(events), chunk):
                yield events[start : start + chunk]

    def _first_size(self) -> tuple[int, int] | None:
        for raw in self._raw(self._is_events):
            width, height = self._unpack(raw, PacketDecoder(self.path))[1]
            return (width, height) if width and height else None
        return None

    def _pixels(
        self, message: Any, dtype: np.dtype[np.generic], encodings: tuple[str, ...], channels: int = 1
    ) -> UncheckedArray:
        if message.encoding not in encodings:
            raise DecodeError(f"{self.path}: image encoding {message.encoding!r}, expected {' or '.join(encodings)}")
        row = message.width * dtype.itemsize * channels
        if message.step < row or message.data.size != message.step * message.height:
            raise DecodeError(
                f"{self.path}: an image of {message.width} x {message.height} has {message.data.size} bytes"
            )
        rows = np.ascontiguousarray(message.data.reshape(message.height, message.step)[:, :row])
        pixels = rows.view(dtype.newbyteorder(">" if message.is_bigendian else "<")).astype(dtype)
        return pixels if channels == 1 else pixels.reshape(message.height, message.width, channels)
