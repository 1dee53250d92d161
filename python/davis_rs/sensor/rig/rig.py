"""Defines a rig: cameras and IMUs that are fixed to one body."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..._util.argument_checks import check_type
from ..._util.argument_error import ArgumentError
from ..._util.random_words import Words
from ...geometry.camera import Camera
from ...geometry.pose import IDENTITY, Pose, PoseLike, as_pose
from ..effects.effect import check_range
from ..imu import Imu, Mounting
from ..parameters import SensorParameters
from ..presets import RECORDED, read_once, sensor_parameters


@dataclass(frozen=True)
class CameraClock:
    """Holds a camera's clock: at the rig's time t it shows (1 + ``drift``) t + ``offset_s``.

    A camera records from where its own clock shows 0 on, and all of its stamps are by that clock.

    Args:
        offset_s: -10..10 s. Kalibr's ``timeshift_cam_imu`` is its negative, because t_imu = t_cam + timeshift.
        drift: seconds a second, -0.1..0.1.

    Raises:
        ValueError: for values out of range.

    Source: Kalibr's documentation, "YAML formats", for the sign.
    """

    offset_s: float = 0.0
    drift: float = 0.0

    def __post_init__(self) -> None:
        check_range("the clock's offset_s", self.offset_s, -10.0, 10.0, "s")
        check_range("the clock's drift", self.drift, -0.1, 0.1)

    @property
    def pace(self) -> float:
        """Return how many seconds it counts in a second of the rig."""
        return 1.0 + self.drift

    @property
    def zero_s(self) -> float:
        """Return the rig's time at which it shows 0."""
        return -self.offset_s / self.pace

    def stamps_us(self, t_us: npt.ArrayLike) -> npt.NDArray[np.int64]:
        """Return what it shows at the rig's times (n,), to the nearest microsecond."""
        times = np.asarray(t_us, np.int64)
        if self.drift == 0:  # in integers, so that nothing is rounded twice
            return times + round(self.offset_s * 1e6)
        return np.rint(self.pace * times + self.offset_s * 1e6).astype(np.int64)


RIG_CLOCK = CameraClock()
"""The clock of a camera that keeps the rig's own time."""


@dataclass(frozen=True, kw_only=True)
class RigCamera:
    """Describes a camera of a rig.

    Args:
        camera: its lens and size.
        mount: T_body_camera, where it is on the body: a pose, a matrix (4, 4), or (position, quaternion).
        sensor: its pixels: parameters, a preset's name, or a sensor file; None leaves them to the settings of the run.
        clock: its clock.
        topic: under which ROS bags have it; "" for none of its own.

    Raises:
        ValueError: for a mount that is no pose, or a sensor of another size than the camera.
    """

    camera: Camera
    mount: Pose = IDENTITY
    sensor: SensorParameters | str | None = None
    clock: CameraClock = RIG_CLOCK
    topic: str = ""

    def __post_init__(self) -> None:
        check_type("camera", self.camera, Camera, "Camera(...) makes one, davis_rs.load_camera(...) loads one")
        check_type("clock", self.clock, CameraClock, "CameraClock(offset_s=..., drift=...) makes one")
        object.__setattr__(self, "mount", as_pose(self.mount, "mount"))
        if self.sensor == RECORDED:
            raise ArgumentError("{sensor} {!r} is that of one recording, which has one camera", self.sensor)
        object.__setattr__(self, "sensor", read_once(self.sensor))
        pixels = sensor_parameters(self.sensor)
        own = (pixels.width or self.camera.width, pixels.height or self.camera.height)
        if own != (self.camera.width, self.camera.height):
            raise ArgumentError(
                "the {camera} has {} x {} pixels, but its {sensor} has {} x {}",
                *(self.camera.width, self.camera.height, *own),
            )


@dataclass(frozen=True, kw_only=True)
class RigImu:
    """Describes an IMU of a rig.

    Args:
        imu: its rate, its imperfections, and its mounting: T_imu_body, from the body's axes to its own.
        topic: under which ROS bags have it; "" for none of its own.
    """

    imu: Imu
    topic: str = ""

    def __post_init__(self) -> None:
        check_type("imu", self.imu, Imu, "Imu() makes an ideal one, Imu.mpu6150() that of the DAVIS240C")

    def seen_from(self, mount: PoseLike) -> Imu:
        """Return the same IMU with its mounting relative to a camera at ``mount`` (T_body_camera): T_imu_camera."""
        matrix = self.imu.effective_mounting.matrix @ as_pose(mount, "mount").matrix
        return replace(self.imu, mounting=Mounting(matrix))


@dataclass(frozen=True, kw_only=True)
class Rig:
    """Describes cameras and IMUs that are fixed to one body, which moves along one path.

    The body's axes are those of a camera (x right, y down, z ahead): a scene's camera path is the body's path. The
    rig's clock is that of its IMUs and of the body's ground truth.

    Args:
        name: for messages and records.
        cameras: at least one, ``cam0``, ``cam1``, ... in this order.
        imus: ``imu0``, ``imu1``, ...; the first one's samples are in every camera's folder, too.

    Raises:
        TypeError: for what is no camera or IMU of a rig.
        ValueError: for no camera.
    """

    name: str
    cameras: tuple[RigCamera, ...]
    imus: tuple[RigImu, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "cameras", tuple(self.cameras))
        object.__setattr__(self, "imus", tuple(self.imus))
        if not self.cameras:
            raise ArgumentError("{cameras} must hold at least one camera, got none")
        for each in self.cameras:
            check_type("cameras", each, RigCamera, "RigCamera(camera=..., mount=...) makes one")
        for inertial in self.imus:
            check_type("imus", inertial, RigImu, "RigImu(imu=Imu(...)) makes one")

    @property
    def start_s(self) -> float:
        """Return the time of the body's path at which the rig's clock shows 0, in seconds.

        It is 0 unless a camera's clock is ahead of the rig's: that camera begins at the path's start, and the rig's
        clock shows 0 later.
        """
        return max(0.0, *(-each.clock.zero_s for each in self.cameras))

    def begins_s(self, camera: int) -> float:
        """Return the time of the body's path at which a camera's clock shows 0, in seconds."""
        return self.start_s + self.cameras[self.checked_index(camera)].clock.zero_s

    def checked_index(self, camera: int) -> int:
        """Return the number of a camera, or refuse one that the rig does not have.

        Raises:
            ValueError: naming the cameras that there are.
        """
        if not 0 <= camera < len(self.cameras):
            raise ArgumentError(
                "{camera_index} must be one of 0..{}, the cameras of rig {!r}, got {}",
                *(len(self.cameras) - 1, self.name, camera),
            )
        return camera

    def relative_pose(self, camera: int, other: int) -> Pose:
        """Return T_camera_other: points in the axes of another camera in those of a camera."""
        return self.cameras[camera].mount.inverse @ self.cameras[other].mount


def member_seed(seed: int, index: int) -> int:
    """Return the seed of a rig's camera or IMU: the first has the run's own, so that it is what it is alone.

    The others have seeds that are functions of (seed, index): their noise is independent of the first one's.
    """
    return seed if index == 0 else Words(seed, index, "member of a rig").word()
