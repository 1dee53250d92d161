"""Describes how the strength of a light changes over time: mains flicker, pulses, a dimmer."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
import numpy.typing as npt

from .._util.argument_checks import check_number
from .._util.argument_error import ArgumentError
from ..geometry.pose import FloatArray

_WAVEFORMS = ("sine", "triangle", "square")
_INTERPOLATIONS = ("linear", "cubic")
_MOST_EDGES_HZ = 5e5


class LightProfile(ABC):
    """A factor >= 0 on a light's strength at any time of the sequence; 1 is the strength that the scene gives it."""

    @abstractmethod
    def factor(self, t_s: npt.ArrayLike) -> FloatArray:
        """Return factors (n,), >= 0, at times (n,) in seconds of the sequence."""

    @abstractmethod
    def rate(self, t_s: npt.ArrayLike) -> FloatArray:
        """Return the derivative of :meth:`factor`, (n,), per second: exact, because it enters the rates of luma.

        Where the factor has a bend, it is the slope after the bend. A jump has no slope and is left out.
        """

    def breaks_s(self, start_s: float, end_s: float) -> FloatArray:
        """Return instants (n,), increasing, within [``start_s``, ``end_s``] at which the factor jumps or has a bend.

        At a jump :meth:`factor` gives the value after it. Luma must not be interpolated across these instants. A smooth
        profile has none, and so this method returns none unless a subclass has its own.
        """
        return np.empty(0)

    @abstractmethod
    def describe(self) -> dict[str, object]:
        """Return a description of this profile, in JSON's types."""


class Flicker(LightProfile):
    """A periodic profile about 1: factor 1 + modulation w(2 pi frequency t + phase), with w a wave in [-1, 1].

    A lamp on alternating current shines twice a period: 100 Hz on mains of 50 Hz, 120 Hz on those of 60 Hz.

    Args:
        frequency_hz: of the light, > 0.
        modulation: from 0 (steady) to 1 (dark once a period).
        phase_rad: at t = 0.
        waveform: ``sine``, ``triangle``, or ``square`` (a pulsed diode; rate 0 but for its jumps).

    Raises:
        ValueError: for a value out of range.
    """

    def __init__(
        self, frequency_hz: float, *, modulation: float, phase_rad: float = 0.0, waveform: str = "sine"
    ) -> None:
        check_number("frequency_hz", frequency_hz, 0, above_low=True, unit="Hz")
        check_number("modulation", modulation, 0, 1)
        check_number("phase_rad", phase_rad)
        if waveform not in _WAVEFORMS:
            raise ArgumentError("{waveform} must be one of {}, got {!r}", ", ".join(_WAVEFORMS), waveform)
        self.frequency_hz, self.modulation = float(frequency_hz), float(modulation)
        self.phase_rad, self.waveform = float(phase_rad), waveform

    def factor(self, t_s: npt.ArrayLike) -> FloatArray:
        turns = self._turns(t_s)
        if self.waveform == "sine":
            wave = np.sin(2 * np.pi * turns)
        elif self.waveform == "triangle":
            wave = np.abs(4 * ((turns - 0.25) % 1) - 2) - 1
        else:
            wave = np.where(turns % 1 < 0.5, 1.0, -1.0)
        return np.maximum(1 + self.modulation * wave, 0.0)

    def rate(self, t_s: npt.ArrayLike) -> FloatArray:
        turns = self._turns(t_s)
        if self.waveform == "sine":
            slope = 2 * np.pi * np.cos(2 * np.pi * turns)
        elif self.waveform == "triangle":
            slope = np.where((turns - 0.25) % 1 < 0.5, -4.0, 4.0)
        else:
            slope = np.zeros_like(turns)
        return self.modulation * self.frequency_hz * slope

    def breaks_s(self, start_s: float, end_s: float) -> FloatArray:
        """Return the square's edges or the triangle's peaks; none where they follow within 2 us, the least time
        that two keyframes can resolve."""
        if self.waveform == "sine" or self.modulation == 0 or self.frequency_hz > _MOST_EDGES_HZ / 2:
            return np.empty(0)
        first = 0.25 if self.waveform == "triangle" else 0.0
        low, high = (2 * (self._turns([start_s, end_s]) - first)).tolist()
        halves = np.arange(np.ceil(low), np.floor(high) + 1)
        return (halves / 2 + first - self.phase_rad / (2 * np.pi)) / self.frequency_hz

    def describe(self) -> dict[str, object]:
        return {
            "kind": "flicker",
            "frequency_hz": self.frequency_hz,
            "modulation": self.modulation,
            "phase_rad": self.phase_rad,
            "waveform": self.waveform,
        }

    def _turns(self, t_s: npt.ArrayLike) -> FloatArray:
        return np.asarray(t_s, np.float64) * self.frequency_hz + self.phase_rad / (2 * np.pi)


