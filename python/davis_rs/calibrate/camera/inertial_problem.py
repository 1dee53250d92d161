"""Compares what a path, transforms, lags and biases predict of one or more cameras and an IMU with what they measured.

The first camera's clock is that of the path. Further cameras have clocks of their own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ...sensor.imu import ImuNoise
from .board_pose import BoardPose
from .body_spline import BodySpline, right_jacobian
from .camera_views import FIRST_CAMERA, CameraViews, RelativeCamera
from .levenberg_marquardt import solve
from .reprojection import cross_matrix, rotation_of, vector_of

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

FloatArray = npt.NDArray[np.float64]

_GRAVITY = 9.81
"""m/s^2; on Earth it is between 9.78 and 9.83."""

_GRAVITY_DEVIATION = 0.02
_GYROSCOPE_BIAS_DEVIATION, _ACCELEROMETER_BIAS_DEVIATION = 0.2, 1.0
"""What is known beforehand: rad/s and m/s^2."""

_TURN_DEVIATION, _POSITION_DEVIATION = 1.0, 100.0
"""The standard deviation of the splines' coefficients, rad and m. It only settles those that no measurement reaches."""

_LONGEST_LAG_S, _LAG_STEP_S = 0.05, 0.0025
"""Lags up to the first are fitted; fits begin at a multiple of the second."""

_LAG_MARGIN_S = _LONGEST_LAG_S + 2 * _LAG_STEP_S
"""So far from where the board is not seen measurements must be, because lags move them."""

_FARTHEST_LAG_S, _COARSE_STEP_S = 1.0, 0.01
"""Longer lags, up to the first, are looked for in steps of the second; then times are shifted by them."""

_LONGEST_GAP_S = 0.5
"""Readings between two views that are farther apart than this are left out, because the path there is not known."""

_STEP_S = 1e-4
"""The step in time for derivatives of what the IMU sees."""

_LEAST_RATE = np.radians(5.0)
"""Root mean square of the angular rate about the second axis, rad/s."""

_TAIL = 16
"""Number of unknowns other than the splines: rotation, lever, lag, biases and gravity, in this order."""

_OF_ANOTHER_CAMERA = 7
"""Number of unknowns of each further camera, after these: rotation, place and lag."""

_LEAST_READINGS = 50
"""Number of readings of the IMU that are needed while the first camera sees the board."""

_LEAST_VIEWS = 10
"""Number of views of the board that a further camera needs while the first one sees the board, too."""


class Readings(NamedTuple):
    """Holds IMU samples: ``t_s`` (n,) seconds; ``acceleration`` and ``rate`` (n, 3), m/s^2 and rad/s, IMU axes."""

    t_s: FloatArray
    acceleration: FloatArray
    rate: FloatArray

    @property
    def rate_hz(self) -> float:
        """Return how many there are a second."""
        return (len(self.t_s) - 1) / float(self.t_s[-1] - self.t_s[0])


@dataclass(frozen=True, eq=False)
class InertialState:
    """Holds all unknowns.

    Attributes:
        turns, positions: coefficients (size, 3) of the splines of small turns (see :class:`BodySpline`) and of the
            IMU's position in board axes.
        rotation: R_IMU,E.
        lever: the IMU's origin in camera axes, metres.
        lag_s: how late stamps are.
        gyroscope_bias, accelerometer_bias: (3,) rad/s and m/s^2.
        gravity: (3,) m/s^2, board axes.
        others: of each further camera.
    """

    turns: FloatArray
    positions: FloatArray
    rotation: FloatArray
    lever: FloatArray
    lag_s: float
    gyroscope_bias: FloatArray
    accelerometer_bias: FloatArray
    gravity: FloatArray
    others: tuple[RelativeCamera, ...] = ()


