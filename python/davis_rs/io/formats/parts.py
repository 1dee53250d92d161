"""Lists what a recording may have next to its events: how each part is handed on, and which writers take it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt


class Part(NamedTuple):
    """Holds one kind of data next to the events.

    A reader that has it offers a method ``read``, which gives tuples (t_us, ...) in order of time; a writer that takes
    it offers a method ``write``, which takes what such a tuple holds.
    """

    name: str
    """As :attr:`Format.holds` and ``parts=`` name it."""
    read: str
    write: str
    counted: str
    """What messages call several of them."""


CAMERA = Part("camera", "cameras", "write_camera", "calibration")
FRAMES = Part("frames", "images", "write_image", "frames")
DEPTH = Part("depth", "depth_maps", "write_depth", "depth maps")
FLOW = Part("flow", "flow_maps", "write_flow", "maps of optical flow")
IMU = Part("imu", "imu", "write_imu", "IMU samples")
POSES = Part("poses", "poses", "write_pose", "poses")

PARTS = (CAMERA, FRAMES, DEPTH, FLOW, IMU, POSES)
"""All of them, in the order in which those of one time are written."""

ALL_PARTS = tuple(part.name for part in PARTS)


class CameraLike(Protocol):
    """Names what a calibration has: OpenCV's pinhole camera with radial-tangential distortion, in pixels."""

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
        """Return the coefficients k1, k2, p1, p2, k3."""


class Calibration(NamedTuple):
    """Holds a calibration as a container has it; ``davis_rs.Camera(*calibration)`` is the camera."""

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

    @property
    def distortion(self) -> tuple[float, float, float, float, float]:
        """Return the coefficients k1, k2, p1, p2, k3."""
        return self.k1, self.k2, self.p1, self.p2, self.k3


class ImuSample(NamedTuple):
    """Holds one IMU sample: ``acceleration`` in m/s^2 and ``angular_velocity`` in rad/s, float64 (3,)."""

    t_us: int
    acceleration: npt.NDArray[np.float64]
    angular_velocity: npt.NDArray[np.float64]


class PoseSample(NamedTuple):
    """Holds one pose: ``position`` in metres, float64 (3,), ``quaternion`` (x, y, z, w), float64 (4,)."""

    t_us: int
    position: npt.NDArray[np.float64]
    quaternion: npt.NDArray[np.float64]


def check_map(name: str, image: npt.NDArray[np.generic], shape: Iterable[int], dtype: npt.DTypeLike) -> None:
    """Refuse an image that is not of the sensor's shape or of another type.

    Raises:
        ValueError: with what it should be and what it is.
    """
    if image.shape != tuple(shape) or image.dtype != np.dtype(dtype):
        raise ValueError(f"{name} must be {np.dtype(dtype)} of shape {tuple(shape)}: got {image.dtype}, {image.shape}")


def on_sensor(image: npt.NDArray[np.uint8], x: int, y: int, size: tuple[int, int] | None) -> npt.NDArray[np.uint8]:
    """Return an image whose first pixel lies at ``x``, ``y`` as one of the whole sensor, 0 where it does not reach."""
    height, width = image.shape
    if size is None or (x, y, width, height) == (0, 0, *size):
        return image
    whole = np.zeros(size[::-1], np.uint8)
    visible = image[: max(size[1] - y, 0), : max(size[0] - x, 0)]
    whole[y : y + visible.shape[0], x : x + visible.shape[1]] = visible
    return whole
