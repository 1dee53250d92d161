"""Defines what an action does to a camera: poses, velocities, or forces on a body that carries it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box, Space

from .._util.argument_checks import check_number
from ..geometry.pose import FloatArray, Pose

GRAVITY = np.array([0.0, 0.0, -9.81])
"""In world axes, m/s^2."""

_SUBSTEP_S = 1e-3


@dataclass(frozen=True, eq=False)
class BodyState:
    """Holds how the camera moves at an instant.

    Attributes:
        pose: T_world_camera.
        velocity: float64 (3,), of the camera's centre in world axes, m/s.
        angular_rate: float64 (3,), in camera axes, rad/s.
    """

    pose: Pose
    velocity: FloatArray
    angular_rate: FloatArray


class Body(ABC):
    """Carries the camera, and moves as its actions say.

    Attributes:
        action_space: a box (k,) of float32.
        state: how the camera moves now.
    """

    action_space: Space[npt.NDArray[Any]]
    state: BodyState

    def reset(self, start: Pose) -> None:
        """Begin at rest, with the camera at a pose."""
        self.state = BodyState(start, np.zeros(3), np.zeros(3))

    @abstractmethod
    def move(self, action: FloatArray, duration_s: float) -> BodyState:
        """Move for a time under one action, and return the state at its end.

        Args:
            action: float64 (k,), within :attr:`action_space`.
        """


class PoseBody(Body):
    """Goes where it is told: an action is a pose relative to the start, (x, y, z, rx, ry, rz).

    The first three are metres, the others a rotation vector in radians, both in the camera's axes at the start. The
    camera gets there within the step, whatever the distance.

    Args:
        reach_m, turn_rad: limits of each component.
    """

    def __init__(self, *, reach_m: float = 0.5, turn_rad: float = 0.5) -> None:
        check_number("reach_m", reach_m, 0, above_low=True, unit="m")
        check_number("turn_rad", turn_rad, 0, np.pi / np.sqrt(3), above_low=True, unit="rad")
        self.action_space = _box([reach_m] * 3 + [turn_rad] * 3)

    def reset(self, start: Pose) -> None:
        super().reset(start)
        self._start = start

    def move(self, action: FloatArray, duration_s: float) -> BodyState:
        from scipy.spatial.transform import Rotation

        before = self.state.pose
        pose = self._start @ Pose(action[:3], Rotation.from_rotvec(action[3:]).as_quat())
        turn = Rotation.from_matrix(before.rotation.T @ pose.rotation).as_rotvec()
        self.state = BodyState(pose, (pose.position - before.position) / duration_s, turn / duration_s)
        return self.state


class VelocityBody(Body):
    """Has the velocity that it is told at once: an action is (vx, vy, vz, wx, wy, wz), all in camera axes.

    Args:
        max_speed_m_s, max_rate_rad_s: limits of each component.
    """

    def __init__(self, *, max_speed_m_s: float = 2.0, max_rate_rad_s: float = 3.0) -> None:
        check_number("max_speed_m_s", max_speed_m_s, 0, above_low=True, unit="m/s")
        check_number("max_rate_rad_s", max_rate_rad_s, 0, above_low=True, unit="rad/s")
        self.action_space = _box([max_speed_m_s] * 3 + [max_rate_rad_s] * 3)

    def move(self, action: FloatArray, duration_s: float) -> BodyState:
        before = self.state.pose
        velocity, rate = before.rotation @ action[:3], action[3:]
        pose = Pose(before.position + velocity * duration_s, _turned(before, rate * duration_s))
        self.state = BodyState(pose, velocity, rate)
        return self.state


class PointMassBody(Body):
    """Accelerates as it is told and does not turn: an action is (ax, ay, az) in world axes, m/s^2, without gravity.

    Args:
        max_acceleration_m_s2: limit of each component.
        drag_per_s: v' = a - drag v.
    """

    def __init__(self, *, max_acceleration_m_s2: float = 10.0, drag_per_s: float = 0.0) -> None:
        check_number("max_acceleration_m_s2", max_acceleration_m_s2, 0, above_low=True, unit="m/s^2")
        check_number("drag_per_s", drag_per_s, 0, unit="1/s")
        self.action_space, self._drag = _box([max_acceleration_m_s2] * 3), drag_per_s

    def move(self, action: FloatArray, duration_s: float) -> BodyState:
        before = self.state
        position, velocity = _dragged(before.pose.position, before.velocity, action, self._drag, duration_s)
        self.state = BodyState(Pose(position, before.pose.quaternion), velocity, np.zeros(3))
        return self.state


class QuadrotorBody(Body):
    """Flies by collective thrust and body rates: an action is (thrust, wx, wy, wz).

    Thrust is per mass in m/s^2, along the body's z; 9.81 hovers when level. Rates are in body axes (x ahead, y left, z
    up), rad/s; the body follows them with a time constant. Drag is linear: v' = g + R (0, 0, thrust) - drag v. The
    camera sits in the body's centre and looks ahead, tilted up by ``camera_tilt_rad``.

    Args:
        max_thrust_m_s2: thrust is between 0 and this.
        max_rate_rad_s: limit of each rate.
        rate_time_constant_s: of the body's rates; 0 follows at once.

    Source: the control modality and the model of Kaufmann, Bauersfeld, Scaramuzza, A Benchmark Comparison of Learned
    Control Policies for Agile Quadrotor Flight, ICRA 2022, section III (collective thrust and body rates).
    """

    def __init__(
        self,
        *,
        max_thrust_m_s2: float = 30.0,
        max_rate_rad_s: float = 6.0,
        rate_time_constant_s: float = 0.03,
        drag_per_s: float = 0.2,
        camera_tilt_rad: float = 0.0,
    ) -> None:
        check_number("max_thrust_m_s2", max_thrust_m_s2, 9.81, above_low=True, unit="m/s^2")
        check_number("max_rate_rad_s", max_rate_rad_s, 0, above_low=True, unit="rad/s")
        check_number("rate_time_constant_s", rate_time_constant_s, 0, unit="s")
        check_number("drag_per_s", drag_per_s, 0, unit="1/s")
        check_number("camera_tilt_rad", camera_tilt_rad, -np.pi / 2, np.pi / 2, unit="rad")
        self.action_space = _box([max_thrust_m_s2] + [max_rate_rad_s] * 3, lowest=[0.0] + [-max_rate_rad_s] * 3)
        self._lag_s, self._drag = rate_time_constant_s, drag_per_s
        sine, cosine = np.sin(camera_tilt_rad), np.cos(camera_tilt_rad)
        mount = np.eye(4)  # columns: where the camera's right, down and ahead point in the body
        mount[:3, :3] = np.array([[0.0, -1.0, 0.0], [sine, 0.0, -cosine], [cosine, 0.0, sine]]).T
        self._mount = Pose.from_matrix(mount)

    def reset(self, start: Pose) -> None:
        super().reset(start)
        self._body, self._velocity, self._rate = start @ self._mount.inverse, np.zeros(3), np.zeros(3)

    def move(self, action: FloatArray, duration_s: float) -> BodyState:
        steps = max(1, int(np.ceil(duration_s / _SUBSTEP_S - 1e-9)))
        for _ in range(steps):
            self._substep(action, duration_s / steps)
        rate = self._mount.rotation.T @ self._rate
        self.state = BodyState(self._body @ self._mount, self._velocity, rate)
        return self.state

    def _substep(self, action: FloatArray, dt_s: float) -> None:
        """Move for at most a millisecond; rates and drag follow their own exponentials, thrust acts half way round."""
        kept = np.exp(-dt_s / self._lag_s) if self._lag_s > 0 else 0.0
        after = action[1:] + kept * (self._rate - action[1:])
        middle = (self._rate + after) / 2
        half_way = Pose(self._body.position, _turned(self._body, middle * dt_s / 2))
        acceleration = GRAVITY + action[0] * half_way.rotation[:, 2]
        position, self._velocity = _dragged(self._body.position, self._velocity, acceleration, self._drag, dt_s)
        self._body = Pose(position, _turned(self._body, middle * dt_s))
        self._rate = after


BODIES: dict[str, type[Body]] = {
    "pose": PoseBody,
    "velocity": VelocityBody,
    "point_mass": PointMassBody,
    "quadrotor": QuadrotorBody,
}
"""The bodies by the names that they have in environments' ids and arguments."""


def _box(highest: list[float], *, lowest: list[float] | None = None) -> Space[npt.NDArray[Any]]:
    high = np.array(highest, np.float32)
    return Box(-high if lowest is None else np.array(lowest, np.float32), high, dtype=np.float32)


def _turned(pose: Pose, rotvec: npt.ArrayLike) -> FloatArray:
    """Return the quaternion of a pose turned by a rotation vector in its own axes."""
    from scipy.spatial.transform import Rotation

    return np.asarray((Rotation.from_quat(np.array(pose.quaternion)) * Rotation.from_rotvec(rotvec)).as_quat())


def _dragged(
    position: FloatArray, velocity: FloatArray, acceleration: FloatArray, drag_per_s: float, t_s: float
) -> tuple[FloatArray, FloatArray]:
    """Return position and velocity a time later, under constant acceleration and linear drag: the exact solution."""
    if drag_per_s == 0:
        return position + velocity * t_s + acceleration * t_s**2 / 2, velocity + acceleration * t_s
    final, reached = acceleration / drag_per_s, -np.expm1(-drag_per_s * t_s)
    return position + final * t_s + (velocity - final) * reached / drag_per_s, velocity + (final - velocity) * reached
