"""Writes Kalibr's files about IMU and camera, which estimators read."""

from __future__ import annotations

from ...geometry.camera import Camera
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
    if camera.k3 != 0:
        raise ValueError(f"Kalibr's radtan distortion has no k3, which must be 0, got {camera.k3}")
    mounting = imu.effective_mounting
    rows = [[*map(float, r), float(x)] for r, x in zip(mounting.rotation.T, mounting.lever_arm, strict=True)]
    lines = ["cam0:", "  T_cam_imu:", *(f"  - {row!r}" for row in [*rows, [0.0, 0.0, 0.0, 1.0]])]
    lines += [
        "  camera_model: pinhole",
        f"  distortion_coeffs: {[camera.k1, camera.k2, camera.p1, camera.p2]!r}",
        "  distortion_model: radtan",
        f"  intrinsics: {[camera.fx, camera.fy, camera.cx, camera.cy]!r}",
        f"  resolution: {[camera.width, camera.height]!r}",
        f"  rostopic: {topic}",
        f"  timeshift_cam_imu: {imu.lag_s!r}",
    ]
    return "\n".join(lines) + "\n"
