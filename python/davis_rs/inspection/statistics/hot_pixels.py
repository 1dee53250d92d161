"""Finds hot pixels: those that fire on their own, as far as events alone can tell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .pixel_sums import PixelSums

LEAST_EVENTS = 10
TIMES_ITS_NEIGHBOURS = 5.0
_MOST_VARIATION = 2.0
"""A pixel that a passing edge makes fire has its events in clusters; the intervals of one that fires on its own are
regular (0), or those of a Poisson process (1)."""
_LEAST_SPAN = 0.5
"""Its events last for so much of the stream: what moves for a while makes others fire."""


@dataclass(frozen=True, eq=False)
class HotPixels:
    """Pixels with far more events of a polarity than their neighbours, all the time.

    A pixel is hot if it has at least 10 events of a polarity, 5 times as many as the median of the 5 x 5 pixels around
    it (plus one), the coefficient of variation of its intervals is below 2, and from the first of them to the last it
    is at least half of the stream.

    Attributes:
        x, y: int64 (n,), in rows.
        rate_hz: float64 (n,): events of both polarities.
        on_share: float64 (n,): of its events.
        variation: float64 (n,): standard deviation over mean of the intervals between its events of the polarity that
            it has more of: 0 for a clock, 1 for a Poisson process.
    """

    x: npt.NDArray[np.int64]
    y: npt.NDArray[np.int64]
    rate_hz: npt.NDArray[np.float64]
    on_share: npt.NDArray[np.float64]
    variation: npt.NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.x)


def find_hot_pixels(pixels: PixelSums, duration_s: float) -> HotPixels:
    """Return the hot pixels of a stream."""
    from scipy.ndimage import median_filter

    events = pixels.events
    hot = np.zeros(events.shape[1:], np.bool_)
    variation = _variation(pixels)
    lasting = pixels.interval_sum * 1e-6 >= _LEAST_SPAN * duration_s
    for counts, scatter, long in zip(events, variation, lasting, strict=True):
        usual = median_filter(counts, size=5, mode="mirror")
        many = (counts >= LEAST_EVENTS) & (counts >= TIMES_ITS_NEIGHBOURS * (usual + 1))
        hot |= many & (scatter < _MOST_VARIATION) & long
    y, x = np.nonzero(hot)
    off, on = events[0, y, x], events[1, y, x]
    mostly = (on >= off).astype(np.int64)
    return HotPixels(
        x,
        y,
        (on + off) / max(duration_s, 1e-6),
        on / np.maximum(on + off, 1),
        variation[mostly, y, x],
    )


def _variation(pixels: PixelSums) -> npt.NDArray[np.float64]:
    """Return the coefficient of variation of the intervals of each polarity and pixel, (2, H, W); infinite with fewer
    than three."""
    count = pixels.intervals
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = pixels.interval_sum / count
        variance = (pixels.interval_squares - count * mean**2) / (count - 1)
        variation = np.sqrt(np.maximum(variance, 0)) / mean
    return np.where((count > 2) & (mean > 0), variation, np.inf)
