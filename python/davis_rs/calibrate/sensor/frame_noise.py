"""Measures noise of frames: how values without change scatter, over how bright they are (photon transfer)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...inspection.statistics.stream_statistics import Measured

_MOST_VALUES = 1 << 18
_A_FRAME, _LEAST_OF_FRAMES = 1 << 12, 30
_LEAST_VALUES = 300
_LEVELS = 10
_OUTLIER = 4.0
_STEADY = 1.25
_MODEL_SHARE = 0.01
"""What the read noise of simulated frames is off, however many there are."""
_STEADIEST, _AS_STEADY = 0.2, 1.15
"""Frames between which nothing changes are those whose second differences scatter least: that quantile, and up to a
factor of it."""


class NoiseValues(NamedTuple):
    """Values of pixels without events in three consecutive frames, float64 (n,) each.

    Attributes:
        level: the mean of the three values.
        step: the difference of the first two.
        bend: the first less twice the second plus the third: a steady change is not in it.
    """

    level: npt.NDArray[np.float64]
    step: npt.NDArray[np.float64]
    bend: npt.NDArray[np.float64]


class NoiseSampler:
    """Takes frames and how many events each pixel had until then; holds a bounded number of values."""

    def __init__(self) -> None:
        self._frames: list[npt.NDArray[np.float64]] = []
        self._counts: npt.NDArray[np.float64] | None = None
        self._found: list[npt.NDArray[np.float64]] = []
        self._total = 0
        self._random = np.random.default_rng(0)

    def add(self, values: npt.NDArray[np.float32], counts: npt.NDArray[np.float64]) -> None:
        """Add the next frame.

        Args:
            values: (H, W), NaN where there is none.
            counts: (H, W): events up to its instant.
        """
        if self._counts is None or not self._frames:
            self._counts = counts
        self._frames.append(values.astype(np.float64))
        if len(self._frames) < 3:
            return
        a, b, c = self._frames
        still = counts == self._counts
        still[1:] &= (counts == self._counts)[:-1]
        still[:-1] &= (counts == self._counts)[1:]
        rows = still.copy()
        still[:, 1:] &= rows[:, :-1]
        still[:, :-1] &= rows[:, 1:]
        self._frames = []
        usable = np.flatnonzero(still & np.isfinite(a + b + c))
        if self._total >= _MOST_VALUES:
            return
        if len(usable) > _A_FRAME:
            usable = self._random.choice(usable, _A_FRAME, replace=False)
        a, b, c = (one.ravel()[usable] for one in (a, b, c))
        if len(usable) < _LEAST_OF_FRAMES:
            return
        self._found.append(np.stack([(a + b + c) / 3, b - a, a - 2 * b + c]))
        self._total += len(usable)

    def finish(self) -> NoiseValues:
        """Return the values of those frames between which light changes least."""
        scatter = [_variance(one[2]) for one in self._found]
        most = _AS_STEADY * float(np.quantile(scatter, _STEADIEST)) if scatter else 0.0
        steady = [one for one, own in zip(self._found, scatter, strict=True) if own <= most]
        return NoiseValues(*np.concatenate([np.zeros((3, 0)), *steady], axis=1))


class FrameNoise(NamedTuple):
    """Noise of frames in their own units.

    Attributes:
        read: standard deviation without light, next to that of rounding to whole values.
        gain: how much the variance grows with the value; 1 over it are electrons a unit.
    """

    read: Measured
    gain: Measured


def fit_frame_noise(values: NoiseValues, lowest: float, highest: float, black: float) -> FrameNoise | str:
    """Fit read noise and gain; or say why there is none.

    The variance of values is read^2 + gain (value - black). Variances are those of second differences over 6, without
    outliers; where first differences scatter more than these, light changes, and nothing is fitted.

    Args:
        lowest, highest: of all frames; what is near them may be clipped.
        black: the value without light.
    """
    margin = 0.02 * (highest - lowest)
    inside = (values.level > lowest + margin) & (values.level < highest - margin)
    level, step, bend = (one[inside] for one in values)
    if len(level) < _LEAST_VALUES * 2:
        need = 2 * _LEAST_VALUES
        return f"pixels without events in three frames that follow each other: {len(level):,} values, {need} are needed"
    order = np.argsort(level)
    bins = np.array_split(order, max(2, min(_LEVELS, len(level) // _LEAST_VALUES)))
    rows = []
    for own in bins:
        variances = [_variance(differences[own]) / divisor for differences, divisor in ((bend, 6), (step, 2))]
        rows.append((float(level[own].mean()), *variances, len(own)))
    x, variance, of_steps, count = np.array(rows).T
    if float(np.median(of_steps / np.maximum(variance, 1e-300))) > _STEADY:
        return "the light of pixels without events changes by more than the noise of frames"
    sigma = np.maximum(variance, 1e-12) * np.sqrt(2 / count)
    columns = np.stack([np.ones_like(x), x - black], axis=1) / sigma[:, None]
    covariance = np.linalg.inv(columns.T @ columns)
    dark, gain = covariance @ columns.T @ (variance / sigma)
    residual = variance / sigma - columns @ np.array([dark, gain])
    covariance = covariance * max(1.0, float((residual**2).sum()) / max(len(x) - 2, 1))
    if gain < 3 * math.sqrt(covariance[1, 1]):  # none that shows: all of it is read noise
        dark = np.average(variance, weights=1 / sigma**2)
        covariance[0, 0] = 1 / (1 / sigma**2).sum()
    read2 = float(dark) - 1 / 12
    error2, gain_error = (math.sqrt(one) for one in np.diag(covariance))
    if read2 < 2 * error2:
        return f"read noise is at most {math.sqrt(max(read2, 0) + 2 * error2):.2g}"
    read = math.sqrt(read2)
    error = math.hypot(error2 / (2 * read), _MODEL_SHARE * read)
    return FrameNoise(Measured(read, error), Measured(float(gain), gain_error))


def _variance(differences: npt.NDArray[np.float64]) -> float:
    """Return the variance without outliers."""
    kept = differences
    for _ in range(5):
        kept = kept[np.abs(kept - kept.mean()) <= _OUTLIER * max(float(kept.std()), 1e-12)]
    return float(kept.var())
