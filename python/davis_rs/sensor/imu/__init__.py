"""Simulates an inertial measurement unit (IMU) that is fixed to the sensor. All imperfections are off by default."""

from ...events.decoded import IMU_DTYPE
from .converter import ImuQuantisation, ImuSaturation
from .imu import IMU_EFFECTS, IMU_MODELS, Imu, ImuArray, as_imu, simulate_imu
from .kalibr import kalibr_camera, kalibr_camera_chain, kalibr_imu
from .lag import ImuLag
from .low_pass import ImuLowPass
from .mounting import DAVIS_T_IMU_CAMERA, Mounting
from .noise import ImuNoise

__all__ = [
    "DAVIS_T_IMU_CAMERA",
    "IMU_DTYPE",
    "IMU_EFFECTS",
    "IMU_MODELS",
    "Imu",
    "ImuArray",
    "ImuLag",
    "ImuLowPass",
    "ImuNoise",
    "ImuQuantisation",
    "ImuSaturation",
    "Mounting",
    "as_imu",
    "kalibr_camera",
    "kalibr_camera_chain",
    "kalibr_imu",
    "simulate_imu",
]
