"""Estimates the pose of a camera before a board, from one view of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...geometry.camera import Camera
from ...scene.builtin.checkerboard import Checkerboard
from .corners import BoardView
from .opencv import load_opencv
from .reprojection import cross_matrix, inverse, projection_jacobian, rotation_of, transform

FloatArray = npt.NDArray[np.float64]

_WORST_RMS_PX = 1.0


@dataclass(frozen=True, eq=False)
class BoardPose:
    """Holds a camera before a board.

    Attributes:
        view: what it was found from.
        matrix: T_board_camera, (4, 4), metres.
        information: (6, 6) inverse covariance, for corners of one pixel's noise, of a small motion (rotation vector,
            translation; radians, metres) in camera axes.
        rms_px: root mean square distance of the corners from where this pose sees them.
    """

    view: BoardView
    matrix: FloatArray
    information: FloatArray
    rms_px: float


def board_pose(view: BoardView, board: Checkerboard, camera: Camera) -> BoardPose:
    """Find the board's pose that projects its corners nearest to where they are.

    A flat board has two poses that look nearly alike; both are tried (Collins and Bartoli, IJCV 2014, as OpenCV's
    ``SOLVEPNP_IPPE``), and the one that fits is refined.

    Raises:
        ImportError: without OpenCV 4.
    """
    cv2 = load_opencv()
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    given = (board.corners, view.corners.reshape(-1, 1, 2), matrix, np.array(camera.distortion))
    _, rotations, translations, _ = cv2.solvePnPGeneric(*given, flags=cv2.SOLVEPNP_IPPE)
    refined = [
        cv2.solvePnPRefineLM(*given, rotation, translation)
        for rotation, translation in zip(rotations, translations, strict=True)
    ]
    poses = [transform(rotation_of(rotation.ravel()), translation.ravel()) for rotation, translation in refined]
    errors = [_rms(pose, view, board, camera) for pose in poses]
    best = int(np.argmin(errors))
    points = board.corners @ poses[best][:3, :3].T + poses[best][:3, 3]
    by_point = projection_jacobian(camera, points)
    # The camera's motion (rotation, translation) moves a point p by [p]x rotation - translation.
    by_motion = np.concatenate([by_point @ cross_matrix(points), -by_point], -1).reshape(-1, 6)
    return BoardPose(view, inverse(poses[best]), by_motion.T @ by_motion, errors[best])


def board_poses(views: Sequence[BoardView], board: Checkerboard, camera: Camera) -> list[BoardPose]:
    """Find the board's pose in each view. Views whose corners no pose explains within a pixel are left out.

    Raises:
        ValueError: if none is left.
        ImportError: without OpenCV 4.
    """
    poses = [board_pose(view, board, camera) for view in views]
    good = [pose for pose in poses if pose.rms_px <= _WORST_RMS_PX]
    if not good:
        raise ValueError(
            f"no pose of the camera explains the corners of any of {len(views)} views within {_WORST_RMS_PX} px: "
            "is it this camera's calibration, and this board?"
        )
    return good


def _rms(pose: FloatArray, view: BoardView, board: Checkerboard, camera: Camera) -> float:
    seen = camera.project(board.corners @ pose[:3, :3].T + pose[:3, 3])
    return float(np.sqrt(np.square(seen - view.corners).sum(1).mean())) if np.isfinite(seen).all() else np.inf
