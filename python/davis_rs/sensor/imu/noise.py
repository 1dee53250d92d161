"""Simulates white noise and a drifting bias of the IMU."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...geometry.pose import FloatArray
from ..effects.effect import Effect, Where, check_range


@dataclass(frozen=True)
class ImuNoise(Effect):
    """Kalibr's model: each axis has white noise, and a bias that is a random walk from 0.

    A sample's noise has the standard deviation density / sqrt(dt), and the bias changes by a step of standard deviation
    random_walk * sqrt(dt) from one sample to the next. The first n samples do not depend on how many follow.

    Args:
        accelerometer_noise_density: m/s^2/sqrt(Hz), >= 0, as the next three.
        gyroscope_noise_density: rad/s/sqrt(Hz).
        accelerometer_random_walk: m/s^3/sqrt(Hz).
        gyroscope_random_walk: rad/s^2/sqrt(Hz).

    The defaults are those of ESIM. The MPU-6150's datasheet states white noise of 3.9e-3 m/s^2/sqrt(Hz) (400 ug) and
    8.7e-5 rad/s/sqrt(Hz) (0.005 deg/s), and no random walk.

    Raises:
        ValueError: for a value that is negative or not finite.

    Source: Kalibr, "IMU noise model"; Rebecq, Gehrig and Scaramuzza, "ESIM: an open event camera simulator", CoRL 2018.
    """

    accelerometer_noise_density: float = 1.86e-3
    gyroscope_noise_density: float = 1.86e-4
    accelerometer_random_walk: float = 4.33e-4
    gyroscope_random_walk: float = 2.66e-5

    name: ClassVar[str] = "imu_noise"
    acts_on: ClassVar[Where] = "imu"

    def __post_init__(self) -> None:
        for name, value in self.settings().items():
            check_range(f"imu_noise {name}", value, 0.0, np.inf)

    @property
    def neutral(self) -> bool:
        """Whether there is no noise."""
        return not any(self.settings().values())

    def draw(self, count: int, rate_hz: float, seed: int) -> FloatArray:
        """Draw noise and bias of ``count`` samples, (count, 6): accelerometer x y z, gyroscope x y z, SI units."""
        densities = np.repeat([self.accelerometer_noise_density, self.gyroscope_noise_density], 3)
        walks = np.repeat([self.accelerometer_random_walk, self.gyroscope_random_walk], 3)
        white = self.random(seed, purpose=0).standard_normal((count, 6)) * (densities * np.sqrt(rate_hz))
        steps = self.random(seed, purpose=1).standard_normal((max(count - 1, 0), 6)) * (walks / np.sqrt(rate_hz))
        noise: FloatArray = white
        noise[1:] += np.cumsum(steps, axis=0)
        return noise
