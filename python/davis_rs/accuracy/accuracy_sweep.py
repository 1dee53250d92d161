"""Sweeps settings of the simulator, each measured against references and by the clock."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..events.arrays import EventArray, concatenate_events
from ..events.matching import compare_events
from ..geometry.camera import Camera
from ..geometry.pose import FloatArray
from ..geometry.trajectory.trajectory import Trajectory
from ..render.base import Renderer
from ..render.choice import make_renderer
from ..sampling.displacement import DisplacementClock
from ..sampling.observe import CountedRenderer, LumaRecorder
from ..sampling.rules import TimeSampling
from ..scene.scene import Scene
from ..simulation.simulator import Simulator
from .reference_events import TICKS_PER_US, FineReference, Recipe, exact_crossings, fine_reference, in_ticks
from .settings import Setting

FINE_RAYS = 1024

_PATH_PX, _TIMED_PARTS = 6.0, 4
_MOST_RECORDED = 16
SLOW_S = 3.0
"""A setting that takes longer than this for the judged part alone is timed on that part, and once."""

_WARM_UP = 0.1
"""Share of the judged part that is run beforehand: all kernels are compiled by then."""

_LONGEST_WINDOW_US = 10_000

_LOOK_S, _MOST_LOOKS = 0.01, 256
"""The middle of the fastest pixel's path is found from its speed at up to ``_MOST_LOOKS`` places of a trajectory, each
measured over ``_LOOK_S`` seconds."""


class Errors(NamedTuple):
    """Says how far a setting's events and log luma are from a reference's.

    Attributes:
        median_us, p99_us: of the absolute time error of events that have a partner.
        missing_percent, spurious_percent: of the reference's events.
        log_rms: root mean square error of log luma between renders, in units of C.
    """

    median_us: float
    p99_us: float
    missing_percent: float
    spurious_percent: float
    log_rms: float


@dataclass
class Measurement:
    """Holds what was measured of a setting.

    Attributes:
        pixel: whether its luma was a mean over ``rays`` or taken by ``lines``.
        refined: whether its event times were refined.
        events: how many it made in the judged part.
        keyframes_per_s, rays_per_s: rendered per simulated second, rays for depth and for single pixels included.
        in_time: errors against the crossings of the same rays or lines; None for random rays, and where nobody asks.
        in_all: errors against the fine reference.
        kept_percent: share of pixels whose log luma errs no more than the setting promises, at the same instants as
            ``log_rms`` and against the same rays; None where nothing is promised, and for random rays.
        slow: it takes so long that its run on the judged part is the only one timed.
        wall_s: of each timed round, wall time per simulated second.
    """

    setting: Setting
    pixel: str
    refined: bool
    events: int
    keyframes_per_s: float
    rays_per_s: float
    in_time: Errors | None
    in_all: Errors
    kept_percent: float | None
    slow: bool
    wall_s: list[float]

    @property
    def median_wall_s(self) -> float:
        return float(np.median(self.wall_s))


class Sweep:
    """Judges settings on a short part of a trajectory, and times them on a longer one.

    Args:
        scene: with its camera path, see :meth:`Scene.with_trajectory`.
        start_s: where the part begins; None: where the fastest pixel has gone half of its path.
        duration_s: of the judged part; None: until the fastest pixel has moved ``path_px`` pixels. The timed part is
            ``timed_parts`` times as long, where the trajectory is.
        camera: None takes the scene's.
        folder: keeps the frames of the fine reference for another time.
        fine_rays: rays a pixel of the fine reference.

    Raises:
        ValueError: if there is no such part of a trajectory, or nothing moves in it.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        start_s: float | None = None,
        duration_s: float | None = None,
        camera: Camera | None = None,
        folder: str | Path,
        fine_rays: int = FINE_RAYS,
        path_px: float = _PATH_PX,
        timed_parts: int = _TIMED_PARTS,
    ) -> None:
        self.scene = scene
        self.camera, self.folder, self.fine_rays = camera or scene.own_camera, Path(folder), fine_rays
        whole = self.scene.path
        renderer = make_renderer(self.scene, self.camera, rays_per_pixel=1)
        if start_s is None:
            start_s = min(half_way_s(renderer, whole), max(whole.duration_s - (duration_s or 0.0), 0.0))
        rest = self.scene.crop(start_s)
        renderer = make_renderer(rest, self.camera, rays_per_pixel=1)
        rest_s = rest.path.duration_s
        clock = DisplacementClock(renderer, rest.path, round(rest_s * 1e6))
        if duration_s is None:
            reached_us = clock.time_at(path_px)
            duration_s = rest_s if reached_us is None else max(reached_us, 1) * 1e-6
        self._judged = rest.crop(0.0, duration_s)
        judged = self._judged.path
        self.start_s, self.duration_s = start_s, judged.duration_s
        self.path_px = DisplacementClock(renderer, judged, round(duration_s * 1e6)).path_at(round(duration_s * 1e6))
        if self.path_px <= 0:
            raise ValueError(
                f"nothing moves in the {duration_s} s from {start_s} s of the trajectory: nothing to judge"
            )
        self._timed = rest.crop(0.0, min(timed_parts * duration_s, rest_s))
        # One pixel's way: what lies further apart is not the same crossing.
        window_us = int(np.clip(duration_s * 1e6 / self.path_px, 1, _LONGEST_WINDOW_US))
        self.recipe = Recipe(judged, scene.contrast_threshold, 1e-3, window_us)
        self._crossings: dict[tuple[int, str], EventArray] = {}
        self._logs: dict[tuple[int, str], FloatArray] = {}

    @property
    def timed_s(self) -> float:
        """Return how long the timed part is, in seconds of the trajectory."""
        return self._timed.path.duration_s

    def measure(self, setting: Setting, *, same_rays: bool = True) -> Measurement:
        """Judge a setting, and time it unless it is slow: then the judged part is its one timed run.

        Args:
            same_rays: judge it against the exact crossings of its own rays too, which may take longer than it does.
        """
        seconds = self.duration_s
        for _ in self._simulator(setting, setting.sampling, self._judged.crop(0, _WARM_UP * seconds)).run():
            pass
        recorder = LumaRecorder(setting.sampling, self._recorded_us, self.recipe.log_eps)
        simulator = self._ready(setting, recorder, self._judged)
        simulator.renderer = counted = CountedRenderer(simulator.renderer)
        started = time.perf_counter()
        events = concatenate_events([packet.events for packet in simulator.run()])
        wall_s = time.perf_counter() - started
        log = np.stack(recorder.log)
        in_time, kept_percent = None, None
        of_pixel = counted.rays_per_pixel, counted.pixel
        if same_rays and not setting.random:
            in_time = self._errors(events, log, self._same_crossings(*of_pixel), self._same_log(*of_pixel))
        if setting.promised is not None and not setting.random:
            errors = np.abs(log - self._same_log(*of_pixel))
            kept = errors <= setting.promised * self.recipe.contrast_threshold
            kept_percent = 100 * float(kept.mean())
        in_all = self._errors(events, log, self.fine.events, self._fine_log)
        rates = recorder.keyframe_count / seconds, counted.count / seconds
        wall_s_per_s = wall_s / seconds if wall_s > SLOW_S else self.time(setting)
        slow = wall_s > SLOW_S
        found = len(events), *rates, in_time, in_all, kept_percent, slow, [wall_s_per_s]
        return Measurement(setting, counted.pixel, simulator.refine, *found)

    def time(self, setting: Setting) -> float:
        """Return the wall time per simulated second, of one run that keeps nothing."""
        simulator = self._ready(setting, setting.sampling, self._timed)
        started = time.perf_counter()
        for _ in simulator.run():
            pass
        return (time.perf_counter() - started) / self.timed_s

    def prepare(self) -> Iterator[tuple[int, int]]:
        """Render the fine reference, unless the folder holds it.

        Yields after each frame how many there are, and how many there will be at most.
        """
        renderer = self._renderer(self.fine_rays)
        cached = self.folder / f"reference_{self.fine_rays}_rays.npz"
        self.fine: FineReference = yield from fine_reference(renderer, self.recipe, cached)
        # At the rendered instants of the reference nothing of it is interpolated.
        inner = np.arange(1, len(self.fine.t_us) - 1)
        chosen = inner[:: -(-len(inner) // _MOST_RECORDED)] if len(inner) else np.array([len(self.fine.t_us) - 1])
        self._recorded_us = self.fine.t_us[chosen]
        self._fine_log = self.recipe.log_luma(self.fine.luma[chosen])

    def _same_crossings(self, rays_per_pixel: int, pixel: str) -> EventArray:
        """Return the exact crossings of the same rays, or of the same lines."""
        key = rays_per_pixel, pixel
        if key not in self._crossings:
            self._crossings[key] = exact_crossings(self._renderer(*key), self.recipe).events
        return self._crossings[key]

    def _same_log(self, rays_per_pixel: int, pixel: str) -> FloatArray:
        """Return log luma of the same rays or lines, rendered at the recorded instants."""
        key = rays_per_pixel, pixel
        if key not in self._logs:
            luma = self._renderer(*key).luma(self.recipe.views(self._recorded_us * TICKS_PER_US))
            self._logs[key] = self.recipe.log_luma(luma)
        return self._logs[key]

    def _errors(self, events: EventArray, log: FloatArray, reference: EventArray, reference_log: FloatArray) -> Errors:
        size, window = (self.camera.width, self.camera.height), self.recipe.window_us * TICKS_PER_US
        comparison = compare_events(in_ticks(events), reference, size=size, window_us=window)
        log_rms = float(np.sqrt(np.mean((log - reference_log) ** 2))) / self.recipe.contrast_threshold
        median_us, p99_us = comparison.median_us / TICKS_PER_US, comparison.p99_us / TICKS_PER_US
        return Errors(median_us, p99_us, comparison.missing_percent, comparison.spurious_percent, log_rms)

    def _renderer(self, rays_per_pixel: int, pixel: str = "rays") -> Renderer:
        return make_renderer(self._judged, self.camera, rays_per_pixel=rays_per_pixel, pixel=pixel)

    def _ready(self, setting: Setting, sampling: TimeSampling, scene: Scene) -> Simulator:
        """Make a simulator that has all of what a renderer makes when it is first asked for luma."""
        simulator = self._simulator(setting, sampling, scene)
        simulator.renderer.luma(self.recipe.views(np.zeros(1, np.int64)))
        return simulator

    def _simulator(self, setting: Setting, sampling: TimeSampling, scene: Scene) -> Simulator:
        # With a preset, the scene decides whether lines are possible.
        by_hand = {"rays_per_pixel": setting.rays_per_pixel, "pixel": setting.pixel, "refine": setting.refine}
        of_pixel: dict[str, Any] = {"accuracy": setting.preset} if setting.preset else by_hand
        return Simulator(
            scene,
            camera=self.camera,
            frame_rate_hz=0,
            depth_rate_hz=0,
            sampling=sampling,
            renderer=setting.renderer,
            **of_pixel,
        )


def sweep(prepared: Sweep, settings: Sequence[Setting], rounds: int) -> Iterator[list[Measurement]]:
    """Measure settings, and time them in rounds, each round all of them; yields what there is after each run.

    So whatever slows the machine for a while slows a round of all, not all rounds of one; the median of a setting's
    rounds leaves it out.
    """
    measured: list[Measurement] = []
    for setting in settings:
        measured.append(prepared.measure(setting))
        yield measured
    for _ in range(rounds - 1):
        for measurement in measured:
            if not measurement.slow:
                measurement.wall_s.append(prepared.time(measurement.setting))
            yield measured


def half_way_s(renderer: Renderer, trajectory: Trajectory) -> float:
    """Return the time in seconds at which the fastest pixel has gone half of its path; 0 if nothing moves.

    The path is added up from short looks, one in each of many equal parts of the trajectory: to follow all of a long
    one would take minutes.
    """
    duration_s = trajectory.duration_s
    looks = min(_MOST_LOOKS, math.ceil(duration_s / _LOOK_S))
    edges_s = np.linspace(0.0, duration_s, looks + 1)
    path = [0.0]
    for start_s in edges_s[:-1].tolist():
        look_us = max(1, round(1e6 * min(_LOOK_S, duration_s / looks)))
        look = trajectory.crop(start_s, look_us * 1e-6)
        speed = DisplacementClock(renderer, look, look_us, start_us=round(start_s * 1e6)).path_at(look_us) / look_us
        path.append(path[-1] + speed)
    return float(np.interp(path[-1] / 2, path, edges_s)) if path[-1] > 0 else 0.0
