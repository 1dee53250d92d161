"""Finds how many pixels are hot, and how often they fire."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ...inspection.statistics import StreamStatistics
from ...inspection.statistics.hot_pixels import LEAST_EVENTS, TIMES_ITS_NEIGHBOURS
from ...inspection.statistics.stream_statistics import Measured
from ...sensor.effects import HotPixels
from .finding import Finding
from .quiet_pixels import fires_by_itself

_CALM_SHARE = 0.3

_RATE = ("rate of hot pixels", "hot_pixel_rate_hz")


def find_hot_pixels(recordings: Sequence[StreamStatistics]) -> tuple[Finding, ...]:
    """Return their share of the pixels that are calm enough to show them, and the median of their rates.

    Noise makes pixels with low thresholds fire often, too, at random and with both polarities: those are counted, but
    not taken as hot. Rates are taken to be log-normal with the spread of :class:`~davis_rs.sensor.effects.HotPixels`.
    Pixels with less than 10 events are not seen: the median is the mean of the medians that this allows, and the share
    counts those below.
    """
    longest = max(recordings, key=lambda one: one.duration_s)
    # A pixel is hot from five times as many events on as those around it: the calmest pixels have a common bound.
    usual = _usual(longest)
    most = max(1.0, float(np.quantile(usual, _CALM_SHARE)))
    calm = usual <= most
    least_hz = max(LEAST_EVENTS, TIMES_ITS_NEIGHBOURS * (most + 1)) / longest.duration_s
    rates, variation, others = _of_calm(recordings, calm)
    pixels, seen = int(calm.sum()), len(rates)
    unseen = f"{seen} of {pixels:,} pixels without much signal; those below {least_hz:.2g} Hz are not seen"
    if others:
        unseen += f"; {others} more fire often, but at random or with both polarities, as noise does"
    if not seen:
        fraction = Measured(0.0, math.sqrt(2) / pixels)
        return Finding("hot pixels", "hot_pixel_fraction", fraction, unseen), Finding(*_RATE, None, "there are none")
    median, above = _log_normal(rates, least_hz)
    fraction = Measured(min(seen / pixels / above, 1.0), math.sqrt(seen + 2) / pixels / above)
    regular = (
        f"the median; {rates.min():.3g} to {rates.max():.3g} Hz; variation of intervals {np.median(variation):.2g} "
        "(median), 1 for a Poisson process"
    )
    return Finding("hot pixels", "hot_pixel_fraction", fraction, unseen), Finding(*_RATE, median, regular)


def _usual(stream: StreamStatistics) -> npt.NDArray[np.float64]:
    """Return events of a polarity in the pixels around each."""
    from scipy.ndimage import median_filter

    return np.maximum(*(median_filter(counts, size=5, mode="mirror").astype(np.float64) for counts in stream.counts))


def _of_calm(
    recordings: Sequence[StreamStatistics], calm: npt.NDArray[np.bool_]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], int]:
    """Return rates and variations of the hot pixels there, those of the longest recording, and how many pixels are
    noisy."""
    pixels: dict[tuple[int, int], tuple[float, float, float]] = {}
    for stream in sorted(recordings, key=lambda one: one.duration_s):
        hot = stream.hot_pixels
        columns = (hot.x.tolist(), hot.y.tolist(), hot.rate_hz, hot.variation, fires_by_itself(hot))
        for x, y, rate, variation, periodic in zip(*columns, strict=True):
            if calm[y, x]:
                pixels[x, y] = float(rate), float(variation), float(periodic)
    rates, variation, periodic = np.array(list(pixels.values())).reshape(-1, 3).T
    return rates[periodic > 0], variation[periodic > 0], int(np.count_nonzero(periodic == 0))


def _log_normal(rates: npt.NDArray[np.float64], least_hz: float) -> tuple[Measured, float]:
    """Return the median of a log-normal law of known spread that is cut off below, and the share that lies above.

    The error is that upwards, which is the larger one.
    """
    from scipy.special import log_ndtr, ndtr

    spread = HotPixels(0.0).rate_spread
    logs, cut = np.log(np.maximum(rates, least_hz)), math.log(least_hz)
    centre = np.linspace(cut - spread, float(logs.max()) + 3 * spread, 4001)
    likelihood = -((logs[:, None] - centre) ** 2).sum(axis=0) / (2 * spread**2) - len(logs) * log_ndtr(
        (centre - cut) / spread
    )
    weight = np.exp(likelihood - likelihood.max())
    best = float(np.average(centre, weights=weight))
    sigma = math.sqrt(float(np.average((centre - best) ** 2, weights=weight)))
    median = math.exp(best)
    return Measured(median, median * math.expm1(sigma)), float(ndtr((best - cut) / spread))