class SampledProfile(LightProfile):
    """A profile through given factors; before the first and after the last it is constant.

    Args:
        t_s: times (n,) in seconds of the sequence, n >= 2, strictly increasing.
        factors: (n,), >= 0.
        interpolation: ``linear``, or ``cubic``: through every factor without overshoot (Fritsch, Butland 1984), so
            that it never falls below 0.

    Raises:
        ValueError: for arrays of other shapes, a value out of range, or times that do not increase.
    """

    def __init__(self, t_s: npt.ArrayLike, factors: npt.ArrayLike, *, interpolation: str = "linear") -> None:
        self._t_s, self._factors = np.array(t_s, np.float64), np.array(factors, np.float64)
        if self._t_s.ndim != 1 or self._t_s.shape != self._factors.shape or len(self._t_s) < 2:
            shapes = f"{self._t_s.shape} and {self._factors.shape}"
            raise ValueError(f"times and factors of a light must both have shape (n,), n >= 2, got {shapes}")
        if not (np.isfinite(self._t_s).all() and (np.diff(self._t_s) > 0).all()):
            raise ValueError("the times of a light's factors must be finite and strictly increasing")
        wrong = ~((self._factors >= 0) & (self._factors < np.inf))
        if wrong.any():
            raise ValueError(f"a light's factors must be finite and >= 0, got {self._factors[wrong][0]}")
        if interpolation not in _INTERPOLATIONS:
            raise ArgumentError(
                "{interpolation} must be one of {}, got {!r}", ", ".join(_INTERPOLATIONS), interpolation
            )
        self.interpolation = interpolation

    def factor(self, t_s: npt.ArrayLike) -> FloatArray:
        t = np.asarray(t_s, np.float64)
        if self.interpolation == "linear":
            return np.interp(t, self._t_s, self._factors)
        return np.maximum(self._cubic(np.clip(t, self._t_s[0], self._t_s[-1]), 0), 0.0)

    def rate(self, t_s: npt.ArrayLike) -> FloatArray:
        t = np.asarray(t_s, np.float64)
        inside = (t >= self._t_s[0]) & (t < self._t_s[-1])
        if self.interpolation == "linear":
            slopes = np.diff(self._factors) / np.diff(self._t_s)
            rates = slopes[np.clip(np.searchsorted(self._t_s, t, side="right") - 1, 0, len(slopes) - 1)]
        else:
            rates = self._cubic(np.clip(t, self._t_s[0], self._t_s[-1]), 1)
        return np.where(inside, rates, 0.0)

    def breaks_s(self, start_s: float, end_s: float) -> FloatArray:
        """Return the times of the samples."""
        return self._t_s[(self._t_s >= start_s) & (self._t_s <= end_s)]

    def describe(self) -> dict[str, object]:
        return {
            "kind": "sampled",
            "t_s": self._t_s.tolist(),
            "factors": self._factors.tolist(),
            "interpolation": self.interpolation,
        }

    def _cubic(self, t: FloatArray, order: int) -> FloatArray:
        from scipy.interpolate import PchipInterpolator

        return np.asarray(PchipInterpolator(self._t_s, self._factors)(t, order), np.float64)


class ShiftedProfile(LightProfile):
    """A profile that starts ``start_s`` seconds into another one."""

    def __init__(self, profile: LightProfile, start_s: float) -> None:
        self._profile: LightProfile = profile
        self._start_s: float = start_s
        if isinstance(profile, ShiftedProfile):  # a part of a part
            self._profile, self._start_s = profile._profile, profile._start_s + start_s

    def factor(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._profile.factor(np.asarray(t_s, np.float64) + self._start_s)

    def rate(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._profile.rate(np.asarray(t_s, np.float64) + self._start_s)

    def breaks_s(self, start_s: float, end_s: float) -> FloatArray:
        return self._profile.breaks_s(start_s + self._start_s, end_s + self._start_s) - self._start_s

    def describe(self) -> dict[str, object]:
        return {**self._profile.describe(), "start_s": self._start_s}


class PacedProfile(LightProfile):
    """Tells another profile by a clock of another pace: at the clock's time t the other one is at t / ``pace``.

    Args:
        profile: by its own clock.
        pace: seconds of the new clock in a second of the profile's own, > 0.
    """

    def __init__(self, profile: LightProfile, pace: float) -> None:
        self._profile, self._pace = profile, pace

    def factor(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._profile.factor(np.asarray(t_s, np.float64) / self._pace)

    def rate(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._profile.rate(np.asarray(t_s, np.float64) / self._pace) / self._pace

    def breaks_s(self, start_s: float, end_s: float) -> FloatArray:
        return self._profile.breaks_s(start_s / self._pace, end_s / self._pace) * self._pace

    def describe(self) -> dict[str, object]:
        return {**self._profile.describe(), "pace": self._pace}
