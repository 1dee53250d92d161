"""Measures the noise of frames from two of them, and the dark level that keeps it from making events."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..._util.array_types import FloatingArray

_TILE = 8
_QUANTILE = 0.25
"""Of the variances of tiles of about one brightness: most tiles may hold texture that moves, the calmest do not."""

_LEAST_TILES, _BINS = 40, 8
_WHITE = 1.5
"""Noise of pixels is independent. Where differences of neighbours scatter by more than this factor as much as second
differences, it is texture and no noise."""

_FREEDOM = _TILE**2 / 3.78
"""Independent values of a tile: second differences of neighbours share pixels, and the sum of the squares of their
correlations is 3.78."""

_MOST_OF_WHITE = 0.05
"""Noise above this fraction of the range of the values is no camera's."""

_MODEL = 0.05
"""What read noise errs by on simulated frames, as a fraction, however many pixels there are."""

_CERTAIN = 3.0

EXCEEDED_BY = 2.58
"""Of a normal distribution: its absolute value is larger with a probability of one in a hundred."""


class LumaNoise(NamedTuple):
    """Holds how the values of a pixel scatter from frame to frame: variance = read^2 + gain * value.

    Attributes:
        read: standard deviation without light, in units of the values.
        read_sigma: its standard error.
        gain: how much the variance grows with the value, >= 0.
    """

    read: float
    read_sigma: float
    gain: float

    def dark_level(self, contrast_threshold: float) -> float:
        """Return the least log_eps at which noise hardly ever changes log intensity by C between two frames.

        For values without light, and for each brightness: the difference of two frames with independent noise exceeds C
        in one pixel of a hundred. From 2.58 sqrt(2 (read^2 + gain Y)) / (Y + e) <= C follows the largest e over all
        Y >= 0.
        """
        a = EXCEEDED_BY * math.sqrt(2) / contrast_threshold
        half = a * self.gain / 2
        if half <= self.read:
            return a * self.read
        return a * half / 2 + self.read**2 / self.gain

    def dark_level_sigma(self, contrast_threshold: float) -> float:
        """Return the standard error of that dark level, from that of the read noise."""
        step = max(self.read_sigma, 1e-12)
        return abs(
            self._replace(read=self.read + step).dark_level(contrast_threshold) - self.dark_level(contrast_threshold)
        )


