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
from .._util.argument_error import ArgumentError
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
from ..sensor.imu import IMU_DTYPE, Imu, ImuArray, simulate_imu
from ..sensor.motion_capture import MotionCapture
from .darkness import estimate_darkness
from .frame_gain import path_image_gain
from .monte_carlo_noise import refuse_noise
from .pixel_error import estimate_pixel_error
from .planning import EffectPlan
from .run_time import estimate_run_time
from .settings import FolderSettings, complete, make_imu, make_motion_capture, takes_settings
from .simulate import MadeSimulator, make_simulator
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
    on_packet: Callable[[Packet, tuple[int, int]], object] | None = None,
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
        on_packet: is called with each packet that was written and the (width, height) of the sensor: for showing it.
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
    imu = make_imu(given)
    scene = scene.crop(start_s, duration_s)
    with progress("simulating", scene.path.duration_s, unit="s", show=not quiet, forecast=advice(given)) as bar:
        inertial = None if imu is None else Inertial(imu, simulate_imu(scene.path, imu, seed=given.seed))
        run = prepare_run(scene, given, inertial)
        foretold = run.tell(quiet=quiet, stacklevel=3)
        if not quiet and scene.path.start_time_ns:
            say(start_line(scene.path.start_time_ns, "the camera path"))
        count = _EventCount(bar)
        bar.begin(foretold=foretold)
        doing("rendering the first keyframes")
        packets = run.made.packets(count.add)
        # Whatever is wrong with the scene shows before the folder is touched.
        first = next(packets)
        with (
            stop_requests() as stop_requested,  # before the folder is made: a signal must not leave an empty one
            run.writer(path, overwrite=overwrite, meta=meta) as writer,
        ):
            for packet in chain([first], packets):
                writer.write(packet)
                if on_packet is not None:
                    on_packet(packet, (run.simulator.camera.width, run.simulator.camera.height))
                if stop_requested() and writer.can_end:
                    writer.stop()
                    break
            writer.finish()
    wall_s = time.perf_counter() - started
    return SimulationReport(
        path=Path(path),
        events=writer.events,
        duration_s=writer.end_us * 1e-6,
        wall_s=wall_s,
        interrupted=writer.interrupted,
        stopped_by=stop_requested(),
        dropped_events=run.simulator.dropped_events,
        missed_events=run.simulator.missed_events,
        plan=run.made.plan,
    )


class Inertial(NamedTuple):
    """Holds an IMU and its samples, on the clock of the folder that gets them."""

    imu: Imu
    samples: ImuArray


def prepare_run(scene: Scene, given: FolderSettings, inertial: Inertial | None) -> PreparedRun:
    """Make all that a folder needs before the first packet: the simulator, and what has stamps of its own.

    Args:
        scene: with the camera path that is simulated, from its t = 0 to its end.
        given: the settings; those of the IMU are not looked at.
        inertial: the IMU and its samples; None for none.

    Raises:
        ValueError, OSError, ImportError: as :func:`simulate_to_folder`.
    """
    if given.flow_png is not None and given.flow_interval_s is None:
        raise ArgumentError("{flow_png} is that of displacements: give {flow_interval_s}")
    motion_capture = make_motion_capture(given)
    made = make_simulator(scene, given)
    if given.accept_noise is False:
        refuse_noise(made.noise, scene, given)
    end_us = round(1e6 * scene.path.duration_s)
    moving_us = np.fromiter(periodic_instants(given.velocity_rate_hz, 0, end_us), np.int64)
    event_truth = None
    if given.event_truth is not None:
        simulator = made.simulator
        event_truth = EventTruth(simulator.scene, simulator.camera, surfaces=simulator.surfaces, threads=given.threads)
    return PreparedRun(
        scene=scene,
        given=given,
        made=made,
        motion_capture=motion_capture,
        truth=motion_capture.poses(scene.path, seed=given.seed),
        velocities=camera_velocities(scene.path, moving_us),
        inertial=inertial,
        event_truth=event_truth,
    )