class InertialProblem:
    """Computes residuals, each in units of its own noise, and their derivatives.

    Residuals are of angular rates, of accelerations, of the board's poses in each camera, and of what is known of
    biases and gravity.

    Args:
        poses: of the first camera, in the order of time.
        readings: their noise is taken for white.
        others: the same of each further camera; what it saw while the first one did not see the board is left out.

    Attributes:
        shifts_s: of each further camera, by how much its times were too late, to a few milliseconds; 0 where its lag
            may be fitted as it is. States, and what follows from them, are of shifted times.
        imu_shift_s: the same of the IMU.

    Raises:
        ValueError: if the IMU or a further camera hardly overlaps with the first camera.
    """

    def __init__(
        self,
        poses: Sequence[BoardPose],
        readings: Readings,
        noise: ImuNoise,
        knot_rate_hz: float,
        others: Sequence[Sequence[BoardPose]] = (),
    ) -> None:
        self._views = CameraViews(poses)
        self._t = self._views.t_s
        self._spline = BodySpline(self._t, self._views.turns, knot_rate_hz)
        self.shifts_s = [self._shift_of(CameraViews(views)) for views in others]
        self._others = [
            self._overlapping(number, views, shift)
            for number, (views, shift) in enumerate(zip(others, self.shifts_s, strict=True), 1)
        ]
        self._tail = _TAIL + _OF_ANOTHER_CAMERA * len(self._others)
        lag = self._first_lag(readings)
        self.imu_shift_s = lag if abs(lag) > _LONGEST_LAG_S else 0.0
        readings, lag = readings._replace(t_s=readings.t_s - self.imu_shift_s), lag - self.imu_shift_s
        inside = self._seen(readings.t_s - lag, _LAG_MARGIN_S)
        if np.count_nonzero(inside) < _LEAST_READINGS:
            raise ValueError(
                f"the IMU's samples, from {readings.t_s[0]} s to {readings.t_s[-1]} s, hardly overlap the views of the "
                f"board, from {self._t[0]} s to {self._t[-1]} s"
            )
        self._readings = Readings(*(a[inside] for a in readings))
        self._lag = lag
        root_rate = np.sqrt(readings.rate_hz)
        self._gyroscope = noise.gyroscope_noise_density * root_rate
        self._accelerometer = noise.accelerometer_noise_density * root_rate

    @property
    def unseen_s(self) -> float:
        """Return the seconds from the first to the last view whose readings are left out, because no view is near."""
        gaps = np.diff(self._t)
        return float(gaps[gaps > _LONGEST_GAP_S].sum())

    @property
    def samples(self) -> int:
        """Return the number of readings used."""
        return len(self._readings.t_s)

    def start(self) -> InertialState:
        """Return rotation and lag from the angular rates alone, gravity from the mean acceleration.

        Raises:
            ValueError: if the motion does not turn about two axes.
        """
        r, size = self._readings, self._spline.basis.size
        zero = np.zeros((size, 3))
        rates = self._spline.rates(zero, r.t_s - self._lag)
        rotation, bias = _aligning(rates, r.rate)
        turns = self._spline.rotations(zero, r.t_s - self._lag)
        gravity = -(turns @ (rotation.T @ r.acceleration[..., None])).mean(0)[:, 0]
        others = tuple(map(self._first_place, self._others))
        return InertialState(zero, zero, rotation, np.zeros(3), self._lag, bias, np.zeros(3), gravity, others)

    def moved(self, s: InertialState, step: FloatArray) -> InertialState:
        """Return the state after a step of all unknowns, in the order of :class:`InertialState`."""
        n = 3 * self._spline.basis.size
        tail = step[2 * n :]
        return InertialState(
            turns=s.turns + step[:n].reshape(-1, 3),
            positions=s.positions + step[n : 2 * n].reshape(-1, 3),
            rotation=s.rotation @ rotation_of(tail[:3]),
            lever=s.lever + tail[3:6],
            # Where splines and readings overlap is fixed beforehand.
            lag_s=float(np.clip(s.lag_s + tail[6], self._lag - _LAG_MARGIN_S, self._lag + _LAG_MARGIN_S)),
            gyroscope_bias=s.gyroscope_bias + tail[7:10],
            accelerometer_bias=s.accelerometer_bias + tail[10:13],
            gravity=s.gravity + tail[13:16],
            others=tuple(
                RelativeCamera(
                    other.rotation @ rotation_of(own[:3]),
                    other.place + own[3:6],
                    float(np.clip(other.lag_s + own[6], -_LAG_MARGIN_S, _LAG_MARGIN_S)),
                )
                for other, own in zip(s.others, tail[_TAIL:].reshape(-1, _OF_ANOTHER_CAMERA), strict=True)
            ),
        )

    def residuals(self, s: InertialState) -> FloatArray:
        """Return the residuals (m,), each divided by its standard deviation."""
        rate, force = self._in_camera(s, s.lag_s)
        r = self._readings
        gyroscope = rate @ s.rotation.T + s.gyroscope_bias - r.rate
        accelerometer = force @ s.rotation.T + s.accelerometer_bias - r.acceleration
        poses = [self._off(s, FIRST_CAMERA, self._views)]
        poses += [self._off(s, other, views) for other, views in zip(s.others, self._others, strict=True)]
        known = np.concatenate(
            [
                s.turns.ravel() / _TURN_DEVIATION,
                s.positions.ravel() / _POSITION_DEVIATION,
                s.gyroscope_bias / _GYROSCOPE_BIAS_DEVIATION,
                s.accelerometer_bias / _ACCELEROMETER_BIAS_DEVIATION,
                [(np.linalg.norm(s.gravity) - _GRAVITY) / _GRAVITY_DEVIATION],
            ]
        )
        return np.concatenate(
            [
                gyroscope.ravel() / self._gyroscope,
                accelerometer.ravel() / self._accelerometer,
                *(pose.ravel() for pose in poses),
                known,
            ]
        )

    def jacobian(self, s: InertialState) -> Any:
        """Return d(residuals)/d(step), sparse; of the angular rates to first order in the small turns."""
        from scipy.sparse import csr_array, diags_array, vstack

        basis, t = self._spline.basis, self._readings.t_s - s.lag_s
        identity = np.broadcast_to(np.eye(3), (len(t), 3, 3))
        rate, force = self._in_camera(s, s.lag_s)
        less_lag, more_lag = self._in_camera(s, s.lag_s - _STEP_S), self._in_camera(s, s.lag_s + _STEP_S)
        by_lag = [(more - less) / (2 * _STEP_S) @ s.rotation.T for less, more in zip(less_lag, more_lag, strict=True)]
        turns = self._spline.rotations(s.turns, t)
        to_imu = s.rotation @ np.swapaxes(turns, 1, 2)
        by_turn, by_turning = self._spline.rate_derivatives(s.turns, t)

        rows = np.zeros((len(t), 3, self._tail))
        rows[..., :3], rows[..., 6], rows[..., 7:10] = -s.rotation @ cross_matrix(rate), by_lag[0], identity
        gyroscope = _row_blocks(
            [(basis.matrix(t), s.rotation @ by_turn), (basis.matrix(t, 1), s.rotation @ by_turning)],
            [],
            rows,
            basis.size,
        )
        rows = np.zeros((len(t), 3, self._tail))
        rows[..., :3], rows[..., 6], rows[..., 10:13] = -s.rotation @ cross_matrix(force), by_lag[1], identity
        rows[..., 13:16] = -to_imu
        accelerometer = _row_blocks(
            [(basis.matrix(t), s.rotation @ cross_matrix(force) @ by_turning)],
            [(basis.matrix(t, 2), to_imu)],
            rows,
            basis.size,
        )

        poses = [self._pose_rows(s, FIRST_CAMERA, self._views, None)]
        for number, (other, views) in enumerate(zip(s.others, self._others, strict=True)):
            poses.append(self._pose_rows(s, other, views, _TAIL + _OF_ANOTHER_CAMERA * number))

        size = 3 * basis.size
        curves = diags_array(
            np.repeat([1 / _TURN_DEVIATION, 1 / _POSITION_DEVIATION], size), shape=(2 * size, 2 * size + self._tail)
        )
        known = np.zeros((7, 2 * size + self._tail))
        tail = known[:, 2 * size :]
        tail[:3, 7:10] = np.eye(3) / _GYROSCOPE_BIAS_DEVIATION
        tail[3:6, 10:13] = np.eye(3) / _ACCELEROMETER_BIAS_DEVIATION
        tail[6, 13:16] = s.gravity / np.linalg.norm(s.gravity) / _GRAVITY_DEVIATION
        return vstack(
            [gyroscope / self._gyroscope, accelerometer / self._accelerometer, *poses, curves, csr_array(known)],
            format="csr",
        )

    def covariance(self, s: InertialState) -> FloatArray:
        """Return it (7 + 7 k, 7 + 7 k), given that the IMU's noise is right.

        It is of steps of rotation (camera axes), lever and lag; then, of each of k further cameras, of rotation (its
        own axes), place (axes of the first camera) and lag.
        """
        derivative, n = self.jacobian(s), self._tail
        last = np.zeros((derivative.shape[1], n))
        last[-n:] = np.eye(n)
        whole = solve(derivative.T @ derivative, last)[-n:]
        chosen = np.r_[:7, _TAIL:n]
        return np.asarray(whole[np.ix_(chosen, chosen)])

    def scatter(self, s: InertialState) -> tuple[float, float, list[float]]:
        """Return what is left, root mean square of an axis: of angular rates (rad/s), accelerations (m/s^2), and
        corners of each camera (px)."""
        r, n = self.residuals(s), 3 * self.samples
        cameras = [self._views, *self._others]
        ends = np.cumsum([n, n, *(6 * len(views.t_s) for views in cameras)])
        rate, acceleration, *pixels = (float(np.sqrt(np.mean(p**2))) for p in np.split(r, ends)[:-1])
        left = [pixel * views.pixel for pixel, views in zip(pixels, cameras, strict=True)]
        return rate * self._gyroscope, acceleration * self._accelerometer, left

    @property
    def views(self) -> list[int]:
        """Return the number of views that are used of each camera."""
        return [len(views.t_s) for views in (self._views, *self._others)]

    def _off(self, s: InertialState, other: RelativeCamera, views: CameraViews) -> FloatArray:
        """Return by how much a camera's views are off, (n, 6), in units of their noise."""
        t = views.t_s - other.lag_s
        turns = self._spline.rotations(s.turns, t)
        positions = self._spline.basis.matrix(t) @ s.positions + turns @ (other.place - s.lever)
        return np.asarray((views.whiten @ views.errors(turns @ other.rotation, positions)[..., None])[..., 0])

    def _pose_rows(self, s: InertialState, other: RelativeCamera, views: CameraViews, first: int | None) -> Any:
        """Return rows of the Jacobian of :meth:`_off`.

        Args:
            first: where the camera's own unknowns begin after the splines; None of the first camera.
        """
        t = views.t_s - other.lag_s
        turns = self._spline.rotations(s.turns, t)
        back = np.swapaxes(views.turns, 1, 2)
        relative = back @ turns
        turned = np.linalg.inv(right_jacobian(vector_of(relative @ other.rotation)))
        arm = other.place - s.lever
        by_motion = np.concatenate([turned @ other.rotation.T, -relative @ cross_matrix(arm)], 1)
        by_place = np.concatenate([np.zeros_like(relative), back], 1)
        rows = np.zeros((len(t), 6, self._tail))
        rows[:, 3:, 3:6] = -relative
        rows = views.whiten @ rows
        if first is not None:
            own = np.zeros((len(t), 6, _OF_ANOTHER_CAMERA - 1))
            own[:, :3, :3], own[:, 3:, 3:] = turned, relative
            less, more = (self._off(s, other._replace(lag_s=other.lag_s + step), views) for step in (-_STEP_S, _STEP_S))
            rows[..., first : first + 6] = views.whiten @ own
            rows[..., first + 6] = (more - less) / (2 * _STEP_S)
        basis = self._spline.basis
        at_views, motion = basis.matrix(t), self._spline.motions(s.turns, t)
        return _row_blocks(
            [(at_views, views.whiten @ by_motion @ motion)], [(at_views, views.whiten @ by_place)], rows, basis.size
        )

    def _overlapping(self, number: int, poses: Sequence[BoardPose], shift_s: float) -> CameraViews:
        """Return a further camera's views while the first one sees the board, too, and a lag away from where not."""
        inside = self._seen(np.array([pose.view.t_us for pose in poses]) * 1e-6 - shift_s, _LAG_MARGIN_S)
        if np.count_nonzero(inside) < _LEAST_VIEWS:
            raise ValueError(
                f"camera {number} sees the board in {np.count_nonzero(inside)} frames while camera 0 sees it, too, at "
                f"least {_LEAST_VIEWS} are needed: are their clocks more than {_FARTHEST_LAG_S:g} s apart?"
            )
        return CameraViews([pose for pose, kept in zip(poses, inside, strict=True) if kept], shift_s)

    def _shift_of(self, views: CameraViews) -> float:
        """Return by how much a further camera's times are too late, where that is more than can be fitted; else 0."""
        lag = _lag_of_least(lambda lag_s: self._spread(views, lag_s))
        return lag if abs(lag) > _LONGEST_LAG_S else 0.0

    def _relative(self, views: CameraViews, lag_s: float) -> Rotation:
        """Return how a further camera is turned from the first one in each of its views, if its clock has a lag."""
        from scipy.spatial.transform import Rotation

        t = views.t_s - lag_s
        inside = self._seen(t, 0.0)
        at = self._spline.rotations(np.zeros((self._spline.basis.size, 3)), t[inside])
        return Rotation.from_matrix(np.swapaxes(at, 1, 2) @ views.turns[inside])

    def _spread(self, views: CameraViews, lag_s: float) -> float:
        """Return how unsteadily it is turned, radians."""
        seen, at_zero = (np.count_nonzero(self._seen(views.t_s - lag, 0.0)) for lag in (lag_s, 0.0))
        if seen < max(_LEAST_VIEWS, at_zero / 2):
            return np.inf  # few views are steady by chance
        turns = self._relative(views, lag_s)
        return float(np.median((turns.mean().inv() * turns).magnitude()))

    def _first_place(self, views: CameraViews) -> RelativeCamera:
        """Return where a further camera is by the measured path of the first one, and the lag by which it is there
        most steadily."""
        zero = np.zeros((self._spline.basis.size, 3))
        lag = _fitted_lag(lambda lag_s: self._spread(views, lag_s))
        t = views.t_s - lag
        path = np.stack([np.interp(t, self._t, axis) for axis in self._views.positions.T], 1)
        apart = np.einsum("nji,nj->ni", self._spline.rotations(zero, t), views.positions - path)
        return RelativeCamera(np.asarray(self._relative(views, lag).mean().as_matrix()), np.median(apart, 0), lag)

    def _in_camera(self, s: InertialState, lag_s: float) -> tuple[FloatArray, FloatArray]:
        """Return angular rate and specific force at the IMU, (n, 3) each, in camera axes, at the times of readings."""
        t = self._readings.t_s - lag_s
        acceleration = self._spline.basis.matrix(t, 2) @ s.positions
        turns = self._spline.rotations(s.turns, t)
        return self._spline.rates(s.turns, t), np.einsum("nji,nj->ni", turns, acceleration - s.gravity)

    def _seen(self, t_s: FloatArray, margin_s: float) -> npt.NDArray[np.bool_]:
        """Return which times lie between two views close to each other, and at least the margin from where no views
        are."""
        gap = np.flatnonzero(np.diff(self._t) > _LONGEST_GAP_S)
        begins = self._t[np.concatenate([[0], gap + 1])] + margin_s
        ends = self._t[np.concatenate([gap, [-1]])] - margin_s
        stretch = np.searchsorted(begins, t_s) - 1
        return np.asarray((stretch >= 0) & (t_s < ends[stretch]))

    def _first_lag(self, readings: Readings) -> float:
        """Return the lag to within a few milliseconds, from the turning speeds of both, which do not depend on the
        axes."""
        zero = np.zeros((self._spline.basis.size, 3))
        inside = self._seen(readings.t_s, 2 * _LAG_MARGIN_S)
        t, speed = readings.t_s[inside], np.linalg.norm(readings.rate[inside], axis=1)
        if len(t) < _LEAST_READINGS:
            return 0.0  # refused where the overlap is looked at

        def difference(lag_s: float) -> float:
            at = t - lag_s
            seen = self._seen(at, 0.0)
            if np.count_nonzero(seen) < max(_LEAST_READINGS, len(t) / 2):
                return np.inf
            return float(np.std(np.linalg.norm(self._spline.rates(zero, at[seen]), axis=1) - speed[seen]))

        return _lag_of_least(difference)


