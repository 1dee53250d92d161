"""Views of the calibration scene's checkerboard: rendered frames, and exact projections without any."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from davis_rs import Camera, Trajectory, load_scene
from davis_rs.calibrate import BoardView, find_corners
from davis_rs.calibrate.camera.reprojection import inverse, transform
from davis_rs.events.arrays import EVENT_DTYPE
from davis_rs.events.packet import Packet
from davis_rs.geometry.pose import GroundTruth, Pose
from davis_rs.geometry.trajectory.views import Views
from davis_rs.io.dataset.writer import DatasetWriter
from davis_rs.render.choice import make_renderer
from davis_rs.scene.builtin.checkerboard import DATASET_BOARD
from davis_rs.scene.builtin.checkerboard_scene import board_in_world
from davis_rs.sensor.imu import ImuArray

FloatArray = npt.NDArray[np.float64]

SCENE = load_scene("checkerboard")
CAMERA = SCENE.own_camera
BOARD = DATASET_BOARD
FRAME_RATE_HZ = 10


def path() -> Trajectory:
    assert SCENE.trajectory is not None
    return SCENE.trajectory


class Frames(NamedTuple):
    """Rendered frames: times (n,) in microseconds and linear light, uint8 (n, H, W)."""

    t_us: npt.NDArray[np.int64]
    images: npt.NDArray[np.uint8]
    luma: npt.NDArray[np.float32]


@lru_cache
def frames() -> Frames:
    """The whole path of the scene, ten frames a second, without motion blur."""
    t_us = np.arange(0, 20_000_000, 1_000_000 // FRAME_RATE_HZ)
    luma = make_renderer(SCENE, CAMERA).luma(Views.along(path(), t_us * 1e-6))
    exposure = 0.8 / np.percentile(luma[0], 98)
    return Frames(t_us, np.clip(np.round(255 * exposure * luma), 0, 255).astype(np.uint8), luma)


@lru_cache
def found_views(every: int = 1) -> list[BoardView]:
    """The board in every so many of those frames, as it is found."""
    t_us, images, _ = frames()
    found = {i: find_corners(images[i], BOARD) for i in range(0, len(images), every)}
    return [BoardView(int(t_us[i]), i, corners) for i, corners in found.items() if corners is not None]


def exact_view(board_camera: FloatArray, number: int = 0, camera: Camera = CAMERA) -> BoardView:
    """What a camera at T_board_camera (4, 4) sees, computed."""
    to_camera = inverse(board_camera)
    corners = camera.project(BOARD.corners @ to_camera[:3, :3].T + to_camera[:3, 3])
    return BoardView(number * 100_000, number, corners)


def board_camera(t_s: float) -> FloatArray:
    """T_board_camera on the scene's path, (4, 4)."""
    return np.asarray(inverse(board_in_world().matrix) @ path().pose(t_s).matrix)


def matrices(poses: GroundTruth) -> FloatArray:
    return transform(Rotation.from_quat(poses.quaternions).as_matrix(), poses.positions)


def ground_truth(t_us: npt.NDArray[np.int64], poses: FloatArray) -> GroundTruth:
    return GroundTruth(t_us, poses[:, :3, 3], Rotation.from_matrix(poses[:, :3, :3]).as_quat())


def degrees_between(a: FloatArray, b: FloatArray) -> float:
    """The angle between the rotations of two transforms."""
    return float(np.degrees(Rotation.from_matrix(a[:3, :3].T @ b[:3, :3]).magnitude()))


def write_folder(folder: Path, chosen: slice, poses: GroundTruth | None = None, imu: ImuArray | None = None) -> None:
    """A dataset of some of the frames, without events, with what a tracker and an IMU measured."""
    t_us, _, luma = frames()
    still, none, before = Pose((0, 0, 0), (0, 0, 0, 1)), np.empty(0, EVENT_DTYPE), 0
    with DatasetWriter(folder, CAMERA, check_frames=0) as writer:
        for t, image in zip(t_us[chosen].tolist(), luma[chosen], strict=True):
            writer.write(Packet(before, t, none, still, image))
            before = t
        stamped = [] if poses is None else [(int(t), Pose(p, q)) for t, p, q in zip(*poses, strict=True)]
        writer.write(Packet(before, before, none, still), stamped, imu)