def luma_noise(
    before: FloatingArray, after: FloatingArray, *, black: float = 0.0, step: float = 0.0
) -> LumaNoise | None:
    """Measure noise of frames from two that follow each other; None where they do not tell it.

    What the scene does between two frames is smooth, and noise is not. So second differences of neighbours, across and
    down, are taken of the difference of the frames (the mask of Immerkaer), whose variance is that of noise where there
    is no texture that moves. Of tiles of one brightness the calmest quarter tells it. Fixed patterns of pixels are the
    same in both frames, and drop out.

    Args:
        before, after: (H, W), linear in light; NaN where there is no value.
        black: the value without light.
        step: by which values are rounded; its variance, step^2 / 12, is no noise of the camera.

    Source: Immerkaer, "Fast noise variance estimation", Computer Vision and Image Understanding 64(2), 1996.
    """
    from scipy.stats import chi2

    change = (after.astype(np.float64) - before) / math.sqrt(2)
    level = (after.astype(np.float64) + before) / 2 - black
    known = np.isfinite(change)
    if not known.any():
        return None
    lowest, highest = (float(limit(np.where(known, level, level[known][0]))) for limit in (np.min, np.max))
    margin = 0.02 * (highest - lowest)
    usable = known & (level > lowest + margin * (lowest + black > 0)) & (level < highest - margin)
    second = _differences(change, (1.0, -2.0, 1.0)) / 6
    first = _differences(change, (1.0, -1.0)) / 2
    rows = _tiles(usable, level, second**2, first**2)
    if len(rows) < _LEAST_TILES:
        return None
    rows = rows[np.argsort(rows[:, 0])]
    at, variance, number = [], [], []
    for tiles in np.array_split(rows, max(1, min(_BINS, len(rows) // _LEAST_TILES))):
        calm = tiles[tiles[:, 1] <= np.quantile(tiles[:, 1], _QUANTILE)]
        if calm[:, 2].mean() > _WHITE * max(float(calm[:, 1].mean()), 1e-300):
            continue
        usual = float(chi2.ppf(_QUANTILE, _FREEDOM)) / _FREEDOM
        at.append(float(tiles[:, 0].mean()))
        variance.append(float(np.quantile(tiles[:, 1], _QUANTILE)) / usual)
        number.append(len(tiles) * _FREEDOM * _QUANTILE)
    if not variance or min(variance) <= 0:
        return None
    return _fitted(np.array(at), np.array(variance), np.array(number), highest - lowest, step)


def _fitted(
    at: npt.NDArray[np.float64],
    variance: npt.NDArray[np.float64],
    number: npt.NDArray[np.float64],
    span: float,
    step: float,
) -> LumaNoise | None:
    """Fit variance = read^2 + gain * value, neither of them negative."""
    sigma = np.maximum(variance, 1e-300) * np.sqrt(2 / number)
    weight = 1 / sigma**2
    read2, gain = float(np.average(variance, weights=weight)), 0.0
    error2 = float(1 / np.sqrt(weight.sum()))
    if len(at) > 2:
        columns = np.stack([np.ones_like(at), at])
        normal = (columns * weight) @ columns.T
        covariance = np.linalg.pinv(normal)
        dark, slope = (covariance @ (columns * weight) @ variance).tolist()
        if slope > 0 and dark > 0:
            read2, gain = dark, slope
            misfit = float((weight * (variance - dark - slope * at) ** 2).sum()) / max(len(at) - 2, 1)
            error2 = math.sqrt(float(covariance[0, 0]) * max(misfit, 1.0))
        elif slope > 0:
            read2, gain = 0.0, float((weight * at * variance).sum() / (weight * at * at).sum())
    rounding2 = step**2 / 12
    read2 -= rounding2
    most2 = max(read2, 0.0) + gain * float(at.max())
    if most2 < max(_CERTAIN * error2, rounding2) or read2 > (_MOST_OF_WHITE * span) ** 2:
        return None
    read = math.sqrt(max(read2, 0.0))
    return LumaNoise(read, math.hypot(error2 / max(2 * read, math.sqrt(error2)), _MODEL * read), gain)


def _differences(values: npt.NDArray[np.float64], mask: tuple[float, ...]) -> npt.NDArray[np.float64]:
    """Return differences across and down, at the place of their last value; NaN before."""
    for axis in (0, 1):
        count = len(mask)
        terms = [
            weight * np.take(values, np.arange(k, values.shape[axis] - count + 1 + k), axis)
            for k, weight in enumerate(mask)
        ]
        padding = [(0, 0), (0, 0)]
        padding[axis] = (count - 1, 0)
        values = np.pad(sum(terms, np.zeros(())), padding, constant_values=np.nan)
    return values


def _tiles(
    usable: npt.NDArray[np.bool_],
    level: npt.NDArray[np.float64],
    second: npt.NDArray[np.float64],
    first: npt.NDArray[np.float64],
) -> npt.NDArray[np.float64]:
    """Return (n, 3) of whole tiles: mean level, mean of the squares of second and of first differences."""
    height, width = (side // _TILE * _TILE for side in level.shape)
    with np.errstate(invalid="ignore"):
        whole = [
            one[:height, :width].reshape(height // _TILE, _TILE, width // _TILE, _TILE).mean(axis=(1, 3)).ravel()
            for one in (np.where(usable, level, np.nan), second, first)
        ]
    rows = np.stack(whole, axis=1)
    return rows[np.isfinite(rows).all(axis=1)]
