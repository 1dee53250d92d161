"""Pairs neighbouring frames of a pixel: how much their values changed, and its events between and during them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...events.arrays import EventArray
from .signal_samples import MOST_GAP_S, StampedFrame

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_TILE = 8
_MOST_PAIRS = 1 << 19

_GOES_ON = 1.2
"""A signal that turns between two events first goes on, by any part of a threshold, then back. At a constant speed it
has the mean of a parabola whose first slope is that many thresholds in the time between both."""


class Inside(NamedTuple):
    """Holds how a signal goes within the exposures of one end of all pairs, by the events there.

    In the middle of a piece of time a pixel's log intensity is where it is in the middle of the exposure, plus
    on C_on - off C_off.

    Attributes:
        row: int64 (n,): the pair that a piece of time belongs to, in order; those of a pair are the whole exposure.
        part: float64 (n,): its length as a fraction of the exposure.
        on, off: float64 (n,): events since the middle of the exposure, with their fractions; negative before it.
    """

    row: IntArray
    part: FloatArray
    on: FloatArray
    off: FloatArray

    def log_mean(self, on: float, off: float, rows: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return ln of the mean of exp(log intensity) over the exposure, less its value in the middle, for each of
        ``rows`` pairs, and what it changes by with C_on and with C_off."""
        light = self.part * np.exp(np.clip(on * self.on - off * self.off, -20, 20))
        mean, by_on, by_off = (
            np.bincount(self.row, light * each, rows) for each in (np.ones_like(light), self.on, -self.off)
        )
        known = np.where(mean > 0, mean, 1.0)
        return np.log(known), by_on / known, by_off / known


class ExposurePairs(NamedTuple):
    """Holds pairs of frames that follow each other, one row for each pixel that has events in between.

    Attributes:
        pixel: int64 (n,).
        value: float64 (2, n): of both frames.
        on, off: float64 (n,): events between the middles of both exposures, with the fraction that the signal has gone
            of the next one at either end.
        open_ends: float64 (2, n): the polarity, 1 or -1, of the first and of the last event in between, at an end where
            no event on the other side of the frame tells that fraction; 0 where one does.
        seconds: float64 (n,): between both middles.
        inside: how the signal goes within the first and the second exposure.
        group: int64 (n,): tiles of pixels are divided into groups, to be left out one at a time.
    """

    pixel: IntArray
    value: FloatArray
    on: FloatArray
    off: FloatArray
    open_ends: FloatArray
    seconds: FloatArray
    inside: tuple[Inside, Inside]
    group: IntArray


