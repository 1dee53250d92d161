"""Simulates the active pixels of a DAVIS, which make its intensity frames: shutter, electrons, noise, and an ADC."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from .effect import Effect, Where, check_range

FloatArray = npt.NDArray[np.float64]

_LONGEST_US = (1 << 22) - 1
_SLOWEST_ROW_US = 1e5
_MOST_BITS = 16
_USUAL_BITS = 10
_MOST_ELECTRONS = 1e15
"""Beyond this many electrons shot noise is negligible, and up to it the generator's integers hold the number."""

_SHOT, _READ, _COLUMN_NOISE, _PRNU, _DSNU, _COLUMN_OFFSET = range(6)
"""The streams of random numbers, one for each noise and each fixed pattern."""


@dataclass(frozen=True)
class Aps(Effect):
    """Frames of an active pixel sensor, instead of exact luma at an instant.

    A frame stamped t gathers light in (t - exposure_us, t]: it is stamped when the shutter closes, as a frame that is
    made while the camera moves must be. Who wants stamps in the middle subtracts half of the exposure. The shutter is
    global unless ``row_readout_us`` is given: then the last row closes at t, each row above it that much earlier, so
    the image's row y (of H) shows (t_y - exposure_us, t_y] with t_y = t - (H - 1 - y) row_readout_us. Before the first
    instant of a sequence there is no light: an exposure that would begin there begins with the sequence.

    The mean luma of a pixel is read out in these steps (the linear model of EMVA 1288):

    - electrons: luma times (electrons at full scale / ``full_scale_luma``), times the pixel's own gain (``prnu``);
    - photon shot noise: Poisson, and what is beyond the full well is lost;
    - digital numbers (DN), of which 2^bits - 1 are full scale: electrons / ``electrons_per_dn``;
    - offsets that stay (``dsnu_dn`` of each pixel, ``column_offset_dn`` of each column), and noise of each frame
      (``read_noise_dn`` of each pixel, ``column_noise_dn`` that all pixels of a column have in common);
    - the ADC: whole DN, clipped to 0 and full scale. As what is below 0 is lost, a pixel in the dark has half of its
      noise and offsets only.

    Fixed patterns are functions of the seed and of the pixel's number y W + x, or of its column x. Dark current is not
    simulated. The neutral values are 0, and None for bits, full scale, full well and electrons per DN.

    Args:
        exposure_us: how long the shutter is open, 0..4194303 us, rounded to the microsecond; 0 for an instant. The
            range is that of the camera's own setting (DAVIS_CONFIG_APS_EXPOSURE of libcaer).
        read_noise_dn: standard deviation of a pixel's temporal noise in the dark, in DN, >= 0. The DAVIS240 has a
            dynamic range of 51 dB in its frames: 1023 / 10^(51 / 20) = 2.9 of 1023 DN.
        bits: of the ADC, 1..16; None does not round, and then a DN is that of 10 bits.
        full_scale_luma: where the ADC saturates, 1e-6..1e6 in units of luma, as the gain and the exposure have it;
            None never saturates, and then the scale is that of 1.
        full_well_e: electrons that a pixel holds, 1..1e9: more are lost. None for no limit.
        electrons_per_dn: 1e-6..1e9, for photon shot noise; what a chip has is measured from its photon transfer curve.
            None makes a full well full scale; without a full well there is no shot noise then.
        prnu: photo response non-uniformity: standard deviation of the pixels' gains, a fraction of their mean, 0..1;
            log-normal.
        dsnu_dn: dark signal non-uniformity: standard deviation of the pixels' offsets, in DN, >= 0; normal.
        column_offset_dn: standard deviation of an offset that all pixels of a column have, in DN, >= 0; normal, the
            same in each frame.
        column_noise_dn: standard deviation of such an offset that changes from frame to frame.
        row_readout_us: time between the ends of exposure of a row and of the next one below, 0..1e5 us; 0 is a global
            shutter.

    Raises:
        ValueError: for a value out of range.

    Source: Brandli, Berner, Yang, Liu, Delbruck, A 240 x 180 130 dB 3 us latency global shutter spatiotemporal vision
    sensor, IEEE JSSC 49(10), 2014 (the pixel; dynamic range and fixed pattern noise of its frames); EMVA Standard 1288,
    release 4.0 (linear model, full well, PRNU, DSNU). Names of libcaer: DAVIS_CONFIG_APS_GLOBAL_SHUTTER.
    """

    exposure_us: float = 10_000.0
    read_noise_dn: float = 2.9
    bits: int | None = _USUAL_BITS
    full_scale_luma: float | None = 1.0
    full_well_e: float | None = None
    electrons_per_dn: float | None = None
    prnu: float = 0.0
    dsnu_dn: float = 0.0
    column_offset_dn: float = 0.0
    column_noise_dn: float = 0.0
    row_readout_us: float = 0.0

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
        if self.electrons_per_dn is not None:
            check_range("electrons_per_dn", self.electrons_per_dn, 1e-6, 1e9, "electrons")
        check_range("prnu", self.prnu, 0, 1)
        for name in ("dsnu_dn", "column_offset_dn", "column_noise_dn"):
            check_range(name, getattr(self, name), 0, np.inf, "DN")
        check_range("row_readout_us", self.row_readout_us, 0, _SLOWEST_ROW_US, "us")

    @property
    def neutral(self) -> bool:
        return self.exposure_us == 0 and self.row_readout_us == 0 and self._exact

    @property
    def _exact(self) -> bool:
        """Whether the exposure is read out unchanged."""
        limits = (self.bits, self.full_scale_luma, self.full_well_e, self.electrons_per_dn)
        noise = (self.read_noise_dn, self.prnu, self.dsnu_dn, self.column_offset_dn, self.column_noise_dn)
        return limits == (None, None, None, None) and not any(noise)

    def readout_us(self, height: int) -> float:
        """Return the microseconds from the end of the first row's exposure to that of the last row's, of ``height``."""
        return (height - 1) * self.row_readout_us

    def read_out(self, luma: npt.ArrayLike, *, frame: int, seed: int = 0) -> npt.NDArray[np.float32]:
        """Read out the frame (H, W), float32 in units of luma, from the exposure's mean ``luma`` (H, W).

        Its noise depends on ``seed`` and ``frame`` (whole numbers in 0..2^64 - 1), the frame's number, alone, and its
        fixed patterns on ``seed``.
        """
        exposed = np.asarray(luma, np.float64)
        if self._exact:
            return exposed.astype(np.float32)
        highest = 2.0 ** (_USUAL_BITS if self.bits is None else self.bits) - 1
        luma_per_dn = (self.full_scale_luma or 1.0) / highest
        signal = exposed / luma_per_dn
        if self.prnu > 0:
            variance = math.log1p(self.prnu**2)
            signal = signal * np.exp(math.sqrt(variance) * _fixed(seed, _PRNU, signal.shape) - variance / 2)
        signal = self._as_electrons(signal, highest, seed, frame)
        if self.dsnu_dn > 0:
            signal = signal + self.dsnu_dn * _fixed(seed, _DSNU, signal.shape)
        if self.column_offset_dn > 0:
            signal = signal + self.column_offset_dn * _fixed(seed, _COLUMN_OFFSET, signal.shape[1:])
        if self.column_noise_dn > 0:
            signal = signal + self.column_noise_dn * self._noise(seed, _COLUMN_NOISE, frame, signal.shape[1:])
        if self.read_noise_dn > 0:
            signal = signal + self.read_noise_dn * self._noise(seed, _READ, frame, signal.shape)
        signal = np.clip(signal, 0.0, np.inf if self.full_scale_luma is None else highest)
        if self.bits is not None:
            signal = np.rint(signal)
        return (signal * luma_per_dn).astype(np.float32)

    def _as_electrons(self, signal: FloatArray, highest: float, seed: int, frame: int) -> FloatArray:
        """Add the shot noise of its electrons to a signal in DN, and cut it off at the full well."""
        per_dn = self.electrons_per_dn
        if per_dn is None:
            if self.full_well_e is None:
                return signal
            per_dn = self.full_well_e / highest
        mean = np.minimum(signal * per_dn, _MOST_ELECTRONS)
        electrons = self.random(seed, purpose=_SHOT, index=frame).poisson(mean)
        return np.asarray(np.minimum(electrons, np.inf if self.full_well_e is None else self.full_well_e) / per_dn)

    def _noise(self, seed: int, purpose: int, frame: int, shape: tuple[int, ...]) -> FloatArray:
        return self.random(seed, purpose=purpose, index=frame).standard_normal(shape)


@lru_cache(maxsize=16)
def _fixed(seed: int, purpose: int, shape: tuple[int, ...]) -> FloatArray:
    """Draw standard normal numbers that stay from frame to frame; they are kept, because each frame needs them."""
    pattern = Aps().random(seed, purpose=purpose).standard_normal(shape)
    pattern.flags.writeable = False
    return pattern
