"""Makes camera paths for scenes that have none: around an object, in a room, and a small one for a camera at rest."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..geometry.camera import PRESETS
from ..geometry.pose import FloatArray, Pose, hamilton
from ..geometry.trajectory.trajectory import CallableTrajectory
from .parts import look_at

CAMERA = PRESETS["ideal"]
"""The camera of a file that has none."""
_FILLED = 0.9
"""Fraction of the image's width or height that a mesh fills where it looks largest."""
_LOOKS, _HEIGHTS = 36, 33
"""From so many angles it is seen how large a mesh looks; so many heights are tried for what the camera looks at."""
_OFF = 1.05
"""The camera stays so far from what it looks at, in radii of a ball around the mesh."""
DEFAULT_DURATION_S = 2.0
"""How much of a path of 10 s the command line simulates where nothing else is said: all of it takes hours with glossy
surfaces on few processors."""
_ELEVATION_RAD, _TURN_S = np.radians(30.0), 10.0
_FREE, _MOST_M = 0.5, 0.5
"""The circle's radius in a room: as a fraction of the free distance, and in metres at most."""
_TILT_RAD = np.radians(10.0)
"""How far down the camera looks in a room, because things stand on the floor."""
_LEAST_SWING_RAD, _OFF_MIDDLE = np.radians(25.0), 0.7
"""A camera that swings goes at least so far to either side of its middle; it starts within this fraction of that."""
_SWAY, _SWAY_S = 0.05, 2.0
"""The radius of the small motion as a fraction of the depth, and how long a round takes."""


def direction(angle_rad: float, elevation_rad: float = _ELEVATION_RAD) -> FloatArray:
    """Return the unit vector from a circle's centre to the camera, turned by an angle from its start in front (-y)."""
    out, rise = np.cos(elevation_rad), np.sin(elevation_rad)
    return np.array([out * np.sin(angle_rad), -out * np.cos(angle_rad), rise])


