"""The photoreceptor's limited bandwidth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from .effect import Where
from .engine_effect import EngineEffect


@dataclass(frozen=True)
class PhotoreceptorBandwidth(EngineEffect):
    """A first-order low-pass of log intensity whose corner frequency is proportional to irradiance.

    In an interval between two samples the corner is f = hz * exp(mean log intensity), where exp(L) is luma + log_eps,
    but within floor_hz..ceiling_hz. For an input that runs straight the output has a closed form, and levels are
    crossed by that; a cubic input is taken as chords that stray from it by at most C / 100 (or 16 of them). A pixel
    begins settled, at its first sample.

    Args:
        hz: corner frequency where luma + log_eps = 1, 1e-3..inf Hz; inf is neutral. Scenes tell how many lux that is
            (``lux_per_luma``).
        floor_hz: the corner never falls below, 0..ceiling_hz.
        ceiling_hz: nor rises above: that of the source follower behind the photoreceptor.

    Raises:
        ValueError: for values out of range.

    Source: Lichtsteiner, Posch and Delbruck, "A 128 x 128 120 dB 15 us latency asynchronous temporal contrast vision
    sensor", IEEE JSSC 43(2), 2008, section III (photoreceptor; bandwidth proportional to photocurrent).
    """

    hz: float
    floor_hz: float = 0.0
    ceiling_hz: float = math.inf

    name: ClassVar[str] = "photoreceptor_bandwidth_hz"
    acts_on: ClassVar[Where] = "log intensity"

    @property
    def neutral(self) -> bool:
        """Whether the corner is infinite."""
        return math.isinf(min(self.hz, self.ceiling_hz))