def exposure_pairs(
    events: EventArray,
    frames: Iterable[StampedFrame],
    width: int,
    *,
    groups: int,
    left_out: npt.NDArray[np.bool_] | None = None,
) -> ExposurePairs:
    """Pair each frame with the next one.

    Values that are the lowest or the highest of their frame are left out, because they may be clipped.

    Args:
        events: sorted by time.
        frames: in the order of time.
        width: of the sensor in pixels.
        groups: how many groups of tiles there are.
        left_out: bool (H, W): pixels that are not used, such as hot ones.
    """
    pixel = events["y"].astype(np.int64) * width + events["x"]
    order = np.argsort(pixel, kind="stable")
    by_pixel = _ByPixel(pixel[order], events["t"][order], events["p"][order].astype(np.int64))
    rows: list[tuple[npt.NDArray[np.float64], ...]] = []
    inside: list[list[Inside]] = [[], []]
    count, before = 0, None
    for frame in frames:
        if before is not None and count < _MOST_PAIRS:
            taken = _pair(by_pixel, before, frame, left_out)
            rows.append(taken)
            for end, seen in enumerate((before, frame)):
                inside[end].append(by_pixel.inside(taken[0].astype(np.int64), seen, count))
            count += len(taken[0])
        before = frame
    columns = np.concatenate([np.zeros((8, 0)), *(np.stack(one) for one in rows)], axis=1)
    numbers = columns[0].astype(np.int64)
    tile = (numbers // width // _TILE) * (width // _TILE + 1) + numbers % width // _TILE
    _, rank = np.unique(tile, return_inverse=True)
    joined = [Inside(*(np.concatenate(parts) for parts in zip(*one, strict=True))) for one in inside] if rows else []
    nothing = Inside(np.zeros(0, np.int64), np.zeros(0), np.zeros(0), np.zeros(0))
    first, second = joined or [nothing, nothing]
    return ExposurePairs(
        numbers, columns[1:3], columns[3], columns[4], columns[5:7], columns[7], (first, second), rank % groups
    )


class _ByPixel:
    """Holds events by pixel, those of a pixel in the order of time."""

    def __init__(self, pixel: IntArray, t_us: IntArray, p: IntArray) -> None:
        self.pixel, self.t_us, self.p = pixel, t_us, p
        self._on = np.append(0, np.cumsum(p))
        # Pixel and time as one number, to be searched at once.
        self._first = int(t_us.min()) if len(t_us) else 0
        self._span = (int(t_us.max()) if len(t_us) else 0) - self._first + 2
        self._key = pixel * self._span + (t_us - self._first)

    def until(self, pixel: IntArray, t_us: npt.ArrayLike) -> IntArray:
        """Return the place behind the last event of each pixel before or at an instant."""
        at = np.clip(np.floor(np.asarray(t_us)) - self._first, -1, self._span - 2).astype(np.int64)
        return np.asarray(np.searchsorted(self._key, pixel * self._span + at, side="right"), np.int64)

    def between(self, start: IntArray, stop: IntArray) -> tuple[IntArray, IntArray]:
        """Return how many ON and OFF events there are from one place to another."""
        on = self._on[stop] - self._on[start]
        return on, stop - start - on

    def towards(self, pixel: IntArray, index: IntArray, t_us: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return which fraction of an ON and of an OFF event a pixel's signal has gone since its last event.

        It goes straight to the next one of the same polarity, and along a parabola to one of the other. The fraction is
        0 where there is no event before or after, or none for long.
        """
        count = len(self.pixel)
        before, after = np.clip(index - 1, 0, max(count - 1, 0)), np.clip(index, 0, max(count - 1, 0))
        known = (index > 0) & (index < count) & (self.pixel[before] == pixel) & (self.pixel[after] == pixel)
        gap = (self.t_us[after] - self.t_us[before]).astype(np.float64)
        known &= (gap > 0) & (gap <= MOST_GAP_S * 1e6)
        fraction = np.clip((t_us - self.t_us[before]) / np.maximum(gap, 1.0), 0, 1)
        turns = self.p[after] != self.p[before]
        fraction = np.where(known, np.where(turns, fraction * ((1 + _GOES_ON) * fraction - _GOES_ON), fraction), 0.0)
        return np.where(self.p[after] == 1, fraction, 0.0), np.where(self.p[after] == 1, 0.0, fraction)

    def inside(self, pixel: IntArray, frame: StampedFrame, row: int) -> Inside:
        """Return the pieces of an exposure; ``row`` is the first pair's."""
        half_us = max(frame.exposure_us, 1.0) / 2
        start, middle, stop = (self.until(pixel, frame.t_us + shift) for shift in (-half_us, 0.0, half_us))
        number = stop - start + 1
        own = np.repeat(np.arange(len(pixel)), number)
        step = np.arange(number.sum()) - np.repeat(np.cumsum(number) - number, number)
        index = start[own] + step  # of the event that ends a piece
        begins = np.where(step == 0, -half_us, self._after(index - 1, frame.t_us))
        ends = np.where(step == number[own] - 1, half_us, self._after(index, frame.t_us))
        on = (self._on[index] - self._on[middle[own]]).astype(np.float64)
        off = (index - middle[own]) - on
        here = self.towards(pixel[own], index, frame.t_us + (begins + ends) / 2)
        there = self.towards(pixel, middle, np.full(len(pixel), frame.t_us))
        return Inside(
            own + row, (ends - begins) / (2 * half_us), on + here[0] - there[0][own], off + here[1] - there[1][own]
        )

    def _after(self, index: IntArray, t_us: float) -> FloatArray:
        """Return the times of events after an instant; indices outside of all events give any."""
        return np.asarray(self.t_us[np.clip(index, 0, max(len(self.t_us) - 1, 0))] - t_us, np.float64)


def _pair(
    events: _ByPixel, before: StampedFrame, after: StampedFrame, left_out: npt.NDArray[np.bool_] | None
) -> tuple[FloatArray, ...]:
    values = np.stack([np.asarray(frame.values, np.float64).ravel() for frame in (before, after)])
    with np.errstate(invalid="ignore"):
        usable = np.isfinite(values).all(axis=0)
        for frame_values in values:
            known = frame_values[np.isfinite(frame_values)]
            usable &= (frame_values > known.min(initial=np.inf)) & (frame_values < known.max(initial=-np.inf))
    if left_out is not None:
        usable &= ~left_out.ravel()
    pixel = np.flatnonzero(usable)
    start, stop = (events.until(pixel, frame.t_us) for frame in (before, after))
    fired = stop > start
    pixel, start, stop = pixel[fired], start[fired], stop[fired]
    whole_on, whole_off = events.between(start, stop)
    on, off = whole_on.astype(np.float64), whole_off.astype(np.float64)
    open_ends = np.zeros((2, len(pixel)))
    for end, (index, frame) in enumerate(((start, before), (stop, after))):
        gone = events.towards(pixel, index, np.full(len(pixel), frame.t_us))
        sign = 2 * end - 1
        on += sign * gone[0]
        off += sign * gone[1]
        nearest = start if end == 0 else stop - 1  # of the pair's own events, of which there is one at least
        open_ends[end] = np.where(gone[0] + gone[1] == 0, 2.0 * events.p[nearest] - 1, 0.0)
    seconds = np.full(len(pixel), (after.t_us - before.t_us) * 1e-6)
    return pixel.astype(np.float64), *values[:, pixel], on, off, *open_ends, seconds
