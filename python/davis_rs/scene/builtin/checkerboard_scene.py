"""Makes the scene ``checkerboard``: a checkerboard on a white panel, seen from many sides."""

from __future__ import annotations

from functools import cache

import numpy as np

from ..._mitsuba.types import SceneDictionary
from ...geometry.camera import PRESETS
from ...geometry.pose import FloatArray, Pose
from ...geometry.trajectory.sampled_trajectory import SampledTrajectory
from ..parts import DIRECT, rectangle
from ..scene import Scene
from .checkerboard import DATASET_BOARD

_AXES = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Board axes (x right, y down, z into the board) as columns in the world: it stands upright and is seen along +y."""

_CENTRE = np.array([0.0, 0.0, 1.2])
_MARGIN_M, _WALL_M = 0.14, 0.8
"""White around the tiles; the wall's distance behind them."""

_BLACK, _GREY, _WHITE = 0.08, 0.3, 0.9


@cache
def board_in_world() -> Pose:
    """Return T_world_board, in the board axes of :class:`.Checkerboard`."""
    origin = _CENTRE - _AXES @ DATASET_BOARD.centre
    return Pose.from_matrix(np.block([[_AXES, origin[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]]))


def checkerboard() -> Scene:
    """Make a checkerboard of 6 x 7 tiles of 70 mm on a white panel before a grey wall, for a DAVIS240C's lens; 20 s.

    Light falls straight on the board and from everywhere at once, so that one colour is equally bright everywhere. The
    camera goes :func:`around_board` at up to about 1 m/s and 130 deg/s.
    """
    return Scene(
        name="checkerboard", source=_scene, camera=PRESETS["davis240c"], trajectory=around_board(20.0), shadows=False
    )


def around_board(duration_s: float, *, pace: float = 1.0, gaze_pace: float = 1.0) -> SampledTrajectory:
    """Make a path around the board by up to 35 degrees to either side and 30 up and down, 0.6 to 1.2 m away.

    It rolls by up to 35 degrees and lets the board wander over the image: every rotation and translation is excited,
    which calibrating against a hand or an IMU needs.

    Args:
        duration_s: > 0.
        pace, gaze_pace: speed of the position, and of gaze and roll: 0.5 is half as fast.
    """
    t = np.linspace(0.0, duration_s, round(duration_s * 50) + 1)

    def position(amplitude: float, hertz: float, phase: float) -> FloatArray:
        return np.asarray(amplitude * np.sin(2 * np.pi * pace * hertz * t + phase))

    def gaze(amplitude: float, hertz: float, phase: float) -> FloatArray:
        return np.asarray(amplitude * np.sin(2 * np.pi * gaze_pace * hertz * t + phase))

    # The position: angles around the board, and distance.
    around, above = np.radians([position(35.0, 0.17, 0.0), position(30.0, 0.23, 1.0)])
    distance = 0.9 + position(0.27, 0.29, 2.5)
    direction = np.stack([np.sin(around) * np.cos(above), -np.cos(around) * np.cos(above), np.sin(above)], 1)
    positions = _CENTRE + distance[:, None] * direction
    # The direction: past the board's middle by these angles (more where it is far), and rolled.
    far = (distance - 0.63) / 0.54
    yaw = np.radians(2.5 + gaze(14.0, 0.41, 0.5) * far + gaze(3.0, 1.1, 0.0))
    pitch = np.radians(-6.0 + gaze(7.0, 0.53, 2.0) * far + gaze(3.0, 1.3, 1.0))
    roll = np.radians(gaze(25.0, 0.37, 0.3) + gaze(6.0, 0.9, 2.0))
    return SampledTrajectory(
        t,
        positions,
        _looking(-direction, yaw, pitch, roll),
        description={"path": "around a checkerboard, sines in place, distance, gaze and roll"},
    )


def _looking(forward: FloatArray, yaw: FloatArray, pitch: FloatArray, roll: FloatArray) -> FloatArray:
    """Return quaternions of cameras that look along ``forward`` (n, 3), then turned about their own y, x and z."""
    from scipy.spatial.transform import Rotation

    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    upright = Rotation.from_matrix(np.stack([right, np.cross(forward, right), forward], 2))
    return np.asarray((upright * Rotation.from_euler("YXZ", np.stack([yaw, pitch, roll], 1))).as_quat())


def _scene() -> SceneDictionary:
    board = DATASET_BOARD
    towards_camera = -_AXES[:, 2]
    facing = np.stack([_AXES[:, 0], -_AXES[:, 1], towards_camera], 1)
    half_tile = board.tile_m / 2
    origin = board_in_world().position
    tiles = {
        f"tile_{k:02}": rectangle((origin + _AXES @ centre).tolist(), facing, (half_tile, half_tile), _BLACK)
        for k, centre in enumerate(board.black_tiles)
    }
    # The panel lies just behind the tiles, so that their edges are where the board says.
    half_panel = (board.columns * half_tile + _MARGIN_M, board.rows * half_tile + _MARGIN_M)
    wall = _CENTRE - _WALL_M * towards_camera
    return {
        "type": "scene",
        "integrator": DIRECT,
        "sun": {"type": "directional", "direction": (-towards_camera).tolist(), "irradiance": 2.0},
        "sky": {"type": "constant", "radiance": 0.3},
        "panel": rectangle((_CENTRE - 1e-4 * towards_camera).tolist(), facing, half_panel, _WHITE),
        "wall": rectangle(wall.tolist(), facing, (30.0, 30.0), _GREY),
        **tiles,
    }
