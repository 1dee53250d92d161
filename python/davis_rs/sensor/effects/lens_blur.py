"""Defines the effect of lens blur: the image of a point is a Gaussian spot."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from ...events.luma import LumaFrames
from ...render.edges.neighbours import mirrored
from .effect import Effect, Where, check_range

_NEGLIGIBLE = 2.0**-23
"""The kernel ends where less than this fraction of the light, float32's resolution, lies beyond on each axis."""


@dataclass(frozen=True)
class LensBlur(Effect):
    """Linear luma convolved with a Gaussian point-spread function, mirrored at the frame's edge.

    The weights at whole pixels k are those of a Gaussian, exp(-k^2 / 2 s^2), normalised, with the s that makes their
    variance sigma_px^2 exactly. From 0.7 px up s is sigma_px within 0.2 %; a narrower Gaussian, sampled at pixels,
    would blur less than it should, and in the end not at all.

    Args:
        sigma_px: standard deviation of the spot in x and in y; 0.7 is 1.65 px wide at half its maximum, 0 none at all.

    Raises:
        ValueError: for a width outside of 0..10 px.

    Source of the weights: Kemp, "Characterizations of a discrete normal distribution", J. Stat. Plan. Inference 63
    (1997): of all weights at whole numbers with this variance they have the largest entropy.
    """

    sigma_px: float = 0.7

    name: ClassVar[str] = "lens_blur_px"
    acts_on: ClassVar[Where] = "luma"

    def __post_init__(self) -> None:
        check_range("lens_blur_px sigma_px", self.sigma_px, 0.0, 10.0, "px")

    @property
    def neutral(self) -> bool:
        return self.sigma_px == 0

    def weights(self) -> npt.NDArray[np.float32]:
        """Return the kernel along one axis from its centre to its end, (radius + 1,); the other half is the same.

        It ends where the light beyond is less than 2^-23 of the whole, which float32 cannot resolve (at 0.7 px this is
        after three pixels). So what is left out is smaller than the rounding of luma of the same magnitude.
        """
        if self.sigma_px**2 < _NEGLIGIBLE:
            return np.ones(1, np.float32)
        k = np.arange(math.ceil(6 * self.sigma_px) + 6)
        weights = _gaussian(k, self.sigma_px**2)
        beyond = 2 * (np.cumsum(weights[::-1])[::-1] - weights)
        kept = weights[: np.argmax(beyond < _NEGLIGIBLE) + 1]
        side = (kept[1:] / (2 * kept.sum() - kept[0])).astype(np.float32)
        # The centre compensates rounding: light is neither lost nor made.
        centre = 1 - 2 * side.sum(dtype=np.float64)
        return np.concatenate([[np.float32(centre)], side])


def blur_frame(frame: LumaFrames, weights: npt.NDArray[np.float32], out: LumaFrames) -> None:
    """Convolve one frame (H, W) on both axes, columns first, into ``out``; float32 sums in a fixed order."""
    column = _along_columns(_continued(frame, len(weights) - 1), weights)
    out.T[:] = _along_columns(_continued(column.T, len(weights) - 1), weights)


def _continued(rows: LumaFrames, radius: int) -> LumaFrames:
    """Extend rows by ``radius`` mirrored rows at either end."""
    return rows.take(mirrored(np.arange(-radius, len(rows) + radius), len(rows)), axis=0)


def blur_squares(luma: LumaFrames, weights: npt.NDArray[np.float32]) -> LumaFrames:
    """Blur the middles (m,) of squares (2 radius + 1, 2 radius + 1, m), with the same bits as :func:`blur_frame`."""
    return _along_columns(_along_columns(luma, weights)[0], weights)[0]


def _along_columns(rows: LumaFrames, weights: npt.NDArray[np.float32]) -> LumaFrames:
    """Convolve along the rows, from the middle outwards; rows without ``radius`` neighbours on both sides are
    left out."""
    radius = len(weights) - 1
    count = len(rows) - 2 * radius
    total = weights[0] * rows[radius : radius + count]
    pair = np.empty_like(total)
    for k in range(1, radius + 1):
        np.add(rows[radius - k : radius - k + count], rows[radius + k : radius + k + count], out=pair)
        np.multiply(pair, weights[k], out=pair)
        np.add(total, pair, out=total)
    return total


def _gaussian(k: npt.NDArray[np.int64], variance: float) -> npt.NDArray[np.float64]:
    """Return normalised weights proportional to exp(-a k^2), k = 0, 1, ..., with this variance over both sides."""
    from scipy.optimize import brentq

    def weights(a: float) -> npt.NDArray[np.float64]:
        w = np.exp(-a * k**2)
        return w / (2 * w.sum() - 1)

    def excess(a: float) -> float:
        return float(2 * (k**2 * weights(a)).sum()) - variance

    # A Gaussian at whole numbers varies less than a continuous one, by less than that of rounding to them; a wide one
    # so little less that rounding hides it.
    return weights(brentq(excess, 0.5 / (variance + 0.25), 0.501 / variance, xtol=1e-15, rtol=1e-14))
