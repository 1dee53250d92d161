"""Defines the effect of hot pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from .effect import EngineEffect, Where


@dataclass(frozen=True)
class HotPixels(EngineEffect):
    """A fraction of the pixels fires by itself: nearly periodic ON events in each, whatever it sees.

    Which pixels these are depends only on the seed. Each has a rate of its own, log-normal, and a regularity of its
    own: the coefficient of variation (CV) of its intervals, which are log-normal and independent, lies between least_cv
    and most_cv, evenly in its logarithm. A hot pixel sees the scene as well, but each of its own events resets it, so
    that it sees little of what is slow.

    Args:
        fraction: the fraction of pixels, 0..1.
        rate_hz: events per second of each, the median of all, 0..1e7 Hz. Neutral where either is 0.
        rate_spread: standard deviation of the natural logarithm of the rate from pixel to pixel, 0..3; no pixel fires
            faster than 1e7 Hz.
        least_cv, most_cv: of a pixel's intervals, 0..1, the first at most the second.

    Raises:
        ValueError: for values out of range.

    Defaults of rate, spread and regularity: two public recordings of a DAVIS240C, which have 8 and 4 such pixels (0.019
    % and 0.009 %, the 4 among the 8) of 5 to 54 Hz with CV from 0.05 to 0.5, next to all events ON. That both are
    log-normal is an assumption.
    """

    fraction: float
    rate_hz: float = 16.0
    rate_spread: float = 0.8
    least_cv: float = 0.05
    most_cv: float = 0.5

    name: ClassVar[str] = "hot_pixels"
    acts_on: ClassVar[Where] = "pixel"

    def mean_rate_hz(self) -> float:
        """Return events per second of a hot pixel, the mean of all."""
        return min(self.rate_hz * math.exp(self.rate_spread**2 / 2), 1e7)

    @property
    def neutral(self) -> bool:
        """Whether no pixel fires by itself."""
        return self.fraction == 0 or self.rate_hz == 0