@dataclass(frozen=True, kw_only=True)
class PreparedRun:
    """Holds a simulation of one camera that is ready to be written into a folder.

    Attributes:
        scene: with the camera path.
        given: the settings.
        made: the simulator, and what was found out before it was made.
        motion_capture: that gives the ground truth.
        truth: the camera's poses, as stamped.
        velocities: of the camera.
        inertial: the IMU and its samples; None for none.
        event_truth: what gives the truth of each event; None for none.
    """

    scene: Scene
    given: FolderSettings
    made: MadeSimulator
    motion_capture: MotionCapture
    truth: GroundTruth
    velocities: Velocities
    inertial: Inertial | None
    event_truth: EventTruth | None

    @property
    def simulator(self) -> Simulator:
        """Return the simulator."""
        return self.made.simulator

    def tell(self, *, quiet: bool, stacklevel: int, prefix: str = "") -> bool:
        """Say who renders, how many events that makes wrong, that most is dark, and that much memory or time will be
        taken.

        Args:
            quiet: only warn of noise.
            stacklevel: of the warning, as seen from the caller of this method.
            prefix: in front of each line.

        Returns:
            Whether it was said how long the run will take.

        Warns:
            NoiseWarning: if ``quiet``, where more of the events will be noise than may be.
        """
        if quiet:
            self.made.warn_of_noise(stacklevel=stacklevel + 1)
            return False
        simulator = self.simulator
        for line in (_rendering_with(simulator.renderer), self.made.noise_line, simulator.memory.line()):
            if line:
                say(prefix + line)
        darkness = estimate_darkness(simulator.renderer, self.scene.path, log_eps=simulator.log_eps)
        if darkness is not None:
            say(f"{prefix}{darkness}")
        run_time = estimate_run_time(simulator.renderer, self.scene.path, simulator.sampling)
        if run_time is not None:
            say(f"{prefix}{run_time}")
        thresholds = simulator.contrast_threshold, simulator.contrast_threshold_off
        error = estimate_pixel_error(
            simulator.renderer, self.scene.path, thresholds=thresholds, log_eps=simulator.log_eps
        )
        if error is not None:
            say(f"{prefix}{error}")
        return run_time is not None

    def describe(self) -> dict[str, object]:
        """Return what ``meta.json`` says of the run."""
        made, imu = self.made, None if self.inertial is None else self.inertial.imu
        noise = None if made.noise is None else made.noise.describe(self.simulator.renderer.rays_per_pixel)
        return {
            **self.simulator.describe(),
            "effect_plan": None if made.plan is None else made.plan.describe(),
            "monte_carlo_noise": noise,
            "trajectory": self.scene.path.describe(),
            "start_time_ns": self.scene.path.start_time_ns,
            "pose_rate_hz": self.motion_capture.rate_hz,
            "motion_capture": self.motion_capture.describe(),
            "imu": None if imu is None else imu.describe(),
        }

    @contextmanager
    def writer(
        self, path: str | Path, *, overwrite: bool = False, meta: Mapping[str, object] | None = None
    ) -> Iterator[RunWriter]:
        """Open the folder; it is closed with what was written, whatever happens.

        Args:
            path, overwrite: see :class:`~davis_rs.DatasetWriter`.
            meta: more for ``meta.json``.
        """
        given, simulator, gain = self.given, self.simulator, self.given.image_gain
        if gain is None and given.frame_rate_hz > 0:
            gain = path_image_gain(simulator, self.scene.path)
        with (
            DatasetWriter(
                path,
                simulator.camera,
                image_gain=gain,
                events_format=given.events_format,
                overwrite=overwrite,
                shape_names=simulator.shape_names,
                flow_png=given.flow_png,
                signal_window_us=given.signal_window_us,
                imu=None if self.inertial is None else self.inertial.imu,
                meta={**self.describe(), **(meta or {})},
            ) as dataset,
            _truth_file(dataset.path, given.event_truth, self.event_truth) as add_truth,
        ):
            yield RunWriter(self, dataset, add_truth)


