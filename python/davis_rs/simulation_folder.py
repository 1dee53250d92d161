"""A simulation into a dataset folder, with a progress bar, and whole even when it is interrupted."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ._mitsuba import FAST, default_variant
from .dataset.writer import DatasetWriter
from .effect_planning import EffectPlan
from .folder_report import FolderReport
from .imu import IMU_DTYPE, ImuArray, simulate_imu
from .packet import Packet
from .pose import GroundTruth, Pose
from .progress import Progress, progress, say
from .rendering.render import Renderer
from .scene.scene import Scene
from .settings import FolderSettings, SimulationSettings, complete, make_imu, make_motion_capture, only, takes_settings
from .simulation import make_simulator
from .simulator import Simulator
from .stop_requests import stop_requests

if TYPE_CHECKING:
    from typing_extensions import Unpack


@dataclass(frozen=True, kw_only=True)
class SimulationReport(FolderReport):
    """What a simulation wrote into a folder.

    Attributes:
        plan: which effects the scene called for, where they were planned.
    """

    plan: EffectPlan | None = None

    def __str__(self) -> str:
        return self._line(f"{self.events:,} events")


@takes_settings(FolderSettings)
def simulate_to_folder(
    scene: Scene,
    path: str | Path,
    *,
    start_s: float = 0.0,
    duration_s: float | None = None,
    overwrite: bool = False,
    meta: Mapping[str, Any] | None = None,
    quiet: bool = False,
    **settings: Unpack[FolderSettings],
) -> SimulationReport:
    """Simulate a scene along its camera path into a dataset folder.

    >>> simulate_to_folder(load_scene("three_planes"), "planes", duration_s=0.1, imu="mpu6150")

    Ctrl-C (SIGINT) or SIGTERM ends it after the packet at hand (the second at the earliest), with a valid, shorter
    dataset; a second one ends it at once.

    Args:
        scene: with its camera path, see :meth:`Scene.with_trajectory`.
        path, overwrite: see :class:`~davis_rs.DatasetWriter`.
        start_s, duration_s: the part of the camera path to simulate, by default all from ``start_s`` on.
        meta: more for meta.json.
        quiet: no progress bar, and no lines that say who renders and how much noise that makes.
        {settings}

    Noise of IMU and motion capture has the same seed as the simulation.

    Raises:
        TypeError: for a setting that does not exist.
        OSError: if the folder exists or cannot be written; what was written stays readable.
        ValueError: as :func:`simulate` and :class:`~davis_rs.DatasetWriter`.
    """
    started = time.perf_counter()
    given = complete(FolderSettings, settings, of="simulate_to_folder")
    imu, motion_capture = make_imu(given), make_motion_capture(given)
    scene = scene.crop(start_s, duration_s)
    made = make_simulator(scene, only(SimulationSettings, given))
    simulator, plan = made.simulator, made.plan
    if quiet:
        made.warn_of_noise(stacklevel=3)
    else:
        say(_rendering_with(simulator.renderer))
        if made.noise_line:
            say(made.noise_line)
    truth = motion_capture.poses(scene.path, seed=given["seed"])
    inertial = np.zeros(0, IMU_DTYPE) if imu is None else simulate_imu(scene.path, imu, seed=given["seed"])
    packets = simulator.run()
    # Whatever is wrong with the scene shows before the folder is touched.
    first = next(packets)
    described = {
        **simulator.describe(),
        "effect_plan": None if plan is None else plan.describe(),
        "monte_carlo_noise": None if made.noise is None else made.noise.describe(simulator.renderer.rays),
        "trajectory": scene.path.describe(),
        "pose_rate_hz": motion_capture.rate_hz,
        "motion_capture": motion_capture.describe(),
        "imu": None if imu is None else imu.describe(),
        **(meta or {}),
    }
    with (
        stop_requests() as stop_requested,  # before the folder is made: a signal must not leave an empty one
        DatasetWriter(
            path, simulator.camera, image_gain=given["image_gain"], overwrite=overwrite, imu=imu, meta=described
        ) as writer,
        progress("simulating", scene.path.duration_s, unit="s", show=not quiet) as bar,
    ):
        written = _write_all(writer, chain([first], packets), simulator, truth, inertial, bar, stop_requested)
    wall_s = time.perf_counter() - started
    return SimulationReport(
        path=Path(path),
        events=written.events,
        duration_s=written.end_us * 1e-6,
        wall_s=wall_s,
        interrupted=written.interrupted,
        dropped_events=simulator.dropped_events,
        plan=plan,
    )


class _Written(NamedTuple):
    """How much of a run was written."""

    events: int
    end_us: int
    interrupted: bool


def _write_all(
    writer: DatasetWriter,
    packets: Iterator[Packet],
    simulator: Simulator,
    truth: GroundTruth,
    inertial: ImuArray,
    bar: Progress,
    stop_requested: Callable[[], bool],
) -> _Written:
    """Write packets, with the poses and samples that fall due until their ends, until they or the user end it."""
    total_us = round(simulator.scene.path.duration_s * 1e6)
    events = end_us = posed = sampled = 0
    for packet in packets:
        last_us = min(packet.end_us, total_us)
        # Stamps of another clock may lie beyond the end: the last packet takes them all.
        pose_end = _up_to(truth.t_us, last_us, total_us)
        sample_end = _up_to(inertial["t"], last_us, total_us)
        poses = [(int(truth.t_us[i]), Pose(truth.positions[i], truth.quaternions[i])) for i in range(posed, pose_end)]
        writer.write(packet, poses, inertial[sampled:sample_end])
        posed, sampled = pose_end, sample_end
        events, end_us = events + len(packet.events), packet.end_us
        bar.to(last_us * 1e-6, f"{events:,} events")
        if stop_requested() and end_us > 0:  # with the first frame alone the dataset could not be checked
            for late in simulator.flush():
                writer.write(late)
                events += len(late.events)
            break
    interrupted = end_us < total_us
    writer.finish({"dropped_events": simulator.dropped_events}, interrupted=interrupted)
    return _Written(events, min(end_us, total_us), interrupted)


def _rendering_with(renderer: Renderer) -> str:
    """What renders, why, and with which LLVM."""
    with_what = f"; {default_variant()[1]}" if renderer.variant == FAST else ""  # without LLVM that is the reason
    return f"rendering with {renderer.name}: {renderer.reason}{with_what}"


def _up_to(t_us: npt.NDArray[np.int64], last_us: int, total_us: int) -> int:
    """How many of the stamps are due once the sequence has got to ``last_us`` of ``total_us``."""
    return len(t_us) if last_us >= total_us else int(np.searchsorted(t_us, last_us, "right"))
