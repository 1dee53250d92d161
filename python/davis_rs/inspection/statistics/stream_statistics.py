"""Holds what was measured of a stream."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..._util.array_types import JsonObject, JsonValue
from .bursts import Bursts
from .counts import Histogram
from .hot_pixels import HotPixels, find_hot_pixels
from .pixel_sums import PixelSums

Region = tuple[int, int, int, int]

TILE = 8
QUIET_SHARE = 1 / 16
"""The quietest sixteenth of the sensor, in tiles of 8 x 8 pixels, is taken as quiet. Of a tile the pixels of one colour
of a checkerboard are measured where those of the other colour are quiet: noise of pixels is independent, so what
happens to be quiet is not preferred, and signal reaches both."""


class Measured(NamedTuple):
    """A number with its standard deviation; NaN where the stream does not tell."""

    value: float
    sigma: float

    def __str__(self) -> str:
        if not math.isfinite(self.value):
            return "-"
        value = _to_digits(self.value, 3)
        return f"{value} +- {_to_digits(self.sigma, 1)}" if math.isfinite(self.sigma) else value


def _to_digits(number: float, digits: int) -> str:
    """Return a number rounded to ``digits`` digits; with an exponent only from a million on, or below 0.0001."""
    return f"{float(f'{number:.{digits}g}'):g}"


class PixelIntervals(NamedTuple):
    """The intervals between ON events of each pixel, (H, W) each.

    Attributes:
        number: int64: how many.
        sum_us, squares_us2: float64: their sum, and that of their squares.
    """

    number: npt.NDArray[np.int64]
    sum_us: npt.NDArray[np.float64]
    squares_us2: npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StreamStatistics:
    """The statistics of a stream of events.

    Attributes:
        name, kind: of the stream.
        size: (width, height) in pixels.
        events: how many were measured.
        backward, outside: left out: earlier than one before them; outside of the sensor.
        first_us, last_us: times of the first and the last event.
        counts: int64 (2, H, W): OFF and ON events of each pixel.
        same, any: histograms of a pixel's intervals in us, between events of the same polarity and of any.
        on_intervals: those between ON events, added up for each pixel.
        bursts: how the stream was read out.
        hot_pixels: pixels that fire on their own.
        quiet: bool (H, W): the pixels that count as quiet.
        quiet_rate_hz: events of a quiet pixel in a second, hot pixels left out.
        quiet_on_share: ON events among them.
        column_parity, row_parity: (OFF, ON): events of pixels at even x (y) over those at odd x (y).
    """

    name: str
    kind: str
    size: tuple[int, int]
    events: int
    backward: int
    outside: int
    first_us: int
    last_us: int
    counts: npt.NDArray[np.int64]
    same: Histogram
    any: Histogram
    on_intervals: PixelIntervals
    bursts: Bursts
    hot_pixels: HotPixels
    quiet: npt.NDArray[np.bool_]
    quiet_rate_hz: Measured
    quiet_on_share: Measured
    column_parity: tuple[Measured, Measured]
    row_parity: tuple[Measured, Measured]

    def __repr__(self) -> str:
        width, height = self.size
        return (
            f"<StreamStatistics of {self.name}, {width} x {height} px, {self.events:,} events, {self.duration_s:g} s>"
        )

    @property
    def duration_s(self) -> float:
        """The time from the first event to the last."""
        return (self.last_us - self.first_us) * 1e-6

    @property
    def rates_hz(self) -> npt.NDArray[np.float64]:
        """OFF and ON events per second of each pixel, float64 (2, H, W)."""
        return self.counts / max(self.duration_s, 1e-6)

    def describe(self) -> JsonObject:
        """Return all numbers in JSON's types; None where the stream does not tell."""
        hot, bursts = self.hot_pixels, self.bursts
        several = bursts.ascending + bursts.descending + bursts.unordered
        steps = bursts.rows_up + bursts.rows_down
        pixels = self.size[0] * self.size[1]
        off, on = self.rates_hz.mean(axis=(1, 2)).tolist()
        parity = {"columns": self.column_parity, "rows": self.row_parity}
        described = {
            "name": self.name,
            "kind": self.kind,
            "size": list(self.size),
            "duration_s": self.duration_s,
            "events": self.events,
            "left_out": {"backward": self.backward, "outside": self.outside},
            "on_share": self.counts[1].sum() / max(self.events, 1) if self.events else None,
            "rate_per_pixel_hz": {"on": on, "off": off},
            "interval_us": {name: _percentiles(one) for name, one in (("same", self.same), ("any", self.any))},
            "shared_stamp_share": bursts.sharing / self.events if self.events else None,
            "rows_of_bus": "columns" if bursts.by_columns else "rows",
            "rows_per_us": _shape(bursts.rows_per_us),
            "rows_per_10_us": _shape(bursts.rows_per_window),
            "events_per_10_us": _shape(bursts.events_per_window),
            "events_per_row": _shape(bursts.events_per_row),
            "column_order": {
                order: getattr(bursts, order) / several if several else None
                for order in ("ascending", "descending", "unordered")
            },
            "rows_up_share": bursts.rows_up / steps if steps else None,
            "hot_pixels": {
                "count": len(hot),
                "share": len(hot) / pixels,
                "rate_hz": _range(hot.rate_hz),
                "on_share": _range(hot.on_share),
                "variation": _range(hot.variation),
                "at": [[x, y] for x, y in zip(hot.x.tolist(), hot.y.tolist(), strict=True)],
            },
            "quiet": {"pixels": int(self.quiet.sum()), "rate_hz": self.quiet_rate_hz, "on_share": self.quiet_on_share},
            "even_over_odd": {name: {"off": pair[0], "on": pair[1]} for name, pair in parity.items()},
        }
        plain: JsonObject = _plain(described)
        return plain


