"""Defines the topics of the public bags, and what their messages hold, in ROS 1 and ROS 2."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from ..._util.array_types import AnyArray
from ..._util.extras import from_extra
from .parts import CameraLike

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore


class Topic(NamedTuple):
    """A topic, the type of its messages, and other names under which known bags have it."""

    name: str
    type: str
    others: tuple[str, ...] = ()


EVENTS = Topic("/dvs/events", "dvs_msgs/msg/EventArray")
IMAGES = Topic("/dvs/image_raw", "sensor_msgs/msg/Image", ("/davis/left/image_raw",))
CAMERA = Topic("/dvs/camera_info", "sensor_msgs/msg/CameraInfo", ("/davis/left/camera_info",))
INERTIAL = Topic("/dvs/imu", "sensor_msgs/msg/Imu", ("/davis/left/imu",))
POSES = Topic("/optitrack/davis", "geometry_msgs/msg/PoseStamped", ("/dvs/pose", "/davis/left/pose"))
DEPTH = Topic("/dvs/depthmap", "sensor_msgs/msg/Image", ("/davis/left/depth_image_raw",))
"""As in the public Event-Camera Dataset; other names are those of its simulator and of MVSEC."""
FLOW = Topic("/dvs/optic_flow", "sensor_msgs/msg/Image")
"""Ours: no public bag has flow."""

EVENT_PACKETS = "event_camera_msgs/msg/EventPacket"
"""The events of today's ROS drivers."""

_OWN_MESSAGES = {
    "dvs_msgs/msg/Event": "uint16 x\nuint16 y\ntime ts\nbool polarity\n",
    "dvs_msgs/msg/EventArray": "std_msgs/Header header\nuint32 height\nuint32 width\ndvs_msgs/Event[] events\n",
    EVENT_PACKETS: (
        "std_msgs/Header header\nuint32 height\nuint32 width\nuint64 seq\nuint64 time_base\nstring encoding\n"
        "bool is_bigendian\nuint8[] events\n"
    ),
}
"""Sources: rpg_dvs_ros, dvs_msgs/msg; ros-event-camera/event_camera_msgs, msg_ros1 and msg_ros2."""


@cache
def typestore(version: Literal[1, 2] = 1) -> Typestore:
    """Return the message types of ROS 1 (Noetic) or ROS 2 (Humble), of dvs_msgs and of event_camera_msgs.

    Raises:
        ImportError: without rosbags, with the extra that brings it.
    """
    with from_extra("ros"):
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
    for name, definition in _OWN_MESSAGES.items():
        if version == 2:
            definition = definition.replace("time ts", "builtin_interfaces/Time ts")
        store.register(get_types_from_msg(definition, name))
    return store


def header(store: Typestore, seq: int, t_us: int, frame_id: str) -> Any:
    """Return a std_msgs/Header; that of ROS 2 has no number."""
    seconds, microseconds = divmod(t_us, 1_000_000)
    time = store.types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=microseconds * 1000)
    kind = store.types["std_msgs/msg/Header"]
    number = {"seq": seq} if "seq" in kind.__dataclass_fields__ else {}
    return kind(stamp=time, frame_id=frame_id, **number)


def image_fields(image: AnyArray, encoding: str) -> dict[str, Any]:
    """Return fields of a sensor_msgs/Image with the bytes of an image (height, width) or (height, width, channels)."""
    height, width = image.shape[:2]
    data = np.frombuffer(np.ascontiguousarray(image).tobytes(), np.uint8)
    step = data.size // height
    return {"height": height, "width": width, "encoding": encoding, "is_bigendian": 0, "step": step, "data": data}


def camera_fields(store: Typestore, camera: CameraLike) -> dict[str, Any]:
    """Return fields of a sensor_msgs/CameraInfo: ``plumb_bob`` with k1, k2, p1, p2, k3."""
    intrinsics = np.array([camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1], np.float64)
    kind = store.types["sensor_msgs/msg/CameraInfo"]
    matrices = {
        "d": np.array(camera.distortion, np.float64),
        "k": intrinsics,
        "r": np.eye(3).ravel(),
        "p": np.insert(intrinsics, [3, 6, 9], 0.0),
    }
    if "K" in kind.__dataclass_fields__:  # ROS 1 has capitals
        matrices = {name.upper(): values for name, values in matrices.items()}
    return {
        "height": camera.height,
        "width": camera.width,
        "distortion_model": "plumb_bob",
        **matrices,
        "binning_x": 0,
        "binning_y": 0,
        "roi": store.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False),
    }


def imu_fields(store: Typestore, acceleration: npt.ArrayLike, angular_velocity: npt.ArrayLike) -> dict[str, Any]:
    """Return fields of a sensor_msgs/Imu without an orientation."""
    vector = store.types["geometry_msgs/msg/Vector3"]
    return {
        "orientation": store.types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
        "orientation_covariance": np.array([-1.0, *[0.0] * 8]),
        "angular_velocity": vector(*np.asarray(angular_velocity, np.float64).tolist()),
        "angular_velocity_covariance": np.zeros(9),
        "linear_acceleration": vector(*np.asarray(acceleration, np.float64).tolist()),
        "linear_acceleration_covariance": np.zeros(9),
    }


def pose_fields(store: Typestore, position: npt.ArrayLike, quaternion: npt.ArrayLike) -> dict[str, Any]:
    """Return fields of a geometry_msgs/PoseStamped."""
    point = store.types["geometry_msgs/msg/Point"](*np.asarray(position, np.float64).tolist())
    rotation = store.types["geometry_msgs/msg/Quaternion"](*np.asarray(quaternion, np.float64).tolist())
    return {"pose": store.types["geometry_msgs/msg/Pose"](position=point, orientation=rotation)}


def stamp_us(stamp: Any) -> int:
    """Return a time of ROS in microseconds, to the nearest, halves up."""
    return int(stamp.sec) * 1_000_000 + (int(stamp.nanosec) + 500) // 1000
