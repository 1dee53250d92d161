"""The active pixels of a DAVIS, which make its intensity frames: exposure, noise, and an ADC that saturates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from .effect import Effect, Where, check_range

_LONGEST_US = (1 << 22) - 1
_MOST_BITS = 16
_USUAL_BITS = 10
_MOST_ELECTRONS = 1e15
"""A pixel so bright has no shot noise to speak of, and the generator's integers hold it."""

_SHOT, _READ = 0, 1
"""Each noise has its own stream of random numbers."""


@dataclass(frozen=True)
class Aps(Effect):
    """The frames of an active pixel sensor with a global shutter, in place of exact luma at an instant.

    A frame stamped t gathers light in (t - exposure_us, t]: it is stamped when the shutter closes, as a frame that is
    made while the camera moves must be. Who wants stamps in the middle subtracts half of the exposure. Mean luma comes
    to ``full_scale_luma`` / (2^bits - 1) a digital number (DN); then come shot noise, read noise, and the ADC: whole
    DN, clipped to 0 and full scale. As what is below 0 is lost, a pixel in the dark has half of its read noise only.

    The neutral values are exposure 0, noise 0 and None for the others.

    Args:
        exposure_us: how long the shutter is open, 0..4194303 us, rounded to the microsecond; 0 for an instant. The
            range is that of the camera's own setting (DAVIS_CONFIG_APS_EXPOSURE of libcaer).
        read_noise_dn: standard deviation of all noise in the dark, in DN, >= 0. The DAVIS240 has a dynamic range of
            51 dB in its frames: 1023 / 10^(51 / 20) = 2.9 of 1023 DN.
        bits: of the ADC, 1..16; None does not round, and then a DN is that of 10 bits.
        full_scale_luma: where the ADC saturates, 1e-6..1e6 in units of luma, as the gain and the exposure have it;
            None never saturates, and then the scale is that of 1.
        full_well_e: electrons at full scale, 1..1e9, for photon shot noise: the number of electrons is Poisson's.
            None for no shot noise; what a chip has is measured from its photon transfer curve (EMVA 1288).

    Raises:
        ValueError: for a value out of range.

    Source: Brandli, Berner, Yang, Liu, Delbruck, A 240 x 180 130 dB 3 us latency global shutter spatiotemporal vision
    sensor, IEEE JSSC 49(10), 2014 (the pixel; dynamic range of its frames); EMVA Standard 1288 (linear model of noise).
    """

    exposure_us: float = 10_000.0
    read_noise_dn: float = 2.9
    bits: int | None = _USUAL_BITS
    full_scale_luma: float | None = 1.0
    full_well_e: float | None = None

    name: ClassVar[str] = "aps"
    acts_on: ClassVar[Where] = "frames"

    def __post_init__(self) -> None:
        check_range("exposure_us", self.exposure_us, 0, _LONGEST_US, "us")
        check_range("read_noise_dn", self.read_noise_dn, 0, np.inf, "DN")
        if self.bits is not None:
            check_range("bits", self.bits, 1, _MOST_BITS)
            if self.bits != int(self.bits):
                raise ValueError(f"bits must be a whole number in 1..{_MOST_BITS}, got {self.bits!r}")
        if self.full_scale_luma is not None:
            check_range("full_scale_luma", self.full_scale_luma, 1e-6, 1e6)
        if self.full_well_e is not None:
            check_range("full_well_e", self.full_well_e, 1, 1e9, "electrons")

    @property
    def neutral(self) -> bool:
        return self.exposure_us == 0 and self._exact

    @property
    def _exact(self) -> bool:
        """Whether what is exposed is read out as it is."""
        return (self.read_noise_dn, self.bits, self.full_scale_luma, self.full_well_e) == (0, None, None, None)

    def read_out(self, luma: npt.ArrayLike, *, frame: int, seed: int = 0) -> npt.NDArray[np.float32]:
        """The frame (H, W), float32 in units of luma, that is read of mean ``luma`` (H, W) over the exposure.

        Its noise depends on ``seed`` and ``frame`` (whole numbers in 0..2^64 - 1), the frame's number, alone.
        """
        exposed = np.asarray(luma, np.float64)
        if self._exact:
            return exposed.astype(np.float32)
        highest = 2.0 ** (_USUAL_BITS if self.bits is None else self.bits) - 1
        luma_per_dn = (self.full_scale_luma or 1.0) / highest
        signal = exposed / luma_per_dn
        if self.full_well_e is not None:
            electrons = np.minimum(signal * (self.full_well_e / highest), _MOST_ELECTRONS)
            signal = np.asarray(
                self.random(seed, purpose=_SHOT, index=frame).poisson(electrons) * (highest / self.full_well_e)
            )
        if self.read_noise_dn > 0:
            signal = signal + self.read_noise_dn * self.random(seed, purpose=_READ, index=frame).standard_normal(
                signal.shape
            )
        signal = np.clip(signal, 0.0, np.inf if self.full_scale_luma is None else highest)
        if self.bits is not None:
            signal = np.rint(signal)
        return (signal * luma_per_dn).astype(np.float32)
