"""Defines the effect of the readout bus."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from .effect import EngineEffect, Where


@dataclass(frozen=True)
class Readout(EngineEffect):
    """Models a bus that reads events out row by row (address-event representation).

    Pixels ask for their row. When the bus is free it grants the row whose request is the oldest, stamps all of that
    row's requests alike, and carries the row's address and their columns, upwards, at its own pace. Events come in this
    order: those of one stamp burst by burst, in the order of the grants. No event that waits is lost unless
    ``drop_after_us`` is given; those that still wait at the end come from :meth:`~davis_rs.CrossingEngine.flush`, with
    later stamps.

    Events of pixels have whole microseconds. When within its microsecond a row asks is a draw of (seed, row, time since
    the first frame), and a stamp is the last whole microsecond before its time, as of a camera's clock.

    A pixel's reset waits for the bus: what reaches a level before the pixel's last event was read out, and its
    refractory period (at least a microsecond) was over, is no event, and is counted as missed. What log intensity the
    pixel memorises is that of a reset that did not wait: docs/effects.md has the consequences.

    Args:
        events_per_s: events that the bus carries in a second, >= 1; inf for all at once.
        latency_us: from grant to stamp, 0..1e9 us.
        jitter_us: standard deviation of the normal jitter that is added to the latency, 0..1e9 us. Order stays, and no
            stamp is earlier than the microsecond of its grant: where latency or the gaps between bursts are less, it is
            no longer normal.
        drop_after_us: an event that has waited longer than this when its row is granted is dropped and counted; None
            drops none.
        row_us: additional time for a row's address, 0..1e9 us: with 0.32 and 9e6 events a second, bursts of single
            events follow each other by 0.43 us.
        by_columns: 1 where the rows of the bus are columns of the image, as in a DAVIS346, which has 346 of them; else
            0.

    Raises:
        ValueError: for values out of range.

    Source: Brandli, Berner, Yang, Liu and Delbruck, "A 240 x 180 130 dB 3 us latency global shutter spatiotemporal
    vision sensor", IEEE JSSC 49(10), 2014 (word-serial burst readout; 12 million events per second). Pace and order in
    recordings: docs/effects.md.
    """

    events_per_s: float = 12e6
    latency_us: float = 0.0
    jitter_us: float = 0.0
    drop_after_us: float | None = None
    row_us: float = 0.0
    by_columns: int = 0

    name: ClassVar[str] = "readout"
    acts_on: ClassVar[Where] = "stream"

    @property
    def neutral(self) -> bool:
        """Return whether events leave unchanged."""
        return math.isinf(self.events_per_s) and self.row_us == 0 and self.latency_us == 0 and self.jitter_us == 0

    def rows(self, width: int, height: int) -> int:
        """Return how many rows the bus of a sensor has, of so many pixels."""
        return width if self.by_columns else height
