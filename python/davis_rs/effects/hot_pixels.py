"""Hot pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from .effect import Where
from .engine_effect import EngineEffect


@dataclass(frozen=True)
class HotPixels(EngineEffect):
    """A share of the pixels fires by itself: a Poisson process of ON events in each, whatever it sees.

    Which ones depends on the seed alone. A hot pixel sees the scene as well, but each of its own events resets it, so
    that it sees little of what is slow.

    Args:
        fraction: the share of pixels, 0..1.
        rate_hz: events per second of each, 0..1e7 Hz. Neutral where either is 0.

    Raises:
        ValueError: for values out of range.

    Rate and share are whatever a sensor shows with its lens covered: no typical ones are published.
    """

    fraction: float
    rate_hz: float = 10.0

    name: ClassVar[str] = "hot_pixels"
    acts_on: ClassVar[Where] = "pixel"

    @property
    def neutral(self) -> bool:
        """Whether none fires."""
        return self.fraction == 0 or self.rate_hz == 0
