"""Writes a simulated rig into a folder: a dataset for each camera, and what belongs to the body."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..._util.argument_error import ArgumentError
from ..._util.folder_report import FolderReport, start_line
from ..._util.progress import Progress, doing, progress, say
from ..._util.quantities import events_a_second
from ..._util.stop_requests import stop_requests
from ...geometry.pose import describe_pose
from ...io.dataset.event_truth_file import require_event_truth
from ...io.dataset.rig_folder import RigDataset, RigFolder, camera_folder
from ...io.formats import FORMATS
from ...render.scene_cache import shared_scenes
from ...scene.scene import Scene, check_scene
from ...sensor.imu import ImuArray, simulate_imu
from ...sensor.rig import Rig, load_rig, rectify
from ...sensor.rig.rig import member_seed
from ..folder import Inertial, PreparedRun, advice, prepare_run
from ..settings import FolderSettings, complete, make_motion_capture, takes_settings
from .rig_cameras import scene_of_camera, settings_of_camera
from .rig_simulator import in_step

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ..settings.keywords import FolderKeywords


@dataclass(frozen=True, kw_only=True)
class RigReport(FolderReport):
    """Says what a simulation of a rig wrote into a folder.

    Attributes:
        camera_events: how many events each camera that was simulated made, by its number.
    """

    camera_events: Mapping[int, int]

    def __str__(self) -> str:
        each = ", ".join(f"cam{camera} {events:,}" for camera, events in self.camera_events.items())
        return self._line(f"{self.events:,} events ({each})")


@takes_settings(FolderSettings)
def simulate_rig_to_folder(
    scene: Scene,
    path: str | Path,
    *,
    rig: Rig | str,
    camera_index: int | None = None,
    start_s: float = 0.0,
    duration_s: float | None = None,
    overwrite: bool = False,
    meta: Mapping[str, object] | None = None,
    quiet: bool = False,
    **settings: Unpack[FolderKeywords],
) -> RigReport:
    """Simulate a rig along the scene's path into a folder.

    >>> simulate_rig_to_folder(load_scene("three_planes"), "rig", rig="stereo-davis346", duration_s=0.1)

    The folder has a dataset for each camera (``cam0``, ``cam1``, ...), by that camera's clock and with the samples of
    the rig's first IMU on that clock. Next to them are the body's ``groundtruth.txt`` and each IMU's ``imu0.txt``, by
    the rig's clock, ``rig.yaml``, Kalibr's ``camchain.yaml`` and ``imu0.yaml``, and ``meta.json``.

    Ctrl-C (SIGINT) or SIGTERM ends it with a valid, shorter folder; a second one ends it at once.

    Args:
        scene: its camera path is that of the rig's body.
        path, overwrite: the folder, see :class:`~davis_rs.DatasetWriter`.
        rig: a rig, a preset's name, or a file.
        camera_index: simulate this camera alone; its folder is the same, byte by byte, as among all of them.
        start_s, duration_s: the part of the path to simulate, by default all from ``start_s`` on.
        meta: more for the rig's ``meta.json``.
        quiet: no progress bar, and no lines.
        {settings}

    The camera with number k > 0 has a seed that follows from (``seed``, k), so that noise is independent; IMUs
    likewise.

    Warns:
        NoEventsWarning, NoiseWarning: as :func:`simulate_to_folder`.

    Raises:
        TypeError, ValueError, OSError, ImportError: as :func:`simulate_to_folder` and :func:`load_rig`, and for
            settings that the rig decides.
    """
    check_scene(scene)
    started = time.perf_counter()
    given, rig = complete(FolderSettings, settings, taker=simulate_rig_to_folder), load_rig(rig)
    if given.imu not in (None, "none") or given.imu_rate_hz is not None or given.imu_effects:
        raise ArgumentError("{imu}, {imu_rate_hz} and {imu_effects} are those of the {rig}: leave them out")
    FORMATS[given.events_format].require_libraries()
    require_event_truth(given.event_truth)
    indices = range(len(rig.cameras)) if camera_index is None else [rig.checked_index(camera_index)]
    scene = scene.crop(start_s, duration_s)
    scenes = {camera: scene_of_camera(scene, rig, camera) for camera in indices}
    own = {camera: settings_of_camera(given, rig, camera) for camera in indices}
    body = scene.path.crop(rig.start_s)
    with progress("simulating", body.duration_s, unit="s", show=not quiet, forecast=advice(given)) as bar:
        samples = [
            simulate_imu(body, each.imu, seed=member_seed(given.seed, number)) for number, each in enumerate(rig.imus)
        ]
        runs: dict[int, PreparedRun] = {}
        with shared_scenes():
            for camera in indices:
                runs[camera] = prepare_run(scenes[camera], own[camera], _inertial(rig, camera, scenes[camera], samples))
                runs[camera].tell(quiet=quiet, stacklevel=3, prefix=f"cam{camera}: ")
        if not quiet and body.start_time_ns:
            say(start_line(body.start_time_ns, "the body's path"))
        truth = make_motion_capture(given).poses(body, seed=given.seed)
        counts = _RigProgress(rig, bar)
        bar.begin()
        doing("rendering the first keyframes")
        streams = {}
        for camera, run in runs.items():
            packets = run.made.packets(counts.of_camera(camera))
            streams[camera] = chain([next(packets)], packets)
        described = next(iter(runs.values())).describe()
        about = {
            **{name: described[name] for name in ("davis_rs", "model", "versions", "scene")},
            "rig": {"name": rig.name, "cameras": list(indices), "imus": len(rig.imus), "start_s": rig.start_s},
            "trajectory": body.describe(),
            "start_time_ns": body.start_time_ns,
            "seed": given.seed,
            **(meta or {}),
        }
        with (
            stop_requests() as stop_requested,
            RigFolder(Path(path), rig, truth, samples, overwrite=overwrite, meta=about) as folder,
            ExitStack() as stack,
        ):
            writers = {
                camera: stack.enter_context(
                    run.writer(camera_folder(folder.path, camera), meta=_about_camera(rig, camera))
                )
                for camera, run in runs.items()
            }
            ends_us = dict.fromkeys(indices, 0)
            for camera, packet in in_step(rig, streams):
                writers[camera].write(packet)
                clock = rig.cameras[camera].clock
                ends_us[camera] = round((packet.end_us * 1e-6 - clock.offset_s) / clock.pace * 1e6)
                folder.write_until(max(0, min(ends_us.values())))
                if stop_requested() and all(writer.can_end for writer in writers.values()):
                    for writer in writers.values():
                        writer.stop()
                    break
            for writer in writers.values():
                writer.finish()
            interrupted = any(writer.interrupted for writer in writers.values())
            end_us = max(ends_us.values()) if interrupted else round(body.duration_s * 1e6)
            folder.write_until(end_us)
            if {0, 1} <= writers.keys():
                _write_stereo(folder, rig, quiet=quiet)
            events = {camera: writer.events for camera, writer in writers.items()}
            totals = {"counts": {"events": sum(events.values())}, "duration_us": end_us}
            folder.finish(totals, interrupted=interrupted)
    return RigReport(
        path=Path(path),
        events=sum(events.values()),
        duration_s=end_us * 1e-6,
        wall_s=time.perf_counter() - started,
        interrupted=interrupted,
        stopped_by=stop_requested(),
        dropped_events=sum(run.simulator.dropped_events for run in runs.values()),
        missed_events=sum(run.simulator.missed_events for run in runs.values()),
        camera_events=events,
    )


def _write_stereo(folder: RigFolder, rig: Rig, *, quiet: bool) -> None:
    """Write disparity and occlusion of the first two cameras, from the depth maps that both have written."""
    try:
        rectify(rig)
    except ArgumentError as error:
        if not quiet:
            say(f"no disparity is written: {error}")
        return
    doing("writing disparities")
    for index, t_us, truth in RigDataset(folder.path).pairs():
        folder.write_stereo(index, t_us, truth)


def _inertial(rig: Rig, camera: int, scene: Scene, samples: Sequence[ImuArray]) -> Inertial | None:
    """Return the first IMU as a camera has it: mounted relative to the camera, stamped by the camera's clock.

    Raises:
        ValueError: where the clock runs so slowly that two samples have one stamp.
    """
    if not rig.imus:
        return None
    each = rig.cameras[camera]
    stamped = samples[0].copy()
    stamped["t"] = each.clock.stamps_us(samples[0]["t"])
    stamped = stamped[(stamped["t"] >= 0) & (stamped["t"] <= round(scene.path.duration_s * 1e6))]
    if (np.diff(stamped["t"]) <= 0).any():
        raise ArgumentError(
            "the {rig}'s imu0 has {:g} samples a second, which the clock of cam{} cannot tell apart in microseconds",
            *(rig.imus[0].imu.rate_hz, camera),
        )
    return Inertial(rig.imus[0].seen_from(each.mount), stamped)


def _about_camera(rig: Rig, camera: int) -> dict[str, object]:
    """Return what a camera's ``meta.json`` says of the rig."""
    each = rig.cameras[camera]
    clock = {"offset_s": each.clock.offset_s, "drift": each.clock.drift}
    return {"rig": {"name": rig.name, "camera": camera, "T_body_camera": describe_pose(each.mount), "clock": clock}}


class _RigProgress:
    """Shows on a bar, after each keyframe, up to where all cameras are, and how many events they made."""

    def __init__(self, rig: Rig, bar: Progress) -> None:
        self._rig, self._bar, self._events = rig, bar, 0
        self._until: dict[int, float] = {}

    def of_camera(self, camera: int) -> Callable[[int, int], None]:
        """Return what counts the events of a camera."""
        self._until[camera] = 0.0
        return partial(self._add, camera)

    def _add(self, camera: int, t_us: int, events: int) -> None:
        """Count the events of a keyframe of a camera at ``t_us`` of its clock."""
        self._events += events
        clock = self._rig.cameras[camera].clock
        self._until[camera] = max(0.0, (t_us * 1e-6 - clock.offset_s) / clock.pace)
        until_s = min(self._until.values())
        rate = f", {events_a_second(self._events / until_s)}" if until_s else ""
        self._bar.to(until_s, f"{self._events:,} events{rate}")
