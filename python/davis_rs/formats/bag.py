"""ROS 1 bags with the topics of the public Event-Camera Dataset."""

from __future__ import annotations

import os
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .._core import pack_event_message
from ..events import EventArray, concatenate_events
from . import bag_messages as messages
from .bag_reader import BagReader
from .extras import from_extra
from .files import claim
from .interface import EventWriter, Failing, Format, Limits, Target
from .reading import ReadRules
from .system import naming

if TYPE_CHECKING:
    from rosbags.interfaces import Connection


CALLER = "/davis_rs"
"""Who a bag's connections name: in such a bag a message's time is that of its last event."""

_LATEST_US = 2**32 * 1_000_000 - 1


class BagWriter(EventWriter):
    """Writes events as ``dvs_msgs/EventArray``, and what else a DAVIS gives, each on its topic of the public bags.

    Events are gathered into messages of up to ``message_us`` and ``message_events``. A message's time is that of its
    last event, or its own; ROS has no time 0, so a bag's time is at least 1 ns (stamps inside of messages are exact).
    Messages of other topics may be written at any moment; readers sort by time.

    A killed process leaves a bag without an index, up to the last megabyte or :meth:`flush`:
    :func:`davis_rs.read_events` reads it as it is, other programs after ``rosbag reindex``.

    Args:
        message_us: events of one message lie in one interval of so many microseconds.
        message_events: most events of one message.
        compression: "none", "lz4" or "bz2".
        frame_id: of all messages but poses, which are in "world".

    Sources: http://wiki.ros.org/Bags/Format/2.0; the topics, Mueggler et al., IJRR 2017.
    """

    def __init__(
        self,
        target: Target,
        *,
        format: str,
        size: tuple[int, int],
        limits: Limits,
        overwrite: bool,
        message_us: int = 10_000,
        message_events: int = 1 << 16,
        compression: str = "none",
        frame_id: str = "dvs",
    ) -> None:
        if not isinstance(target, str | os.PathLike):
            raise ValueError("a bag needs a file: its head is written last")
        if compression not in ("none", "lz4", "bz2"):
            raise ValueError(f"compression must be one of none, lz4, bz2: got {compression!r}")
        if message_us < 1 or message_events < 1:
            raise ValueError(f"a message must hold at least 1 us and 1 event: got {message_us}, {message_events}")
        super().__init__(target, format=format, size=size, limits=limits)
        with from_extra("ros"):
            from rosbags.rosbag1 import Writer
        self._message_us, self._message_events, self._frame_id = message_us, message_events, frame_id
        self._waiting: list[EventArray] = []
        self._count = self._interval = 0
        self._connections: dict[str, Connection] = {}
        self._sequences: dict[str, int] = {}
        path = claim(target, overwrite=overwrite)
        path.unlink()
        self._bag = Writer(path)
        if compression != "none":
            self._bag.set_compression(Writer.CompressionFormat[compression.upper()])
        with naming(path):
            self._bag.open()
            self._connection(messages.EVENTS)
            self._bag.bio.flush()
        self._whole = path.stat().st_size

    def write_image(self, t_us: int, image: npt.NDArray[np.uint8]) -> None:
        """Write an intensity frame: uint8, shape (height, width)."""
        self._image(messages.IMAGES, t_us, image, np.dtype("u1"), "mono8")

    def write_depth(self, t_us: int, depth: npt.NDArray[np.float32]) -> None:
        """Write a depth map: float32, shape (height, width), metres along the optical axis."""
        self._image(messages.DEPTH, t_us, depth, np.dtype("<f4"), "32FC1")

    def write_camera(self, t_us: int, camera: messages.CameraLike) -> None:
        """Write a calibration (a :class:`davis_rs.Camera`), as ``plumb_bob``: k1, k2, p1, p2, k3."""
        intrinsics = np.array([camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1], np.float64)
        projection = np.insert(intrinsics, [3, 6, 9], 0.0)
        region = messages.typestore().types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
        self._message(
            messages.CAMERA,
            t_us,
            height=camera.height,
            width=camera.width,
            distortion_model="plumb_bob",
            D=np.array(camera.distortion, np.float64),
            K=intrinsics,
            R=np.eye(3).ravel(),
            P=projection,
            binning_x=0,
            binning_y=0,
            roi=region,
        )

    def write_imu(self, t_us: int, acceleration: npt.ArrayLike, angular_velocity: npt.ArrayLike) -> None:
        """Write an IMU sample: specific force in m/s^2 and rate in rad/s, each of shape (3,)."""
        types = messages.typestore().types
        vector, unknown = types["geometry_msgs/msg/Vector3"], np.array([-1.0, *[0.0] * 8])
        self._message(
            messages.INERTIAL,
            t_us,
            orientation=types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
            orientation_covariance=unknown,
            angular_velocity=vector(*np.asarray(angular_velocity, np.float64).tolist()),
            angular_velocity_covariance=np.zeros(9),
            linear_acceleration=vector(*np.asarray(acceleration, np.float64).tolist()),
            linear_acceleration_covariance=np.zeros(9),
        )

    def write_pose(self, t_us: int, position: npt.ArrayLike, quaternion: npt.ArrayLike) -> None:
        """Write a pose of the camera, T_world_camera: metres, and (x, y, z, w)."""
        types = messages.typestore().types
        point = types["geometry_msgs/msg/Point"](*np.asarray(position, np.float64).tolist())
        rotation = types["geometry_msgs/msg/Quaternion"](*np.asarray(quaternion, np.float64).tolist())
        posed = types["geometry_msgs/msg/Pose"](position=point, orientation=rotation)
        self._message(messages.POSES, t_us, frame_id="world", pose=posed)

    def _image(
        self, kind: tuple[str, str], t_us: int, image: npt.NDArray[Any], dtype: np.dtype[Any], name: str
    ) -> None:
        width, height = self.size
        if image.shape != (height, width) or image.dtype != dtype:
            raise ValueError(f"an image must be {dtype} of shape {(height, width)}: got {image.dtype}, {image.shape}")
        data = np.frombuffer(np.ascontiguousarray(image).tobytes(), np.uint8)
        step = width * dtype.itemsize
        self._message(kind, t_us, height=height, width=width, encoding=name, is_bigendian=0, step=step, data=data)

    def _message(self, kind: tuple[str, str], t_us: int, *, frame_id: str | None = None, **fields: Any) -> None:
        """Write one message of a topic other than the events'."""
        if not 0 <= t_us <= self._limits.latest_us:
            raise ValueError(f"a time of ROS must lie in 0..{self._limits.latest_us} us: got {t_us}")
        with self._turn:
            self._refuse_if_over()
            topic, type_ = kind
            store = messages.typestore()
            sequence = self._sequences.get(topic, 0)
            head = messages.header(sequence, t_us, self._frame_id if frame_id is None else frame_id)
            data = store.serialize_ros1(store.types[type_](header=head, **fields), type_)
            self._sequences[topic] = sequence + 1
            with Failing(self):
                self._put(self._connection(kind), t_us, bytes(data))

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
        if not self._count:
            return
        events = concatenate_events(self._waiting) if len(self._waiting) > 1 else self._waiting[0]
        self._waiting, self._count = [], 0
        topic = messages.EVENTS[0]
        sequence = self._sequences.get(topic, 0)
        self._sequences[topic] = sequence + 1
        data = pack_event_message(events, self.size, sequence % 2**32, self._frame_id)
        self._put(self._connections[topic], int(events["t"][-1]), data)

    def _connection(self, kind: tuple[str, str]) -> Connection:
        topic, type_ = kind
        if topic not in self._connections:
            self._connections[topic] = self._bag.add_connection(
                topic, type_, typestore=messages.typestore(), callerid=CALLER
            )
        return self._connections[topic]

    def _put(self, connection: Connection, t_us: int, data: bytes) -> None:
        chunks = len(self._bag.chunks)
        with naming(self.path):
            self._bag.write(connection, max(1, t_us * 1000), data)
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
    """ROS 1 bags."""

    name = "bag"
    suffixes = (".bag",)
    options = ("message_us", "message_events", "compression", "frame_id")
    limits = Limits(latest_us=_LATEST_US)

    def sniff(self, head: bytes, path: Path) -> bool:
        return head.startswith(b"#ROSBAG V2.0\n")

    def open_writer(self, target: Target, size: tuple[int, int], *, overwrite: bool, **options: Any) -> BagWriter:
        return BagWriter(target, format=self.name, size=size, limits=self.limits, overwrite=overwrite, **options)

    def open_reader(self, path: str | os.PathLike[str], rules: ReadRules = ReadRules()) -> BagReader:  # noqa: B008
        return BagReader(Path(path), format=self.name, caller=CALLER, rules=rules)
