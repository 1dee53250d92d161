"""Defines the effect of the limited bandwidth of the photoreceptor and of the source follower behind it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from .effect import EngineEffect, Where


@dataclass(frozen=True)
class PhotoreceptorBandwidth(EngineEffect):
    """The photoreceptor and the source follower behind it: two first-order low-passes of log intensity.

    The photoreceptor is as fast as its photocurrent is large. In an interval between two samples its corner is f = hz *
    exp(mean log intensity), where exp(L) is luma + log_eps. ``log_eps`` is the dark current, so in the dark the corner
    is hz * log_eps, and contrast is that of light plus dark current. The source follower's corner is set by its bias,
    in any light.

    For an input that runs straight the output has a closed form, and levels are crossed by that; a cubic input is taken
    as chords that stray from it by at most C / 100 (or 16 of them). A pixel begins settled, at its first sample.
    :meth:`response` is the gain of a small sine.

    Args:
        hz: the photoreceptor's corner frequency where luma + log_eps = 1, > 0 Hz; inf for one that follows at once.
            Scenes tell how many lux that is (``lux_per_luma``).
        source_follower_hz: the source follower's corner frequency, 1e-3..inf Hz; inf likewise. With both infinite the
            effect is neutral.

    Raises:
        ValueError: for values out of range.

    Source: Lichtsteiner, Posch and Delbruck, "A 128 x 128 120 dB 15 us latency asynchronous temporal contrast vision
    sensor", IEEE JSSC 43(2), 2008, section III (bandwidth proportional to photocurrent); Graca and Delbruck,
    "Unraveling the paradox of intensity-dependent DVS pixel noise", IISW 2021, and Graca, McReynolds and Delbruck,
    "Shining light on the DVS pixel", IISW 2023, arXiv:2304.04706 (source follower; dark current); Nozaki and Delbruck,
    "Temperature and parasitic photocurrent effects in dynamic vision sensors", IEEE Trans. Electron Devices 64(8), 2017
    (dark current).
    """

    hz: float
    source_follower_hz: float = math.inf

    name: ClassVar[str] = "photoreceptor_bandwidth_hz"
    acts_on: ClassVar[Where] = "log intensity"

    def response(self, frequency_hz: npt.ArrayLike, light: npt.ArrayLike) -> npt.NDArray[np.complex128]:
        """Return the low-passes' complex gain for a small sine of log intensity; arguments are broadcast.

        Its absolute value is the gain, 1 / sqrt(2) at the corner of one low-pass alone, and its angle the phase.

        Args:
            frequency_hz: of the sine.
            light: mean luma + log_eps.
        """
        frequency = np.asarray(frequency_hz, np.float64)
        corner_hz = self.hz * np.asarray(light, np.float64)
        poles = (1 + 1j * frequency / corner_hz) * (1 + 1j * frequency / self.source_follower_hz)
        return np.asarray(1 / poles, np.complex128)

    @property
    def neutral(self) -> bool:
        """Whether both corners are infinite."""
        return math.isinf(min(self.hz, self.source_follower_hz))
