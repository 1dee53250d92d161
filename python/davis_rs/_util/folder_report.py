"""Says in one line for people what a run wrote into a dataset folder, and when that begins."""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path


def start_line(start_time_ns: int, clock: str) -> str:
    """Say what t = 0 of a folder is on the clock of its input, exactly: "t = 0 is 1000.25 s on the clock of ..."."""
    seconds = (Decimal(start_time_ns) / 10**9).normalize()
    return f"t = 0 is {seconds:f} s on the clock of {clock}"


@dataclass(frozen=True, kw_only=True)
class FolderReport:
    """Says what a run wrote into a folder.

    Attributes:
        path: the folder.
        events: written.
        duration_s, wall_s: of the sequence, and wall time, in seconds.
        interrupted: whether a signal cut it short.
        stopped_by: that signal: ``Ctrl-C`` or ``SIGTERM``; else empty.
        dropped_events: how many events the readout dropped.
        missed_events: how often a pixel reached a level before its last event was read out and its reset over.
    """

    path: Path
    events: int
    duration_s: float
    wall_s: float
    interrupted: bool
    stopped_by: str = ""
    dropped_events: int = 0
    missed_events: int = 0

    def _line(self, events: str) -> str:
        rate = self.events / self.duration_s if self.duration_s else 0.0
        cut = f", cut short by {self.stopped_by}" if self.interrupted else ""
        dropped = f", {self.dropped_events:,} dropped by the readout" if self.dropped_events else ""
        missed = f", {self.missed_events:,} missed by pixels that waited for the bus" if self.missed_events else ""
        return (
            f"{self.path}: {events} in {self.duration_s:.6g} s ({rate / 1e6:.3f} Mev/s), "
            f"wall time {self.wall_s:.1f} s{dropped}{missed}{cut}"
        )
