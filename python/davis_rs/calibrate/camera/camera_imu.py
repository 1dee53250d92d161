"""Calibrates camera and IMU: how they sit on each other, and how late the IMU's stamps are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...sensor.imu import ImuArray, ImuNoise, as_imu
from .board_pose import BoardPose
from .inertial_problem import InertialProblem, InertialState, Readings
from .levenberg_marquardt import levenberg_marquardt
from .reprojection import cross_matrix, transform

FloatArray = npt.NDArray[np.float64]

MPU6150_NOISE = ImuNoise(accelerometer_noise_density=3.9e-3, gyroscope_noise_density=8.7e-5)
"""White noise of the dataset's IMU by its data sheet: 400 ug/sqrt(Hz) and 0.005 degrees/s/sqrt(Hz)."""

_LEAST_VIEWS = 10
_LEAST_SAMPLES = 50


@dataclass(frozen=True, eq=False)
class CameraImu:
    """Holds what calibrating a camera against an IMU found.

    Attributes:
        imu_camera: T_IMU,E, (4, 4), metres: maps camera axes to the IMU's.
        lag_s: a sample stamped t shows the motion at t - lag_s on the frames' clock.
        gyroscope_bias, accelerometer_bias: (3,) rad/s and m/s^2, IMU axes: what the readings are too large by.
        gravity: (3,) m/s^2, board axes.
        covariance: (7, 7) of a small motion of the camera in IMU axes (rotation vector, rad; translation of its centre,
            m) and of the lag (s), as far as the noise given for the IMU holds.
        rate_rms, acceleration_rms, corner_rms_px: what is left, root mean square of an axis: of the (averaged)
            readings, rad/s and m/s^2, and of the board's poses in pixels of corner noise.
        views, samples: number of board poses and of (averaged) readings used.
        unseen_s: seconds in which the board was out of sight for more than half a second; readings there are not used.
    """

    imu_camera: FloatArray
    lag_s: float
    gyroscope_bias: FloatArray
    accelerometer_bias: FloatArray
    gravity: FloatArray
    covariance: FloatArray
    rate_rms: float
    acceleration_rms: float
    corner_rms_px: float
    views: int
    samples: int
    unseen_s: float

    @property
    def deviations(self) -> FloatArray:
        """Standard deviations (7,): rotation (rad) and translation (m) in IMU axes, and lag (s)."""
        return np.sqrt(np.diag(self.covariance))


def calibrate_camera_imu(
    camera_poses: Sequence[BoardPose],
    imu: ImuArray,
    *,
    noise: ImuNoise = MPU6150_NOISE,
    knot_rate_hz: float = 25.0,
    reading_rate_hz: float = 200.0,
) -> CameraImu:
    """Find rotation, translation and time lag between a camera and an IMU from a sequence before a checkerboard.

    Splines describe the path of the IMU and the turning of both; what they say of the board's poses, angular rates and
    specific forces is fitted by least squares to what the camera and the IMU measured, together with the unknown
    transform, lag, biases and gravity. Rotation and lag start from the angular rates alone, so nothing need be known
    beforehand but that the lag is below 50 ms.

    Args:
        camera_poses: of at least ten frames, in any order. Where the board is out of sight for more than half a second
            the readings are left out, and both sides are fitted together.
        imu: ``IMU_DTYPE``.
        noise: white noise of the IMU, which weighs readings against corners.
        knot_rate_hz: knots of the splines a second; the motion must have nothing faster than about a third of that.
        reading_rate_hz: readings are averaged to about this rate.

    Raises:
        ValueError: for too few views or readings, a motion that does not turn about two axes, or measurements that do
            not fit together.

    Source: Furgale, Rehder and Siegwart, IROS 2013 (continuous-time estimation).
    """
    problem, solution = fit_path(camera_poses, imu, noise, knot_rate_hz, reading_rate_hz)
    return camera_imu_of(problem, solution)


def fit_path(
    camera_poses: Sequence[BoardPose],
    imu: ImuArray,
    noise: ImuNoise,
    knot_rate_hz: float,
    reading_rate_hz: float,
    others: Sequence[Sequence[BoardPose]] = (),
) -> tuple[InertialProblem, InertialState]:
    """Fit the path, transforms, lags and biases to what one or more cameras and an IMU measured.

    Args:
        others: board poses of further cameras; the rest is as of :func:`calibrate_camera_imu`.

    Raises:
        ValueError: as :func:`calibrate_camera_imu`.
    """
    if len(camera_poses) < _LEAST_VIEWS:
        raise ValueError(f"camera and IMU need at least {_LEAST_VIEWS} views of the board, got {len(camera_poses)}")
    poses, *more = (sorted(each, key=lambda pose: pose.view.t_us) for each in (camera_poses, *others))
    problem = InertialProblem(poses, _averaged(as_imu(imu), reading_rate_hz), noise, knot_rate_hz, more)
    solution = levenberg_marquardt(
        problem.start(), problem.residuals, problem.jacobian, problem.moved, iterations=30, tolerance=1e-9
    )
    return problem, solution


def camera_imu_of(problem: InertialProblem, solution: InertialState) -> CameraImu:
    """Return what a fit says of the first camera and the IMU."""
    # From steps of rotation in camera axes, lever and lag to what is reported.
    to_reported = np.zeros((7, 7))
    to_reported[:3, :3] = solution.rotation
    to_reported[3:6, :3] = solution.rotation @ cross_matrix(solution.lever)
    to_reported[3:6, 3:6] = -solution.rotation
    to_reported[6, 6] = 1.0
    rate, acceleration, corners = problem.scatter(solution)
    return CameraImu(
        imu_camera=transform(solution.rotation, -solution.rotation @ solution.lever),
        lag_s=solution.lag_s + problem.imu_shift_s,
        gyroscope_bias=solution.gyroscope_bias,
        accelerometer_bias=solution.accelerometer_bias,
        gravity=solution.gravity,
        covariance=to_reported @ problem.covariance(solution)[:7, :7] @ to_reported.T,
        rate_rms=rate,
        acceleration_rms=acceleration,
        corner_rms_px=corners[0],
        views=problem.views[0],
        samples=problem.samples,
        unseen_s=problem.unseen_s,
    )


def _averaged(imu: ImuArray, rate_hz: float) -> Readings:
    """Return means of as many neighbouring samples as bring them to about this rate."""
    if len(imu) < _LEAST_SAMPLES:
        raise ValueError(f"camera and IMU need at least {_LEAST_SAMPLES} samples of the IMU, got {len(imu)}")
    samples = Readings(imu["t"] * 1e-6, imu["accel"], imu["gyro"])
    group = max(1, round(samples.rate_hz / rate_hz))
    whole = len(imu) // group * group
    return Readings(*(a[:whole].reshape(-1, group, *a.shape[1:]).mean(1) for a in samples))
