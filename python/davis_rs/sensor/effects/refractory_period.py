"""Defines the effect of the refractory period."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from .effect import EngineEffect, Where


@dataclass(frozen=True)
class RefractoryPeriod(EngineEffect):
    """Holds a pixel in reset after each of its events. At the end of the reset it memorises log intensity anew.

    It is held from the crossing itself, not from the stamp: on a ramp of slope s events follow each other by C / s + T.
    What log intensity does meanwhile is lost, so events no longer add up to it. Where events wait for a bus
    (:class:`~davis_rs.sensor.effects.Readout`), the pixel makes none until the period after its readout is over.

    Args:
        period_us: T in microseconds, 0..1e15; 0 is neutral.

    Raises:
        ValueError: for a value out of range.

    Source: Lichtsteiner, Posch and Delbruck, IEEE JSSC 43(2), 2008, section III (reset and refractory period).
    """

    period_us: float

    name: ClassVar[str] = "refractory_period_us"
    acts_on: ClassVar[Where] = "pixel"

    @property
    def neutral(self) -> bool:
        """Whether a pixel is ready at once."""
        return self.period_us == 0
