"""Defines trajectories: pose, velocity and angular rate of a camera at any time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..._util.argument_checks import check_number, check_type
from ..._util.argument_error import ArgumentError
from ..._util.few_numbers import all_finite, all_within
from ..._util.html_table import html_lines, html_table
from ..pose import (
    FloatArray,
    Pose,
    PoseLike,
    as_pose,
    body_rates,
    conjugate,
    describe_pose,
    hamilton,
    rotation_matrices,
)

TIME_TOLERANCE_S = 1e-6

SPEED_WINDOW_S = 0.1
"""Length of the window of a top speed, which is a mean: see :meth:`Trajectory.top_speeds`."""

_PLOT_SAYS = "<div>position over time, from the start: x red, y green, z blue</div>"

_DIFFERENCE_STEP_S = 1e-4


class TopSpeeds(NamedTuple):
    """Holds the fastest motion of a trajectory, and when its window begins: m/s, rad/s, and seconds for either."""

    speed_m_s: float
    rate_rad_s: float
    speed_at_s: float
    rate_at_s: float


class Trajectory(ABC):
    """Describes a camera's path over [0, ``duration_s``] seconds.

    A subclass sets ``duration_s`` and implements the five abstract methods; those that take times, (n,) in seconds,
    pass them through :meth:`times` first. One that knows its second derivatives implements them too: those of this
    class are differences, good to about 1e-8 of the third derivative, with noise of 1e-12 of the first over 1e-4 s.

    Attributes:
        start_time_ns: t = 0 on the clock of the file or the path that this one was made from, nanoseconds.
        steady: velocity in world axes and body rate are the same at all times.
    """

    duration_s: float
    start_time_ns: int = 0
    steady: bool = False

    @abstractmethod
    def positions(self, t_s: npt.ArrayLike) -> FloatArray:
        """Return camera centres (n, 3) in the world, metres."""

    @abstractmethod
    def quaternions(self, t_s: npt.ArrayLike) -> FloatArray:
        """Return unit quaternions (n, 4) of R_world_camera, (x, y, z, w); the sign is continuous in time."""

    @abstractmethod
    def velocities(self, t_s: npt.ArrayLike) -> FloatArray:
        """Return velocities (n, 3) in world axes, m/s."""

    @abstractmethod
    def angular_rates(self, t_s: npt.ArrayLike) -> FloatArray:
        """Return angular rates (n, 3) in body (camera) axes, rad/s: what a gyroscope in the camera measures."""

    def accelerations(self, t_s: npt.ArrayLike) -> FloatArray:
        """Return second derivatives of the position (n, 3) in world axes, m/s^2 (gravity is not in them)."""
        return self._difference(self.velocities, t_s)

    def angular_accelerations(self, t_s: npt.ArrayLike) -> FloatArray:
        """Return derivatives of the body's angular rate (n, 3) in body (camera) axes, rad/s^2."""
        return self._difference(self.angular_rates, t_s)

    def breaks_s(self) -> FloatArray:
        """Return increasing instants (n,) in (0, ``duration_s``) at which velocity, body rate or the pose jumps.

        Examples are a start from rest, the end of a motion, and a corner of the path. Nothing may be interpolated in
        time across them. A smooth path has none, and so this method returns none unless a subclass has its own.
        """
        return np.empty(0)

    @abstractmethod
    def describe(self) -> dict[str, object]:
        """Return a description of this trajectory and of its origin, in JSON's types."""

    def __repr__(self) -> str:
        return f"<{type(self).__name__.lstrip('_')} of {self.duration_s:.6g} s>"

    def _repr_html_(self) -> str:
        first, last = self.positions([0.0, self.duration_s])
        top = self.top_speeds()
        rows = [
            ("duration", f"{self.duration_s:.6g} s"),
            ("from", "({:.3f}, {:.3f}, {:.3f}) m".format(*first)),
            ("to", "({:.3f}, {:.3f}, {:.3f}) m".format(*last)),
            ("top speed", f"{top.speed_m_s:.3g} m/s"),
            ("top rate", f"{top.rate_rad_s:.3g} rad/s"),
        ]
        return html_table(type(self).__name__.lstrip("_"), rows, below=self.html_plot())

    def html_plot(self) -> str:
        """Return a small plot of the position over time as HTML: x red, y green, z blue, each from where it starts."""
        positions = self.positions(np.linspace(0.0, self.duration_s, 121))
        return html_lines((positions - positions[0]).T.tolist()) + _PLOT_SAYS

    def rotations(self, t_s: npt.ArrayLike) -> FloatArray:
        """Return R_world_camera, shape (n, 3, 3)."""
        return rotation_matrices(self.quaternions(t_s))

    def pose(self, t_s: float) -> Pose:
        """Return T_world_camera at one time."""
        return Pose(self.positions([t_s])[0], self.quaternions([t_s])[0])

    def times(self, t_s: npt.ArrayLike) -> FloatArray:
        """Return ``t_s`` as float64 (n,); times up to 1 us outside the range are moved to its end.

        Raises:
            ValueError: for another shape, or a time outside [0, ``duration_s``] by more than 1 us (or NaN).
        """
        t = np.asarray(t_s, np.float64)
        if t.ndim != 1:
            raise ValueError(f"times must have shape (n,), got {t.shape}")
        if all_within(t, 0.0, self.duration_s):
            return t  # nearly always, and much cheaper
        outside = ~((t >= -TIME_TOLERANCE_S) & (t <= self.duration_s + TIME_TOLERANCE_S))
        if outside.any():
            raise ValueError(
                f"time {t[outside][0]} s is outside the trajectory, which runs from 0 to {self.duration_s} s"
            )
        return np.clip(t, 0.0, self.duration_s)

    def crop(self, start_s: float = 0.0, duration_s: float | None = None) -> Trajectory:
        """Return the part from ``start_s`` on, ``duration_s`` long (default: to the end), with t = 0 at its start.

        Raises:
            ValueError: for a duration that is not > 0, or a part that is not inside the trajectory (within 1 us).
        """
        if start_s == 0 and duration_s in (None, self.duration_s):
            return self
        check_number("start_s", start_s, 0)
        if not start_s < self.duration_s:
            raise ArgumentError(
                "{start_s} must lie within the trajectory, which runs from 0 to {:g} s, got {}",
                self.duration_s,
                start_s,
            )
        if duration_s is None:
            duration_s = self.duration_s - start_s
        check_number("duration_s", duration_s, 0, above_low=True)
        if start_s + duration_s > self.duration_s + TIME_TOLERANCE_S:
            raise ArgumentError(
                "{duration_s} must be at most {:g} s from {start_s} {:g} s on, because the trajectory runs from 0 to "
                "{:g} s; got {}",
                *(self.duration_s - start_s, start_s, self.duration_s, duration_s),
            )
        return _Cropped(self, float(start_s), min(float(duration_s), self.duration_s - start_s))

    def top_speeds(self, window_s: float = SPEED_WINDOW_S) -> TopSpeeds:
        """Return the fastest mean motion over any ``window_s``: distance, and angle of the rotation, over time.

        A top speed of a measured trajectory is only as good as its window: a 200 Hz motion capture whose positions are
        noisy by 0.65 mm and rotations by 4.3 mrad resolves 9 mm/s and 3.5 deg/s in 100 ms, but 180 mm/s and 70 deg/s
        from one sample to the next. With 100 ms the public dataset's poster_6dof has 2.50 m/s and 931 deg/s, smoothed
        or not, and the paper's table 2.51 m/s and 937 deg/s; momentarily the smoothed path reaches 2.78 m/s and 1,158
        deg/s, and the one through all samples 3.5 m/s and 1,690 deg/s.

        Args:
            window_s: 0 for momentary speeds. A window longer than the trajectory is cut to it.

        Windows begin every millisecond, or 2,000 times a trajectory where that is more. A rotation by more than half a
        turn within one window is counted by its smaller angle.

        Raises:
            ValueError: for a window that is negative or not finite.
        """
        check_number("window_s", window_s, 0)
        t, window_s = _windows(self.duration_s, window_s)
        if window_s == 0:
            speeds = np.linalg.norm(self.velocities(t), axis=1)
            rates = np.linalg.norm(self.angular_rates(t), axis=1)
        else:
            speeds = np.linalg.norm(self.positions(t + window_s) - self.positions(t), axis=1) / window_s
            rates = mean_rates(self.quaternions, self.duration_s, window_s)
        fastest, quickest = int(speeds.argmax()), int(rates.argmax())
        return TopSpeeds(float(speeds[fastest]), float(rates[quickest]), float(t[fastest]), float(t[quickest]))

    def check(
        self, max_speed_m_s: float = np.inf, max_rate_rad_s: float = np.inf, *, window_s: float = SPEED_WINDOW_S
    ) -> TopSpeeds:
        """Check that no :meth:`top_speeds` lies above the given limits; return them.

        Raises:
            ValueError: naming the speed or rate, when it is reached, and the limit; for a window out of range.
        """
        top = self.top_speeds(window_s)
        over = f"over {1e3 * window_s:g} ms" if window_s else "momentarily"
        for quantity, value, limit, at_s, unit in (
            ("speed", top.speed_m_s, max_speed_m_s, top.speed_at_s, "m/s"),
            ("angular rate", top.rate_rad_s, max_rate_rad_s, top.rate_at_s, "rad/s"),
        ):
            if not value <= limit:
                reached = f"{value:.6g} {unit} {over} at {at_s:.6g} s"
                raise ValueError(f"the trajectory's {quantity} must be at most {limit:g} {unit}, got {reached}")
        return top

    def _difference(self, function: Callable[[npt.ArrayLike], FloatArray], t_s: npt.ArrayLike) -> FloatArray:
        """Differentiate a function of time by central differences, one-sided at the ends of the trajectory."""
        t = self.times(t_s)
        step = min(_DIFFERENCE_STEP_S, self.duration_s / 4)
        middle = np.clip(t, step, self.duration_s - step)
        before, at, after = function(middle - step), function(middle), function(middle + step)
        slope = (after - before) / (2 * step)
        bend = (after - 2 * at + before) / step**2
        differences: FloatArray = slope + (t - middle)[:, None] * bend
        return differences


