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

from .dataset import DatasetWriter
from .sampling import periodic_instants
from .simulate import Simulator
from .trajectory import Trajectory


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
    exposure: float | None = None,
    overwrite: bool = False,
    meta: Mapping[str, Any] | None = None,
    quiet: bool = False,
) -> Recording:
    """Simulate a trajectory into a dataset folder.

    Ctrl-C (SIGINT) or SIGTERM ends it after the packet at hand, with a valid, shorter dataset; a second one ends it
    at once.

    Args:
        simulator: a fresh one.
        trajectory: from t = 0.
        path, exposure, overwrite: see :class:`~davis_rs.dataset.DatasetWriter`.
        pose_rate_hz: rate of the ground truth; 200 Hz is the public dataset's.
        meta: more for meta.json.
        quiet: no progress bar.

    Raises:
        OSError: if the folder exists or cannot be written; what was written stays readable.
        ValueError: as :meth:`Simulator.run`.
    """
    from tqdm import tqdm

    started = time.perf_counter()
    packets = simulator.run(trajectory)
    # Whatever is wrong with the scene shows before the folder is touched; effects may be chosen by now.
    first = next(packets)
    record_of_run = {
        **simulator.describe(),
        "trajectory": trajectory.describe(),
        "pose_rate_hz": pose_rate_hz,
        **(meta or {}),
    }
    events = 0
    with (
        DatasetWriter(path, simulator.camera, exposure=exposure, overwrite=overwrite, meta=record_of_run) as writer,
        _stop_requests() as stop_requested,
        tqdm(total=trajectory.duration_s, unit="s", disable=quiet, bar_format=_BAR) as bar,
    ):
        end_us, total_us = 0, round(trajectory.duration_s * 1e6)
        for packet in chain([first], packets):
            # What a readout brings after the end has no more poses.
            last_us = min(packet.end_us, total_us)
            pose_times = periodic_instants(pose_rate_hz, 0 if packet is first else end_us + 1, last_us)
            writer.write(packet, [(t_us, trajectory.pose(t_us * 1e-6)) for t_us in pose_times])
            events, end_us = events + len(packet.events), packet.end_us
            bar.set_postfix_str(f"{events:,} events", refresh=False)
            bar.update(last_us * 1e-6 - bar.n)
            if stop_requested():
                for late in simulator.flush():
                    writer.write(late)
                    events += len(late.events)
                break
        dropped = simulator.dropped_events
        writer.finish({"dropped_events": dropped}, interrupted=end_us < total_us)
    simulated_s = min(end_us, total_us) * 1e-6
    return Recording(Path(path), events, simulated_s, time.perf_counter() - started, end_us < total_us, dropped)


_BAR = "{percentage:3.0f}%|{bar}| {n:.3f}/{total:.3g} s simulated [{elapsed}<{remaining}, {rate_noinv_fmt}{postfix}]"


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
