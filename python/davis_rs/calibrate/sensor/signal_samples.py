"""Samples log intensity by a pixel's events at the instants of frames, next to the frames' values there."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..._util.array_types import FloatingArray
from ...events.arrays import EventArray, concatenate_events
from .frame_noise import NoiseSampler, NoiseValues

MOST_GAP_S = 0.25
"""A frame's instant lies between two events of the pixel, each at most so far away."""

_BLOCK_S = 0.5
_MOST_HELD = 1 << 21
_MOST_SAMPLES = 1 << 21
_MOST_EVENTS_AN_EXPOSURE = 1.0
_MOST_OF_NEIGHBOUR = 1.5
"""A signal that stays for long between two events may have gone anywhere within a threshold."""

SAMPLE_DTYPE = np.dtype(
    [
        ("pixel", "<i4"),
        ("t_s", "<f8"),
        ("value", "<f4"),
        ("on", "<f8"),
        ("off", "<f8"),
        ("rate", "<f4"),
        ("turns", "u1"),
    ],
    align=True,
)
"""A pixel at the instant of a frame: its number y W + x; the instant in seconds; the frame's value; how many ON and OFF
events there were since the start, with the fraction that the signal has gone of the next one; events a second there,
negative for OFF; whether the signal turned before the event before or after the one behind (0 or 1)."""

SampleArray = npt.NDArray[np.void]


class StampedFrame(NamedTuple):
    """Holds an intensity frame.

    Attributes:
        t_us: the middle of its exposure, in microseconds on the events' clock.
        exposure_us: how long it was exposed; 0 where that is not known.
        values: (H, W), linear in light, of the whole sensor; NaN where the frame has none.
    """

    t_us: float
    exposure_us: float
    values: FloatingArray


class SignalSamples(NamedTuple):
    """Samples of all frames of a recording.

    Attributes:
        samples: ``SAMPLE_DTYPE``, by pixel, those of a pixel in the order of time.
        lowest, highest: the smallest and the largest value of any frame.
        mean: float64 (H, W): the mean of the frames' values, NaN where they have none.
        frames: how many there were.
        share: of the pixels of which samples were kept, 1 but for long recordings.
        exposure_us: the median of the frames' exposures; 0 where they do not tell it.
        noise: values of pixels without events.
    """

    samples: SampleArray
    lowest: float
    highest: float
    mean: npt.NDArray[np.float64]
    frames: int
    share: float
    exposure_us: float
    noise: NoiseValues


