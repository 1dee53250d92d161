"""The topics of the public bags, and what their messages hold."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from .extras import from_extra

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

EVENTS = ("/dvs/events", "dvs_msgs/msg/EventArray")
IMAGES = ("/dvs/image_raw", "sensor_msgs/msg/Image")
CAMERA = ("/dvs/camera_info", "sensor_msgs/msg/CameraInfo")
INERTIAL = ("/dvs/imu", "sensor_msgs/msg/Imu")
POSES = ("/optitrack/davis", "geometry_msgs/msg/PoseStamped")
DEPTH = ("/dvs/depthmap", "sensor_msgs/msg/Image")
"""Topic and message type of each, as in the public Event-Camera Dataset."""

_DVS_MESSAGES = {
    "dvs_msgs/msg/Event": "uint16 x\nuint16 y\ntime ts\nbool polarity\n",
    "dvs_msgs/msg/EventArray": "std_msgs/Header header\nuint32 height\nuint32 width\ndvs_msgs/Event[] events\n",
}


class CameraLike(Protocol):
    """What a calibration has: OpenCV's pinhole camera with radial-tangential distortion, in pixels."""

    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def fx(self) -> float: ...
    @property
    def fy(self) -> float: ...
    @property
    def cx(self) -> float: ...
    @property
    def cy(self) -> float: ...
    @property
    def distortion(self) -> tuple[float, float, float, float, float]:
        """k1, k2, p1, p2, k3."""


class Calibration(NamedTuple):
    """A calibration as a bag has it; ``davis_rs.Camera(*calibration)`` is the camera."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0


class ImuSample(NamedTuple):
    """One IMU sample: ``acceleration`` in m/s^2 and ``angular_velocity`` in rad/s, float64 (3,)."""

    t_us: int
    acceleration: npt.NDArray[np.float64]
    angular_velocity: npt.NDArray[np.float64]


class PoseSample(NamedTuple):
    """One pose: ``position`` in metres, float64 (3,), ``quaternion`` (x, y, z, w), float64 (4,)."""

    t_us: int
    position: npt.NDArray[np.float64]
    quaternion: npt.NDArray[np.float64]


@cache
def typestore() -> Typestore:
    """The message types of ROS 1 and of dvs_msgs.

    Raises:
        ImportError: without rosbags, with the extra that brings it.
    """
    with from_extra("ros"):
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    store = get_typestore(Stores.ROS1_NOETIC)
    for name, definition in _DVS_MESSAGES.items():
        store.register(get_types_from_msg(definition, name))
    return store


def header(seq: int, t_us: int, frame_id: str) -> Any:
    """A std_msgs/Header."""
    types = typestore().types
    seconds, microseconds = divmod(t_us, 1_000_000)
    time = types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=microseconds * 1000)
    return types["std_msgs/msg/Header"](seq=seq, stamp=time, frame_id=frame_id)


def stamp_us(stamp: Any) -> int:
    """A time of ROS in microseconds, to the nearest, halves up."""
    return int(stamp.sec) * 1_000_000 + (int(stamp.nanosec) + 500) // 1000