def evaluate(
    pixels: PixelSums,
    bursts: Bursts,
    span: tuple[int, int],
    *,
    name: str,
    kind: str,
    backward: int,
    outside: int,
    quiet: Region | None,
) -> StreamStatistics:
    """Return the statistics from what was added up.

    Raises:
        ValueError: for a region that is not in the sensor.
    """
    counts = pixels.events
    height, width = counts.shape[1:]
    first_us, last_us = span
    hot = find_hot_pixels(pixels, (last_us - first_us) * 1e-6)
    cold = np.ones((height, width), np.bool_)
    cold[hot.y, hot.x] = False
    chosen = _quiet_pixels(counts.sum(axis=0), cold, quiet)
    off, on = (int(one[chosen].sum()) for one in counts)
    return StreamStatistics(
        name=name,
        kind=kind,
        size=(width, height),
        events=int(counts.sum()),
        backward=backward,
        outside=outside,
        first_us=first_us,
        last_us=last_us,
        counts=counts,
        same=pixels.same,
        any=pixels.any,
        on_intervals=PixelIntervals(pixels.intervals[1], pixels.interval_sum[1], pixels.interval_squares[1]),
        bursts=bursts,
        hot_pixels=hot,
        quiet=chosen,
        quiet_rate_hz=_rate(off + on, np.count_nonzero(chosen) * (last_us - first_us) * 1e-6),
        quiet_on_share=_share(on, off + on),
        column_parity=(_parity(counts[0], cold, 1), _parity(counts[1], cold, 1)),
        row_parity=(_parity(counts[0], cold, 0), _parity(counts[1], cold, 0)),
    )


