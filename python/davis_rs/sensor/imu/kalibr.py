"""Writes Kalibr's files about IMU and camera, which estimators read."""

from __future__ import annotations

import numpy as np

from ...geometry.camera import Camera
from ...geometry.pose import FloatArray
from .imu import Imu
from .noise import ImuNoise


def kalibr_imu(imu: Imu, *, topic: str = "/dvs/imu") -> str:
    """Return the text of Kalibr's ``imu.yaml``: rate and noise densities, zero where the IMU has no noise.

    Source: Kalibr's documentation, "YAML formats".
    """
    noise = imu.noise or ImuNoise(0.0, 0.0, 0.0, 0.0)
    lines = [f"rostopic: {topic}", f"update_rate: {imu.rate_hz!r}"]
    lines += [f"{name}: {value!r}" for name, value in noise.settings().items()]
    if not all(noise.settings().values()):
        lines.insert(0, "# 0.0 is what was simulated; estimators ask for densities above zero")
    return "\n".join(lines) + "\n"


def kalibr_camera_chain(camera: Camera, imu: Imu, *, topic: str = "/dvs/image_raw") -> str:
    """Return the text of Kalibr's ``camchain.yaml`` with one camera: T_cam_imu, and t_imu = t_cam + timeshift_cam_imu.

    Raises:
        ValueError: for a camera with k3, which Kalibr's model ``radtan`` lacks.

    Source: Kalibr's documentation, "YAML formats".
    """
    matrix = imu.effective_mounting.matrix
    lines = kalibr_camera("cam0", camera, topic=topic, T_cam_imu=inverse_transform(matrix), timeshift_s=imu.lag_s)
    return "\n".join(lines) + "\n"


def kalibr_camera(
    name: str,
    camera: Camera,
    *,
    topic: str,
    T_cam_imu: FloatArray | None = None,
    T_cn_cnm1: FloatArray | None = None,
    timeshift_s: float = 0.0,
) -> list[str]:
    """Return the lines of one camera of Kalibr's ``camchain.yaml``, keys in the order of the alphabet.

    Args:
        name: of the camera: ``cam0``, ``cam1``, ...
        T_cam_imu, T_cn_cnm1: (4, 4), from the IMU and from the camera before to this camera; None where there is none.
        timeshift_s: t_imu = t_cam + timeshift, seconds; written where there is an IMU.

    Raises:
        ValueError: for a camera with k3, which Kalibr's model ``radtan`` lacks.
    """
    if camera.k3 != 0:
        raise ValueError(f"Kalibr's radtan distortion has no k3, which must be 0, got {camera.k3}")
    lines = [f"{name}:"]
    for key, matrix in (("T_cam_imu", T_cam_imu), ("T_cn_cnm1", T_cn_cnm1)):
        if matrix is not None:
            rows = [[*map(float, row)] for row in matrix[:3]]
            lines += [f"  {key}:", *(f"  - {row!r}" for row in [*rows, [0.0, 0.0, 0.0, 1.0]])]
    lines += [
        "  camera_model: pinhole",
        f"  distortion_coeffs: {[camera.k1, camera.k2, camera.p1, camera.p2]!r}",
        "  distortion_model: radtan",
        f"  intrinsics: {[camera.fx, camera.fy, camera.cx, camera.cy]!r}",
        f"  resolution: {[camera.width, camera.height]!r}",
        f"  rostopic: {topic}",
    ]
    return lines if T_cam_imu is None else [*lines, f"  timeshift_cam_imu: {timeshift_s!r}"]


def inverse_transform(matrix: FloatArray) -> FloatArray:
    """Return the inverse (4, 4) of a rigid transform (4, 4), its rotation exactly transposed."""
    inverse = np.eye(4)
    inverse[:3, :3] = matrix[:3, :3].T
    inverse[:3, 3] = -matrix[:3, :3].T @ matrix[:3, 3]
    return inverse
