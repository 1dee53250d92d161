"""Events from noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from .effect import Where
from .engine_effect import EngineEffect


@dataclass(frozen=True)
class ShotNoise(EngineEffect):
    """Events in pairs, ON then OFF or OFF then ON alike, in each pixel, the rarer the more light there is.

    Now and then, a Poisson process, noise takes the signal to a level: an event. The pixel is reset as after any event,
    and a reset memorises the noise with the signal, so the reference moves by a threshold. After a time that is
    exponential with mean 1 / (2 pi bandwidth_hz) the noise has gone back. Then the opposite level is crossed, or is
    within half a threshold, which noise on its way back soon reaches: the event of the opposite polarity, and the
    reference is back as well. So noise does not hide slow contrast: ON events less OFF events are still those of the
    signal, but for the pair under way.

    A refractory period T follows each of the two, and none falls into one. What is memorised at its end is the signal
    there, and what is left of the noise: nearly all while T is much shorter than 1 / (2 pi bandwidth_hz), nothing
    after a much longer T, so that slow contrast is then lost.

    The rate at an instant is rate_hz / (1 + luma / half_luma), with the luma of that instant, so that it does not
    depend on how the signal is sampled. There is one excursion at a time.

    Args:
        rate_hz: events per second of a pixel in the dark, both of a pair counted, 0..1e7 Hz; 0 is neutral.
        half_luma: the luma at which the rate has halved, > 0.
        bandwidth_hz: of the noise, 1e-3..1e12 Hz: how soon the second event of a pair follows.

    Raises:
        ValueError: for values out of range.

    Source: Graca, McReynolds and Delbruck, "Exploiting alternating DVS shot noise event pair statistics to reduce
    background activity", IISW 2023 (noise events alternate in pairs because a reset memorises the noise); Hu, Liu and
    Delbruck, "v2e: From video frames to realistic DVS events", CVPR Workshops 2021 (a rate that falls with intensity;
    in its code a noise event moves the memorised value by one threshold); Graca and Delbruck, "Unraveling the paradox
    of intensity-dependent DVS pixel noise", IISW 2021 (why it falls). How much of the noise is left after T is
    (1 + x) exp(-x), x = 2 pi bandwidth_hz T: white noise behind two poles of one bandwidth. That and the half of a
    threshold are assumptions: noise that gets to a whole threshold is often at half of one.
    """

    rate_hz: float
    half_luma: float = 1.0
    bandwidth_hz: float = 300.0

    name: ClassVar[str] = "shot_noise_rate_hz"
    acts_on: ClassVar[Where] = "pixel"

    @property
    def neutral(self) -> bool:
        """Whether there is no noise."""
        return self.rate_hz == 0