def _quiet_pixels(
    events: npt.NDArray[np.int64], cold: npt.NDArray[np.bool_], region: Region | None
) -> npt.NDArray[np.bool_]:
    """Return the pixels, bool (H, W), that are quiet, or the cold ones of a region."""
    height, width = cold.shape
    if region is not None:
        x0, y0, x1, y1 = region
        if not (0 <= x0 < x1 <= width and 0 <= y0 < y1 <= height):
            raise ValueError(
                f"the quiet region {region} must lie in the sensor's {width} x {height} pixels, and be x0 y0 x1 y1"
            )
        inside = np.zeros_like(cold)
        inside[y0:y1, x0:x1] = True
        return inside & cold
    y, x = np.ogrid[:height, :width]
    tile, colour = (y // TILE) * (-(-width // TILE)) + x // TILE, (x + y) & 1
    tiles = int(tile.max()) + 1
    chosen = np.zeros_like(cold)
    for half in (0, 1):
        others = cold & (colour != half)
        area = np.bincount(tile[others], minlength=tiles)
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.bincount(tile[others], weights=events[others], minlength=tiles) / area
        mean[area == 0] = np.inf
        limit = np.sort(mean)[max(round(QUIET_SHARE * tiles), 1) - 1]
        # Of tiles as quiet as the last one all belong to them: the first in rows are no better than others.
        chosen |= (mean <= limit)[tile] & cold & (colour == half)
    return chosen


def _parity(counts: npt.NDArray[np.int64], cold: npt.NDArray[np.bool_], axis: int) -> Measured:
    """Return events at even over odd positions along an axis; its scatter is that of pairs of neighbours."""
    lines = np.where(cold, counts, 0).sum(axis=1 - axis, dtype=np.float64)
    width = np.maximum(cold.sum(axis=1 - axis), 1)
    per_pixel = lines / width
    even, odd = per_pixel[: len(lines) // 2 * 2 : 2], per_pixel[1::2]
    if not len(odd) or even.sum() == 0 or odd.sum() == 0:
        return Measured(math.nan, math.nan)
    ratio = even.sum() / odd.sum()
    residual = even - ratio * odd
    pairs = len(odd)
    sigma = math.sqrt((residual**2).sum() * pairs / max(pairs - 1, 1)) / odd.sum() if pairs > 1 else math.nan
    return Measured(float(ratio), sigma)


def _rate(events: int, seconds: float) -> Measured:
    if seconds <= 0:
        return Measured(math.nan, math.nan)
    return Measured(events / seconds, math.sqrt(max(events, 1)) / seconds)


def _share(counted: int, total: int) -> Measured:
    """Return a fraction with its standard deviation (Agresti and Coull's: with one of none it does not vanish)."""
    if total == 0:
        return Measured(math.nan, math.nan)
    smooth = (counted + 2) / (total + 4)
    return Measured(counted / total, math.sqrt(smooth * (1 - smooth) / (total + 4)))


_SHARES = (1, 10, 50, 90, 99)


def _percentiles(histogram: Histogram) -> dict[str, float | int | None]:
    described: dict[str, float | int | None] = {"intervals": histogram.total, "least": histogram.least}
    return described | {f"p{share}": histogram.percentile(share) for share in _SHARES}


def _shape(histogram: Histogram) -> dict[str, float | int | None]:
    return {"mean": histogram.mean, "p99": histogram.percentile(99), "most": histogram.most}


def _range(values: npt.NDArray[np.float64]) -> dict[str, float] | None:
    if not len(values):
        return None
    return {"least": float(values.min()), "median": float(np.median(values)), "most": float(values.max())}


def _plain(measured: object) -> JsonValue:
    """Return the statistics in JSON's types; NaN and infinity become None."""
    if isinstance(measured, Measured):
        return {"value": _plain(measured.value), "sigma": _plain(measured.sigma)}
    if isinstance(measured, dict):
        return {key: _plain(one) for key, one in measured.items()}
    if isinstance(measured, list | tuple):
        return [_plain(one) for one in measured]
    if isinstance(measured, np.generic):
        measured = measured.item()
    return None if isinstance(measured, float) and not math.isfinite(measured) else measured
