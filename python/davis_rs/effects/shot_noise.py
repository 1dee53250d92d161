"""Events from noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from .effect import Where
from .engine_effect import EngineEffect


@dataclass(frozen=True)
class ShotNoise(EngineEffect):
    """A Poisson process of events in each pixel, ON and OFF alike, the rarer the more light there is.

    The rate at an instant is rate_hz / (1 + luma / half_luma), with the luma of that instant, so that it does not
    depend on how the signal is sampled. A noise event leaves the reference where it is (on average ON and OFF cancel),
    but starts a refractory period as any other does, and none falls into one.

    Args:
        rate_hz: events per second of a pixel in the dark, 0..1e7 Hz; 0 is neutral.
        half_luma: the luma at which the rate has halved, > 0.

    Raises:
        ValueError: for values out of range.

    Source: Hu, Liu and Delbruck, "v2e: From video frames to realistic DVS events", CVPR Workshops 2021 (a rate that
    falls with intensity); Graca and Delbruck, "Unraveling the paradox of intensity-dependent DVS pixel noise", IISW
    2021.
    """

    rate_hz: float
    half_luma: float = 1.0

    name: ClassVar[str] = "shot_noise_rate_hz"
    acts_on: ClassVar[Where] = "pixel"

    @property
    def neutral(self) -> bool:
        """Whether there is no noise."""
        return self.rate_hz == 0
