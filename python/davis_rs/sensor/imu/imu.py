"""Simulates an inertial measurement unit: a trajectory in, samples out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..._util.argument_checks import check_number, check_type
from ..._util.argument_error import ArgumentError
from ...events.decoded import IMU_DTYPE
from ...geometry.pose import FloatArray
from ...geometry.trajectory.trajectory import Trajectory
from ...sampling.rules import periodic_instants
from ..effects.effect import Effect
from .converter import ImuQuantisation, ImuSaturation
from .lag import ImuLag
from .low_pass import ImuLowPass
from .mounting import Mounting
from .noise import ImuNoise

ImuArray = np.ndarray[tuple[int], np.dtype[np.void]]
"""One-dimensional array of ``IMU_DTYPE``; temperature is not simulated, and 0 as where a camera sends none."""

IMU_EFFECTS: dict[str, type[Effect]] = {
    "low_pass": ImuLowPass,
    "lag": ImuLag,
    "noise": ImuNoise,
    "saturation": ImuSaturation,
    "quantisation": ImuQuantisation,
}
"""The effects by the names that they have in :class:`Imu`, in the order in which they act."""

_GRAVITY = (0.0, 0.0, -9.81)
_BLOCK = 4096


@dataclass(frozen=True)
class Imu:
    """Describes an IMU that is rigidly fixed to the sensor.

    The default is an ideal one at the camera's centre, in camera axes.

    Args:
        rate_hz: sample k is stamped round(k 1e6 / rate) us; above 0, up to 1e6 Hz.
        mounting: where it is, see :class:`Mounting`; None is the camera's own centre and axes.
        gravity: in world axes, m/s^2.
        low_pass, lag, noise, saturation, quantisation: its imperfections, applied in this order; None is off.

    Raises:
        ValueError: for a rate or gravity out of range, or a lag below the delay of the low-pass.
    """

    rate_hz: float = 1000.0
    mounting: Mounting | None = None
    gravity: tuple[float, float, float] = _GRAVITY
    low_pass: ImuLowPass | None = None
    lag: ImuLag | None = None
    noise: ImuNoise | None = None
    saturation: ImuSaturation | None = None
    quantisation: ImuQuantisation | None = None

    def __post_init__(self) -> None:
        check_number("rate_hz", self.rate_hz, 0, 1e6, above_low=True, unit="Hz")
        for name, effect_class in IMU_EFFECTS.items():
            if (effect := getattr(self, name)) is not None:
                check_type(name, effect, effect_class, f"{effect_class.__name__}(...) makes one")
        gravity = np.asarray(self.gravity, np.float64)
        if gravity.shape != (3,) or not np.isfinite(gravity).all():
            raise ArgumentError("{gravity} must be three finite numbers in m/s^2, got {}", self.gravity)
        if self.low_pass is not None and self.lag is not None and self.lag.total_s < self.low_pass.delay_s:
            raise ValueError(
                f"the IMU's lag includes the delay of its low-pass and must be at least {self.low_pass.delay_s} s, "
                f"got {self.lag.total_s} s"
            )

    @classmethod
    def mpu6150(cls) -> Imu:
        """Return the InvenSense MPU-6150 of the paper's DAVIS240C, with all of its imperfections.

        It samples at 1 kHz with full scales of +-16 g and +-2000 deg/s in 16 bits. It is mounted as calibrated, its
        samples are 2.4 ms late in all, and its noise is that of ESIM.

        Source: Mueggler et al., IJRR 2017, the sensor and its calibration; Rebecq et al., CoRL 2018, for the noise.
        """
        return cls(
            mounting=Mounting(),
            low_pass=ImuLowPass(),
            lag=ImuLag(),
            noise=ImuNoise(),
            saturation=ImuSaturation(),
            quantisation=ImuQuantisation(),
        )

    @property
    def lag_s(self) -> float:
        """Return the age of the motion that a sample shows, in seconds."""
        if self.lag is not None:
            return self.lag.total_s
        return self.low_pass.delay_s if self.low_pass is not None else 0.0

    @property
    def effective_mounting(self) -> Mounting:
        """Return the mounting of the IMU; the identity if none was given."""
        return self.mounting or Mounting(np.eye(4))

    def describe(self) -> dict[str, object]:
        """Return a description of the IMU, in JSON's types."""
        effects = {name: getattr(self, name) for name in IMU_EFFECTS}
        return {
            "rate_hz": self.rate_hz,
            "T_imu_camera": self.effective_mounting.matrix.tolist(),
            "gravity": list(self.gravity),
            "lag_s": self.lag_s,
            **{name: effect.settings() for name, effect in effects.items() if effect is not None},
        }


