"""Simulates the IMU's converter: its full scale and its codes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...events.decoded import STANDARD_GRAVITY
from ...geometry.pose import FloatArray
from ..effects.effect import Effect, Where, check_range


@dataclass(frozen=True)
class ImuSaturation(Effect):
    """Each axis is clipped to its full scale.

    Args:
        acceleration_g: the full scale is +- this many g (of 9.80665 m/s^2), > 0.
        rate_deg_s: the full scale is +- this many degrees per second, > 0.

    The defaults are those of the paper's MPU-6150. Infinity leaves one of the two as it is.

    Raises:
        ValueError: for a full scale that is not > 0.

    Source: Mueggler et al., IJRR 2017, the sensor; InvenSense, MPU-6100 and MPU-6150 product specification.
    """

    acceleration_g: float = 16.0
    rate_deg_s: float = 2000.0

    name: ClassVar[str] = "imu_saturation_g"
    acts_on: ClassVar[Where] = "imu"

    def __post_init__(self) -> None:
        for name, value in self.settings().items():
            check_range(f"imu_saturation_g {name}", value, 1e-6, np.inf, finite=False)

    @property
    def neutral(self) -> bool:
        """Whether both full scales are infinite."""
        return bool(np.isinf(self.acceleration_g) and np.isinf(self.rate_deg_s))

    def apply(self, values: FloatArray) -> FloatArray:
        """Return ``values`` (n, 6), m/s^2 and rad/s, clipped to the full scale."""
        scales = full_scales(self.acceleration_g, self.rate_deg_s)
        return np.clip(values, -scales, scales)


@dataclass(frozen=True)
class ImuQuantisation(Effect):
    """Each value becomes the nearest code of a two's complement number, and so lies in its range.

    One code is the full scale / 2^(bits - 1): by default 1 / 2048 g and 1 / 16.384 deg/s, as in the datasheet. The
    highest code is one below the full scale.

    Args:
        bits: 2..32; 0 is neutral.
        acceleration_g, rate_deg_s: the full scale is +- this many g (of 9.80665 m/s^2) and degrees per second, > 0.

    Raises:
        ValueError: for values out of range.

    Source: InvenSense, MPU-6100 and MPU-6150 product specification.
    """

    bits: int = 16
    acceleration_g: float = 16.0
    rate_deg_s: float = 2000.0

    name: ClassVar[str] = "imu_quantisation_bits"
    acts_on: ClassVar[Where] = "imu"

    def __post_init__(self) -> None:
        if not isinstance(self.bits, int) or not (self.bits == 0 or 2 <= self.bits <= 32):
            raise ValueError(f"imu_quantisation_bits bits must be a whole number in 2..32, or 0, got {self.bits!r}")
        for name, value in (("acceleration_g", self.acceleration_g), ("rate_deg_s", self.rate_deg_s)):
            check_range(f"imu_quantisation_bits {name}", value, 1e-6, np.inf)

    @property
    def neutral(self) -> bool:
        """Whether values keep all their digits."""
        return self.bits == 0

    def apply(self, values: FloatArray) -> FloatArray:
        """Return ``values`` (n, 6), m/s^2 and rad/s, rounded to those of the nearest codes."""
        codes = 2 ** (self.bits - 1)
        step = full_scales(self.acceleration_g, self.rate_deg_s) / codes
        quantised: FloatArray = np.clip(np.rint(values / step), -codes, codes - 1) * step
        return quantised


def full_scales(acceleration_g: float, rate_deg_s: float) -> FloatArray:
    """Return the full scales of the six axes, (6,), in m/s^2 and rad/s."""
    return np.repeat([acceleration_g * STANDARD_GRAVITY, np.radians(rate_deg_s)], 3)
