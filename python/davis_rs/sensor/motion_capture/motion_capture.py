"""The motion-capture system: a trajectory in, stamped poses out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...geometry.pose import GroundTruth
from ...geometry.trajectory.trajectory import Trajectory
from ...sampling.rules import periodic_instants
from .clock import MocapClock
from .noise import MocapNoise


@dataclass(frozen=True)
class MotionCapture:
    """Poses at a fixed rate of the system's own clock, which starts at 0. By default exact, on the camera's clock.

    Args:
        rate_hz: 0..1e6 Hz, 0 for no poses; the paper's system has 200 Hz.
        noise, clock: what makes it a real one; None is off.

    Raises:
        ValueError: for a rate out of range.
    """

    rate_hz: float = 200.0
    noise: MocapNoise | None = None
    clock: MocapClock | None = None

    def __post_init__(self) -> None:
        periodic_instants(self.rate_hz, 0, 0)  # refuses a bad rate

    def describe(self) -> dict[str, Any]:
        """Return what it is, in JSON's types."""
        effects = {"noise": self.noise, "clock": self.clock}
        return {"rate_hz": self.rate_hz, **{name: e.settings() for name, e in effects.items() if e is not None}}

    def poses(self, trajectory: Trajectory, *, seed: int = 0) -> GroundTruth:
        """Return every pose within the trajectory, as stamped: at round(k 1e6 / rate) us of the system's clock.

        Args:
            trajectory: from the camera's t = 0 to its end.
            seed: of the noise, 0..2^64 - 1.

        Where the two clocks start apart, stamps before the camera's start (a positive offset) or below 0 (a negative
        one) are left out.
        """
        clock = self.clock or MocapClock(0.0, 0.0)
        end_s = trajectory.duration_s * (1 + clock.drift) + clock.offset_s
        # A hair more than the end, which float arithmetic may have moved: 1 ns.
        instants = periodic_instants(self.rate_hz, 0, int(np.floor(end_s * 1e6 + 1e-3))) if end_s >= 0 else iter(())
        t_us = np.fromiter(instants, np.int64)
        t_s = (t_us * 1e-6 - clock.offset_s) / (1 + clock.drift)
        inside = t_s >= -1e-9
        t_us, t_s = t_us[inside], t_s[inside]
        poses = GroundTruth(t_us, trajectory.positions(t_s), trajectory.quaternions(t_s))
        return poses if self.noise is None else self.noise.apply(poses, seed)
