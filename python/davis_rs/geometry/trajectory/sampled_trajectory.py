"""Makes trajectories through samples: smoothing splines of stated sigma."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from ..._util.argument_checks import check_number
from ..._util.argument_error import ArgumentError
from ..pose import UNIT_NORM_TOLERANCE, FloatArray, body_rates
from .sample_noise import pose_noise
from .trajectory import Trajectory

if TYPE_CHECKING:
    from scipy.interpolate import BSpline
    from scipy.sparse import sparray


class SampleError(ValueError):
    """Raised where a sample of a trajectory breaks a rule; the message names the sample."""


class PathChange(NamedTuple):
    """The distance of a smoothed path from its samples: rms and largest, in metres and radians."""

    position_rms_m: float
    position_max_m: float
    rotation_rms_rad: float
    rotation_max_rad: float


class SampledTrajectory(Trajectory):
    """Smoothing splines through measured or computed poses: position, velocity and acceleration are continuous.

    Positions are fitted by a quintic smoothing spline: uniform knots at the median spacing of the samples, a penalty on
    the third differences of the coefficients (P-splines; Eilers and Marx, Statistical Science 1996), and the weight at
    which the rms residual equals the stated sigma (Morozov's discrepancy principle). Quaternions are made continuous in
    sign, fitted likewise in each component, and normalised; the angular rate is the exact derivative of that.

    Where the samples are smoother than sigma at the largest weight already, that fit is kept. With sigma 0, or with
    fewer than six samples, the path goes through every sample: a quintic spline, or one polynomial.

    Args:
        t_s: times (n,) in seconds, n >= 2, strictly increasing; the first becomes t = 0.
        positions: (n, 3), metres, world.
        quaternions: (n, 4) of R_world_camera, (x, y, z, w), of norm 1 within 1e-3, any sign.
        position_sigma_m: rms noise of each coordinate, >= 0; None estimates it
            (``davis_rs.geometry.trajectory.sample_noise.pose_noise``).
        rotation_sigma_rad: rms noise of the rotation about each axis, >= 0; None estimates it.
        position_step_m, quaternion_step: the steps to which the samples are rounded; an estimate within half a step of
            them counts as no noise. They change nothing where the noise is given.
        max_gap_s: the normal spacing is the median; a gap above three times that is bridged with a warning if it is
            at most this long.
        start_time_ns: when the first sample was taken, nanoseconds; None: at its ``t_s``. Float64 seconds of Unix time
            are only good to 0.2 us, so give it where ``t_s`` counts from elsewhere.
        sample_name: names sample i in messages ("sample i at t s" by default).
        description: what :meth:`describe` adds, such as the source.

    Raises:
        SampleError: (a ValueError) where a sample breaks a rule above, a gap is too long, or a sample is turned by more
            than 90 degrees from the one before; it names the sample.
        ValueError: for shapes that don't fit, or a sigma or ``max_gap_s`` out of range.
    """

    def __init__(
        self,
        t_s: npt.ArrayLike,
        positions: npt.ArrayLike,
        quaternions: npt.ArrayLike,
        *,
        position_sigma_m: float | None = 0.0,
        rotation_sigma_rad: float | None = 0.0,
        position_step_m: float = 0.0,
        quaternion_step: float = 0.0,
        max_gap_s: float = 0.1,
        start_time_ns: int | None = None,
        sample_name: Callable[[int], str] | None = None,
        description: Mapping[str, object] | None = None,
    ) -> None:
        t, p, q = (np.asarray(a, np.float64) for a in (t_s, positions, quaternions))
        if t.ndim != 1 or p.shape != (len(t), 3) or q.shape != (len(t), 4):
            raise ArgumentError(
                "{t_s}, {positions} and {quaternions} must have shapes (n,), (n, 3) and (n, 4), got {}, {} and {}",
                t.shape,
                p.shape,
                q.shape,
            )
        for name, value in (("position_sigma_m", position_sigma_m), ("rotation_sigma_rad", rotation_sigma_rad)):
            if value is not None:
                check_number(name, value, 0)
        check_number("max_gap_s", max_gap_s, 0, above_low=True)
        name_of = sample_name or (lambda i: f"sample {i} at {t[i]} s")
        _check_samples(t, p, q, max_gap_s, name_of)

        self.start_time_ns = round(float(t[0]) * 1e9) if start_time_ns is None else start_time_ns
        t = t - t[0]
        self.duration_s = float(t[-1])
        q = _continuous(q)
        if position_sigma_m is None or rotation_sigma_rad is None:
            position_noise, rotation_noise = pose_noise(t, p, q)
            if position_sigma_m is None:
                position_sigma_m = position_noise if position_noise > position_step_m / 2 else 0.0
            if rotation_sigma_rad is None:
                rotation_sigma_rad = rotation_noise if rotation_noise / 2 > quaternion_step / 2 else 0.0
        self._position = _fit(t, p, position_sigma_m)
        self._rotation = _fit(t, q, rotation_sigma_rad / 2)  # a small turn by a moves the quaternion by a / 2
        self._samples = t, p, q
        self._sigmas = position_sigma_m, rotation_sigma_rad
        self._description: dict[str, object] = {
            "kind": "sampled",
            "duration_s": self.duration_s,
            "samples": len(t),
            "position_sigma_m": float(position_sigma_m),
            "rotation_sigma_rad": float(rotation_sigma_rad),
            "start_time_ns": self.start_time_ns,
            **(description or {}),
        }

    def positions(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._derivative(self._position, t_s, 0)

    def quaternions(self, t_s: npt.ArrayLike) -> FloatArray:
        return _unit(self._derivative(self._rotation, t_s, 0))

    def velocities(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._derivative(self._position, t_s, 1)

    def accelerations(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._derivative(self._position, t_s, 2)

    def angular_rates(self, t_s: npt.ArrayLike) -> FloatArray:
        q = self._derivative(self._rotation, t_s, 0)
        rates = body_rates(q, self._derivative(self._rotation, t_s, 1))
        # conj(q) * q is real, so that the norm's change has no part in the vector; its size has to be divided out.
        unit_rates: FloatArray = rates / (q * q).sum(1, keepdims=True)
        return unit_rates

    def angular_accelerations(self, t_s: npt.ArrayLike) -> FloatArray:
        q, dq, ddq = (self._derivative(self._rotation, t_s, order) for order in range(3))
        squared_norm = (q * q).sum(1, keepdims=True)
        # As the rates: conj(q') * q' is real, so that only q'' and the norm's change are left of the derivative.
        rates = body_rates(q, dq) / squared_norm
        change: FloatArray = (body_rates(q, ddq) - rates * 2 * (q * dq).sum(1, keepdims=True)) / squared_norm
        return change

    def describe(self) -> dict[str, object]:
        return dict(self._description)

    def change(self) -> PathChange:
        """Return how far smoothing moved the path from the samples."""
        t, p, q = self._samples
        moved = np.linalg.norm(self.positions(t) - p, axis=1)
        # Of the chord between unit quaternions, since the arc cosine is blind to small turns.
        half = np.arcsin(np.minimum(np.linalg.norm(self.quaternions(t) - q, axis=1) / 2, 1.0))
        turned = 4 * half
        return PathChange(
            float(np.sqrt(np.mean(moved**2))),
            float(moved.max()),
            float(np.sqrt(np.mean(turned**2))),
            float(turned.max()),
        )

    def smoothing(self) -> str:
        """Describe in one line how the samples were smoothed."""
        position_sigma, rotation_sigma = self._sigmas
        change, did = self.change(), []
        if position_sigma > 0:
            did.append(
                f"positions smoothed by sigma {1e3 * position_sigma:.3g} mm (moved by "
                f"{1e3 * change.position_rms_m:.3g} mm rms, {1e3 * change.position_max_m:.3g} mm at most)"
            )
        if rotation_sigma > 0:
            rms, most = np.degrees([change.rotation_rms_rad, change.rotation_max_rad])
            did.append(
                f"rotations smoothed by sigma {rotation_sigma:.3g} rad (turned by "
                f"{rms:.3g} deg rms, {most:.3g} deg at most)"
            )
        kept = [name for name, sigma in zip(("positions", "rotations"), self._sigmas, strict=True) if sigma == 0]
        if kept:
            did.append(f"{' and '.join(kept)} taken as they are")
        return ", ".join(did)

    def _derivative(self, spline: BSpline, t_s: npt.ArrayLike, order: int) -> FloatArray:
        values: FloatArray = spline(self.times(t_s), order)
        return values


def rotation_through(t_s: FloatArray, quaternions: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Return the unit quaternions over time of the :class:`SampledTrajectory` through samples that begin at 0.

    It spares a caller who needs only rotations the fit of positions.
    """
    spline = _fit(t_s, _continuous(quaternions), 0.0)
    return lambda t: _unit(spline(np.clip(t, 0.0, t_s[-1])))


def _unit(q: FloatArray) -> FloatArray:
    unit: FloatArray = q / np.linalg.norm(q, axis=1, keepdims=True)
    return unit


def _continuous(q: FloatArray) -> FloatArray:
    """Normalise quaternions, and give each the sign that is nearer to the one before."""
    q = _unit(q)
    turns = np.where((q[1:] * q[:-1]).sum(1) < 0, -1.0, 1.0)
    q[1:] *= np.cumprod(turns)[:, None]
    return q


def _check_samples(
    t: FloatArray, p: FloatArray, q: FloatArray, max_gap_s: float, name_of: Callable[[int], str]
) -> None:
    """Check the rules of :class:`SampledTrajectory`, for arrays and files alike."""

    def first(bad: npt.ArrayLike) -> int | None:
        where = np.flatnonzero(bad)
        return int(where[0]) if len(where) else None

    if len(t) < 2:
        raise SampleError(f"a trajectory needs at least 2 samples, got {len(t)}")
    if (i := first(~np.isfinite(np.column_stack([t, p, q])).all(1))) is not None:
        raise SampleError(f"{name_of(i)}: every number must be finite, got {t[i]}, {p[i].tolist()}, {q[i].tolist()}")
    norms = np.linalg.norm(q, axis=1)
    if (i := first(np.abs(norms - 1) > UNIT_NORM_TOLERANCE)) is not None:
        raise SampleError(
            f"{name_of(i)}: the quaternion must have norm 1 within {UNIT_NORM_TOLERANCE}, "
            f"got {q[i].tolist()} of norm {norms[i]:.9g}"
        )
    cosines = np.abs((q[1:] * q[:-1]).sum(1)) / (norms[1:] * norms[:-1])
    if (i := first(cosines < np.cos(np.pi / 4))) is not None:
        degrees = np.degrees(2 * np.arccos(cosines[i]))
        raise SampleError(
            f"{name_of(i + 1)}: the rotation between two samples must be at most 90 degrees for its path to be known, "
            f"got {degrees:.1f} since {name_of(i)}"
        )
    steps = np.diff(t)
    if (i := first(steps <= 0)) is not None:
        raise SampleError(f"{name_of(i + 1)}: times must strictly increase, but it does not come after {name_of(i)}")
    spacing = float(np.median(steps))
    gaps = np.flatnonzero(steps > 3 * spacing)
    if len(gaps) == 0:
        return
    longest = int(gaps[steps[gaps].argmax()])
    where = f"{name_of(longest + 1)}: {steps[longest]:.6g} s after {name_of(longest)}"
    rule = f"the normal spacing is {spacing:.6g} s"
    if steps[longest] > max_gap_s:
        raise SampleError(f"{where} is a gap longer than max_gap_s = {max_gap_s} s ({rule})")
    warnings.warn(
        f"bridged {len(gaps)} gap(s) of more than 3 times the normal spacing, the longest at {where} ({rule})",
        stacklevel=3,
    )


def _fit(t: FloatArray, y: FloatArray, sigma: float) -> BSpline:
    """Fit a spline to y over t in [0, t[-1]] with rms residual ``sigma`` in each of a sample's three free directions.

    A position (n, 3) has three, and so has a unit quaternion (n, 4): it never moves along itself.
    """
    from scipy.interpolate import BSpline, make_interp_spline
    from scipy.linalg import solveh_banded
    from scipy.sparse import eye

    n, degree = len(t), 5
    if sigma == 0 or n <= degree:
        return make_interp_spline(t, y, k=min(degree, n - 1))
    # About one knot a sample, also where samples are missing; bounded, should a few samples be very close together.
    pieces = min(round(t[-1] / float(np.median(np.diff(t)))), 4 * n)
    margin = np.arange(1, degree + 1) * (t[-1] / pieces)
    knots = np.concatenate([-margin[::-1], np.linspace(0.0, t[-1], pieces + 1), t[-1] + margin])
    basis = BSpline.design_matrix(t, knots, degree)
    differences = eye(basis.shape[1], format="csr")
    for _ in range(3):
        differences = differences[1:] - differences[:-1]
    normal, penalty = _bands(basis.T @ basis, degree), _bands(differences.T @ differences, degree)
    centre = y.mean(0)  # so that rounding is relative to the motion, not to the distance from the origin
    right = basis.T @ (y - centre)

    def solve(log10_weight: float) -> tuple[FloatArray, float]:
        coefficients = solveh_banded(normal + 10.0**log10_weight * penalty, right, lower=True)
        residual = basis @ coefficients - (y - centre)
        return coefficients, float(np.sqrt((residual**2).sum() / (3 * n)))

    # The residual grows with the weight. 1e-6 is all but interpolation; 1e8 passes only waves of over 100 samples, and
    # beyond it rounding would show.
    low, high = -6.0, 8.0
    coefficients, rms = solve(high)
    if rms > sigma:
        for _ in range(40):
            middle = (low + high) / 2
            coefficients, rms = solve(middle)
            low, high = (middle, high) if rms < sigma else (low, middle)
    return BSpline(knots, coefficients + centre, degree, extrapolate=False)


def _bands(matrix: sparray, width: int) -> FloatArray:
    """Return the diagonals 0 to -width of a sparse symmetric matrix, as solveh_banded takes them."""
    return np.array([np.pad(matrix.diagonal(-k), (0, k)) for k in range(width + 1)])
