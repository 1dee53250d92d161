"""A simulation into a dataset folder, with a progress bar, and whole even when it is interrupted."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import numpy.typing as npt

from .dataset.writer import DatasetWriter
from .imu import IMU_DTYPE, Imu, simulate_imu
from .motion_capture import MotionCapture
from .pose import Pose
from .progress import progress
from .simulate import Simulator
from .trajectory.trajectory import Trajectory


@dataclass(frozen=True)
class Recording:
    """What was recorded: events, simulated and wall time in seconds, whether it was cut short by Ctrl-C, and how many
    events the readout dropped."""

    path: Path
    events: int
    duration_s: float
    wall_s: float
    interrupted: bool
    dropped_events: int = 0

    def __str__(self) -> str:
        rate = self.events / self.duration_s if self.duration_s else 0.0
        cut = ", cut short by Ctrl-C" if self.interrupted else ""
        dropped = f", {self.dropped_events:,} dropped by the readout" if self.dropped_events else ""
        return (
            f"{self.path}: {self.events:,} events in {self.duration_s:.6g} s ({rate / 1e6:.3f} Mev/s), "
            f"wall time {self.wall_s:.1f} s{dropped}{cut}"
        )


def record(
    simulator: Simulator,
    trajectory: Trajectory,
    path: str | Path,
    *,
    pose_rate_hz: float = 200.0,
    motion_capture: MotionCapture | None = None,
    imu: Imu | None = None,
    exposure: float | None = None,
    overwrite: bool = False,
    meta: Mapping[str, Any] | None = None,
    quiet: bool = False,
) -> Recording:
    """Simulate a trajectory into a dataset folder.

    Ctrl-C (SIGINT) or SIGTERM ends it after the packet at hand (the second at the earliest), with a valid, shorter
    dataset; a second one ends it at once.

    Args:
        simulator: a fresh one.
        trajectory: from t = 0.
        path, exposure, overwrite: see :class:`~davis_rs.dataset.writer.DatasetWriter`.
        pose_rate_hz: rate of the ground truth; 200 Hz is the public dataset's.
        motion_capture: what gives the ground truth, in place of exact poses at ``pose_rate_hz``.
        imu: see :class:`~davis_rs.Imu`; None for no ``imu.txt``.
        meta: more for meta.json.
        quiet: no progress bar.

    Raises:
        OSError: if the folder exists or cannot be written; what was written stays readable.
        ValueError: as :meth:`Simulator.run`, and :class:`~davis_rs.dataset.writer.DatasetWriter`.

    Noise of IMU and motion capture has the simulator's seed.
    """
    started = time.perf_counter()
    motion_capture = motion_capture or MotionCapture(pose_rate_hz)
    seed = simulator.parameters["seed"]
    truth = motion_capture.poses(trajectory, seed=seed)
    inertial = np.zeros(0, IMU_DTYPE) if imu is None else simulate_imu(trajectory, imu, seed=seed)
    packets = simulator.run(trajectory)
    # Whatever is wrong with the scene shows before the folder is touched; effects may be chosen by now.
    first = next(packets)
    record_of_run = {
        **simulator.describe(),
        "trajectory": trajectory.describe(),
        "pose_rate_hz": motion_capture.rate_hz,
        "motion_capture": motion_capture.describe(),
        "imu": None if imu is None else imu.describe(),
        **(meta or {}),
    }
    events = 0
    with (
        _stop_requests() as stop_requested,
        DatasetWriter(
            path, simulator.camera, exposure=exposure, overwrite=overwrite, imu=imu, meta=record_of_run
        ) as writer,
        progress("simulating", trajectory.duration_s, unit="s", show=not quiet) as bar,
    ):
        end_us, total_us = 0, round(trajectory.duration_s * 1e6)
        posed = sampled = 0
        for packet in chain([first], packets):
            last_us = min(packet.end_us, total_us)
            # Stamps of another clock may lie beyond the end: the last packet takes them all.
            pose_end = _up_to(truth.t_us, last_us, total_us)
            sample_end = _up_to(inertial["t"], last_us, total_us)
            poses = [
                (int(truth.t_us[i]), Pose(truth.positions[i], truth.quaternions[i])) for i in range(posed, pose_end)
            ]
            writer.write(packet, poses, inertial[sampled:sample_end])
            posed, sampled = pose_end, sample_end
            events, end_us = events + len(packet.events), packet.end_us
            bar.to(last_us * 1e-6, f"{events:,} events")
            if stop_requested() and end_us > 0:  # with the first frame alone the dataset could not be checked
                for late in simulator.flush():
                    writer.write(late)
                    events += len(late.events)
                break
        dropped = simulator.dropped_events
        writer.finish({"dropped_events": dropped}, interrupted=end_us < total_us)
    simulated_s = min(end_us, total_us) * 1e-6
    return Recording(Path(path), events, simulated_s, time.perf_counter() - started, end_us < total_us, dropped)


def _up_to(t_us: npt.NDArray[np.int64], last_us: int, total_us: int) -> int:
    """How many of the stamps are due once the sequence has got to ``last_us`` of ``total_us``."""
    return len(t_us) if last_us >= total_us else int(np.searchsorted(t_us, last_us, "right"))


@contextmanager
def _stop_requests() -> Iterator[Callable[[], bool]]:
    """Catch the first SIGINT or SIGTERM as a wish; the next one acts as it would have."""
    wishes: list[int] = []

    def wish(number: int, _: FrameType | None) -> None:
        wishes.append(number)
        signal.signal(number, before[number])

    try:
        before: dict[int, Any] = {int(number): signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
        for number in before:
            signal.signal(number, wish)
    except ValueError:  # not in the main thread: signals are the caller's
        yield lambda: False
        return
    try:
        yield lambda: bool(wishes)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
