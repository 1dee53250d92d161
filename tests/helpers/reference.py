"""The crossing contract in rational numbers: the slow oracle that the engine is tested against.

Written from the contract, not from the engine: every float64 log intensity is taken as the rational number that it is,
and nothing is ever rounded. Slow (about 10 us an event) and plain on purpose.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from davis_rs import EVENT_DTYPE
from davis_rs.events.arrays import EventArray

LogFrame = npt.NDArray[np.float64]


class Crossing(NamedTuple):
    """One event of a pixel: its stamp and polarity (1 = ON, 0 = OFF)."""

    t_us: int
    p: int


class ExactPixel:
    """One ideal pixel: reference R = B + n_on C_on - n_off C_off, levels R + C_on and R - C_off.

    ``base`` is B, the first log intensity if it is not given.
    """

    def __init__(self, t_us: int, log_intensity: float, c_on: float, c_off: float, base: float | None = None) -> None:
        self.c_on, self.c_off = Fraction(c_on), Fraction(c_off)
        self.log_intensity = Fraction(log_intensity)
        self.base = self.log_intensity if base is None else Fraction(base)
        self.t_us = t_us
        self.n_on = self.n_off = 0

    @property
    def reference(self) -> Fraction:
        return self.base + self.n_on * self.c_on - self.n_off * self.c_off

    def advance(self, t_us: int, log_intensity: float) -> list[Crossing]:
        """The events in (self.t_us, t_us], over which log intensity runs straight to its new value."""
        start_us, start = self.t_us, self.log_intensity
        self.t_us, self.log_intensity = t_us, Fraction(log_intensity)
        rate = (self.log_intensity - start) / (t_us - start_us)
        crossings: list[Crossing] = []
        while True:
            if self.log_intensity >= self.reference + self.c_on:
                self.n_on += 1
            elif self.log_intensity <= self.reference - self.c_off:
                self.n_off += 1
            else:
                return crossings
            # The reference is now the level that was reached; its stamp is the first tick at or after the crossing.
            tick = math.ceil((self.reference - start) / rate)
            crossings.append(Crossing(start_us + tick, int(rate > 0)))


class ExactEngine:
    """:class:`davis_rs.CrossingEngine` for float64 log intensity, one :class:`ExactPixel` a pixel.

    ``first_reference`` is R of each pixel at the first frame, that frame if it is not given.
    """

    def __init__(
        self, *, contrast_threshold: float, contrast_threshold_off: float, first_reference: LogFrame | None = None
    ) -> None:
        self.c_on, self.c_off = contrast_threshold, contrast_threshold_off
        self.first_reference = first_reference
        self.pixels: dict[tuple[int, int], ExactPixel] = {}

    def push_log(self, t_us: int, log_intensity: LogFrame) -> EventArray:
        """The events since the last frame, sorted by (t, y, x, order of crossing)."""
        if not self.pixels:
            base = log_intensity if self.first_reference is None else self.first_reference
            for (y, x), value in np.ndenumerate(log_intensity):
                self.pixels[y, x] = ExactPixel(t_us, float(value), self.c_on, self.c_off, float(base[y, x]))
            return np.zeros(0, EVENT_DTYPE)
        found = [
            (event.t_us, y, x, order, event.p)
            for (y, x), pixel in self.pixels.items()
            for order, event in enumerate(pixel.advance(t_us, float(log_intensity[y, x])))
        ]
        return np.array([(t, x, y, p) for t, y, x, _, p in sorted(found)], EVENT_DTYPE)


def exact_events(times_us: list[int], frames: list[LogFrame], c_on: float, c_off: float) -> EventArray:
    """The events of a whole sequence by :class:`ExactEngine`."""
    oracle = ExactEngine(contrast_threshold=c_on, contrast_threshold_off=c_off)
    return np.concatenate([oracle.push_log(t, frame) for t, frame in zip(times_us, frames, strict=True)])
