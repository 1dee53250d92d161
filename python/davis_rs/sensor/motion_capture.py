"""Simulates the motion-capture system that gives the ground truth: a trajectory in, stamped poses out.

It is exact and on the camera's clock unless noise or a clock of its own are asked for.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..geometry.pose import FloatArray, GroundTruth, hamilton
from ..geometry.trajectory.trajectory import Trajectory
from ..sampling.rules import periodic_instants
from .effects.effect import Effect, Where, check_range


@dataclass(frozen=True)
class MocapNoise(Effect):
    """White Gaussian noise of positions and rotations, independent from sample to sample.

    Args:
        position_m: standard deviation along each axis of the world, 0..1 m.
        rotation_rad: standard deviation of the turn about each axis of the camera, 0..0.5 rad.

    The defaults come from the public dataset's hand-held poster_6dof. Its residuals from a smooth path are white, at
    0.65 mm and 4.3 mrad (see :func:`~davis_rs.read_trajectory`).

    Raises:
        ValueError: for values out of range.

    Source: the residuals above; the paper speaks of less than a millimetre (Mueggler et al., IJRR 2017).
    """

    position_m: float = 6.5e-4
    rotation_rad: float = 4.3e-3

    name: ClassVar[str] = "mocap_noise_m"
    acts_on: ClassVar[Where] = "ground truth"

    def __post_init__(self) -> None:
        check_range("mocap_noise_m position_m", self.position_m, 0.0, 1.0, "m")
        check_range("mocap_noise_m rotation_rad", self.rotation_rad, 0.0, 0.5, "rad")

    @property
    def neutral(self) -> bool:
        """Whether poses are exact."""
        return self.position_m == 0 and self.rotation_rad == 0

    def apply(self, poses: GroundTruth, seed: int) -> GroundTruth:
        """Return ``poses`` with noise; the first n do not depend on how many follow."""
        from scipy.spatial.transform import Rotation

        draws = self.random(seed).standard_normal((len(poses.t_us), 6))
        turns: FloatArray = Rotation.from_rotvec(self.rotation_rad * draws[:, 3:]).as_quat()
        turns *= np.where(turns[:, 3:] < 0, -1.0, 1.0)  # so that the sign of the product stays continuous
        return poses._replace(
            positions=poses.positions + self.position_m * draws[:, :3], quaternions=hamilton(poses.quaternions, turns)
        )


@dataclass(frozen=True)
class MocapClock(Effect):
    """The motion capture's clock: at the camera's time t it shows (1 + ``drift``) t + ``offset_s``.

    Args:
        offset_s: -10..10 s.
        drift: seconds a second, -0.1..0.1.

    The default drift is the paper's, 2 ms in a minute.

    Raises:
        ValueError: for values out of range.

    Source: Mueggler et al., IJRR 2017, known issues: clock drift and offset.
    """

    offset_s: float = 0.0
    drift: float = 2e-3 / 60

    name: ClassVar[str] = "mocap_clock_offset_s"
    acts_on: ClassVar[Where] = "ground truth"

    def __post_init__(self) -> None:
        check_range("mocap_clock_offset_s offset_s", self.offset_s, -10.0, 10.0, "s")
        check_range("mocap_clock_offset_s drift", self.drift, -0.1, 0.1)

    @property
    def neutral(self) -> bool:
        """Whether it is the camera's clock."""
        return self.offset_s == 0 and self.drift == 0


@dataclass(frozen=True)
class MotionCapture:
    """Poses at a fixed rate of the system's own clock, which starts at 0. By default exact, on the camera's clock.

    Args:
        rate_hz: 0..1e6 Hz, 0 for no poses; the paper's system has 200 Hz.
        noise, clock: its imperfections; None is off.

    Raises:
        ValueError: for a rate out of range.
    """

    rate_hz: float = 200.0
    noise: MocapNoise | None = None
    clock: MocapClock | None = None

    def __post_init__(self) -> None:
        periodic_instants(self.rate_hz, 0, 0)  # refuses a bad rate

    def describe(self) -> dict[str, object]:
        """Return a description of the system, in JSON's types."""
        effects = {"noise": self.noise, "clock": self.clock}
        return {"rate_hz": self.rate_hz, **{name: e.settings() for name, e in effects.items() if e is not None}}

    def poses(self, trajectory: Trajectory, *, seed: int = 0) -> GroundTruth:
        """Return every pose within the trajectory, as stamped: at round(k 1e6 / rate) us of the system's clock.

        Args:
            trajectory: from the camera's t = 0 to its end.
            seed: of the noise, 0..2^64 - 1.

        Where the clocks have an offset, stamps before the camera's start or below 0 are left out.
        """
        clock = self.clock or MocapClock(0.0, 0.0)
        end_s = trajectory.duration_s * (1 + clock.drift) + clock.offset_s
        # 1 ns beyond the end, because float arithmetic may have moved it.
        instants = periodic_instants(self.rate_hz, 0, int(np.floor(end_s * 1e6 + 1e-3))) if end_s >= 0 else iter(())
        t_us = np.fromiter(instants, np.int64)
        t_s = (t_us * 1e-6 - clock.offset_s) / (1 + clock.drift)
        inside = t_s >= -1e-9
        t_us, t_s = t_us[inside], t_s[inside]
        poses = GroundTruth(t_us, trajectory.positions(t_s), trajectory.quaternions(t_s))
        return poses if self.noise is None else self.noise.apply(poses, seed)
