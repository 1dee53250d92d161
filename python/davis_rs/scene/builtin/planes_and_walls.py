"""Makes the two scenes that the public dataset simulates: three_planes and three_walls.

Their original textures are lost; these are procedural, and tuned so that the event counts are of the same size.

Source: Mueggler et al., IJRR 2017, section 6 and table of sequences (simulation_3planes, simulation_3walls).
"""

from __future__ import annotations

import numpy as np

from ..._mitsuba.types import SceneDictionary
from ...geometry.pose import FloatArray
from ...geometry.trajectory.trajectory import CallableTrajectory
from ..parts import DIRECT, look_at, textured_rectangle
from ..scene import Scene


def three_planes() -> Scene:
    """Make three textured planes at three depths, seen from a circle of 0.2 m radius; 2 s, C = 0.15.

    The middle plane is the nearest, and the camera always above it: it sees both of its edges from the high side, in
    front of the farther planes. So no shadow of the light, which stands high above, can be seen.
    """
    centre = np.array([-0.5, 1.0, 1.8])

    def angle(t: FloatArray) -> FloatArray:
        return 2 * np.pi * t / 1.999  # theta = 2 pi k / 1999 at k ms

    def positions(t: FloatArray) -> FloatArray:
        theta = angle(t)
        return centre + np.stack([0.2 * np.sin(theta), 0.2 * np.cos(theta), np.zeros_like(theta)], -1)

    def velocities(t: FloatArray) -> FloatArray:
        theta = angle(t)
        rate = 2 * np.pi / 1.999
        return rate * np.stack([0.2 * np.cos(theta), -0.2 * np.sin(theta), np.zeros_like(theta)], -1)

    trajectory = CallableTrajectory(
        duration_s=2.0,
        position=positions,
        quaternion=lambda t: np.broadcast_to(np.array([1.0, 0, 0, 0]), (len(t), 4)),
        velocity=velocities,
        angular_rate=lambda t: np.zeros((len(t), 3)),
        description={
            "path": "x = -0.5 + 0.2 sin(theta), y = 1 + 0.2 cos(theta), z = 1.8, theta = 2 pi t / 1.999 s",
            "quaternion_xyzw": [1, 0, 0, 0],
        },
    )
    return Scene(name="three_planes", source=_planes, trajectory=trajectory, blur=True, shadows=False)


def _planes() -> SceneDictionary:
    return {
        "type": "scene",
        "integrator": DIRECT,
        "light": {"type": "point", "position": [-0.5, 1.0, 8.0], "intensity": 180.0},
        # Half-widths in x and y.
        "left": _plane([-4.3, 1.0, -0.1], (3.5, 6.0), 11),
        "middle": _plane([-0.5, 1.0, 0.6], (0.3, 6.0), 12),
        "right": _plane([3.3, 1.0, 0.2], (3.5, 6.0), 13),
    }


def _plane(centre: list[float], half: tuple[float, float], seed: int) -> SceneDictionary:
    """Make a horizontal plane, facing up."""
    return textured_rectangle(centre, np.eye(3), half, seed=seed, period=0.8, darkest=0.02, shapes=900)


_TOP_SPEED, _TOP_RATE = 5.31, np.radians(109.0)


def three_walls() -> Scene:
    """Make a corner of two walls and a floor, seen on a fast 6-DOF path; 2 s, C = 0.2.

    The camera goes at most 5.31 m/s and 109 deg/s.
    """
    from scipy.spatial.transform import Rotation

    # Sines a_i sin(2 pi f t + phase) in each of x, y, z and of a rotation vector; amplitudes before scaling.
    frequency = np.array([[0.5, 0.9, 0.7], [1.3, 1.7, 1.1]])
    phase = np.array([[0.0, 1.0, 2.0], [0.5, 2.5, 4.0]])
    reach = np.array([[1.0, 1.0, 0.6], [0.25, 0.25, 0.2]])
    turn = np.array([[0.35, 0.45, 0.4], [0.12, 0.1, 0.15]])
    centre = np.array([3.2, 3.0, 1.8])
    looking = Rotation.from_matrix(look_at(centre, np.array([0.0, 0.0, 0.9])))

    def sines(t: FloatArray, amplitude: FloatArray, derivative: bool) -> FloatArray:
        argument = 2 * np.pi * frequency * t[..., None, None] + phase
        waves = 2 * np.pi * frequency * np.cos(argument) if derivative else np.sin(argument)
        return np.asarray((amplitude * waves).sum(-2))

    def rates(t: FloatArray, amplitude: FloatArray) -> FloatArray:
        """Return the body rates of exp(r(t)): the right Jacobian of SO(3) times dr/dt."""
        r, dr = sines(t, amplitude, False), sines(t, amplitude, True)
        angle = np.linalg.norm(r, axis=-1, keepdims=True)
        safe = np.maximum(angle, 1e-9)
        cross = np.cross(r, dr)
        return np.asarray(
            dr - (1 - np.cos(safe)) / safe**2 * cross + (safe - np.sin(safe)) / safe**3 * np.cross(r, cross)
        )

    # Scale the path so that its top speeds are the paper's.
    t = np.linspace(0, 2, 20001)
    reach = reach * (_TOP_SPEED / np.linalg.norm(sines(t, reach, True), axis=-1).max())
    for _ in range(20):
        turn = turn * (_TOP_RATE / np.linalg.norm(rates(t, turn), axis=-1).max())

    def quaternions(t: FloatArray) -> FloatArray:
        vectors = sines(t, turn, False)
        turned = (looking * Rotation.from_rotvec(vectors.reshape(-1, 3))).as_quat().reshape(len(t), 4)
        # The start orientation is far from the sign change, so the first quaternion's sign serves for all.
        return np.asarray(turned * np.where(turned @ looking.as_quat() < 0, -1.0, 1.0)[..., None])

    trajectory = CallableTrajectory(
        duration_s=2.0,
        position=lambda t: centre + sines(t, reach, False),
        quaternion=quaternions,
        velocity=lambda t: sines(t, reach, True),
        angular_rate=lambda t: rates(t, turn),
        description={
            "path": "sums of two sines in position and in rotation vector",
            "top_speed_m_s": _TOP_SPEED,
            "top_rate_deg_s": float(np.degrees(_TOP_RATE)),
        },
    )
    return Scene(
        name="three_walls", source=_walls, trajectory=trajectory, contrast_threshold=0.2, blur=True, shadows=False
    )


def _walls() -> SceneDictionary:
    x, y, z = np.eye(3)
    # Seen from inside of a concave corner, no wall shades another.
    return {
        "type": "scene",
        "integrator": DIRECT,
        "light": {"type": "point", "position": [6.0, 6.0, 7.0], "intensity": 250.0},
        # They reach a little past the corner, so that no ray slips through where they meet.
        "wall_x": textured_rectangle(
            [0.0, 7.9, 7.9], np.stack([y, z, x], 1), (8.0, 8.0), seed=21, period=4.0, darkest=0.1, shapes=350
        ),
        "wall_y": textured_rectangle(
            [7.9, 0.0, 7.9], np.stack([z, x, y], 1), (8.0, 8.0), seed=22, period=4.0, darkest=0.1, shapes=350
        ),
        "floor": textured_rectangle(
            [7.9, 7.9, 0.0], np.stack([x, y, z], 1), (8.0, 8.0), seed=23, period=4.0, darkest=0.1, shapes=350
        ),
    }
