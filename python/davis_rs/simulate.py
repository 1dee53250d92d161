"""The simulator: scene, camera and trajectory in, packets of events, frames, depth and poses out."""

from __future__ import annotations

import hashlib
import heapq
from collections.abc import Iterator
from dataclasses import asdict
from itertools import groupby, repeat, tee
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ._core import CrossingEngine, __version__
from ._mitsuba import versions
from .camera import Camera
from .effects import Effects, with_optics
from .events import EventArray, concatenate_events
from .packet import Packet
from .plan import EffectPlan, plan_effects_of
from .pose import Pose
from .rendering.renderers import make_renderer
from .sampling.exposure import expose
from .sampling.keyframes import Keyframe, Stretch
from .sampling.presets import accuracy_preset
from .sampling.refine import refine as refine_events
from .sampling.rules import TimeSampling, periodic_instants
from .scene.scene import Scene
from .sensor_parameters import SensorParameters, sensor_parameters
from .trajectory.trajectory import SegmentTrajectory, Trajectory, interval
from .trajectory.views import Views

_PACKET_RATE_HZ = 40.0
"""Where no frame or depth map falls due, packets still end this often, so that memory stays bounded."""


class _Due(NamedTuple):
    """An instant at which a packet ends, and what else falls due there."""

    t_us: int
    frame: bool
    depth: bool