class RunWriter:
    """Writes a run's packets, each with the poses and samples that fall due until its end.

    Attributes:
        events: how many are written.
        interrupted: the run was finished before its end.
    """

    def __init__(self, run: PreparedRun, dataset: DatasetWriter, add_truth: Callable[[EventArray], None]) -> None:
        self._run, self._dataset, self._add_truth = run, dataset, add_truth
        self._total_us = round(run.scene.path.duration_s * 1e6)
        self._samples = np.zeros(0, IMU_DTYPE) if run.inertial is None else run.inertial.samples
        self._posed = self._sampled = self._moved = 0
        self._last_us = 0
        self.events = 0
        self.interrupted = False

    @property
    def end_us(self) -> int:
        """Return up to where the folder goes, microseconds of the sequence."""
        return min(self._last_us, self._total_us)

    @property
    def can_end(self) -> bool:
        """Return whether the folder could be checked if it ended now: with the first frame alone it could not."""
        return self._last_us > 0

    def write(self, packet: Packet) -> None:
        """Write a packet, and what falls due until its end."""
        last_us, total_us = min(packet.end_us, self._total_us), self._total_us
        truth, velocities = self._run.truth, self._run.velocities
        # Stamps of another clock may lie beyond the end: the last packet takes them all.
        posed = _up_to(truth.t_us, last_us, total_us)
        sampled = _up_to(self._samples["t"], last_us, total_us)
        moved = _up_to(velocities.t_us, last_us, total_us)
        numbers = range(self._posed, posed)
        poses = [(int(truth.t_us[i]), Pose(truth.positions[i], truth.quaternions[i])) for i in numbers]
        samples, moving = self._samples[self._sampled : sampled], velocities.select(slice(self._moved, moved))
        self._dataset.write(packet, poses, samples, moving)
        self._add_truth(packet.events)
        self._posed, self._sampled, self._moved = posed, sampled, moved
        self.events, self._last_us = self.events + len(packet.events), packet.end_us

    def stop(self) -> None:
        """Write what the readout still holds, because no more packets of the run will come."""
        for late in self._run.simulator.flush():
            self._dataset.write(late)
            self._add_truth(late.events)
            self.events += len(late.events)

    def finish(self) -> None:
        """Finish the folder; one that does not reach the end of the run is marked as interrupted."""
        simulator = self._run.simulator
        self.interrupted = self._last_us < self._total_us
        counts = {"dropped_events": simulator.dropped_events, "missed_events": simulator.missed_events}
        self._dataset.finish(counts, interrupted=self.interrupted)


def advice(settings: FolderSettings) -> str:
    """Say how a long run would take less time: the fastest preset is named where it would change something."""
    own = (settings.render_rate_hz, settings.max_displacement_px, settings.tolerance, settings.sampling)
    decided = settings.accuracy == "fast" or any(rule is not None for rule in own)
    return f"a shorter --duration{'' if decided else ' or --accuracy fast'} takes less"


class _EventCount:
    """Shows on a bar, after each keyframe, up to where the run is, and how many events it made."""

    def __init__(self, bar: Progress) -> None:
        self._bar, self._events = bar, 0

    def add(self, t_us: int, events: int) -> None:
        """Count the events of a keyframe at ``t_us``."""
        self._events += events
        rate = f", {events_a_second(1e6 * self._events / t_us)}" if t_us else ""
        self._bar.to(t_us * 1e-6, f"{self._events:,} events{rate}")


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


def _rendering_with(renderer: Renderer) -> str:
    """Say what renders, why, and with which LLVM."""
    with_what = f"; {default_variant()[1]}" if renderer.variant == FAST else ""  # without LLVM that is the reason
    return f"rendering with {renderer.name}: {renderer.reason}{with_what}"


def _up_to(t_us: npt.NDArray[np.int64], last_us: int, total_us: int) -> int:
    """Count the stamps that are due once the sequence has got to ``last_us`` of ``total_us``."""
    return len(t_us) if last_us >= total_us else int(np.searchsorted(t_us, last_us, "right"))
