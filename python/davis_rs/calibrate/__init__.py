"""Calibrates from views of a checkerboard: a camera, its pose on a tracked body, cameras and IMU of a rig."""

from .camera.board_pose import BoardPose, board_pose, board_poses
from .camera.camera_imu import MPU6150_NOISE, CameraImu, calibrate_camera_imu
from .camera.corners import BoardView, find_board, find_corners
from .camera.figure import draw_intrinsics
from .camera.hand_eye import HandEye, calibrate_hand_eye
from .camera.intrinsics import Intrinsics, calibrate_intrinsics
from .camera.report import as_dict, report
from .camera.rig import CameraCamera, RigCalibration, calibrate_rig
from .camera.tracked import tracked_poses

__all__ = [
    "MPU6150_NOISE",
    "BoardPose",
    "BoardView",
    "CameraCamera",
    "CameraImu",
    "HandEye",
    "Intrinsics",
    "RigCalibration",
    "as_dict",
    "board_pose",
    "board_poses",
    "calibrate_camera_imu",
    "calibrate_hand_eye",
    "calibrate_intrinsics",
    "calibrate_rig",
    "draw_intrinsics",
    "find_board",
    "find_corners",
    "report",
    "tracked_poses",
]