def _lag_of_least(difference: Callable[[float], float]) -> float:
    """Return the lag in seconds, to within a few milliseconds, by which something differs least from the first camera:
    one that can be fitted, unless a longer one is clearly better."""
    near = _fitted_lag(difference)
    far = _best(difference, _even(0.0, _FARTHEST_LAG_S, _COARSE_STEP_S))
    far = _best(difference, _even(far, _COARSE_STEP_S, _LAG_STEP_S))
    # Where nothing turns, or too little is seen, all lags are alike.
    return far if np.isfinite(difference(far)) and 2 * difference(far) <= difference(near) else near


def _fitted_lag(difference: Callable[[float], float]) -> float:
    """Return the same of the lags that can be fitted."""
    return _best(difference, _even(0.0, _LONGEST_LAG_S, _LAG_STEP_S))


def _best(difference: Callable[[float], float], lags_s: FloatArray) -> float:
    """Return the lag of the least difference, the first of several."""
    return float(min(lags_s.tolist(), key=difference))


def _even(middle: float, reach: float, step: float) -> FloatArray:
    """Return even numbers as far as ``reach`` on both sides of a middle, from there outwards."""
    away = step * np.arange(1, round(reach / step) + 1)
    return middle + np.concatenate([[0.0], np.stack([away, -away], 1).ravel()])


