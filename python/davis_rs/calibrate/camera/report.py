"""Tells what calibrations found, for people and for programs."""

from __future__ import annotations

from functools import singledispatch

import numpy as np
import numpy.typing as npt

from .camera_imu import CameraImu
from .hand_eye import HandEye
from .intrinsics import Intrinsics
from .rig import CameraCamera, RigCalibration

FloatArray = npt.NDArray[np.float64]
Calibration = Intrinsics | HandEye | CameraImu | RigCalibration


@singledispatch
def report(result: Calibration) -> str:
    """Return a calibration's result in a few lines: values, standard deviations and residuals."""
    raise TypeError(f"no calibration's result: {type(result).__name__}")


@singledispatch
def as_dict(result: Calibration) -> dict[str, object]:
    """Return a calibration's result in JSON's types; units as in its attributes."""
    raise TypeError(f"no calibration's result: {type(result).__name__}")


@report.register
def _(result: Intrinsics) -> str:
    lines = [
        f"  {name:2} {getattr(result.camera, name):12.6g} +- {deviation:.2g}"
        for name, deviation in result.deviations.items()
    ]
    return "\n".join(
        [
            f"intrinsics from {result.views} views",
            *lines,
            "  k3            0",
            f"reprojection error {result.rms_px:.3f} px rms",
            f"calib.txt: {result.camera.to_calib().strip()}",
        ]
    )


@as_dict.register
def _(result: Intrinsics) -> dict[str, object]:
    camera = result.camera
    return {
        "width": camera.width,
        "height": camera.height,
        **{name: getattr(camera, name) for name in (*result.deviations, "k3")},
        "deviations": result.deviations,
        "rms_px": result.rms_px,
        "views": result.views,
    }


@report.register
def _(result: HandEye) -> str:
    rotations_deg, translations_mm = np.degrees(result.rotation_deviations_rad), 1e3 * result.translation_deviations_m
    return "\n".join(
        [
            f"hand-eye from {result.views} views",
            "X = T_hand_camera, maps points in camera axes to those of the tracked body:",
            _matrix(result.hand_camera),
            "  standard deviations about and along the camera's axes: "
            f"{_three(rotations_deg)} degrees, {_three(translations_mm)} mm",
            "covariance of X (rotation vector, rad; translation, m; camera axes):",
            _matrix(result.covariance[:6, :6], "10.2e"),
            "Z = T_world_board:",
            _matrix(result.world_board),
            f"reprojection error {result.rms_px:.3f} px rms ({result.linear_rms_px:.3f} px of the linear solution)",
        ]
    )


@as_dict.register
def _(result: HandEye) -> dict[str, object]:
    return {
        "T_hand_camera": result.hand_camera.tolist(),
        "T_world_board": result.world_board.tolist(),
        "covariance": result.covariance.tolist(),
        "rms_px": result.rms_px,
        "linear_T_hand_camera": result.linear.tolist(),
        "linear_rms_px": result.linear_rms_px,
        "views": result.views,
    }


@report.register
def _(result: CameraImu) -> str:
    deviations = result.deviations
    return "\n".join(
        [
            f"camera and IMU from {result.views} views and {result.samples} averaged readings",
            "T_imu_camera, maps points in camera axes to the IMU's:",
            _matrix(result.imu_camera),
            f"  standard deviations about and along the IMU's axes: {_three(np.degrees(deviations[:3]))} degrees, "
            f"{_three(1e3 * deviations[3:6])} mm",
            f"lag {1e3 * result.lag_s:.3f} +- {1e3 * deviations[6]:.3f} ms: a sample stamped t shows t - lag",
            f"biases: gyroscope {_three(result.gyroscope_bias)} rad/s, "
            f"accelerometer {_three(result.accelerometer_bias)} m/s^2",
            f"left: {result.rate_rms:.2g} rad/s, {result.acceleration_rms:.2g} m/s^2, "
            f"{result.corner_rms_px:.2g} px rms",
            *([f"left out: {result.unseen_s:.2f} s in which the board is not seen"] if result.unseen_s else []),
        ]
    )


@as_dict.register
def _(result: CameraImu) -> dict[str, object]:
    return {
        "T_imu_camera": result.imu_camera.tolist(),
        "lag_s": result.lag_s,
        "gyroscope_bias": result.gyroscope_bias.tolist(),
        "accelerometer_bias": result.accelerometer_bias.tolist(),
        "gravity_board": result.gravity.tolist(),
        "covariance": result.covariance.tolist(),
        "rate_rms": result.rate_rms,
        "acceleration_rms": result.acceleration_rms,
        "corner_rms_px": result.corner_rms_px,
        "views": result.views,
        "samples": result.samples,
        "unseen_s": result.unseen_s,
    }


@report.register
def _(result: RigCalibration) -> str:
    first_s, *others_s = result.timeshifts_s
    others = [
        _other_camera(number, other, timeshift_s)
        for number, (other, timeshift_s) in enumerate(zip(result.others, others_s, strict=True), 1)
    ]
    said = "matrices and time shifts are as in rig.yaml with cam0 as the body; time shifts have the IMU's lag in them"
    return "\n".join([said, "camera 0:", report(result.camera_imu), _timeshift(first_s), *others])


def _other_camera(number: int, other: CameraCamera, timeshift_s: float) -> str:
    deviations = other.other_first_deviations
    keys = "T_cn_cnm1 or T_cam_parent" if number == 1 else "T_cam_parent"
    return "\n".join(
        [
            f"camera {number}, from {other.views} views:",
            f"T_cam{number}_cam0 ({keys}), maps points in the axes of camera 0 to its own:",
            _matrix(other.other_first),
            f"  standard deviations about and along its axes: {_three(np.degrees(deviations[:3]))} degrees, "
            f"{_three(1e3 * deviations[3:])} mm",
            f"its clock is {1e3 * other.lag_s:.3f} +- {1e3 * other.deviations[6]:.3f} ms ahead of camera 0's",
            _timeshift(timeshift_s),
            f"left: {other.corner_rms_px:.2g} px rms",
        ]
    )


def _timeshift(seconds: float) -> str:
    return f"timeshift_cam_imu: {seconds:.6f} s"


@as_dict.register
def _(result: RigCalibration) -> dict[str, object]:
    others = [
        {
            "T_cam0_cam": other.first_other.tolist(),
            "T_cam_cam0": other.other_first.tolist(),
            "timeshift_cam_imu": timeshift_s,
            "lag_s": other.lag_s,
            "covariance": other.covariance.tolist(),
            "corner_rms_px": other.corner_rms_px,
            "views": other.views,
        }
        for other, timeshift_s in zip(result.others, result.timeshifts_s[1:], strict=True)
    ]
    return {"cam0_imu": as_dict(result.camera_imu), "other_cameras": others}


def _matrix(matrix: FloatArray, form: str = "10.6f") -> str:
    return "\n".join("  " + " ".join(f"{value:{form}}" for value in row) for row in matrix)


def _three(values: FloatArray) -> str:
    return " ".join(f"{value:.2g}" for value in values)
