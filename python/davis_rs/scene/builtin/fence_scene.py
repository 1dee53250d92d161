"""Makes the scene ``fence``: bars thinner than pixels and letters before a textured wall, hard for any sampling.

A bar narrower than the displacement between two renders comes and goes in between. Its contrast depends on how many
rays hit it. And it occludes what is behind.
"""

from __future__ import annotations

from itertools import count

import numpy as np

from ..._mitsuba.types import SceneDictionary
from ...geometry.pose import FloatArray
from ...geometry.trajectory.trajectory import CallableTrajectory
from ..parts import DIRECT, look_at, rectangle, textured_rectangle
from ..scene import Scene

_EYE = np.array([0.0, 0.0, 1.2])
_REACH = np.array([0.4, 0.1, 0.12])
_YAW, _ROLL = np.radians(4.0), np.radians(3.0)

_FENCE_M, _LETTERS_M, _WALL_M = 1.5, 2.4, 3.0
"""Distances from the camera's plane of motion; at the fence a pixel of the ideal camera is 7.5 mm wide."""

_WIDTHS_MM = (2.5, 9.0, 4.0, 11.0, 3.0, 6.0)
"""Widths of the bars, in turn: a third of a pixel to one and a half."""

_DARK, _BRIGHT = 0.03, 0.9


def fence() -> Scene:
    """Make thin vertical and slanted bars and the letters DAVIS before a wall, passed sideways; 2 s, C = 0.15.

    The camera swings 0.8 m to and fro, at up to 1.3 m/s (some 170 px/s at the fence), turning and rolling a little.
    """
    from scipy.spatial.transform import Rotation

    looking = Rotation.from_matrix(look_at(_EYE, _EYE + np.array([0.0, 1.0, 0.0])))
    # Position and the angles (yaw, roll): sines of whole periods in 2 s.
    multiples, phases = np.pi * np.array([1.0, 2.0, 2.0]), np.array([0.0, 0.7, 0.0])
    turn, turn_multiples = np.array([_YAW, _ROLL]), np.pi * np.array([2.0, 1.0])

    def angles(t: FloatArray) -> FloatArray:
        return np.asarray(turn * np.sin(turn_multiples * t[:, None]))

    def quaternions(t: FloatArray) -> FloatArray:
        # About the camera's y, then about its z.
        return np.asarray((looking * Rotation.from_euler("YZ", angles(t))).as_quat())

    def rates(t: FloatArray) -> FloatArray:
        yaw_rate, roll_rate = (turn * turn_multiples * np.cos(turn_multiples * t[:, None])).T
        roll = angles(t)[:, 1]
        return np.stack([yaw_rate * np.sin(roll), yaw_rate * np.cos(roll), roll_rate], -1)

    trajectory = CallableTrajectory(
        duration_s=2.0,
        position=lambda t: _EYE + _REACH * np.sin(multiples * t[:, None] + phases),
        velocity=lambda t: _REACH * multiples * np.cos(multiples * t[:, None] + phases),
        quaternion=quaternions,
        angular_rate=rates,
        description={"path": "sines in position, yaw and roll", "reach_m": _REACH.tolist()},
    )
    return Scene(name="fence", source=_fence, trajectory=trajectory, shadows=False)


def _fence() -> SceneDictionary:
    return {
        "type": "scene",
        "integrator": DIRECT,
        # From so high that all shadows fall below what the camera sees of the wall.
        "light": {"type": "point", "position": [0.0, 0.8, 8.0], "intensity": 600.0},
        "wall": textured_rectangle(
            [0.0, _WALL_M, 1.2], _facing(0.0), (4.0, 3.0), seed=31, period=3.0, darkest=0.1, shapes=350
        ),
        **_bars(),
        **_letters(),
    }


def _bars() -> SceneDictionary:
    """Make upright bars 11 cm apart, and two families of slanted ones just behind them; dark and bright in turn."""
    # In degrees, metres, number to either side, metres.
    families = [(0.0, 0.11, 15, _FENCE_M), (40.0, 0.37, 5, _FENCE_M + 1e-4), (-63.0, 0.53, 3, _FENCE_M + 2e-4)]
    bars: SceneDictionary = {}
    number = count()
    for degrees, spacing, to_either_side, distance in families:
        axes = _facing(degrees)
        for index in range(-to_either_side, to_either_side + 1):
            k = next(number)
            centre = np.array([0.0, distance, 1.2]) + index * spacing * axes[:, 0]
            half = (_WIDTHS_MM[k % len(_WIDTHS_MM)] / 2000, 2.0)
            bars[f"bar_{k:02}"] = rectangle(centre.tolist(), axes, half, _BRIGHT if k % 3 == 0 else _DARK)
    return bars


_STROKES: dict[str, list[tuple[float, float, float, float]]] = {
    "D": [(0, 0, 0, 4), (0, 4, 1.4, 4), (0, 0, 1.4, 0), (1.4, 4, 2, 3), (2, 3, 2, 1), (2, 1, 1.4, 0)],
    "A": [(0, 0, 1, 4), (1, 4, 2, 0), (0.4, 1.5, 1.6, 1.5)],
    "V": [(0, 4, 1, 0), (1, 0, 2, 4)],
    "I": [(1, 0, 1, 4)],
    "S": [(0, 0, 2, 0), (2, 0, 2, 2), (2, 2, 0, 2), (0, 2, 0, 4), (0, 4, 2, 4)],
}
"""The strokes of each letter, from point to point on a grid two wide and four high."""


def _letters() -> SceneDictionary:
    strokes: SceneDictionary = {}
    grid, half_width = 0.16, 0.03
    for index, letter in enumerate("DAVIS"):
        for k, (x0, z0, x1, z1) in enumerate(_STROKES[letter]):
            along = np.array([x1 - x0, z1 - z0]) * grid
            middle = np.array([(x0 + x1) / 2 + 2.9 * (index - 2) - 1, (z0 + z1) / 2 - 2]) * grid
            degrees = float(np.degrees(np.arctan2(along[0], along[1])))
            # Where strokes meet, one lies a little before the other.
            centre = [middle[0], _LETTERS_M - 1e-4 * k, 1.2 + middle[1]]
            half = (half_width, float(np.hypot(*along)) / 2 + half_width)
            strokes[f"letter_{letter}_{k}"] = rectangle(centre, _facing(degrees), half, _DARK if index % 2 else _BRIGHT)
    return strokes


def _facing(degrees: float) -> FloatArray:
    """Return the axes of a rectangle that faces the camera, turned clockwise from upright."""
    angle = np.radians(degrees)
    across, along = np.array([np.cos(angle), 0.0, -np.sin(angle)]), np.array([np.sin(angle), 0.0, np.cos(angle)])
    return np.stack([across, along, np.cross(across, along)], 1)