class SignalSampler:
    """Takes events piece by piece, and frames as their instants come, in memory that does not grow with the recording.

    An event says exactly where the signal is: a threshold away from the event before. Between two events of one
    polarity the signal is interpolated, by a cubic where events of that polarity also come before or after them. So a
    sample has no error from what is left within a level, as plain counts have it, and frames are only compared with
    what is known.

    Args:
        width, height: of the sensor in pixels.
        frames: in the order of time; read as they are needed.
    """

    def __init__(self, width: int, height: int, frames: Iterable[StampedFrame]) -> None:
        self._width, self._height, self._pixels = width, height, width * height
        self._sum, self._known = np.zeros(self._pixels), np.zeros(self._pixels, np.int64)
        self._frames: Iterator[StampedFrame] = iter(frames)
        self._next: StampedFrame | None = next(self._frames, None)
        self._events: list[EventArray] = []
        self._held = 0
        self._base = np.zeros((2, self._pixels))
        self._samples: list[SampleArray] = []
        self._count = self._halvings = self._seen = 0
        self._exposures: Counter[int] = Counter()
        self._noise = NoiseSampler()
        self._lowest, self._highest = np.inf, -np.inf

    def add(self, events: EventArray) -> None:
        """Add the next events, sorted by time, within the sensor."""
        if not len(events) or self._next is None:
            return
        self._events.append(events)
        self._held += len(events)
        waits_s = (int(events["t"][-1]) - self._next.t_us) * 1e-6
        if waits_s >= _BLOCK_S + MOST_GAP_S or (self._held > _MOST_HELD and waits_s > MOST_GAP_S):
            self._sample(int(events["t"][-1]) - MOST_GAP_S * 1e6)

    def finish(self) -> SignalSamples:
        """Return all samples; the sampler takes no more events then."""
        self._sample(np.inf)
        samples = np.concatenate([np.zeros(0, SAMPLE_DTYPE), *self._samples])
        samples = samples[np.argsort(samples["pixel"], kind="stable")]
        exposures = sorted(self._exposures.elements())
        exposure_us = float(exposures[len(exposures) // 2]) if exposures else 0.0
        return SignalSamples(
            samples,
            self._lowest,
            self._highest,
            np.divide(self._sum, self._known, out=np.full(self._pixels, np.nan), where=self._known > 0).reshape(
                self._height, self._width
            ),
            self._seen,
            0.5**self._halvings,
            exposure_us,
            self._noise.finish(),
        )

    def _sample(self, until_us: float) -> None:
        """Take the samples of all frames up to an instant."""
        if not self._events or self._next is None:
            return
        events = _Pieces(concatenate_events(self._events), self._width, self._pixels)
        while self._next is not None and self._next.t_us <= until_us:
            self._take(self._next, events)
            self._next = next(self._frames, None)
        # Events that no later frame needs are counted and let go.
        oldest_us = np.inf if self._next is None else min(until_us, self._next.t_us - MOST_GAP_S * 1e6)
        gone = int(np.searchsorted(events.events["t"], oldest_us))
        for polarity in (0, 1):
            of_it = events.pixel[:gone][events.events["p"][:gone] == polarity]
            self._base[polarity] += np.bincount(of_it, minlength=self._pixels)
        self._events = [events.events[gone:]] if gone < len(events.events) else []
        self._held = len(events.events) - gone

    def _take(self, frame: StampedFrame, events: _Pieces) -> None:
        self._seen += 1
        self._exposures[round(frame.exposure_us)] += 1
        values = np.asarray(frame.values, np.float32).ravel()
        known = np.isfinite(values)
        if known.any():
            self._lowest = min(self._lowest, float(values[known].min()))
            self._highest = max(self._highest, float(values[known].max()))
            self._sum[known] += values[known]
            self._known += known
        at = events.at(frame.t_us)
        self._noise.add(frame.values, (self._base.sum(axis=0) + events.before).reshape(frame.values.shape))
        steep = np.abs(at["rate"]) * frame.exposure_us * 1e-6 > _MOST_EVENTS_AN_EXPOSURE
        at = at[~steep & known[at["pixel"]] & self._kept(at["pixel"])]
        at["value"] = values[at["pixel"]]
        at["off"] += self._base[0][at["pixel"]]
        at["on"] += self._base[1][at["pixel"]]
        self._samples.append(at)
        self._count += len(at)
        while self._count > _MOST_SAMPLES:
            self._halvings += 1
            self._samples = [one[self._kept(one["pixel"])] for one in self._samples]
            self._count = sum(map(len, self._samples))

    def _kept(self, pixel: npt.NDArray[np.int32]) -> npt.NDArray[np.bool_]:
        """Return the pixels to keep: of long recordings fewer, each time half of them, spread over the sensor."""
        scrambled = pixel.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15) >> np.uint64(40)
        kept: npt.NDArray[np.bool_] = scrambled & np.uint64((1 << self._halvings) - 1) == 0
        return kept


class _Pieces:
    """Holds events by pixel, to be asked for what lies around an instant."""

    def __init__(self, events: EventArray, width: int, pixels: int) -> None:
        self.events = events
        self.pixel = events["y"].astype(np.int64) * width + events["x"]
        order = np.argsort(self.pixel, kind="stable")
        self._t, self._p = events["t"][order], events["p"][order].astype(np.int64)
        self._total = np.bincount(self.pixel, minlength=pixels)
        self._start = np.cumsum(self._total) - self._total
        self._on_before = np.append(0, np.cumsum(self._p))
        self.before = np.zeros(pixels, np.int64)
        self._index = 0

    def at(self, t_us: float) -> SampleArray:
        """Return samples of a later instant than the one before, of pixels with a known signal; without values."""
        index = int(np.searchsorted(self.events["t"], t_us, side="right"))
        self.before += np.bincount(self.pixel[self._index : index], minlength=len(self.before))
        self._index = index
        pixel = np.flatnonzero((self.before > 0) & (self.before < self._total))
        start, total = self._start[pixel], self._total[pixel]
        last = start + self.before[pixel] - 1
        here = (
            (self._p[last] == self._p[last + 1])
            & (t_us - self._t[last] <= MOST_GAP_S * 1e6)
            & (self._t[last + 1] - t_us <= MOST_GAP_S * 1e6)
        )
        pixel, start, total, last = pixel[here], start[here], total[here], last[here]
        p, t0, t1 = self._p[last], self._t[last], self._t[last + 1]
        # Times from one event to the next, on both sides.
        before, after = np.maximum(last - 1, start), np.minimum(last + 2, start + total - 1)
        gap = (t1 - t0).astype(np.float64)
        sides = np.stack([t0 - self._t[before], self._t[after] - t1]).astype(np.float64)
        there = np.stack([before < last, after > last + 1])
        turned = ~there | np.stack([self._p[before] != p, self._p[after] != p])
        smooth = (gap <= _MOST_OF_NEIGHBOUR * np.where(there, sides, np.inf)).all(axis=0) & ~turned.all(axis=0)
        pixel, start, total, last = pixel[smooth], start[smooth], total[smooth], last[smooth]
        p, t0, gap, turned = p[smooth], t0[smooth], gap[smooth], turned[:, smooth]
        part, rate = _between((t_us - t0) / gap, gap, *np.where(turned, np.nan, sides[:, smooth]))
        on = self._on_before[last + 1] - self._on_before[start]
        samples = np.zeros(len(pixel), SAMPLE_DTYPE)
        samples["pixel"], samples["t_s"] = pixel, t_us * 1e-6
        samples["on"], samples["off"] = (
            on + np.where(p == 1, part, 0),
            last + 1 - start - on + np.where(p == 0, part, 0),
        )
        samples["rate"] = np.where(p == 1, rate, -rate) * 1e6
        samples["turns"] = turned.any(axis=0)
        return samples


def _between(
    x: npt.NDArray[np.float64],
    gap: npt.NDArray[np.float64],
    earlier: npt.NDArray[np.float64],
    later: npt.NDArray[np.float64],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return how much of a level the signal has gone, and how fast it goes.

    A cubic whose slope at both ends is that of the parabola through the event and both of its neighbours, at most three
    times the chord's, so that it never turns; where a neighbour is missing the slope makes the curve a parabola.

    Args:
        x: share of the time between the two events.
        gap, earlier, later: that time, the one before and the one after; NaN where the signal turned there.
    """
    begin = (1 / earlier * gap + 1 / gap * earlier) / (earlier + gap) * gap
    end = (1 / gap * later + 1 / later * gap) / (gap + later) * gap
    begin, end = (
        np.where(np.isnan(begin), 2 - np.minimum(end, 2), begin),
        np.where(np.isnan(end), 2 - np.minimum(begin, 2), end),
    )
    begin, end = (np.clip(np.nan_to_num(one, nan=1.0), 0, 3) for one in (begin, end))
    cubic = x**2 * (3 - 2 * x) + begin * x * (1 - x) ** 2 - end * x**2 * (1 - x)
    slope = 6 * x * (1 - x) + begin * (1 - x) * (1 - 3 * x) - end * x * (2 - 3 * x)
    return np.clip(cubic, 0, 1), np.maximum(slope, 0) / gap
