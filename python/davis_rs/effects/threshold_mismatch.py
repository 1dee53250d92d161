"""Thresholds that differ from pixel to pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from .effect import Where
from .engine_effect import EngineEffect


@dataclass(frozen=True)
class ThresholdMismatch(EngineEffect):
    """C_on and C_off of each pixel, drawn once: a fixed pattern for a seed.

    Log-normal with the nominal threshold as mean, so never zero or negative, ON and OFF independent of each other.

    Args:
        sigma: standard deviation in units of the nominal threshold, 0..1; 0 is neutral.

    Raises:
        ValueError: for a value out of range.

    Source: Lichtsteiner, Posch and Delbruck, IEEE JSSC 43(2), 2008, section IV (2.1 % contrast mismatch at
    thresholds of about 15 %, so sigma 0.14).
    """

    sigma: float

    name: ClassVar[str] = "threshold_mismatch"
    acts_on: ClassVar[Where] = "pixel"

    @property
    def neutral(self) -> bool:
        """Whether all pixels are alike."""
        return self.sigma == 0