class Turn(NamedTuple):
    """Says which way a camera looks on a circle, by angles from -y towards x.

    Attributes:
        start_rad: the first angle.
        swing_rad: how far it goes to either side of it, back and forth: (less, more); None: once all around.
    """

    start_rad: float
    swing_rad: tuple[float, float] | None = None

    def angles(self, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the angles at times (n,) in seconds, and their rates (n,) in rad/s."""
        rate = 2 * np.pi / _TURN_S
        if self.swing_rad is None:
            return self.start_rad + rate * t, np.full(len(t), rate)
        half = max(sum(self.swing_rad) / 2, _LEAST_SWING_RAD)
        # It starts where it looks best, but not at rest.
        off = float(np.clip((self.swing_rad[0] - self.swing_rad[1]) / 2 / half, -_OFF_MIDDLE, _OFF_MIDDLE))
        phase = np.arcsin(off) + rate * t
        return self.start_rad + half * (np.sin(phase) - off), half * rate * np.cos(phase)


class Circle(NamedTuple):
    """Holds where a camera goes around things.

    Attributes:
        centre: (3) what it looks at, metres.
        distance_m: how far it is from there.
    """

    centre: FloatArray
    distance_m: float

    def path(self, start_rad: float = 0.0) -> CallableTrajectory:
        """Make a path once around.

        Args:
            start_rad: where the camera stands first, from -y towards x.
        """
        return _circle(
            self.centre,
            self.distance_m,
            _ELEVATION_RAD,
            Turn(start_rad),
            look_at(direction(0.0), np.zeros(3)),
            {
                "path": "a circle around a mesh, looking at its middle",
                "centre_m": self.centre.tolist(),
                "distance_m": self.distance_m,
                "elevation_deg": float(np.degrees(_ELEVATION_RAD)),
                "start_deg": float(np.degrees(start_rad)),
            },
        )


def circle_around(points: FloatArray) -> Circle:
    """Return the circle around points (n, 3) that is so small that they just stay within the image.

    The camera looks at the point of the vertical axis through their middle from which it can be nearest.
    """
    low, high = points.min(0), points.max(0)
    middle = (low + high) / 2
    heights = np.linspace(low[2], high[2], _HEIGHTS)
    targets = np.stack([np.array([middle[0], middle[1], height]) for height in heights])
    angles = np.linspace(0.0, 2 * np.pi, _LOOKS, endpoint=False)
    turned = np.stack([look_at(direction(angle), np.zeros(3)) for angle in angles])
    distances = [_least_distance(points - target, turned) for target in targets]
    best = int(np.argmin(distances))
    return Circle(targets[best], distances[best])


def _least_distance(points: FloatArray, turned: FloatArray) -> float:
    """Return how near a camera may go around points (n, 3), which it looks at from around the origin.

    Args:
        turned: its axes (k, 3, 3) where it looks from.
    """
    seen = points @ turned
    # The depth that a point needs to lie within the image, by how far it is off its middle.
    across, down = (
        np.abs(seen[..., k]) * (2 / _FILLED * (focal / size))
        for k, (focal, size) in enumerate(((CAMERA.fx, CAMERA.width), (CAMERA.fy, CAMERA.height)))
    )
    needed = float((np.maximum(across, down) - seen[..., 2]).max())
    return max(_OFF * float(np.linalg.norm(points, axis=1).max()), needed)


def within(centre: FloatArray, free_m: float, turn: Turn) -> CallableTrajectory:
    """Make a path on a small level circle, looking out from its centre and 10 degrees down.

    Args:
        centre: (3), metres.
        free_m: how far the nearest surface is.
        turn: the directions of the looks.
    """
    distance = min(_FREE * free_m, _MOST_M)
    axes = look_at(np.zeros(3), direction(0.0, -_TILT_RAD))
    swing = {} if turn.swing_rad is None else {"swing_deg": np.degrees(turn.swing_rad).tolist()}
    return _circle(
        centre,
        distance,
        0.0,
        turn,
        axes,
        {
            "path": "a level circle in a room, looking out and 10 degrees down",
            "centre_m": centre.tolist(),
            "distance_m": float(distance),
            "start_deg": float(np.degrees(turn.start_rad)),
            **swing,
        },
    )


def sway(start: Pose, depth_m: float) -> CallableTrajectory:
    """Make a path of 2 s once around a small circle across the view, from a pose and back, without turning.

    Args:
        start: the pose at the start and at the end.
        depth_m: how far away things are; the circle's radius is 5 % of it, so that the image moves by some 30 px/s at
            a focal length of 200 px.
    """
    radius, rate = _SWAY * depth_m, 2 * np.pi / _SWAY_S
    right, down, _ = start.rotation.T

    def positions(t: FloatArray) -> FloatArray:
        aside, along = np.sin(rate * t)[:, None], (1 - np.cos(rate * t))[:, None]
        return start.position + radius * (aside * right + along * down)

    def velocities(t: FloatArray) -> FloatArray:
        return radius * rate * (np.cos(rate * t)[:, None] * right + np.sin(rate * t)[:, None] * down)

    return CallableTrajectory(
        duration_s=_SWAY_S,
        position=positions,
        velocity=velocities,
        quaternion=lambda t: np.tile(start.quaternion, (len(t), 1)),
        angular_rate=lambda t: np.zeros((len(t), 3)),
        description={"path": "a small circle across the view of a camera at rest", "radius_m": float(radius)},
    )


def _circle(
    centre: FloatArray,
    distance: float,
    elevation_rad: float,
    turn: Turn,
    axes: FloatArray,
    description: dict[str, object],
) -> CallableTrajectory:
    """Make a path around a centre, with the camera's axes (3, 3) at the angle 0, turning with it."""
    at_zero = Pose.from_matrix(np.block([[axes, np.zeros((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]]))

    def positions(t: FloatArray) -> FloatArray:
        return centre + distance * np.stack([direction(float(angle), elevation_rad) for angle in turn.angles(t)[0]])

    def velocities(t: FloatArray) -> FloatArray:
        angles, rates = turn.angles(t)
        along = np.stack([np.cos(angles), np.sin(angles), 0 * t], 1)
        return distance * np.cos(elevation_rad) * rates[:, None] * along

    def quaternions(t: FloatArray) -> FloatArray:
        half = turn.angles(t)[0] / 2
        turned = np.stack([0 * t, 0 * t, np.sin(half), np.cos(half)], 1)
        return hamilton(turned, np.broadcast_to(at_zero.quaternion, turned.shape))

    return CallableTrajectory(
        duration_s=_TURN_S,
        position=positions,
        velocity=velocities,
        quaternion=quaternions,
        angular_rate=lambda t: turn.angles(t)[1][:, None] * axes[2],
        description=description,
    )
