"""Measures the statistics of a stream that a comparison prints, each with its draws of the bootstrap."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..events.arrays import EventArray
from ..inspection.statistics import measure_stream
from .resampling import BLOCKS, FloatArray, Resampling

BURST_US = 10
"""Events that begin a burst are followed by all others within so many microseconds."""

_BINS_AN_OCTAVE = 64
_OCTAVES = 32
_PERCENTILES = (1, 10, 50, 90)


class Statistic(NamedTuple):
    """Holds a statistic of one stream.

    Attributes:
        name: as tables have it.
        unit: "" for a pure number.
        draws: float64 (1 + draws,): its value, then that of each draw of the bootstrap; NaN where there is none.
    """

    name: str
    unit: str
    draws: FloatArray


@dataclass(frozen=True, eq=False)
class Span:
    """Holds what is compared: an interval of time, and pixels.

    Attributes:
        start_us, stop_us: events with start <= t < stop.
        size: (width, height) of the sensor in pixels.
        quiet: bool (H, W): pixels whose light the frames show at rest.
        resampling: of the pixels that are compared.
    """

    start_us: int
    stop_us: int
    size: tuple[int, int]
    quiet: npt.NDArray[np.bool_]
    resampling: Resampling

    @property
    def seconds(self) -> float:
        """Return how long it lasts."""
        return (self.stop_us - self.start_us) * 1e-6

    def cut(self, events: EventArray) -> EventArray:
        """Return the events that are compared."""
        inside = (events["t"] >= self.start_us) & (events["t"] < self.stop_us)
        inside &= self.resampling.tile_of[events["y"], events["x"]] >= 0
        return events[inside]

    def pixels(self, events: EventArray) -> npt.NDArray[np.int64]:
        """Return y W + x of each event."""
        return np.asarray(events["y"].astype(np.int64) * self.size[0] + events["x"])


def measure(events: EventArray, span: Span) -> Iterator[Statistic]:
    """Yield the statistics of a stream that was cut to the span."""
    tiles, resampling = span.resampling.tiles, span.resampling
    pixel, on = span.pixels(events), events["p"] == 1
    area = resampling.by_tile(np.flatnonzero(resampling.tile_of.ravel() >= 0))
    with np.errstate(invalid="ignore", divide="ignore"):
        for name, chosen in (("ON events of a pixel", on), ("OFF events of a pixel", ~on)):
            yield Statistic(name, "Hz", tiles @ resampling.by_tile(pixel[chosen]) / (tiles @ area) / span.seconds)
        calm = span.quiet.ravel()
        still = resampling.by_tile(np.flatnonzero(calm & (resampling.tile_of.ravel() >= 0)))
        rate = tiles @ resampling.by_tile(pixel[calm[pixel]]) / (tiles @ still) / span.seconds
        yield Statistic("events of a quiet pixel", "Hz", rate)
        hot = _hot_pixels(events, span)
        yield Statistic("hot pixels", "1/million", 1e6 * (tiles @ resampling.by_tile(hot)) / (tiles @ area))
        yield from _intervals(events, pixel, span)
        yield _burst_size(events, span)
        odd = (pixel % span.size[0]) % 2 == 1
        for name, chosen in (("even / odd columns, ON", on), ("even / odd columns, OFF", ~on)):
            even_sum, odd_sum = (tiles @ resampling.by_tile(pixel[chosen & parity]) for parity in (~odd, odd))
            yield Statistic(name, "", even_sum / odd_sum)


def _hot_pixels(events: EventArray, span: Span) -> npt.NDArray[np.int64]:
    if not len(events):
        return np.zeros(0, np.int64)
    hot = measure_stream(events, size=span.size).hot_pixels
    return np.asarray(hot.y * span.size[0] + hot.x, np.int64)


def _intervals(events: EventArray, pixel: npt.NDArray[np.int64], span: Span) -> Iterator[Statistic]:
    """Yield the shortest interval of a pixel, and quantiles of those between events of one polarity."""
    resampling, tiles = span.resampling, span.resampling.tiles
    owner, gap = _gaps(pixel, events["t"])
    least = np.full(resampling.tile_count, np.inf)
    np.minimum.at(least, resampling.tile_of.ravel()[owner], gap)
    shortest = np.where(tiles > 0, least, np.inf).min(axis=1)
    yield Statistic("shortest interval of a pixel", "us", np.where(np.isfinite(shortest), shortest, np.nan))
    owner, gap = _gaps(2 * pixel + events["p"], events["t"])
    bins = (np.log2(np.maximum(gap, 1)) * _BINS_AN_OCTAVE).astype(np.int64)
    count = _BINS_AN_OCTAVE * _OCTAVES
    table = np.zeros((resampling.tile_count, count))
    np.add.at(table, (resampling.tile_of.ravel()[owner // 2], np.minimum(bins, count - 1)), 1.0)
    below = np.cumsum(tiles @ table, axis=1)
    for percent in _PERCENTILES:
        wanted = percent / 100 * below[:, -1:]
        at = (below < np.maximum(wanted, 1e-9)).sum(axis=1)
        before = np.where(at > 0, np.take_along_axis(below, np.maximum(at - 1, 0)[:, None], 1)[:, 0], 0.0)
        inside = np.take_along_axis(below, np.minimum(at, count - 1)[:, None], 1)[:, 0] - before
        fraction = np.where(inside > 0, (wanted[:, 0] - before) / np.maximum(inside, 1e-300), 0.0)
        value = 2.0 ** ((at + fraction) / _BINS_AN_OCTAVE) / 1e3
        said = f"{percent} % of intervals of one polarity are below"
        yield Statistic(said, "ms", np.where(below[:, -1] > 0, value, np.nan))


def _gaps(key: npt.NDArray[np.int64], t: npt.NDArray[np.int64]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the keys and the times between neighbouring events of one key."""
    order = np.argsort(key, kind="stable")
    key, t = key[order], t[order]
    same = key[1:] == key[:-1]
    return key[1:][same], np.diff(t)[same]


def _burst_size(events: EventArray, span: Span) -> Statistic:
    """Return how many events a burst has, in the mean over bursts."""
    starts = burst_starts(events["t"])
    sizes = np.diff(np.append(starts, len(events)))
    block = (events["t"][starts] - span.start_us) * BLOCKS // max(span.stop_us - span.start_us, 1)
    total, number = (np.bincount(block, values, BLOCKS) for values in (sizes, np.ones(len(sizes))))
    blocks = span.resampling.blocks
    return Statistic(f"events of a burst of {BURST_US} us", "", (blocks @ total) / (blocks @ number))


def burst_starts(t_us: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return which events begin a burst: the first one, and each that comes ``BURST_US`` or more after the last that
    did."""
    starts, at = [], 0
    while at < len(t_us):
        starts.append(at)
        at = int(np.searchsorted(t_us, t_us[at] + BURST_US, side="left"))
    return np.array(starts, np.int64)


def deviation(draws: FloatArray) -> float:
    """Return the standard deviation of the draws, NaN where fewer than half of them have a value."""
    known = draws[1:][np.isfinite(draws[1:])]
    return float(known.std(ddof=1)) if 2 * len(known) > len(draws) - 1 else math.nan
