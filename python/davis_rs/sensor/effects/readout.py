"""Defines the effect of the readout bus."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from .effect import EngineEffect, Where


@dataclass(frozen=True)
class Readout(EngineEffect):
    """A bus that reads events out row by row (address-event representation).

    Pixels ask for their row. When the bus is free it grants the row whose request is the oldest, stamps all of that
    row's requests alike, and carries the row's address and their columns at its own pace. No event that
    waits is lost unless ``drop_after_us`` is given; those that still wait at the end come from
    :meth:`~davis_rs.CrossingEngine.flush`, with later stamps.

    A pixel's reset waits for the bus: what reaches a level before the pixel's last event was read out, and its
    refractory period (at least a microsecond) was over, is no event, and is counted as missed. What log intensity the
    pixel memorises is that of a reset that did not wait: docs/effects.md has the consequences.

    Args:
        events_per_s: events that the bus carries in a second, >= 1; inf for all at once.
        latency_us: from grant to stamp, 0..1e9 us.
        jitter_us: standard deviation of the normal jitter that is added to the latency, 0..1e9 us. Order stays, and no
            stamp is earlier than its grant: where latency or the gaps between bursts are less, it is no longer normal.
        drop_after_us: an event that has waited longer than this when its row is granted is dropped and counted; None
            drops none.
        row_us: additional time for a row's address, 0..1e9 us: with 0.55 and 12e6 events a second, bursts of single
            events follow each other by 0.63 us.

    Raises:
        ValueError: for values out of range.

    Source: Brandli, Berner, Yang, Liu and Delbruck, "A 240 x 180 130 dB 3 us latency global shutter spatiotemporal
    vision sensor", IEEE JSSC 49(10), 2014 (word-serial burst readout; 12 million events per second). Two public
    recordings of a DAVIS240C have at most 3 bursts of rows in a microsecond, and 14 to 16 in ten.
    """

    events_per_s: float = 12e6
    latency_us: float = 0.0
    jitter_us: float = 0.0
    drop_after_us: float | None = None
    row_us: float = 0.0

    name: ClassVar[str] = "readout"
    acts_on: ClassVar[Where] = "stream"

    @property
    def neutral(self) -> bool:
        """Whether events leave unchanged."""
        return math.isinf(self.events_per_s) and self.row_us == 0 and self.latency_us == 0 and self.jitter_us == 0