def _aligning(rates: FloatArray, readings: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return R_IMU,E and bias with readings = R rates + bias, (n, 3) each."""
    from scipy.spatial.transform import Rotation

    spread = np.linalg.svd(rates - rates.mean(0), compute_uv=False) / np.sqrt(len(rates))
    if spread[1] < _LEAST_RATE:
        raise ValueError(
            f"the motion does not tell how the IMU is turned: it must rotate about two axes by at least "
            f"{np.degrees(_LEAST_RATE):g} degrees/s rms, but has {np.degrees(spread[0]):.2g} and "
            f"{np.degrees(spread[1]):.2g}"
        )
    turn, _ = Rotation.align_vectors(readings - readings.mean(0), rates - rates.mean(0))
    rotation = np.asarray(turn.as_matrix())
    return rotation, (readings - rates @ rotation.T).mean(0)


def _row_blocks(
    turn_terms: list[tuple[Any, FloatArray]], place_terms: list[tuple[Any, FloatArray]], tail: FloatArray, size: int
) -> Any:
    """Return rows of the Jacobian of residuals (n, k): sums of basis (n, size) times blocks (n, k, 3), the tail."""
    from scipy.sparse import csr_array, hstack

    n, k, _ = tail.shape
    blocks = []
    for terms in (turn_terms, place_terms):
        block = csr_array((n * k, 3 * size))
        for basis, matrices in terms:
            coo = basis.tocoo()
            values = coo.data[:, None, None] * matrices[coo.row]
            row = np.broadcast_to(k * coo.row[:, None, None] + np.arange(k)[:, None], values.shape)
            column = np.broadcast_to(3 * coo.col[:, None, None] + np.arange(3), values.shape)
            block = block + csr_array((values.ravel(), (row.ravel(), column.ravel())), shape=block.shape)
        blocks.append(block)
    return hstack([*blocks, csr_array(tail.reshape(n * k, -1))], format="csr")
