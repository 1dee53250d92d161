"""Holds what the cameras of a rig saw of a board, and where they are relative to the first one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .board_pose import BoardPose
from .reprojection import vector_of

FloatArray = npt.NDArray[np.float64]


class RelativeCamera(NamedTuple):
    """Holds where another camera is, and what its clock shows.

    Attributes:
        rotation: (3, 3), from its axes to those of the first camera.
        place: (3,) metres, its centre in those axes.
        lag_s: a frame stamped t shows what was at t - lag_s on the first camera's clock.
    """

    rotation: FloatArray
    place: FloatArray
    lag_s: float


FIRST_CAMERA = RelativeCamera(np.eye(3), np.zeros(3), 0.0)
"""The first camera, as one of the cameras."""


class CameraViews:
    """Holds the board's poses that a camera found, with their accuracy.

    Attributes:
        t_s: (n,) times, seconds, less ``shift_s``.
        turns, positions: (n, 3, 3) and (n, 3), T_board_camera.
        pixel: noise of an axis of a corner, as far as the corners tell.
        whiten: (n, 6, 6), from small motions in camera axes to units of their noise.
    """

    def __init__(self, poses: Sequence[BoardPose], shift_s: float = 0.0) -> None:
        matrices = np.stack([pose.matrix for pose in poses])
        self.t_s = np.array([pose.view.t_us for pose in poses]) * 1e-6 - shift_s
        self.turns, self.positions = matrices[:, :3, :3], matrices[:, :3, 3]
        self.pixel = float(np.sqrt(np.mean([pose.rms_px**2 / 2 for pose in poses])))
        information = np.stack([pose.information for pose in poses]) / self.pixel**2
        self.whiten = np.swapaxes(np.linalg.cholesky(information), 1, 2)

    def errors(self, turns: FloatArray, positions: FloatArray) -> FloatArray:
        """Return by how much the camera at given poses (n, 3, 3) and (n, 3) is off, (n, 6), in its own axes."""
        turned = vector_of(np.swapaxes(self.turns, 1, 2) @ turns)
        return np.concatenate([turned, np.einsum("nji,nj->ni", self.turns, positions - self.positions)], 1)
