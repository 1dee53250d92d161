"""Trajectories: pose, velocity and angular rate of a camera at any time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt

from .pose import FloatArray, Pose, body_rates, conjugate, describe_pose, hamilton, rotation_matrices

TIME_TOLERANCE_S = 1e-6


class Trajectory(ABC):
    """A camera's path over [0, ``duration_s``] seconds.

    An implementation sets ``duration_s`` and gives the five abstract methods; those that take times, (n,) in seconds,
    pass them through :meth:`times` first.
    """

    duration_s: float

    @abstractmethod
    def positions(self, t_s: npt.ArrayLike) -> FloatArray:
        """Camera centres (n, 3) in the world, metres."""

    @abstractmethod
    def quaternions(self, t_s: npt.ArrayLike) -> FloatArray:
        """Unit quaternions (n, 4) of R_world_camera, (x, y, z, w); the sign is continuous in time."""

    @abstractmethod
    def velocities(self, t_s: npt.ArrayLike) -> FloatArray:
        """Velocities (n, 3) in world axes, m/s."""

    @abstractmethod
    def angular_rates(self, t_s: npt.ArrayLike) -> FloatArray:
        """Angular rates (n, 3) in body (camera) axes, rad/s: what a gyroscope in the camera measures."""

    @abstractmethod
    def describe(self) -> dict[str, object]:
        """What this trajectory is and where it comes from, of types that JSON knows."""

    def rotations(self, t_s: npt.ArrayLike) -> FloatArray:
        """R_world_camera, shape (n, 3, 3)."""
        return rotation_matrices(self.quaternions(t_s))

    def pose(self, t_s: float) -> Pose:
        """T_world_camera at one time."""
        return Pose(self.positions([t_s])[0], self.quaternions([t_s])[0])

    def times(self, t_s: npt.ArrayLike) -> FloatArray:
        """``t_s`` as float64 (n,), times up to 1 us outside the range moved onto its end.

        Raises:
            ValueError: for another shape, or a time outside [0, ``duration_s``] by more than 1 us (or NaN).
        """
        t = np.asarray(t_s, np.float64)
        if t.ndim != 1:
            raise ValueError(f"times must have shape (n,), got {t.shape}")
        outside = ~((t >= -TIME_TOLERANCE_S) & (t <= self.duration_s + TIME_TOLERANCE_S))
        if outside.any():
            raise ValueError(
                f"time {t[outside][0]} s is outside the trajectory, which runs from 0 to {self.duration_s} s"
            )
        return np.clip(t, 0.0, self.duration_s)


def _checked_duration(duration_s: float) -> float:
    if not (np.isfinite(duration_s) and duration_s > 0):
        raise ValueError(f"a trajectory's duration must be finite and > 0 s, got {duration_s}")
    return float(duration_s)


class CallableTrajectory(Trajectory):
    """A path given by functions, each exact in its own right: nothing is differentiated numerically.

    Args:
        duration_s: > 0.
        position, velocity: times (n,) in seconds -> (n, 3), world axes, m and m/s.
        quaternion: times -> (n, 4), unit, (x, y, z, w), continuous in sign.
        angular_rate: times -> (n, 3), body axes, rad/s.
        description: what :meth:`describe` adds to the duration.

    Raises:
        ValueError: for a bad duration; on evaluation, where a function returns another shape or a value not finite.
    """

    def __init__(
        self,
        duration_s: float,
        *,
        position: Callable[[FloatArray], npt.ArrayLike],
        quaternion: Callable[[FloatArray], npt.ArrayLike],
        velocity: Callable[[FloatArray], npt.ArrayLike],
        angular_rate: Callable[[FloatArray], npt.ArrayLike],
        description: Mapping[str, object],
    ) -> None:
        self.duration_s = _checked_duration(duration_s)
        self._position, self._quaternion = position, quaternion
        self._velocity, self._angular_rate = velocity, angular_rate
        self._description = dict(description)

    def positions(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._evaluate(self._position, "position", t_s, 3)

    def quaternions(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._evaluate(self._quaternion, "quaternion", t_s, 4)

    def velocities(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._evaluate(self._velocity, "velocity", t_s, 3)

    def angular_rates(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._evaluate(self._angular_rate, "angular_rate", t_s, 3)

    def describe(self) -> dict[str, object]:
        return {"kind": "analytic", "duration_s": self.duration_s, **self._description}

    def _evaluate(
        self, function: Callable[[FloatArray], npt.ArrayLike], name: str, t_s: npt.ArrayLike, width: int
    ) -> FloatArray:
        t = self.times(t_s)
        values = np.asarray(function(t), np.float64)
        if values.shape != (len(t), width):
            raise ValueError(f"{name}(t_s) must return shape ({len(t)}, {width}), got {values.shape}")
        finite = np.isfinite(values).all(-1)
        if not finite.all():
            raise ValueError(f"{name}(t_s) must be finite, got {values[~finite][0].tolist()} at {t[~finite][0]} s")
        return values


class SegmentTrajectory(Trajectory):
    """From one pose to the next at constant velocity and constant body rate, the shorter way round.

    For a controller that gives pose after pose. Of a half turn (both ways equally long) it takes the one that the
    quaternions' signs point to.

    Raises:
        ValueError: for a duration that is not finite and > 0.
    """

    def __init__(self, start: Pose, end: Pose, duration_s: float) -> None:
        self.duration_s = _checked_duration(duration_s)
        self.start, self.end = start, end
        self._velocity = (end.position - start.position) / self.duration_s
        # Slerp as a great circle of unit quaternions: q(t) = start cos(phi) + tangent sin(phi), phi growing evenly.
        cosine = float(start.quaternion @ end.quaternion)
        towards = end.quaternion if cosine >= 0 else -end.quaternion
        across = towards - abs(cosine) * start.quaternion
        sine = float(np.linalg.norm(across))
        self._tangent = across / sine if sine > 0 else across
        self._phi_rate = np.arctan2(sine, abs(cosine)) / self.duration_s

    def positions(self, t_s: npt.ArrayLike) -> FloatArray:
        return self.start.position + self.times(t_s)[:, None] * self._velocity

    def quaternions(self, t_s: npt.ArrayLike) -> FloatArray:
        phi = self.times(t_s)[:, None] * self._phi_rate
        q: FloatArray = self.start.quaternion * np.cos(phi) + self._tangent * np.sin(phi)
        return q

    def velocities(self, t_s: npt.ArrayLike) -> FloatArray:
        return np.tile(self._velocity, (len(self.times(t_s)), 1))

    def angular_rates(self, t_s: npt.ArrayLike) -> FloatArray:
        rate = body_rates(self.start.quaternion, self._tangent * self._phi_rate)
        return np.tile(rate, (len(self.times(t_s)), 1))

    def describe(self) -> dict[str, object]:
        return {
            "kind": "segment",
            "duration_s": self.duration_s,
            "start": describe_pose(self.start),
            "end": describe_pose(self.end),
        }


class _Aligned(Trajectory):
    def __init__(self, trajectory: Trajectory, pose: Pose, at_s: float) -> None:
        was = trajectory.pose(at_s)
        self.duration_s = trajectory.duration_s
        self._base, self._pose, self._at_s = trajectory, pose, float(at_s)
        self._quaternion = hamilton(pose.quaternion, conjugate(was.quaternion))
        self._rotation = rotation_matrices(self._quaternion)
        self._origin, self._target = was.position, pose.position

    def positions(self, t_s: npt.ArrayLike) -> FloatArray:
        return (self._base.positions(t_s) - self._origin) @ self._rotation.T + self._target

    def quaternions(self, t_s: npt.ArrayLike) -> FloatArray:
        return hamilton(self._quaternion, self._base.quaternions(t_s))

    def velocities(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._base.velocities(t_s) @ self._rotation.T

    def angular_rates(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._base.angular_rates(t_s)

    def describe(self) -> dict[str, object]:
        at = {"at_s": self._at_s, "pose": describe_pose(self._pose)}
        return {"kind": "aligned", "duration_s": self.duration_s, **at, "trajectory": self._base.describe()}


def align(trajectory: Trajectory, pose: Pose, at_s: float = 0.0) -> Trajectory:
    """``trajectory`` moved rigidly so that its pose at ``at_s`` is ``pose``: T_new(t) = pose T(at_s)^-1 T(t).

    Velocities turn with it; body rates stay as they are.

    Raises:
        ValueError: if ``at_s`` is outside the trajectory.
    """
    return _Aligned(trajectory, pose, at_s)


class _Interval(Trajectory):
    def __init__(self, trajectory: Trajectory, start_s: float, duration_s: float) -> None:
        self.duration_s = duration_s
        self._base, self._start_s = trajectory, start_s

    def positions(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._base.positions(self.times(t_s) + self._start_s)

    def quaternions(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._base.quaternions(self.times(t_s) + self._start_s)

    def velocities(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._base.velocities(self.times(t_s) + self._start_s)

    def angular_rates(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._base.angular_rates(self.times(t_s) + self._start_s)

    def describe(self) -> dict[str, object]:
        at = {"start_s": self._start_s, "duration_s": self.duration_s}
        return {"kind": "interval", **at, "trajectory": self._base.describe()}


def interval(trajectory: Trajectory, start_s: float = 0.0, duration_s: float | None = None) -> Trajectory:
    """The part of ``trajectory`` from ``start_s`` on, ``duration_s`` long (default: to its end), t = 0 at its start.

    Raises:
        ValueError: for a duration that is not > 0, or a part that is not inside the trajectory (within 1 us).
    """
    if duration_s is None:
        duration_s = trajectory.duration_s - start_s
    end_s = start_s + duration_s
    if not (0 <= start_s < trajectory.duration_s and start_s < end_s <= trajectory.duration_s + TIME_TOLERANCE_S):
        raise ValueError(
            f"the interval from {start_s} s to {end_s} s must be longer than 0 s and lie inside the trajectory, "
            f"which runs from 0 to {trajectory.duration_s} s"
        )
    return _Interval(trajectory, float(start_s), min(float(duration_s), trajectory.duration_s - start_s))