def mean_rates(quaternions: Callable[[FloatArray], FloatArray], duration_s: float, window_s: float) -> FloatArray:
    """Return the mean angular rates (n,), rad/s, over the windows of :meth:`Trajectory.top_speeds`, > 0 seconds long.

    Args:
        quaternions: the unit quaternions (n, 4) at times (n,), of which rounding puts some just after ``duration_s``.
    """
    t, window_s = _windows(duration_s, window_s)
    turns = hamilton(conjugate(quaternions(t)), quaternions(t + window_s))
    rates: FloatArray = 2 * np.arctan2(np.linalg.norm(turns[:, :3], axis=1), np.abs(turns[:, 3])) / window_s
    return rates


def _windows(duration_s: float, window_s: float) -> tuple[FloatArray, float]:
    """Return the times at which the windows of a path begin, and their length."""
    window_s = min(window_s, duration_s)
    last_s = duration_s - window_s
    t = np.linspace(0.0, last_s, max(round(last_s / 1e-3), 2000) + 1) if last_s > 0 else np.zeros(1)
    return t, window_s


def _checked_duration(duration_s: float) -> float:
    check_number("duration_s", duration_s, 0, above_low=True)
    return float(duration_s)


def _checked_breaks(breaks_s: npt.ArrayLike, duration_s: float) -> FloatArray:
    breaks = np.array(breaks_s, np.float64)
    if breaks.ndim != 1:
        raise ValueError(f"breaks_s must have shape (n,), got {breaks.shape}")
    wrong = ~((breaks > 0) & (breaks < duration_s))
    if wrong.any():
        raise ValueError(f"breaks_s must lie within (0, {duration_s}) s, got {breaks[wrong][0]} s")
    if not (np.diff(breaks) > 0).all():
        raise ValueError(f"breaks_s must strictly increase, got {breaks.tolist()}")
    return breaks


