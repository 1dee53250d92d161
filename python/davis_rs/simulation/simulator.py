"""Simulates: a scene with its camera path in, packets of events, frames, depth and poses out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, replace
from itertools import tee
from typing import TYPE_CHECKING, TypedDict

import numpy as np
import numpy.typing as npt

from .._core import CrossingEngine
from .._util.argument_checks import check_number
from .._util.argument_error import ArgumentError
from .._util.read_ahead import read_ahead
from ..events.arrays import EventArray, concatenate_events
from ..events.packet import Displacement, Packet
from ..geometry.pose import Pose, PoseLike, as_pose
from ..geometry.trajectory.trajectory import SegmentTrajectory, Trajectory
from ..geometry.trajectory.views import Views
from ..render.base import Renderer
from ..render.motion.scene_motion import SceneMotion, Steering
from ..render.truth import SceneSurfaces, lost_look_fractions
from ..render.truth.lost_look_fractions import warn_of_lost_looks
from ..sampling.event_refinement import EventRefinement
from ..sampling.exposure import KeyframeExposure, expose
from ..sampling.keyframes import Keyframe, Stretch
from ..scene.scene import Scene
from ..sensor.effects import Effects, with_optics
from .due_instants import DueInstant, due_instants
from .jumps import warn_of_jump
from .noiseless_twin import NoiselessTwin, last_time_us
from .run_description import SimulatorDescription, describe_run
from .settings import Resolved, SimulatorSettings, complete, resolve, takes_settings, truth_rates_hz

if TYPE_CHECKING:
    from typing_extensions import Self, Unpack

    from .settings.keywords import SimulatorKeywords

TRUTH_MAPS = ("flow", "mask", "normal")
"""Maps of the ground truth that fall due at rates of their own."""

_LATEST_US = 1 << 53


class _TruthMaps(TypedDict, total=False):
    """Names the fields of a :class:`Packet` that a map of the ground truth fills."""

    flow: npt.NDArray[np.float32]
    displacement: Displacement
    shapes: npt.NDArray[np.uint16]
    normals: npt.NDArray[np.float32]


@takes_settings(SimulatorSettings)
class Simulator:
    """Simulates a DAVIS in a scene.

    :meth:`run` follows the scene's camera path; :meth:`step` serves a controller that decides the next pose as it goes.
    Every intensity frame and depth map is one of the rendered instants, so events, frames and depth agree exactly.

    Args:
        scene: what is seen, with the camera path that :meth:`run` follows.
        {settings}

    Attributes:
        scene: in the settings' light.
        camera: lens and size of the image.
        settings: all of them, with the defaults of those that were not given.
        contrast_threshold, contrast_threshold_off: C_on and C_off, from settings, sensor or scene.
        log_eps: the dark level in units of luma, from settings or sensor.
        start_phase: where references lie at the first frame, from settings or sensor.
        colour_filter: before the pixels, from settings or sensor; None for a sensor without colour.
        sampling: when luma is rendered.
        effects: those of the pixels, readout and frames.
        custom_effects: those of the user's own.
        refine: whether event times are refined.
        renderer: what renders, behind the lens.
        surfaces: what gives flow, masks and normals; None where none of them is asked for.
        memory: what it is forecast to take.
        lost_looks: the share of the image that each look concerns which the scene's file has and nothing shows; None
            for a look of no shape.

    Raises:
        TypeError: for a setting that does not exist.
        ValueError: for a value out of range, effects that are not :class:`~davis_rs.Effects`, a scene that cannot be
            rendered, settings that contradict each other, or a sensor for which there is not enough memory.
        OSError: if a scene file or a calibration cannot be read.

    Warns:
        LostLookWarning: of the looks that are lost, in one line.
    """

    def __init__(self, scene: Scene, **settings: Unpack[SimulatorKeywords]) -> None:
        resolved = resolve(scene, complete(SimulatorSettings, settings, taker=Simulator))
        self._set_up(resolved, resolved.renderer())
        warn_of_lost_looks(self.scene, self.lost_looks, stacklevel=2)

    @classmethod
    def of_resolved(cls, resolved: Resolved, renderer: Renderer) -> Self:
        """Make a simulator of what is decided already.

        Args:
            resolved: scene and settings.
            renderer: that ``resolved.renderer()`` gave.

        Warns:
            LostLookWarning: of the looks that are lost, in one line.
        """
        simulator = cls.__new__(cls)
        simulator._set_up(resolved, renderer)
        warn_of_lost_looks(simulator.scene, simulator.lost_looks, stacklevel=2)
        return simulator

    def _set_up(self, resolved: Resolved, plain: Renderer) -> None:
        """Make the parts of the simulator; ``plain`` is the renderer without the lens."""
        view, settings = resolved.view, resolved.settings
        self.settings, self.scene, self.camera = settings, view.scene, view.camera
        self.contrast_threshold, self.contrast_threshold_off = view.contrast_threshold, view.contrast_threshold_off
        self.log_eps, self.start_phase, self.colour_filter = view.log_eps, view.start_phase, view.colour_filter
        self.sampling = resolved.sampling
        self.refine = resolved.refines(plain)
        self.effects, self.custom_effects = resolved.effects, resolved.custom_effects
        self.memory = resolved.memory(plain)
        self.lost_looks = lost_look_fractions(self.scene, self.camera, plain)
        self.renderer = with_optics(plain, self.effects)
        maps_asked = any(rate_hz > 0 for rate_hz in truth_rates_hz(settings).values())
        self.surfaces = None
        if maps_asked:
            culled, threads = plain.culls_backs, settings.threads
            self.surfaces = SceneSurfaces(self.scene, self.camera, culled=culled, threads=threads)
        aps = self.effects.aps
        self._shutter_us = 0.0 if aps is None else round(aps.exposure_us) + aps.readout_us(self.camera.height)
        self._begin()

    def _begin(self) -> None:
        """Make what a sequence changes, as it is before the first instant."""
        self._engine = self._make_engine(self.effects)
        self._twin = NoiselessTwin(self._make_engine, self.effects, wanted=self.settings.signal_window_us is not None)
        self._pose: Pose | None = None
        self._last: Keyframe | None = None
        self._t_us = 0
        self._exposed: list[Stretch] = []
        aps = self.effects.aps
        exposure_us, row_readout_us = (0, 0.0) if aps is None else (round(aps.exposure_us), aps.row_readout_us)
        # The renderer's sub-frames would lack what an effect of the user's own does to luma.
        on_luma = self.custom_effects.on_luma
        self._exposure = KeyframeExposure(exposure_us, row_readout_us, self.camera.height) if on_luma else None
        self._frames = 0

    def _make_engine(self, effects: Effects) -> CrossingEngine:
        return CrossingEngine(
            self.camera.width,
            self.camera.height,
            contrast_threshold=self.contrast_threshold,
            contrast_threshold_off=self.contrast_threshold_off,
            log_eps=self.log_eps,
            interpolation=self.sampling.interpolation,
            effects=effects.engine_settings(),
            start_phase=self.start_phase,
            seed=self.settings.seed,
            threads=self.settings.threads,
        )

    def __repr__(self) -> str:
        size = f"{self.camera.width} x {self.camera.height} px"
        return (
            f"<Simulator of {self.scene.name!r}, {size}, C = {self.contrast_threshold:g}, at {self._t_us / 1e6:.6g} s>"
        )

    @property
    def shape_names(self) -> tuple[str, ...]:
        """Return the names of the shapes in masks: number 1 is the first; () if no map of the ground truth was
        requested."""
        return () if self.surfaces is None else self.surfaces.names

    def run(self, *, after_keyframe: Callable[[int, int], object] | None = None) -> Iterator[Packet]:
        """Simulate the scene's camera path from its start to its end; memory stays bounded, however long it is.

        Args:
            after_keyframe: is called after each keyframe with its time in microseconds and with the number of events
                since the keyframe before, long before the packet is complete: for showing progress.

        Yields:
            Packets that tile the time; the first ends at 0 and has no events. One ends at every instant where a frame
            or a depth map falls due, and at the end. Where a readout still holds events then, one more brings them.

        Raises:
            ValueError: if the scene has no camera path, the simulator has run before, or no ray hits anything anywhere
                along the path.
        """
        trajectory = self.scene.path
        if self._pose is not None:
            raise ValueError("this simulator has run already; its pixels remember: make a new one for a new sequence")
        self._refuse_empty_view(trajectory)
        # Two threads pay only where the caller has not asked for one.
        ahead = self.renderer.concurrent and self.settings.threads != 1
        end_us = round(trajectory.duration_s * 1e6)
        yield from self._packets(trajectory, 0, end_us, ahead=ahead, after_keyframe=after_keyframe)
        yield from self.flush()

    def step(
        self,
        t_us: int,
        pose: PoseLike,
        *,
        objects: Mapping[str, PoseLike] | None = None,
        lights: Mapping[str, float] | None = None,
    ) -> list[Packet]:
        """Move the camera to ``pose`` at ``t_us``; return the packets since the last step.

        Between two poses the camera moves at constant velocity and body rate, and is rendered as often as ``sampling``
        asks. The first step must be at 0: it sets the references. The last packet ends at ``t_us``; the others
        end where frames and depth maps fall due between.

        A pose is a :class:`~davis_rs.Pose`, a matrix T_world_camera (4, 4), or (position, quaternion (x, y, z, w)).

        Args:
            t_us: microseconds, whole, larger than at the last step.
            pose: of the camera, T_world_camera.
            objects: where objects are at ``t_us``, T_world_object by their ids, of those that
                :meth:`Scene.with_movable` has named. They go there from where they were at the last step, at constant
                velocity and body rate. The others stay where they are.
            lights: factors >= 0 on the strengths of lights at ``t_us``, likewise; between two steps they are linear in
                time.

        There is a keyframe at the end of each step. So steps shorter than the spacing of keyframes in :meth:`run`
        sample more finely: where their events differ from those of a run along the same path, those of the steps are
        nearer the truth. docs/accuracy.md says by how much.

        Raises:
            ValueError: for a first step that is not at 0, a time that is no integer, does not increase or is 2^53 us
                or later, what is no pose, an object or a light that is not the caller's, or a ``flow_interval_s``,
                because nobody knows yet where the camera goes. Nothing has changed then.

        Warns:
            JumpWarning: where the camera turns by more than 120 degrees at more than 6,000 degrees a second, or moves
            so that the image moves as much. Then all that lies between the two poses makes events.
        """
        if self.settings.flow_interval_s is not None:
            raise ArgumentError("{flow_interval_s} looks ahead along a path: it is for run, not for step")
        check_number("t_us", t_us, whole=True)
        pose, motion = as_pose(pose), self.renderer.motion
        steering = motion.steered(objects or {}, lights or {}) if objects or lights else None
        if self._pose is None:
            if t_us != 0:
                raise ValueError(f"the first step must be at t = 0 us, got {t_us} us")
            self._steer(steering, 0)
            # A duration is needed for a trajectory, but nothing after its start is rendered.
            return list(self._packets(SegmentTrajectory(pose, pose, 1.0), 0, 0))
        if t_us >= _LATEST_US:
            raise ArgumentError("{t_us} must be below 2^53 us, where seconds in floating point still tell microseconds "
                                "apart, got {}", t_us)  # fmt: skip
        if t_us <= self._t_us:
            raise ValueError(f"the time of a step must be after the last one ({self._t_us} us), got {t_us} us")
        self._steer(steering, t_us)
        warn_of_jump(self.renderer, self._pose, pose, self._t_us, t_us, stacklevel=2)
        segment = SegmentTrajectory(self._pose, pose, (t_us - self._t_us) * 1e-6)
        return list(self._packets(segment, self._t_us, t_us))

    def restart(self, *, seed: int | None = None) -> None:
        """Begin a new sequence in the same scene; what was rendered and baked for it stays, so this takes little time.

        All pixels are as new, movable objects are where the scene has them, and the next step is at 0.

        Args:
            seed: of the noise, 0..2^64 - 1; None for the one before, which gives the same noise again.

        Raises:
            ValueError: for a seed out of range, or with custom effects, which may remember what they have seen.
        """
        if self.custom_effects:
            raise ArgumentError("{custom_effects} may remember what they have seen: make a new simulator")
        if seed is not None:
            self.settings = replace(self.settings, seed=seed)
        for motion in self._motions:
            motion.restart()
        self._begin()

    @property
    def _motions(self) -> tuple[SceneMotion, ...]:
        """Return what moves in the scene, for all that render it."""
        return (self.renderer.motion, *(() if self.surfaces is None else (self.surfaces.motion,)))

    def _steer(self, steering: Steering | None, t_us: int) -> None:
        """Move what the caller moves until ``t_us``, for all that render it."""
        if steering is None:
            return
        for motion in self._motions:
            motion.steer(steering, self._t_us, t_us, seen_from_us=self._t_us - self._shutter_us)

    def flush(self) -> list[Packet]:
        """Return what a readout still holds: a packet of events requested until now and stamped later, if any.

        :meth:`run` ends with it by itself; after :meth:`step` it is the caller's to ask for.
        """
        if self._pose is None:
            return []
        late = self.custom_effects.events(self._t_us, None, self._engine.flush())
        noiseless = self._twin.flush(late)
        end_us = last_time_us(late, noiseless)
        return [] if end_us is None else [Packet(self._t_us, end_us, late, self._pose, noiseless=noiseless)]

    @property
    def dropped_events(self) -> int:
        """Return the number of events that the readout has dropped; 0 unless it is set to drop events."""
        return self._engine.dropped_events

    @property
    def missed_events(self) -> int:
        """Return how often a pixel reached a level before its last event was read out and its reset over; 0 without
        a bus."""
        return self._engine.missed_events

    def describe(self) -> SimulatorDescription:
        """Return everything that is needed to repeat the run, for meta.json."""
        parameters = {
            **self.settings.by_name(),
            "lux_per_luma": self.scene.lux_per_luma,
            "contrast_threshold": self.contrast_threshold,
            "contrast_threshold_off": self.contrast_threshold_off,
            "start_phase": self.start_phase,
            "colour_filter": None if self.colour_filter is None else asdict(self.colour_filter),
            "log_eps": self.log_eps,
            "rays_per_pixel": self.renderer.rays_per_pixel,
            "pixel": self.renderer.pixel,
            "blur": self.renderer.blur,
            "sampling": repr(self.sampling),
            "refine": self.refine,
        }
        return describe_run(
            self.scene,
            self.camera,
            self.renderer,
            self.effects,
            parameters,
            custom_effects=self.custom_effects,
            lost_looks=self.lost_looks,
        )

    def _packets(
        self,
        trajectory: Trajectory,
        start_us: int,
        end_us: int,
        *,
        ahead: bool = False,
        after_keyframe: Callable[[int, int], object] | None = None,
    ) -> Iterator[Packet]:
        """Yield packets of (start_us, end_us], or of the very first instant too; the trajectory starts at ``start_us``.

        Args:
            ahead: render in a thread of its own, while the crossing engine works on the keyframes before.
            after_keyframe: as of :meth:`run`.
        """
        settings = self.settings
        rates_hz = {"frame": settings.frame_rate_hz, "depth": settings.depth_rate_hz, **truth_rates_hz(settings)}
        # The keyframes run ahead of the packets by no more than a batch.
        instants, planned = tee(due_instants(start_us, end_us, rates_hz, first=self._pose is None))
        stretch = Stretch(
            renderer=self.renderer,
            trajectory=trajectory,
            start_us=start_us,
            end_us=end_us,
            first=self._pose is None,
            due=(instant.t_us for instant in planned),
            contrast_threshold=min(self.contrast_threshold, self.contrast_threshold_off),
            log_eps=self.log_eps,
            batch=self.settings.poses_per_launch or self.renderer.poses_per_launch,
            # Effects of the user's own may have changed it.
            start_luma=None if self._last is None or self.custom_effects else self._last.luma,
        )
        # A shutter that is open now may have opened some stretches ago.
        open_us = start_us - self._shutter_us
        self._exposed = [*(before for before in self._exposed if before.end_us > open_us), stretch]
        thresholds = self.contrast_threshold, self.contrast_threshold_off
        refinement = EventRefinement(stretch, thresholds) if self.refine else None
        pending: list[EventArray] = []
        due = next(instants)
        keyframes = self.sampling.keyframes(stretch)
        for rendered in read_ahead(keyframes, most=stretch.batch) if ahead else keyframes:
            keyframe = self._lit(rendered)
            pending.append(self._take(keyframe, refinement, due=keyframe.t_us >= due.t_us))
            if after_keyframe is not None:
                after_keyframe(keyframe.t_us, len(pending[-1]))
            if keyframe.t_us < due.t_us:
                continue
            depth = self.renderer.depth(stretch.views([due.t_us]))[0] if "depth" in due.due else None
            truth = self._truth(stretch, due)
            pose = trajectory.pose((due.t_us - start_us) * 1e-6)
            packet_start, self._t_us, self._pose = self._t_us, due.t_us, pose
            events = concatenate_events(pending)
            pending.clear()
            if self.custom_effects and due.t_us > packet_start:
                events = self.custom_effects.events(packet_start, due.t_us, events)
            luma = keyframe.luma.copy() if "frame" in due.due else None
            frame = None if luma is None else self._frame(luma, due.t_us)
            noiseless = self._twin.take(events, due.t_us)
            yield Packet(packet_start, due.t_us, events, pose, luma, depth, frame, noiseless=noiseless, **truth)
            due = next(instants, due)

    def _truth(self, stretch: Stretch, due: DueInstant) -> _TruthMaps:
        """Render the packet's maps of the ground truth that fall due."""
        maps: _TruthMaps = {}
        if self.surfaces is None or due.due.isdisjoint(TRUTH_MAPS):
            return maps
        size = self.camera.height, self.camera.width
        seen = self.surfaces.frame(stretch.views([due.t_us]))
        if "flow" in due.due:
            maps["flow"] = seen.flow.reshape(*size, 2)
            later_us = due.t_us + round(1e6 * (self.settings.flow_interval_s or 0.0))
            if due.t_us < later_us <= stretch.end_us:
                maps["displacement"] = self.surfaces.displacement(stretch.views([due.t_us, later_us]))
        if "mask" in due.due:
            maps["shapes"] = seen.shape.reshape(size)
        if "normal" in due.due:
            maps["normals"] = seen.normal.reshape(*size, 3)
        return maps

    def _frame(self, luma: npt.NDArray[np.float32], t_us: int) -> npt.NDArray[np.float32] | None:
        """Return the frame that active pixels make, where they are not ideal."""
        aps = self.effects.aps
        if aps is None:
            return None
        if self._exposure is not None:
            exposed = self._exposure.mean(t_us)
        else:
            exposed = expose(luma, self._exposed, t_us, round(aps.exposure_us), aps.row_readout_us)
        number, self._frames = self._frames, self._frames + 1
        return aps.read_out(exposed, frame=number, seed=self.settings.seed)

    def _lit(self, keyframe: Keyframe) -> Keyframe:
        """Return the keyframe as the pixels see it."""
        if self._exposure is None:
            return keyframe
        keyframe = keyframe._replace(luma=self.custom_effects.luma(keyframe.t_us, keyframe.luma))
        self._exposure.add(keyframe.t_us, keyframe.luma)
        return keyframe

    def _take(self, keyframe: Keyframe, refinement: EventRefinement | None, *, due: bool) -> EventArray:
        """Feed the crossing engine and its twin; return the events since the last keyframe.

        Events that are refined come together where a packet falls ``due``.
        """
        last, self._last = self._last, keyframe
        if self.custom_effects.on_log_intensity:
            logs = self.custom_effects.log_intensity(keyframe.t_us, keyframe.luma, self.log_eps)
            self._twin.push_log(keyframe.t_us, logs)
            return self._engine.push_log(keyframe.t_us, logs)
        self._twin.push(keyframe.t_us, keyframe.luma, keyframe.rate, sparse=keyframe.sparse)
        if refinement is None or last is None:
            return self._engine.push(keyframe.t_us, keyframe.luma, keyframe.rate, sparse=keyframe.sparse)
        reference = self._engine.reference
        events = self._engine.push(keyframe.t_us, keyframe.luma, keyframe.rate, sparse=keyframe.sparse)
        refinement.add(events, reference, last, keyframe)
        return refinement.take() if due else events[:0]

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
