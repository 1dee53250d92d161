"""Aligns the clocks of camera and motion capture by the motion that both saw."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .._util.argument_checks import check_number, check_type
from .._util.argument_error import ArgumentError
from .._util.close_names import names_checked
from ..events.arrays import EventArray, as_events
from ..geometry.pose import FloatArray, GroundTruth
from ..geometry.trajectory.sampled_trajectory import SampledTrajectory
from .imu import ImuArray, as_imu

_COARSE_STEP_S = 0.005
_COARSE_SAMPLES = 2000
_MOST_SAMPLES = 20_000
_LEAST_OVERLAP = 50
_MARGIN_S = 0.05
_BLOCK_S = 0.25
_TINY = 1e-300
_EVENT_BIN_US = 5_000


@dataclass(frozen=True)
class ClockAlignment:
    """Holds the clocks' relation t_mocap = (1 + ``drift``) t_camera + ``offset_s``; standard deviations from the
    residuals.

    Attributes:
        offset_s, drift: seconds, and seconds a second.
        offset_sigma_s, drift_sigma: their standard deviations. They are rather too large, because what smoothing takes
            off sharp turns of the poses counts as noise.
        unexplained: fraction of the signal's power that the aligned motion does not explain, 0..1.
    """

    offset_s: float
    drift: float
    offset_sigma_s: float
    drift_sigma: float
    unexplained: float

    def camera_times_us(self, t_us: npt.ArrayLike) -> npt.NDArray[np.int64]:
        """Return stamps of the motion capture on the camera's clock, to the nearest microsecond."""
        stamps = np.asarray(t_us, np.int64)
        return np.rint((stamps - self.offset_s * 1e6) / (1 + self.drift)).astype(np.int64)

    def __str__(self) -> str:
        return (
            f"offset {1e3 * self.offset_s:.3f} +- {1e3 * self.offset_sigma_s:.3f} ms, "
            f"drift {6e4 * self.drift:.3f} +- {6e4 * self.drift_sigma:.3f} ms/min"
        )


@names_checked
def align_clocks(
    poses: GroundTruth,
    *,
    imu: ImuArray | None = None,
    events: EventArray | None = None,
    imu_lag_s: float = 0.0,
    max_offset_s: float = 0.5,
    position_sigma_m: float | None = None,
    rotation_sigma_rad: float | None = None,
) -> ClockAlignment:
    """Estimate offset and drift of the motion capture's clock against the camera's, from the IMU or from events.

    The poses are smoothed (:class:`SampledTrajectory`, which delays nothing) and their motion is compared with

    - the gyroscope: gyro = R w + b, where the rotation R from camera to IMU and the bias b are free, so that no
      calibration is needed (Kabsch's solution at every trial of the two clocks);
    - or the events' rate in bins of 5 ms: rate^2 = m' G m with m the camera's velocity and body rate and G a free
      symmetric matrix. That is the rate of a pixel that crosses levels in proportion to its speed, the size of grad L .
      flow, in the mean square over the image, flow being linear in m; G stands for texture and depth, and as these
      change under way, it is an approximation. A pixel's event also comes only when a level is reached, so that events
      are late, by a few milliseconds where a pixel has tens of them a second; the offset found is too small by that.
      Use the IMU where there is one.

    A coarse search over the offset is followed by least squares in offset and drift. Without excitation there is
    nothing to align: see ``unexplained`` and the standard deviations.

    Args:
        poses: with their own stamps, as :attr:`~davis_rs.io.dataset.text_folder.TextFolder.groundtruth` of a dataset.
        imu: samples of ``IMU_DTYPE`` on the camera's clock; or
        events: ``EVENT_DTYPE`` on the camera's clock. Give just one of the two.
        imu_lag_s: the age of the motion that an IMU sample shows; 2.4 ms for the paper's.
        max_offset_s: the largest offset to search, > 0.
        position_sigma_m, rotation_sigma_rad: noise of the poses; None estimates it from them.

    Raises:
        ValueError: unless just one of ``imu`` and ``events`` is given, for values out of range, poses that break a rule
            of :class:`SampledTrajectory`, or less than 50 samples or bins in common with the poses.

    Source of the rotation: Kabsch, Acta Cryst. A 32 (1976). Of the elimination of R, b and G: Golub and Pereyra, "The
    differentiation of pseudo-inverses and nonlinear least squares problems whose variables separate", 1973.
    """
    if (imu is None) == (events is None):
        raise ArgumentError(
            "align_clocks needs just one of {imu} and {events}, got {}", "none" if imu is None else "both"
        )
    check_number("max_offset_s", max_offset_s, 0, above_low=True)
    check_type("poses", poses, GroundTruth, "Dataset(...).groundtruth has them, GroundTruth(...) makes them")
    path = SampledTrajectory(
        poses.t_us * 1e-6,
        poses.positions,
        poses.quaternions,
        position_sigma_m=position_sigma_m,
        rotation_sigma_rad=rotation_sigma_rad,
    )
    if events is not None:
        signal = _event_rate(events, path)
    else:
        assert imu is not None
        signal = _gyro(imu, path, imu_lag_s)
    return _refined(signal, path, float(poses.t_us[0]) * 1e-6, _coarse_offset(signal, path, poses, max_offset_s))


