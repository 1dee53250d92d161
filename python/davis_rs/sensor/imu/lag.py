"""Defines the effect of a sample's lag behind its stamp."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..effects.effect import Effect, Where, check_range


@dataclass(frozen=True)
class ImuLag(Effect):
    """A sample stamped t shows the motion at t - ``total_s``, the delay of the low-pass included.

    Args:
        total_s: 0..1 s, no less than the delay of the low-pass, if there is one. The default is what the paper found
            between the camera and the IMU.

    Raises:
        ValueError: for a lag out of range.

    Source: Mueggler et al., IJRR 2017, calibration of camera and IMU.
    """

    total_s: float = 0.0024

    name: ClassVar[str] = "imu_lag_s"
    acts_on: ClassVar[Where] = "imu"

    def __post_init__(self) -> None:
        check_range("imu_lag_s total_s", self.total_s, 0.0, 1.0, "s")

    @property
    def neutral(self) -> bool:
        """Whether a sample shows the motion of its stamp."""
        return self.total_s == 0
