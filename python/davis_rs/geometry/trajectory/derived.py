"""Derives paths from others: of what is mounted on a moving body, and of the same motion by another clock."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..._util.argument_checks import check_number, check_type
from ..pose import FloatArray, PoseLike, as_pose, describe_pose, hamilton
from .trajectory import Trajectory


class MountedTrajectory(Trajectory):
    """Moves what is mounted on a body rigidly: T_world_camera(t) = T_world_body(t) T_body_camera.

    Velocities and accelerations count the lever arm, so that what is mounted far from the body's origin moves faster
    when the body turns. Derivatives are as exact as the body's.

    Args:
        body: the body's path.
        mount: T_body_camera: a :class:`~davis_rs.Pose`, a matrix (4, 4), or (position, quaternion).

    Raises:
        TypeError: for a body's path that is no trajectory.
        ValueError: for what is no pose.
    """

    def __init__(self, body: Trajectory, mount: PoseLike) -> None:
        check_type("body", body, Trajectory, "a scene's is scene.path")
        self.duration_s, self.start_time_ns = body.duration_s, body.start_time_ns
        self._body, self._mount = body, as_pose(mount, "mount")
        self._arm, self._to_mounted = self._mount.position, self._mount.rotation

    def positions(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._body.positions(t_s) + self._in_world(t_s, self._arm)

    def quaternions(self, t_s: npt.ArrayLike) -> FloatArray:
        return hamilton(self._body.quaternions(t_s), self._mount.quaternion)

    def velocities(self, t_s: npt.ArrayLike) -> FloatArray:
        turning = np.cross(self._body.angular_rates(t_s), self._arm)
        return self._body.velocities(t_s) + self._in_world(t_s, turning)

    def angular_rates(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._body.angular_rates(t_s) @ self._to_mounted

    def accelerations(self, t_s: npt.ArrayLike) -> FloatArray:
        rates = self._body.angular_rates(t_s)
        turning = np.cross(self._body.angular_accelerations(t_s), self._arm)
        turning = turning + np.cross(rates, np.cross(rates, self._arm))
        return self._body.accelerations(t_s) + self._in_world(t_s, turning)

    def angular_accelerations(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._body.angular_accelerations(t_s) @ self._to_mounted

    def breaks_s(self) -> FloatArray:
        return self._body.breaks_s()

    def describe(self) -> dict[str, object]:
        mount = describe_pose(self._mount)
        return {"kind": "mounted", "duration_s": self.duration_s, "mount": mount, "body": self._body.describe()}

    def _in_world(self, t_s: npt.ArrayLike, vectors: FloatArray) -> FloatArray:
        """Turn vectors (n, 3), or one (3,), from the body's axes to the world's."""
        return np.einsum("nij,nj->ni", self._body.rotations(t_s), np.broadcast_to(vectors, (np.size(t_s), 3)))


class PacedTrajectory(Trajectory):
    """Tells the same motion by a clock of another pace: at the clock's time t the other path is at t / ``pace``.

    Args:
        trajectory: the path by its own clock.
        pace: seconds of the new clock in a second of the path's own, > 0.

    Raises:
        TypeError: for what is no trajectory.
        ValueError: for a pace that is not finite and > 0.
    """

    def __init__(self, trajectory: Trajectory, pace: float) -> None:
        check_type("trajectory", trajectory, Trajectory, "a scene's is scene.path")
        check_number("pace", pace, 0, above_low=True)
        self.duration_s, self.start_time_ns = trajectory.duration_s * pace, trajectory.start_time_ns
        self._base, self._pace = trajectory, float(pace)

    def positions(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._base.positions(self._own_times(t_s))

    def quaternions(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._base.quaternions(self._own_times(t_s))

    def velocities(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._base.velocities(self._own_times(t_s)) / self._pace

    def angular_rates(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._base.angular_rates(self._own_times(t_s)) / self._pace

    def accelerations(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._base.accelerations(self._own_times(t_s)) / self._pace**2

    def angular_accelerations(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._base.angular_accelerations(self._own_times(t_s)) / self._pace**2

    def breaks_s(self) -> FloatArray:
        return self._base.breaks_s() * self._pace

    def describe(self) -> dict[str, object]:
        return {
            "kind": "paced",
            "duration_s": self.duration_s,
            "pace": self._pace,
            "trajectory": self._base.describe(),
        }

    def _own_times(self, t_s: npt.ArrayLike) -> FloatArray:
        own: FloatArray = self.times(t_s) / self._pace
        return own