@dataclass(frozen=True, eq=False)
class _Signal:
    """Holds a measurement by a sensor on the camera at its own times, and a comparison with the motion at other times.

    ``residuals`` takes times on the path (m,) and values (m, k), and returns residuals (m, k) in units of the root of
    the values' whole power, so that their sum of squares is the fraction that is not explained.
    """

    t_s: FloatArray  # (n,)
    values: FloatArray  # (n, k)
    residuals: Callable[[FloatArray, FloatArray], FloatArray]

    def thinned(self, most: int) -> _Signal:
        """Return every k-th sample, at most ``most`` of them."""
        every = max(1, -(-len(self.t_s) // most))
        return _Signal(self.t_s[::every], self.values[::every], self.residuals)

    def selected(self, which: npt.NDArray[np.bool_]) -> _Signal:
        """Return the samples where ``which`` (n,) is true."""
        return _Signal(self.t_s[which], self.values[which], self.residuals)


def _coarse_offset(signal: _Signal, path: SampledTrajectory, poses: GroundTruth, max_offset_s: float) -> float:
    """Return the offset on a grid that leaves the smallest fraction of the signal unexplained."""
    thin = signal.thinned(_COARSE_SAMPLES)
    steps = max(1, round(max_offset_s / _COARSE_STEP_S))
    fractions: dict[float, float] = {}
    overlaps: dict[float, int] = {}
    for offset_s in (np.linspace(-1, 1, 2 * steps + 1) * max_offset_s).tolist():
        times = thin.t_s + offset_s - float(poses.t_us[0]) * 1e-6
        inside = (times >= 0) & (times <= path.duration_s)
        overlaps[offset_s] = int(inside.sum())
        if overlaps[offset_s] >= _LEAST_OVERLAP:
            fractions[offset_s] = _power(thin.residuals(times[inside], thin.values[inside]))
    # A short overlap is explained by chance.
    enough = [offset for offset in fractions if overlaps[offset] >= max(overlaps.values()) / 2]
    if not enough:
        raise ValueError(f"poses and samples must have at least {_LEAST_OVERLAP} samples or bins in common")
    return min(enough, key=fractions.__getitem__)


def _refined(signal: _Signal, path: SampledTrajectory, start_s: float, offset_s: float) -> ClockAlignment:
    """Fit offset and drift by least squares."""
    from scipy.optimize import least_squares

    # The same samples at every trial: those that stay within the poses while offset and drift settle.
    near = signal.t_s + offset_s - start_s
    signal = signal.selected((near > _MARGIN_S) & (near < path.duration_s - _MARGIN_S)).thinned(_MOST_SAMPLES)
    if len(signal.t_s) < _LEAST_OVERLAP:
        raise ValueError(f"poses and samples must have at least {_LEAST_OVERLAP} samples or bins in common")
    # The offset is fitted at the middle of the samples, where it depends least on the drift.
    middle_s = float(signal.t_s.mean())

    def residuals(x: FloatArray) -> FloatArray:
        times = signal.t_s + x[0] + x[1] * (signal.t_s - middle_s) - start_s
        return signal.residuals(np.clip(times, 0.0, path.duration_s), signal.values).ravel()

    fit = least_squares(residuals, [offset_s, 0.0], x_scale=[1e-3, 1e-3 / float(np.ptp(signal.t_s))], xtol=1e-12)
    left = fit.fun.reshape(signal.values.shape)
    covariance = _covariance(fit.jac.reshape(*left.shape, 2), left, float(np.ptp(signal.t_s)))
    offset, drift = fit.x
    return ClockAlignment(
        offset_s=float(offset - drift * middle_s),
        drift=float(drift),
        offset_sigma_s=float(np.sqrt(covariance[0, 0] + middle_s**2 * covariance[1, 1])),
        drift_sigma=float(np.sqrt(covariance[1, 1])),
        unexplained=_power(left),
    )


def _gyro(imu: ImuArray, path: SampledTrajectory, lag_s: float) -> _Signal:
    samples = as_imu(imu)

    def residuals(t_s: FloatArray, gyro: FloatArray) -> FloatArray:
        rates = path.angular_rates(t_s)
        rates, gyro = rates - rates.mean(0), gyro - gyro.mean(0)  # without the bias
        u, _, vt = np.linalg.svd(gyro.T @ rates)
        rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
        left: FloatArray = gyro - rates @ rotation.T
        return left / np.sqrt(_power(gyro) + _TINY)

    return _Signal(samples["t"] * 1e-6 - lag_s, np.array(samples["gyro"]), residuals)


def _event_rate(events: npt.NDArray[np.void], path: SampledTrajectory) -> _Signal:
    t_us = as_events(events)["t"]
    bins = np.bincount(t_us // _EVENT_BIN_US) if len(t_us) else np.zeros(0)
    rate = bins[:-1].astype(np.float64)  # the last bin may not be whole
    if len(rate) == 0 or not rate.any():
        raise ValueError(f"events must fill at least one bin of {_EVENT_BIN_US} us, got {len(t_us)} events")
    floor = float(np.median(rate)) + 1
    first, second = np.triu_indices(6)

    def residuals(t_s: FloatArray, values: FloatArray) -> FloatArray:
        motion = np.concatenate(
            [np.einsum("nji,nj->ni", path.rotations(t_s), path.velocities(t_s)), path.angular_rates(t_s)], axis=1
        )
        products = motion[:, first] * motion[:, second]
        # Noise of a squared rate grows with the rate, and so does the error of the approximation.
        weights = 1 / (values + floor)
        model = np.column_stack([products / np.sqrt((products**2).mean(0) + _TINY), np.ones(len(t_s))]) * weights
        squares = values**2 * weights
        flat = squares - weights * (weights * squares).sum() / (weights**2).sum()  # without motion
        left: FloatArray = squares - model @ np.linalg.lstsq(model, squares[:, 0], rcond=1e-9)[0][:, None]
        return left / np.sqrt(_power(flat) + _TINY)

    middles = (np.arange(len(rate), dtype=np.float64) + 0.5) * (_EVENT_BIN_US * 1e-6)
    return _Signal(middles, rate[:, None], residuals)


def _power(values: FloatArray) -> float:
    return float((values**2).sum())


def _covariance(jacobian: FloatArray, left: FloatArray, span_s: float) -> FloatArray:
    """Estimate the covariance (2, 2) of offset and drift, from residuals (n, k) that are correlated within a block.

    Source: Newey and West, "A simple, positive semi-definite, heteroskedasticity and autocorrelation consistent
    covariance matrix", Econometrica 55 (1987), here with blocks instead of their window.
    """
    scores = (jacobian * left[..., None]).sum(1)
    blocks = int(np.clip(span_s / _BLOCK_S, 8, len(scores)))
    sums = np.array([block.sum(0) for block in np.array_split(scores, blocks)])
    bread = np.linalg.pinv(np.einsum("nki,nkj->ij", jacobian, jacobian))
    covariance: FloatArray = bread @ (sums.T @ sums) @ bread
    return covariance
