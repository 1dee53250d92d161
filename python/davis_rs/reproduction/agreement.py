"""Compares where and when two streams have events: correlations in bins of time and space."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..events.arrays import EventArray
from .clip_statistics import Span, Statistic
from .resampling import FloatArray

BLUR_PX = 1.5
"""Standard deviation of the Gaussian that bins are smoothed by: an event may be a pixel off."""

BINS_MS = (20.0, 5.0)


def correlations(first: EventArray, second: EventArray, span: Span) -> Iterator[Statistic]:
    """Yield the correlations of two streams: events of a pixel, and signed events in bins of 20 and of 5 ms.

    Bins are smoothed by ``BLUR_PX`` in space. Pixel counts are not.
    """
    counts = [_count(events, span, signed=False)[None] for events in (first, second)]
    yield Statistic("correlation of pixel counts", "", _Moments.of([(counts[0], counts[1])], span).correlation(span))
    for bin_ms in BINS_MS:
        frames = zip(_voxels(first, span, bin_ms), _voxels(second, span, bin_ms), strict=True)
        name = f"correlation of signed events in {bin_ms:g} ms (vox{bin_ms:g})"
        yield Statistic(name, "", _Moments.of(frames, span).correlation(span))


@dataclass(frozen=True, eq=False)
class _Moments:
    """Holds sums over each tile, (5, tiles): of a, b, a^2, b^2, a b; and how many values a tile has."""

    sums: FloatArray
    number: FloatArray

    @classmethod
    def of(cls, pairs: Iterable[tuple[FloatArray, FloatArray]], span: Span) -> _Moments:
        resampling = span.resampling
        area = resampling.by_tile(np.flatnonzero(resampling.tile_of.ravel() >= 0))
        sums, number = np.zeros((5, resampling.tile_count)), np.zeros(resampling.tile_count)
        for a, b in pairs:
            a, b = a.reshape(-1, *resampling.tile_of.shape), b.reshape(-1, *resampling.tile_of.shape)
            for x, y in zip(a, b, strict=True):
                sums += resampling.image_by_tile(np.stack([x, y, x * x, y * y, x * y]))
                number += area
        return cls(sums, number)

    def correlation(self, span: Span) -> FloatArray:
        """Return Pearson's correlation of each draw."""
        a, b, aa, bb, ab = (span.resampling.tiles @ one for one in self.sums)
        n = span.resampling.tiles @ self.number
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray((ab - a * b / n) / np.sqrt((aa - a * a / n) * (bb - b * b / n)), np.float64)


def _count(events: EventArray, span: Span, *, signed: bool) -> FloatArray:
    width, height = span.size
    weights = 2.0 * events["p"] - 1 if signed else None
    counted = np.bincount(span.pixels(events), weights, width * height)
    return np.asarray(counted, np.float64).reshape(height, width)


def _voxels(events: EventArray, span: Span, bin_ms: float) -> Iterator[FloatArray]:
    """Yield signed counts (H, W) of each bin, smoothed; bins are as near to ``bin_ms`` as divide the span."""
    from scipy.ndimage import gaussian_filter

    bins = max(1, round(span.seconds * 1e3 / bin_ms))
    edges = span.start_us + (span.stop_us - span.start_us) * np.arange(bins + 1) / bins
    at = np.searchsorted(events["t"], edges)
    for first, last in pairwise(at.tolist()):
        yield np.asarray(gaussian_filter(_count(events[first:last], span, signed=True), BLUR_PX))
