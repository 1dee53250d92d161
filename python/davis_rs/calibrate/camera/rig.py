"""Calibrates the cameras of a rig and its IMU together: where each camera is, and what its clock shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...geometry.camera import Camera
from ...geometry.pose import Pose
from ...sensor.imu import Imu, ImuArray, ImuNoise, Mounting
from ...sensor.rig.rig import CameraClock, Rig, RigCamera, RigImu
from .board_pose import BoardPose
from .camera_imu import MPU6150_NOISE, CameraImu, camera_imu_of, fit_path
from .reprojection import cross_matrix, inverse, transform

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CameraCamera:
    """Holds where another camera of a rig is, relative to the first one.

    Attributes:
        first_other: T_cam0,other, (4, 4), metres: maps the other camera's axes to those of the first.
        lag_s: the other camera's clock shows so much more than the first one's at the same instant, as a mean over the
            recording.
        covariance: (7, 7) of a small motion of the other camera (rotation vector in its own axes, rad; translation in
            the axes of the first, m) and of the lag (s), as far as the noise given for the IMU holds.
        corner_rms_px: what is left of the board's poses, in pixels of corner noise, root mean square of an axis.
        views: number of board poses used.
    """

    first_other: FloatArray
    lag_s: float
    covariance: FloatArray
    corner_rms_px: float
    views: int

    @property
    def deviations(self) -> FloatArray:
        """Standard deviations (7,): rotation (rad), translation (m) and lag (s)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def other_first(self) -> FloatArray:
        """T_other,cam0 (4, 4), metres, as ``rig.yaml`` states it: maps the first camera's axes to the other's."""
        return inverse(self.first_other)

    @property
    def other_first_deviations(self) -> FloatArray:
        """Standard deviations (6,) of :attr:`other_first` about and along the other camera's axes, rad and m."""
        place = self.other_first[:3, 3]
        # To first order the place moves by the turn x place, and against the motion of the camera.
        jacobian = np.block([[np.eye(3), np.zeros((3, 3))], [cross_matrix(place), -self.first_other[:3, :3].T]])
        return np.sqrt(np.diag(jacobian @ self.covariance[:6, :6] @ jacobian.T))


@dataclass(frozen=True, eq=False)
class RigCalibration:
    """Holds what calibrating a rig found.

    Attributes:
        camera_imu: of the first camera and the IMU.
        others: of each further camera.
    """

    camera_imu: CameraImu
    others: tuple[CameraCamera, ...]

    @property
    def timeshifts_s(self) -> tuple[float, ...]:
        """Return ``timeshift_cam_imu`` of each camera, seconds: t_imu = t_cam + timeshift, with the IMU's lag in it."""
        lag_s = self.camera_imu.lag_s
        return (lag_s, *(lag_s - other.lag_s for other in self.others))

    def rig(self, cameras: Sequence[Camera], *, imu_rate_hz: float = 1000.0, name: str = "calibrated") -> Rig:
        """Return a rig of these lenses as it was found: its body is the first camera, its clock the IMU's.

        A lag of the IMU's samples cannot be told from offsets of the cameras' clocks, so it is part of these.

        Args:
            cameras: one lens for each camera.

        Raises:
            ValueError: for another number of lenses.
        """
        if len(cameras) != 1 + len(self.others):
            raise ValueError(f"{1 + len(self.others)} cameras were calibrated, got {len(cameras)} lenses")
        mounts = [np.eye(4), *(other.first_other for other in self.others)]
        found = [
            RigCamera(
                camera=camera,
                mount=Pose.from_matrix(Mounting(mount).matrix),
                clock=CameraClock(offset_s=-timeshift_s),
            )
            for camera, mount, timeshift_s in zip(cameras, mounts, self.timeshifts_s, strict=True)
        ]
        imu = Imu(rate_hz=imu_rate_hz, mounting=Mounting(self.camera_imu.imu_camera))
        return Rig(name=name, cameras=tuple(found), imus=(RigImu(imu=imu),))


def calibrate_rig(
    camera_poses: Sequence[Sequence[BoardPose]],
    imu: ImuArray,
    *,
    noise: ImuNoise = MPU6150_NOISE,
    knot_rate_hz: float = 25.0,
    reading_rate_hz: float = 200.0,
) -> RigCalibration:
    """Find where the cameras of a rig and its IMU are, and how far their clocks are apart, from one recording.

    All cameras look at the same checkerboard. Splines describe the path of the IMU, and what they say of each camera's
    board poses, of angular rates and of specific forces is fitted by least squares. So frames of different cameras need
    not be of the same instants. Clocks may be a second apart. Their drift is not estimated.

    Args:
        camera_poses: of two or more cameras, each at least ten frames by its own clock. The first camera must see the
            board while the others do.
        imu: ``IMU_DTYPE``, by a clock of its own.
        noise, knot_rate_hz, reading_rate_hz: as of :func:`calibrate_camera_imu`.

    Raises:
        ValueError: for a single camera; for cameras that hardly see the board at the same time; as
            :func:`calibrate_camera_imu`.

    Source: Furgale, Rehder and Siegwart, IROS 2013 (continuous-time estimation), as Kalibr does it.
    """
    if len(camera_poses) < 2:
        raise ValueError(f"a rig's calibration needs two cameras or more, got {len(camera_poses)}")
    first, *others = camera_poses
    problem, solution = fit_path(first, imu, noise, knot_rate_hz, reading_rate_hz, others)
    covariance, (_, _, corners) = problem.covariance(solution), problem.scatter(solution)
    return RigCalibration(
        camera_imu_of(problem, solution),
        tuple(
            CameraCamera(
                first_other=transform(other.rotation, other.place),
                lag_s=other.lag_s + problem.shifts_s[k - 1],
                covariance=covariance[7 * k : 7 * k + 7, 7 * k : 7 * k + 7],
                corner_rms_px=corners[k],
                views=problem.views[k],
            )
            for k, other in enumerate(solution.others, 1)
        ),
    )