IMU_MODELS: Mapping[str, Callable[[], Imu]] = {
    "ideal": Imu,
    "davis": lambda: Imu(mounting=Mounting()),
    "mpu6150": Imu.mpu6150,
}
"""IMUs by name: an ideal one at the camera's centre, one where the DAVIS240C has it, and that with all effects."""


def simulate_imu(trajectory: Trajectory, imu: Imu | None = None, *, seed: int = 0) -> ImuArray:
    """Compute what an IMU on the trajectory reads: specific force and angular rate, by the trajectory's derivatives.

    With R the rotation from camera to IMU, c the IMU's position in camera axes, a, w and dw/dt the camera's
    acceleration (world axes), body rate and its derivative, and g gravity,

        gyro = R w
        accel = R (R_camera_world (a - g) + dw/dt x c + w x (w x c))

    so a camera upright and at rest reads (0, -9.81, 0) in camera axes (y down), and one in free fall 0. A sample whose
    lag or filter reaches back before t = 0 sees the motion of t = 0 there.

    Args:
        trajectory: of the camera. Its accelerations must be realistic: exact, or smoothed (``read_trajectory``).
        imu: None is the ideal one at the camera's centre.
        seed: of the noise, 0..2^64 - 1.

    Returns:
        (n,) of :data:`IMU_DTYPE` at round(k 1e6 / rate) us, from 0 to the end. The same input gives the same bytes, and
        noise does not depend on the trajectory or its length.

    Source: Kok, Hol and Schon, "Using inertial sensors for position and orientation estimation", 2017, section 2.
    """
    check_type("trajectory", trajectory, Trajectory, "a scene's is scene.path")
    imu = Imu() if imu is None else imu
    check_type("imu", imu, Imu, "Imu() makes an ideal one, Imu.mpu6150() that of the DAVIS240C")
    t_us = np.fromiter(periodic_instants(imu.rate_hz, 0, int(trajectory.duration_s * 1e6 + 1e-3)), np.int64)
    samples = np.zeros(len(t_us), IMU_DTYPE)
    samples["t"] = t_us
    values = np.concatenate([_motion(trajectory, imu, t_us[i : i + _BLOCK]) for i in range(0, len(t_us), _BLOCK)])
    if imu.noise is not None:
        values += imu.noise.draw(len(t_us), imu.rate_hz, seed)
    for effect in (imu.saturation, imu.quantisation):
        if effect is not None and not effect.neutral:
            values = effect.apply(values)
    samples["accel"], samples["gyro"] = values[:, :3], values[:, 3:]
    return samples


def as_imu(samples: npt.ArrayLike) -> ImuArray:
    """Return ``samples`` as an array of :data:`IMU_DTYPE`, checked.

    Raises:
        ValueError: for another dtype or shape, times that do not increase, or a value that is not finite.
    """
    array = np.asarray(samples)
    if array.dtype != IMU_DTYPE or array.ndim != 1:
        raise ValueError(f"IMU samples must be a (n,) array of IMU_DTYPE, got {array.dtype} of shape {array.shape}")
    back = np.diff(array["t"]) <= 0
    if back.any():
        at = int(back.argmax())
        raise ValueError(f"IMU times must increase, got {array['t'][at + 1]} us after {array['t'][at]} us")
    bad = ~(np.isfinite(array["accel"]).all(1) & np.isfinite(array["gyro"]).all(1))
    if bad.any():
        raise ValueError(f"IMU samples must be finite, got {array[bad][0]}")
    return array


def _motion(trajectory: Trajectory, imu: Imu, t_us: npt.NDArray[np.int64]) -> FloatArray:
    """Compute readings (n, 6) with the IMU's lag and low-pass, without noise."""
    t: FloatArray = t_us.astype(np.float64) * 1e-6 - imu.lag_s
    if imu.low_pass is None:
        return _readings(trajectory, imu, t)
    around, weights = imu.low_pass.kernel()
    every = _readings(trajectory, imu, np.add.outer(t, around).ravel())
    smooth: FloatArray = np.einsum("k,nkc->nc", weights, every.reshape(len(t), len(around), 6))
    return smooth


def _readings(trajectory: Trajectory, imu: Imu, t_s: FloatArray) -> FloatArray:
    """Compute specific force and angular rate in the axes of the IMU, (n, 6)."""
    t = np.clip(t_s, 0.0, trajectory.duration_s)
    rotation, arm = imu.effective_mounting.rotation, imu.effective_mounting.lever_arm
    rates = trajectory.angular_rates(t)
    force = np.einsum("nji,nj->ni", trajectory.rotations(t), trajectory.accelerations(t) - np.asarray(imu.gravity))
    if arm.any():
        force += np.cross(trajectory.angular_accelerations(t), arm) + np.cross(rates, np.cross(rates, arm))
    return np.concatenate([force @ rotation.T, rates @ rotation.T], axis=1)