class CallableTrajectory(Trajectory):
    """Describes a path given by functions. Each must be exact: those that are given are not differentiated numerically.

    Args:
        duration_s: > 0.
        position, velocity: times (n,) in seconds -> (n, 3), world axes, m and m/s.
        quaternion: times -> (n, 4), unit, (x, y, z, w), continuous in sign.
        angular_rate: times -> (n, 3), body axes, rad/s.
        acceleration, angular_acceleration: times -> (n, 3), as for :class:`Trajectory`; by differences if not given.
        breaks_s: instants (n,), strictly increasing, within (0, ``duration_s``) at which the motion is not smooth, see
            :meth:`Trajectory.breaks_s`. At each of them the functions must return the value after it.
        description: what :meth:`describe` adds to the duration.

    Raises:
        ValueError: for a bad duration, or breaks that are not such instants; on evaluation, where a function returns
            another shape or a value not finite.
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
        acceleration: Callable[[FloatArray], npt.ArrayLike] | None = None,
        angular_acceleration: Callable[[FloatArray], npt.ArrayLike] | None = None,
        breaks_s: npt.ArrayLike = (),
    ) -> None:
        self.duration_s = _checked_duration(duration_s)
        self._breaks_s = _checked_breaks(breaks_s, self.duration_s)
        self._position, self._quaternion = position, quaternion
        self._velocity, self._angular_rate = velocity, angular_rate
        self._acceleration, self._angular_acceleration = acceleration, angular_acceleration
        self._description = dict(description)

    def positions(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._evaluate(self._position, "position", t_s, 3)

    def quaternions(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._evaluate(self._quaternion, "quaternion", t_s, 4)

    def velocities(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._evaluate(self._velocity, "velocity", t_s, 3)

    def angular_rates(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._evaluate(self._angular_rate, "angular_rate", t_s, 3)

    def accelerations(self, t_s: npt.ArrayLike) -> FloatArray:
        if self._acceleration is None:
            return super().accelerations(t_s)
        return self._evaluate(self._acceleration, "acceleration", t_s, 3)

    def angular_accelerations(self, t_s: npt.ArrayLike) -> FloatArray:
        if self._angular_acceleration is None:
            return super().angular_accelerations(t_s)
        return self._evaluate(self._angular_acceleration, "angular_acceleration", t_s, 3)

    def breaks_s(self) -> FloatArray:
        return self._breaks_s.copy()

    def describe(self) -> dict[str, object]:
        breaks: dict[str, object] = {"breaks_s": self._breaks_s.tolist()} if len(self._breaks_s) else {}
        return {"kind": "analytic", "duration_s": self.duration_s, **breaks, **self._description}

    def _evaluate(
        self, function: Callable[[FloatArray], npt.ArrayLike], name: str, t_s: npt.ArrayLike, width: int
    ) -> FloatArray:
        t = self.times(t_s)
        values = np.asarray(function(t), np.float64)
        if values.shape != (len(t), width):
            raise ValueError(f"{name}(t_s) must return shape ({len(t)}, {width}), got {values.shape}")
        if not all_finite(values):
            finite = np.isfinite(values).all(-1)
            raise ValueError(f"{name}(t_s) must be finite, got {values[~finite][0].tolist()} at {t[~finite][0]} s")
        return values


class SegmentTrajectory(Trajectory):
    """Moves from one pose to the next at constant velocity and constant body rate, the shorter way round.

    It suits a controller that gives pose after pose. For a half turn, of which both ways are equally long, the signs of
    the quaternions decide.

    Raises:
        ValueError: for a duration that is not finite and > 0.
    """

    steady = True

    def __init__(self, start: PoseLike, end: PoseLike, duration_s: float) -> None:
        self.duration_s = _checked_duration(duration_s)
        self.start, self.end = start, end = as_pose(start, "start"), as_pose(end, "end")
        self._velocity = (end.position - start.position) / self.duration_s
        # Slerp as a great circle of unit quaternions: q(t) = start cos(phi) + tangent sin(phi), phi growing evenly.
        cosine = float(start.quaternion @ end.quaternion)
        towards = end.quaternion if cosine >= 0 else -end.quaternion
        across = towards - abs(cosine) * start.quaternion
        turned = (towards != start.quaternion).any()  # rounding must not make a turn of none
        sine = float(np.linalg.norm(across)) if turned else 0.0
        self._tangent = across / sine if sine > 0 else across
        self._phi_rate = np.arctan2(sine, abs(cosine)) / self.duration_s
        self._body_rate = body_rates(start.quaternion, self._tangent * self._phi_rate)

    def positions(self, t_s: npt.ArrayLike) -> FloatArray:
        return self.start.position + self.times(t_s)[:, None] * self._velocity

    def quaternions(self, t_s: npt.ArrayLike) -> FloatArray:
        phi = self.times(t_s)[:, None] * self._phi_rate
        q: FloatArray = self.start.quaternion * np.cos(phi) + self._tangent * np.sin(phi)
        return q

    def velocities(self, t_s: npt.ArrayLike) -> FloatArray:
        return _rows(self._velocity, len(self.times(t_s)))

    def angular_rates(self, t_s: npt.ArrayLike) -> FloatArray:
        return _rows(self._body_rate, len(self.times(t_s)))

    def accelerations(self, t_s: npt.ArrayLike) -> FloatArray:
        return np.zeros((len(self.times(t_s)), 3))

    def angular_accelerations(self, t_s: npt.ArrayLike) -> FloatArray:
        return np.zeros((len(self.times(t_s)), 3))

    def describe(self) -> dict[str, object]:
        return {
            "kind": "segment",
            "duration_s": self.duration_s,
            "start": describe_pose(self.start),
            "end": describe_pose(self.end),
        }


def _rows(row: FloatArray, count: int) -> FloatArray:
    """Return so many rows (count, 3) that are alike; of few NumPy's own functions take several times as long."""
    rows = np.empty((count, len(row)))
    rows[:] = row
    return rows


