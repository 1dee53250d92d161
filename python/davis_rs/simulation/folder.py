"""Writes a simulation into a dataset folder, with a progress bar, and whole even when it is interrupted."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from .._mitsuba.variants import FAST, default_variant
from .._util.folder_report import FolderReport, start_line
from .._util.progress import Progress, doing, progress, say
from .._util.quantities import events_a_second
from .._util.stop_requests import stop_requests
from ..events.arrays import EventArray
from ..events.packet import Packet
from ..geometry.pose import GroundTruth, Pose, Velocities
from ..io.dataset.event_truth_file import open_event_truth, require_event_truth
from ..io.dataset.writer import DatasetWriter
from ..io.formats import FORMATS
from ..render.base import Renderer
from ..render.truth import EventTruth, camera_velocities
from ..sampling.rules import periodic_instants
from ..scene.scene import Scene, check_scene
from ..sensor.imu import IMU_DTYPE, ImuArray, simulate_imu
from .monte_carlo_noise import refuse_noise
from .planning import EffectPlan
from .settings import FolderSettings, complete, make_imu, make_motion_capture, takes_settings
from .simulate import make_simulator
from .simulator import Simulator

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from .settings.keywords import FolderKeywords


@dataclass(frozen=True, kw_only=True)
class SimulationReport(FolderReport):
    """Says what a simulation wrote into a folder.

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
    meta: Mapping[str, object] | None = None,
    quiet: bool = False,
    **settings: Unpack[FolderKeywords],
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
        quiet: no progress bar, and no lines that say who renders, how much noise that makes, that much memory will be
            taken, and what t = 0 is on the clock of the camera path's file.
        {settings}

    Noise of IMU and motion capture has the same seed as the simulation.

    Warns:
        NoEventsWarning: as :func:`simulate`.
        NoiseWarning: likewise, if ``quiet``; else a line says it.

    Raises:
        TypeError: for a setting that does not exist.
        OSError: if the folder exists or cannot be written; what was written stays readable.
        NoiseError: with ``accept_noise=False``, if more than 20 % of the events would be Monte Carlo noise.
        ValueError: as :func:`simulate` and :class:`~davis_rs.DatasetWriter`.
        ImportError: if a library is missing that the events or their truth are written with, with its extra.
    """
    check_scene(scene)
    started = time.perf_counter()
    given = complete(FolderSettings, settings, taker=simulate_to_folder)
    FORMATS[given.events_format].require_libraries()  # before minutes are spent on what cannot be written
    require_event_truth(given.event_truth)
    imu, motion_capture = make_imu(given), make_motion_capture(given)
    scene = scene.crop(start_s, duration_s)
    with progress("simulating", scene.path.duration_s, unit="s", show=not quiet, forecast=_advice(given)) as bar:
        made = make_simulator(scene, given)
        simulator, plan = made.simulator, made.plan
        if given.accept_noise is False:
            refuse_noise(made.noise, scene, given)
        if quiet:
            made.warn_of_noise(stacklevel=3)
        else:
            say(_rendering_with(simulator.renderer))
            if made.noise_line:
                say(made.noise_line)
            if line := simulator.memory.line():
                say(line)
            if scene.path.start_time_ns:
                say(start_line(scene.path.start_time_ns, "the camera path"))
        truth = motion_capture.poses(scene.path, seed=given.seed)
        inertial = np.zeros(0, IMU_DTYPE) if imu is None else simulate_imu(scene.path, imu, seed=given.seed)
        end_us = round(1e6 * scene.path.duration_s)
        moving_us = np.fromiter(periodic_instants(given.velocity_rate_hz, 0, end_us), np.int64)
        moving = camera_velocities(scene.path, moving_us)
        event_truth = None
        if given.event_truth is not None:
            event_truth = EventTruth(
                simulator.scene, simulator.camera, surfaces=simulator.surfaces, threads=given.threads
            )
        count = _EventCount(bar)
        bar.begin()
        doing("rendering the first keyframes")
        packets = made.packets(count.add)
        # Whatever is wrong with the scene shows before the folder is touched.
        first = next(packets)
        described = {
            **simulator.describe(),
            "effect_plan": None if plan is None else plan.describe(),
            "monte_carlo_noise": None if made.noise is None else made.noise.describe(simulator.renderer.rays_per_pixel),
            "trajectory": scene.path.describe(),
            "start_time_ns": scene.path.start_time_ns,
            "pose_rate_hz": motion_capture.rate_hz,
            "motion_capture": motion_capture.describe(),
            "imu": None if imu is None else imu.describe(),
            **(meta or {}),
        }
        with (
            stop_requests() as stop_requested,  # before the folder is made: a signal must not leave an empty one
            DatasetWriter(
                path,
                simulator.camera,
                image_gain=given.image_gain,
                events_format=given.events_format,
                overwrite=overwrite,
                shape_names=simulator.shape_names,
                flow_png=given.flow_png,
                imu=imu,
                meta=described,
            ) as writer,
            _truth_file(writer.path, given.event_truth, event_truth) as add_truth,
        ):
            sequence = _Sequence(chain([first], packets), truth, inertial, moving)
            written = _write_all(writer, sequence, simulator, add_truth, stop_requested)
    wall_s = time.perf_counter() - started
    return SimulationReport(
        path=Path(path),
        events=written.events,
        duration_s=written.end_us * 1e-6,
        wall_s=wall_s,
        interrupted=written.interrupted,
        dropped_events=simulator.dropped_events,
        missed_events=simulator.missed_events,
        plan=plan,
    )


def _advice(settings: FolderSettings) -> str:
    """Say how a long run would take less time; "" where the preset is the fastest, or does not decide."""
    own = (settings.render_rate_hz, settings.max_displacement_px, settings.tolerance, settings.sampling)
    decided = settings.accuracy == "fast" or any(rule is not None for rule in own)
    return "" if decided else "--accuracy fast takes less"


class _EventCount:
    """Shows on a bar, after each keyframe, up to where the run is, and how many events it made."""

    def __init__(self, bar: Progress) -> None:
        self._bar, self._events = bar, 0

    def add(self, t_us: int, events: int) -> None:
        """Count the events of a keyframe at ``t_us``."""
        self._events += events
        rate = f", {events_a_second(1e6 * self._events / t_us)}" if t_us else ""
        self._bar.to(t_us * 1e-6, f"{self._events:,} events{rate}")


class _Written(NamedTuple):
    """Says how much of a run was written."""

    events: int
    end_us: int
    interrupted: bool


class _Sequence(NamedTuple):
    """Holds what is to be written: packets, and what has stamps of its own."""

    packets: Iterator[Packet]
    truth: GroundTruth
    inertial: ImuArray
    velocities: Velocities


@contextmanager
def _truth_file(
    folder: Path, kind: str | None, event_truth: EventTruth | None
) -> Iterator[Callable[[EventArray], None]]:
    """Open the folder's file of the events' truth, if there shall be one; give what adds events to it."""
    if kind is None or event_truth is None:
        yield lambda _: None
        return
    file = open_event_truth(folder, kind, event_truth.shape_names)
    try:
        yield lambda events: file.write(events, event_truth(events))
    finally:
        file.close()


def _write_all(
    writer: DatasetWriter,
    sequence: _Sequence,
    simulator: Simulator,
    add_truth: Callable[[EventArray], None],
    stop_requested: Callable[[], bool],
) -> _Written:
    """Write packets, with the poses and samples that fall due until their ends, until they or the user end it."""
    packets, truth, inertial, velocities = sequence
    total_us = round(simulator.scene.path.duration_s * 1e6)
    events = end_us = posed = sampled = moved = 0
    for packet in packets:
        last_us = min(packet.end_us, total_us)
        # Stamps of another clock may lie beyond the end: the last packet takes them all.
        pose_end = _up_to(truth.t_us, last_us, total_us)
        sample_end = _up_to(inertial["t"], last_us, total_us)
        poses = [(int(truth.t_us[i]), Pose(truth.positions[i], truth.quaternions[i])) for i in range(posed, pose_end)]
        moved_end = _up_to(velocities.t_us, last_us, total_us)
        writer.write(packet, poses, inertial[sampled:sample_end], velocities.select(slice(moved, moved_end)))
        add_truth(packet.events)
        posed, sampled, moved = pose_end, sample_end, moved_end
        events, end_us = events + len(packet.events), packet.end_us
        if stop_requested() and end_us > 0:  # with the first frame alone the dataset could not be checked
            for late in simulator.flush():
                writer.write(late)
                add_truth(late.events)
                events += len(late.events)
            break
    interrupted = end_us < total_us
    counts = {"dropped_events": simulator.dropped_events, "missed_events": simulator.missed_events}
    writer.finish(counts, interrupted=interrupted)
    return _Written(events, min(end_us, total_us), interrupted)


def _rendering_with(renderer: Renderer) -> str:
    """Say what renders, why, and with which LLVM."""
    with_what = f"; {default_variant()[1]}" if renderer.variant == FAST else ""  # without LLVM that is the reason
    return f"rendering with {renderer.name}: {renderer.reason}{with_what}"


def _up_to(t_us: npt.NDArray[np.int64], last_us: int, total_us: int) -> int:
    """Count the stamps that are due once the sequence has got to ``last_us`` of ``total_us``."""
    return len(t_us) if last_us >= total_us else int(np.searchsorted(t_us, last_us, "right"))
