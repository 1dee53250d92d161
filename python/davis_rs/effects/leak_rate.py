"""Leak of the reference."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from .effect import Where
from .engine_effect import EngineEffect


@dataclass(frozen=True)
class LeakRate(EngineEffect):
    """The memorised reference drifts down, so that a static scene makes ON events.

    The drift is a function of time, R - rate C_on t, not a sum. At the first frame each pixel has leaked by a part of
    C_on drawn for it, so pixels are not in step.

    Args:
        rate_hz: events per second of a pixel in a static scene, 0..1e6 Hz; 0 is neutral.

    Raises:
        ValueError: for a value out of range.

    Source: Nozaki and Delbruck, "Temperature and parasitic photocurrent effects in dynamic vision sensors", IEEE Trans.
    Electron Devices 64(8), 2017 (junction leakage in the reset switch).
    """

    rate_hz: float

    name: ClassVar[str] = "leak_rate_hz"
    acts_on: ClassVar[Where] = "pixel"

    @property
    def neutral(self) -> bool:
        """Whether nothing leaks."""
        return self.rate_hz == 0