class _Aligned(Trajectory):
    """Holds a trajectory moved rigidly, see :func:`align`."""

    def __init__(self, trajectory: Trajectory, pose: Pose, at_s: float) -> None:
        was = trajectory.pose(at_s)
        self.duration_s, self.start_time_ns = trajectory.duration_s, trajectory.start_time_ns
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

    def accelerations(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._base.accelerations(t_s) @ self._rotation.T

    def angular_accelerations(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._base.angular_accelerations(t_s)

    def breaks_s(self) -> FloatArray:
        return self._base.breaks_s()

    def describe(self) -> dict[str, object]:
        at = {"at_s": self._at_s, "pose": describe_pose(self._pose)}
        return {"kind": "aligned", "duration_s": self.duration_s, **at, "trajectory": self._base.describe()}


def align(trajectory: Trajectory, pose: PoseLike, at_s: float = 0.0) -> Trajectory:
    """Move ``trajectory`` rigidly so that its pose at ``at_s`` is ``pose``: T_new(t) = pose T(at_s)^-1 T(t).

    Velocities turn with it; body rates stay as they are.

    Raises:
        ValueError: if ``at_s`` is outside the trajectory, or as :func:`~davis_rs.as_pose`.
        TypeError: for what is no trajectory.
    """
    check_type("trajectory", trajectory, Trajectory, "davis_rs.read_trajectory(...) reads one")
    return _Aligned(trajectory, as_pose(pose), at_s)


class _Cropped(Trajectory):
    """Holds a part of a trajectory, see :meth:`Trajectory.crop`."""

    def __init__(self, trajectory: Trajectory, start_s: float, duration_s: float) -> None:
        self.duration_s = duration_s
        self.start_time_ns = trajectory.start_time_ns + round(start_s * 1e9)
        self._base, self._start_s = trajectory, start_s

    def positions(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._base.positions(self.times(t_s) + self._start_s)

    def quaternions(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._base.quaternions(self.times(t_s) + self._start_s)

    def velocities(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._base.velocities(self.times(t_s) + self._start_s)

    def angular_rates(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._base.angular_rates(self.times(t_s) + self._start_s)

    def accelerations(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._base.accelerations(self.times(t_s) + self._start_s)

    def angular_accelerations(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._base.angular_accelerations(self.times(t_s) + self._start_s)

    def breaks_s(self) -> FloatArray:
        breaks = self._base.breaks_s() - self._start_s
        return breaks[(breaks > 0) & (breaks < self.duration_s)]

    def describe(self) -> dict[str, object]:
        at = {"start_s": self._start_s, "duration_s": self.duration_s}
        return {"kind": "crop", **at, "trajectory": self._base.describe()}
