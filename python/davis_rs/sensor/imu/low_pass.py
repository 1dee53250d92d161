"""Simulates the IMU's digital low-pass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...geometry.pose import FloatArray
from ..effects.effect import Effect, Where, check_range

_NODES = 21
_WIDEST = 4.0  # standard deviations: beyond it a Gaussian is nothing
_BOX_BANDWIDTH = 0.22147  # of a box of half-width 1 s, Hz: where sin(x) / x is 1 / sqrt(2), x = 2 pi f


@dataclass(frozen=True)
class ImuLowPass(Effect):
    """A causal filter of linear phase: the motion weighted by a Gaussian around t - ``delay_s``, cut at t.

    The width is the one that leaves 1 / sqrt(2) of a sine at ``bandwidth_hz`` (-3 dB). It acts on the continuous
    motion, so that nothing that the filter blocks is aliased, and it delays every frequency alike. The phase of
    the chip's own filter is not published.

    Args:
        bandwidth_hz: > 0, and not so low that the filter would be longer than twice its delay: 0.2215 / ``delay_s``.
        delay_s: 1e-5..1 s.

    The defaults are the datasheet's accelerometer with DLPF_CFG = 1 (the gyroscope's are 188 Hz and 1.9 ms).

    Raises:
        ValueError: for values out of range.

    Source: InvenSense, RM-MPU-6000A "Register map and descriptions", register 26.
    """

    bandwidth_hz: float = 184.0
    delay_s: float = 0.0020

    name: ClassVar[str] = "imu_low_pass_hz"
    acts_on: ClassVar[Where] = "imu"

    def __post_init__(self) -> None:
        check_range("imu_low_pass_hz delay_s", self.delay_s, 1e-5, 1.0, "s")
        lowest = _BOX_BANDWIDTH / self.delay_s
        if not lowest <= self.bandwidth_hz < np.inf:
            raise ValueError(
                f"imu_low_pass_hz bandwidth_hz must be finite and >= {lowest:.6g} Hz for a delay of {self.delay_s} s, "
                f"got {self.bandwidth_hz!r}"
            )

    @property
    def neutral(self) -> bool:
        """Always False: a filter changes every sample."""
        return False

    def kernel(self) -> tuple[FloatArray, FloatArray]:
        """Return times (k,) around the delayed instant, in seconds, within +-``delay_s``, and weights (k,) of sum 1."""
        from scipy.optimize import brentq

        wide = np.sqrt(np.log(2)) / (2 * np.pi * self.bandwidth_hz)  # of a Gaussian that is not cut
        half = min(self.delay_s, _WIDEST * wide)
        nodes, lengths = np.polynomial.legendre.leggauss(_NODES)
        t = half * nodes

        def weights(log_width: float) -> FloatArray:
            w = lengths * np.exp(-0.5 * (t / (wide * np.exp(log_width))) ** 2)
            normalised: FloatArray = w / w.sum()
            return normalised

        def excess(log_width: float) -> float:
            return float(weights(log_width) @ np.cos(2 * np.pi * self.bandwidth_hz * t)) - np.sqrt(0.5)

        # A cut Gaussian is narrower than it was, without bound near a box.
        highest = 10.0
        return t, weights(brentq(excess, -0.1, highest) if excess(highest) < 0 else highest)
