"""Writes the topics of the public bags: what bags of ROS 1 and ROS 2 share."""

from __future__ import annotations

from abc import abstractmethod
from itertools import pairwise
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from ...events.arrays import EventArray, concatenate_events
from . import ros_messages as messages
from .destination import Destination
from .interface import EventWriter, Failing
from .parts import CameraLike, check_map

_MOST_WAITING = 16 << 20
"""Bytes of messages that wait for the events before them."""


class RosWriter(EventWriter):
    """Writes events as messages, and what else a DAVIS gives, each on its topic of the public bags.

    Events are gathered into messages of up to ``message_us`` and ``message_events``. A message's time is that of its
    last event, or its own; ROS has no time 0, so a bag's time is at least 1 ns (stamps inside of messages are exact).
    Messages of other topics may be written at any moment. Where they come in order of time with the events, the bag is
    in order of time too: they wait for the events' message of their interval.

    Args:
        message_us: length of the interval that the events of one message lie in, in microseconds.
        message_events: most events of one message.
        frame_id: of all messages but poses, which are in "world".
    """

    def __init__(
        self,
        destination: Destination,
        *,
        version: Literal[1, 2],
        message_us: int,
        message_events: int,
        frame_id: str,
    ) -> None:
        destination.path("a bag needs a file: it")
        if message_us < 1 or message_events < 1:
            raise ValueError(f"a message must hold at least 1 us and 1 event: got {message_us}, {message_events}")
        super().__init__(destination)
        self._store = messages.typestore(version)
        self._version = version
        self._message_us, self._message_events, self._frame_id = message_us, message_events, frame_id
        self._waiting: list[EventArray] = []
        self._count = self._interval = 0
        self._others: list[tuple[int, messages.Topic, bytes]] = []
        self._others_bytes = 0
        self._sequences: dict[str, int] = {}
        self._camera: CameraLike | None = None
        self._camera_us = -1

    def write_image(self, t_us: int, image: npt.NDArray[np.uint8]) -> None:
        """Write an intensity frame: uint8, shape (height, width). With it goes the calibration, if one was written, as
        the drivers do it."""
        width, height = self.size
        check_map("an image", image, (height, width), np.uint8)
        if self._camera is not None and self._camera_us != t_us:
            self.write_camera(t_us, self._camera)
        self._message(messages.IMAGES, t_us, **messages.image_fields(image, "mono8"))

    def write_depth(self, t_us: int, depth: npt.NDArray[np.float32]) -> None:
        """Write a depth map: float32, shape (height, width), metres along the optical axis."""
        width, height = self.size
        check_map("an image", depth, (height, width), np.float32)
        self._message(messages.DEPTH, t_us, **messages.image_fields(depth, "32FC1"))

    def write_flow(self, t_us: int, flow: npt.NDArray[np.float32]) -> None:
        """Write a map of optical flow: float32, shape (height, width, 2), pixels per second (x right, y down)."""
        width, height = self.size
        check_map("an image", flow, (height, width, 2), np.float32)
        self._message(messages.FLOW, t_us, **messages.image_fields(flow, "32FC2"))

    def write_camera(self, t_us: int, camera: CameraLike) -> None:
        """Write a calibration (a :class:`davis_rs.Camera`), as ``plumb_bob``: k1, k2, p1, p2, k3. It is written again
        with each intensity frame that follows."""
        self._message(messages.CAMERA, t_us, **messages.camera_fields(self._store, camera))
        self._camera, self._camera_us = camera, t_us

    def write_imu(self, t_us: int, acceleration: npt.ArrayLike, angular_velocity: npt.ArrayLike) -> None:
        """Write an IMU sample: specific force in m/s^2 and rate in rad/s, each of shape (3,)."""
        self._message(messages.INERTIAL, t_us, **messages.imu_fields(self._store, acceleration, angular_velocity))

    def write_pose(self, t_us: int, position: npt.ArrayLike, quaternion: npt.ArrayLike) -> None:
        """Write a pose of the camera, T_world_camera: metres, and (x, y, z, w)."""
        fields = messages.pose_fields(self._store, position, quaternion)
        self._message(messages.POSES, t_us, frame_id="world", **fields)

    @abstractmethod
    def _put(self, topic: messages.Topic, t_us: int, data: bytes) -> None:
        """Write the bytes of one message at its time."""

    @abstractmethod
    def _pack(self, events: EventArray, sequence: int) -> tuple[messages.Topic, bytes]:
        """Return a message of events."""

    @abstractmethod
    def _serialize(self, message: Any, type_: str) -> bytes:
        """Return the bytes of a message."""

    def _message(self, topic: messages.Topic, t_us: int, *, frame_id: str | None = None, **fields: Any) -> None:
        """Write one message of a topic other than the events'."""
        if not 0 <= t_us <= self._limits.latest_us:
            raise ValueError(f"a time of ROS must lie in 0..{self._limits.latest_us} us: got {t_us}")
        with self._turn:
            self._refuse_if_over()
            head = messages.header(
                self._store, self._next(topic.name), t_us, self._frame_id if frame_id is None else frame_id
            )
            data = self._serialize(self._store.types[topic.type](header=head, **fields), topic.type)
            with Failing(self):
                if self._count and t_us // self._message_us > self._interval:
                    self._send()
                if not self._count:
                    self._put(topic, t_us, data)
                    return
                self._others.append((t_us, topic, data))
                self._others_bytes += len(data)
                if self._others_bytes > _MOST_WAITING:
                    self._send()

    def _next(self, topic: str) -> int:
        """Return the number of the topic's next message."""
        sequence = self._sequences.get(topic, 0)
        self._sequences[topic] = sequence + 1
        return sequence

    def _encode(self, packet: EventArray) -> None:
        # Where the interval changes: cut there, and where a message is full.
        intervals = packet["t"] // self._message_us
        cuts = [0, *(np.flatnonzero(intervals[1:] != intervals[:-1]) + 1).tolist(), len(packet)]
        for first, end in pairwise(cuts):
            if self._count and intervals[first] != self._interval:
                self._send()
            self._interval = int(intervals[first])
            while first < end:
                piece = packet[first : min(end, first + self._message_events - self._count)]
                first += len(piece)
                self._count += len(piece)
                self._waiting.append(piece)
                if self._count == self._message_events:
                    self._send()
        # The caller's array may change before the message is full.
        self._waiting = [concatenate_events(self._waiting)] if self._waiting else []

    def _send(self) -> None:
        """Write the events that wait, and what waits for them, in order of time."""
        if not self._count:
            return
        events = concatenate_events(self._waiting) if len(self._waiting) > 1 else self._waiting[0]
        self._waiting, self._count = [], 0
        topic, data = self._pack(events, self._next(messages.EVENTS.name))
        others, self._others, self._others_bytes = self._others, [], 0
        for t_us, kind, message in sorted([*others, (int(events["t"][-1]), topic, data)], key=lambda item: item[0]):
            self._put(kind, t_us, message)