class Simulator:
    """A DAVIS in a scene.

    :meth:`run` follows a trajectory; :meth:`step` serves a controller that decides the next pose as it goes. Every
    intensity frame and depth map is one of the rendered instants, so events, frames and depth agree exactly.

    Args:
        scene: see :class:`~davis_rs.scene.scene.Scene`.
        camera: None takes the scene's.
        contrast_threshold: C_on in natural-log units; None takes the sensor's, or else the scene's.
        contrast_threshold_off: C_off; None takes the sensor's, or else C_on.
        log_eps: dark level in units of luma: L = ln(luma + log_eps).
        frame_rate_hz, depth_rate_hz: instant k of either is round(k 1e6 / rate) us; 0 for none.
        accuracy: ``fast``, ``balanced`` or ``exact``, see :data:`~davis_rs.sampling.presets.ACCURACY`: what the next
            two and ``refine`` are where they are not given; None is the paper's rule.
        sampling: when to render; by the paper's rule whenever a pixel may have moved by a third of a pixel.
        samples: rays a pixel, 1..1024; by the paper's rule 8, or 2 for Mitsuba's integrators without LLVM.
        sensor: a preset of :data:`~davis_rs.SENSORS` by its name, or parameters of a sensor: thresholds and effects
            where the other arguments do not give them.
        effects: what makes pixels, readout and frames differ from ideal ones: :class:`~davis_rs.Effects`, over those of
            ``sensor``; ``auto`` for those of ``sensor`` (davis240c if not given) whose neglect would show in this
            scene: see :func:`~davis_rs.plan_effects`. None is the ideal sensor.
        seed: of thresholds and noise, and of Mitsuba's integrators where one of them renders; 0..2^64 - 1.
        threads: of the crossing engine; None means as many as pay. Results do not depend on it.
        renderer: ``auto``, ``native``, ``table`` or ``integrator``, see
            :func:`~davis_rs.rendering.renderers.make_renderer`.
        blur: the 3 x 3 blur of luma; None leaves it to the scene.
        refine: polish each event's time by asking the renderer itself, to the microsecond; slow, and for ideal pixels
            alone. See :func:`~davis_rs.sampling.refine.refine`.
        poses_per_launch: rendered in one call; None leaves it to the renderer. Results do not depend on it.

    Raises:
        ValueError: for a value out of range or a scene that cannot be rendered.
        OSError: if a scene file cannot be read.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        camera: Camera | None = None,
        contrast_threshold: float | None = None,
        contrast_threshold_off: float | None = None,
        log_eps: float = 1e-3,
        frame_rate_hz: float = 40.0,
        depth_rate_hz: float = 40.0,
        accuracy: str | None = None,
        sampling: TimeSampling | None = None,
        samples: int | None = None,
        sensor: str | SensorParameters | None = None,
        effects: Effects | str | None = None,
        seed: int = 0,
        threads: int | None = None,
        renderer: str = "auto",
        blur: bool | None = None,
        refine: bool | None = None,
        poses_per_launch: int | None = None,
    ) -> None:
        self.scene = scene
        self.camera = camera or scene.camera
        if not (effects is None or effects == "auto" or isinstance(effects, Effects)):
            raise ValueError(f"effects must be davis_rs.Effects, 'auto' or None, got {effects!r}")
        preset = accuracy_preset(accuracy)
        self.sampling = sampling or preset.sampling
        if samples is None and accuracy is not None:
            samples = preset.samples
        automatic = effects == "auto"
        sensor = sensor_parameters("davis240c" if sensor is None and automatic else sensor)
        contrast_threshold = _first(contrast_threshold, sensor.contrast_threshold, scene.contrast_threshold)
        contrast_threshold_off = _first(contrast_threshold_off, sensor.contrast_threshold_off, contrast_threshold)
        self.parameters: dict[str, Any] = {
            "contrast_threshold": contrast_threshold,
            "contrast_threshold_off": contrast_threshold_off,
            "log_eps": log_eps,
            "frame_rate_hz": frame_rate_hz,
            "depth_rate_hz": depth_rate_hz,
            "seed": seed,
        }
        for rate_hz in (frame_rate_hz, depth_rate_hz):
            periodic_instants(rate_hz, 0, 0)  # refuses bad rates before anything is loaded
        if poses_per_launch is not None and poses_per_launch < 1:
            raise ValueError(f"poses_per_launch must be at least 1, got {poses_per_launch}")
        self._thresholds = (contrast_threshold, contrast_threshold_off)
        self._threads = threads
        self._refine, self._refine_by_default = refine, preset.refine
        self.renderer = make_renderer(
            scene, self.camera, samples=samples, seed=seed, kind=renderer, blur=blur, edges=self.sampling.edges
        )
        self._poses_per_launch = poses_per_launch or self.renderer.poses_per_launch
        self._pose: Pose | None = None
        self._last: Keyframe | None = None
        self._t_us = 0
        self._exposed: list[Stretch] = []
        self._frames = 0
        self.plan: EffectPlan | None = None  # of effects="auto", once it runs
        self.effects, self.refine = Effects(), False
        candidates = sensor.effects(scene.lux_per_luma)
        self._candidates = candidates if automatic else None
        if not isinstance(effects, str):
            self._take_effects((effects or Effects()).over(candidates))

    def _take_effects(self, effects: Effects) -> None:
        """Put the lens before the renderer, and make the pixels behind it."""
        aps, in_engine = effects.aps, effects.engine_settings()
        rate_hz = self.parameters["frame_rate_hz"]
        if aps is not None and aps.exposure_us * rate_hz > 1e6:
            raise ValueError(
                f"the exposure of {aps.exposure_us:g} us must not exceed the frames' period of {1e6 / rate_hz:g} us"
            )
        if self._refine and in_engine:
            raise ValueError(
                f"refine finds the times of ideal pixels: it cannot be combined with {', '.join(in_engine)}"
            )
        self.refine = bool(self._refine_by_default and not in_engine if self._refine is None else self._refine)
        self.effects = effects
        self._engine = CrossingEngine(
            self.camera.width,
            self.camera.height,
            contrast_threshold=self._thresholds[0],
            contrast_threshold_off=self._thresholds[1],
            log_eps=self.parameters["log_eps"],
            interpolation=self.sampling.interpolation,
            effects=in_engine,
            seed=self.parameters["seed"],
            threads=self._threads,
        )
        self.renderer = with_optics(self.renderer, effects.vignetting, effects.lens_blur_px)

    def run(self, trajectory: Trajectory) -> Iterator[Packet]:
        """Simulate a trajectory from its start to its end; memory stays bounded, however long it is.

        Only a readout that carries less than comes, and drops none, holds more and more.

        Yields:
            Packets that tile the time; the first ends at 0 and has no events. One ends at every instant where a frame
            or a depth map falls due, and at the end. Where a readout still holds events then, one more brings them.

        Raises:
            ValueError: if the simulator has run before, or no ray hits anything anywhere along the trajectory.
        """
        if self._pose is not None:
            raise ValueError("this simulator has run already; its pixels remember: make a new one for a new sequence")
        self._refuse_empty_view(trajectory)
        if self._candidates is not None:
            self.plan = plan_effects_of(
                self.renderer,
                trajectory,
                self._candidates,
                contrast_threshold=self._thresholds[0],
                contrast_threshold_off=self._thresholds[1],
                log_eps=self.parameters["log_eps"],
                seed=self.parameters["seed"],
            )
            self._take_effects(self.plan.effects)
        end_us = round(trajectory.duration_s * 1e6)
        yield from self._packets(trajectory, 0, end_us)
        yield from self.flush()

    def step(self, t_us: int, pose: Pose) -> list[Packet]:
        """Move the camera to ``pose`` at ``t_us``; return the packets since the last step.

        Between two poses the camera moves at constant velocity and body rate, and is rendered as often as ``sampling``
        asks. The first step must be at 0: it sets the references. The last packet ends at ``t_us``; the others
        end where frames and depth maps fall due between.

        Raises:
            ValueError: for a first step that is not at 0, a time that does not increase, or effects ``auto``, which
                need a whole trajectory to look at.
        """
        if self._candidates is not None:
            raise ValueError("effects='auto' looks at a whole trajectory: it serves run(), not step()")
        if self._pose is None:
            if t_us != 0:
                raise ValueError(f"the first step must be at t = 0 us, got {t_us} us")
            # A duration is needed for a trajectory, but nothing after its start is rendered.
            return list(self._packets(SegmentTrajectory(pose, pose, 1.0), 0, 0))
        if t_us <= self._t_us:
            raise ValueError(f"the time of a step must be after the last one ({self._t_us} us), got {t_us} us")
        segment = SegmentTrajectory(self._pose, pose, (t_us - self._t_us) * 1e-6)
        return list(self._packets(segment, self._t_us, t_us))

    def flush(self) -> list[Packet]:
        """What a readout still holds: a packet of events that came until now and are stamped later, if there are any.

        :meth:`run` ends with it by itself; after :meth:`step` it is the caller's to ask for.
        """
        late = self._engine.flush()
        if not len(late) or self._pose is None:
            return []
        return [Packet(self._t_us, int(late["t"][-1]), late, self._pose)]

    @property
    def dropped_events(self) -> int:
        """How many events the readout has dropped; 0 unless it is told to."""
        return self._engine.dropped_events

    def describe(self) -> dict[str, Any]:
        """Everything that is needed to repeat the run, for meta.json."""
        scene: dict[str, Any] = {"name": self.scene.name, "lux_per_luma": self.scene.lux_per_luma}
        if self.scene.file is not None:
            digest = hashlib.sha256(self.scene.file.read_bytes()).hexdigest()
            scene |= {"file": str(self.scene.file), "sha256": digest}
        scene["objects"] = {name: trajectory.describe() for name, trajectory in self.scene.objects.items()}
        scene["lights"] = {name: course.describe() for name, course in self.scene.lights.items()}
        return {
            "davis_rs": __version__,
            "versions": {"numpy": np.__version__, **versions(self.renderer.variant)},
            "scene": scene,
            "camera": asdict(self.camera),
            "sensor": {"width": self.camera.width, "height": self.camera.height},
            "renderer": {"name": self.renderer.name, "reason": self.renderer.reason},
            "parameters": {
                **self.parameters,
                "samples": self.renderer.rays,
                "blur": self.renderer.blur,
                "sampling": repr(self.sampling),
                "refine": self.refine,
            },
            "effects": self.effects.describe(),
        }

    def _packets(self, trajectory: Trajectory, start_us: int, end_us: int) -> Iterator[Packet]:
        """Packets of (start_us, end_us], or of the very first instant too; the trajectory starts at ``start_us``."""
        instants, ahead = tee(self._due(start_us, end_us))
        stretch = Stretch(
            renderer=self.renderer,
            trajectory=trajectory,
            start_us=start_us,
            end_us=end_us,
            first=self._pose is None,
            due=(instant.t_us for instant in ahead),
            contrast_threshold=min(self._thresholds),
            log_eps=self.parameters["log_eps"],
            batch=self._poses_per_launch,
        )
        # A shutter that is open now may have opened some stretches ago.
        open_us = start_us - (0 if self.effects.aps is None else round(self.effects.aps.exposure_us))
        self._exposed = [*(before for before in self._exposed if before.end_us > open_us), stretch]
        pending: list[EventArray] = []
        due = next(instants)
        for keyframe in self.sampling.keyframes(stretch):
            pending.append(self._take(keyframe, stretch))
            if keyframe.t_us < due.t_us:
                continue
            depth = self.renderer.depth(stretch.views([due.t_us]))[0] if due.depth else None
            pose = trajectory.pose((due.t_us - start_us) * 1e-6)
            packet_start, self._t_us, self._pose = self._t_us, due.t_us, pose
            events = concatenate_events(pending)
            pending.clear()
            luma = keyframe.luma.copy() if due.frame else None
            frame = None if luma is None else self._frame(luma, due.t_us)
            yield Packet(packet_start, due.t_us, events, pose, luma, depth, frame)
            due = next(instants, due)

    def _frame(self, luma: npt.NDArray[np.float32], t_us: int) -> npt.NDArray[np.float32] | None:
        """The frame that active pixels make, where they are not ideal."""
        aps = self.effects.aps
        if aps is None:
            return None
        exposed = expose(luma, self._exposed, t_us, round(aps.exposure_us))
        number, self._frames = self._frames, self._frames + 1
        return aps.read_out(exposed, frame=number, seed=self.parameters["seed"])

    def _take(self, keyframe: Keyframe, stretch: Stretch) -> EventArray:
        """Feed the crossing engine; return the events since the last keyframe."""
        last, self._last = self._last, keyframe
        reference = self._engine.reference if self.refine and last is not None else None
        events = self._engine.push(keyframe.t_us, keyframe.luma, keyframe.rate, sparse=keyframe.sparse)
        if last is None or reference is None:
            return events
        return refine_events(events, reference, last, keyframe, stretch, self._thresholds)

    def _due(self, start_us: int, end_us: int) -> Iterator[_Due]:
        """All instants at which something falls due, in order, each once."""
        first_us = start_us if self._pose is None else start_us + 1
        streams = [
            zip(periodic_instants(_PACKET_RATE_HZ, first_us, end_us), repeat("packet")),
            zip(periodic_instants(self.parameters["frame_rate_hz"], first_us, end_us), repeat("frame")),
            zip(periodic_instants(self.parameters["depth_rate_hz"], first_us, end_us), repeat("depth")),
            iter([(first_us, "packet")] if self._pose is None else ()),
            iter([(end_us, "packet")]),
        ]
        for t_us, group in groupby(heapq.merge(*streams), key=lambda item: item[0]):
            kinds = {kind for _, kind in group}
            yield _Due(t_us, "frame" in kinds, "depth" in kinds)

    def _refuse_empty_view(self, trajectory: Trajectory) -> None:
        views = Views.along(trajectory, np.linspace(0, trajectory.duration_s, 9))
        if any(np.isfinite(self.renderer.depth(views[i : i + 1])).any() for i in range(len(views))):
            return
        pose = trajectory.pose(0.0)
        raise ValueError(
            f"no ray hits anything in scene {self.scene.name!r}, from nowhere along the trajectory; the camera starts "
            f"at {np.round(pose.position, 3).tolist()} m and looks along {np.round(pose.rotation[:, 2], 3).tolist()}; "
            "align the trajectory with the scene (--align), or check axes and units"
        )


def _first(*values: float | None) -> float:
    """The first that is given."""
    return next(value for value in values if value is not None)


def simulate(
    scene: Scene,
    trajectory: Trajectory | None = None,
    *,
    start_s: float = 0.0,
    duration_s: float | None = None,
    **settings: Any,
) -> Iterator[Packet]:
    """Simulate a DAVIS that moves through a scene: a generator of packets, in bounded memory.

    >>> for packet in simulate(load_scene("three_planes"), duration_s=0.1):
    ...     print(packet.end_us, len(packet.events))

    Args:
        scene: see :func:`~davis_rs.scenes.load_scene`.
        trajectory: None takes the scene's.
        start_s, duration_s: the part of the trajectory to simulate, by default all from ``start_s`` on; t = 0 of the
            sequence is at ``start_s``.
        settings: see :class:`Simulator`.

    Raises:
        ValueError, OSError: as :class:`Simulator` and :meth:`Simulator.run`, at the call or at the first packet.
    """
    if trajectory is None:
        scene = scene.part(start_s, duration_s)
        trajectory = scene.path
    else:
        trajectory = interval(trajectory, start_s, duration_s)
    return Simulator(scene, **settings).run(trajectory)
