"""How the times of events move with the camera's path, the thresholds and the light."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..camera import Camera
from ..close_names import did_you_mean
from ..events import EventArray
from ..rendering.render_native import NativeRenderer
from ..scene.scene import Scene
from ..settings import SimulatorSettings
from ..simulator import Simulator
from .event_jumps import EventJumps
from .event_levels import EventLevels, count_levels
from .log_luma import LogLuma, LogLumaField

if TYPE_CHECKING:
    from typing_extensions import Unpack

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

QUANTITIES = ("pose", "contrast_threshold", "log_eps", "clock_offset", "light")
"""What ``of`` may name."""

AT_STAMP_US = (-2.0, 1.0)
"""Where the crossing of a refined event lies, from its stamp: in the microsecond before, and what rounding adds. A ray
that jumps by 1e-4 of log luma or more there puts it farther away."""

JUMPS_US = ((1.25, 0.25), (12.0, 10.0))
"""How long before and after its stamp an event's jump is looked for, one after the other: where the image moves slowly
an edge needs many microseconds for what float32 rounds."""

NEAR_US = 200.0
"""How far from its stamp the crossing of an event that was not refined is looked for."""

_TOGETHER = 1 << 12
"""Jumps that are looked for in one call."""

_TURNS = 6
_FOUND_US = 0.05

LEAST_SLOPE = 0.02
"""Log luma per second, below which a crossing is tangential: a change of 1e-6 of log luma then moves it by 50 us."""

_US = 1e6


class EventTimeModel:
    """The times of a run's events as functions of its unknowns.

    Args:
        scene: with the camera path of the run, from the run's start on.
        settings: of the run.

    Raises:
        TypeError, ValueError, OSError: as :class:`~davis_rs.Simulator`; ValueError for a scene that another renderer
            than the native one renders, and for effects, whose events are not where log luma reaches a level.
    """

    def __init__(self, scene: Scene, **settings: Unpack[SimulatorSettings]) -> None:
        simulator = Simulator(scene, **settings)
        renderer = simulator.renderer
        if not isinstance(renderer, NativeRenderer):
            raise ValueError(
                "derivatives of event times need the native renderer, which takes diffuse meshes; this is the "
                f"{renderer.name}: {renderer.reason}"
            )
        effects = [*simulator.effects.engine_settings()]
        effects += ["custom_effects"] if simulator.custom_effects else []
        effects += ["an effect of the lens"] if renderer.optics is not None else []
        if effects:
            raise ValueError(f"derivatives of event times are those of ideal pixels, without {', '.join(effects)}")
        self.simulator, self.refined = simulator, simulator.refine
        self.path = simulator.scene.path
        self.field = LogLumaField(renderer, self.path, simulator.settings["log_eps"])
        self.jumps = EventJumps(self.field)
        names = [light.name for light in renderer.table.lights]
        self.light_names = tuple(dict.fromkeys(names))
        self._of_name = np.array([[name == one for one in self.light_names] for name in names], np.float64)

    def levels(self, events: npt.ArrayLike) -> EventLevels:
        """Count the levels of events, see :func:`event_time_jacobian`."""
        camera = self.simulator.camera
        return count_levels(events, camera.width, camera.height, self.path.duration_s * _US)

    def linearise(self, levels: EventLevels) -> LinearisedEvents:
        """Find the crossing of each event, and log luma and its derivatives there and at the start of the run."""
        pixels, of_pixel = np.unique(levels.pixel, return_inverse=True)
        start = self.field.at_start(pixels).take(of_pixel)
        simulator = self.simulator
        threshold_on, threshold_off = simulator.contrast_threshold, simulator.contrast_threshold_off
        level = start.value + levels.on * threshold_on - levels.off * threshold_off
        at_us = levels.t_us.copy()
        here = self.field.at(at_us, levels.pixel)
        step_us = _step_us(here, level)
        if self.refined:
            smooth = (step_us >= AT_STAMP_US[0]) & (step_us <= AT_STAMP_US[1])
        else:
            smooth = self._follow(at_us, here, step_us, levels, level)
        jump = np.zeros(len(level), np.bool_)
        jump_pose = np.zeros((len(level), 6))
        for before_us, after_us in JUMPS_US if self.refined else ():
            for index in _parts(np.flatnonzero(~smooth & ~jump)):
                found = self.jumps.find(
                    np.maximum(levels.t_us[index] - before_us, 0.0),
                    np.minimum(levels.t_us[index] + after_us, self.path.duration_s * _US),
                    levels.pixel[index],
                    levels.sign[index],
                    np.exp(level[index]) - self.field.log_eps,
                )
                jump[index], jump_pose[index] = found.found, found.pose
        rising = here.rate * levels.sign
        smooth &= rising >= LEAST_SLOPE
        return LinearisedEvents(at_us, levels, start, here, smooth, jump, jump_pose)

    def _follow(
        self, at_us: FloatArray, here: LogLuma, step_us: FloatArray, levels: EventLevels, level: FloatArray
    ) -> Flags:
        """Go to the crossings, in place; returns which were found."""
        found = np.abs(step_us) <= _FOUND_US
        active = np.flatnonzero(~found)
        for _ in range(_TURNS):
            target = at_us[active] + step_us[active]
            near = np.isfinite(target) & (np.abs(target - levels.t_us[active]) <= NEAR_US)
            near &= (target >= 0) & (target <= self.path.duration_s * _US)
            active = active[near]
            if len(active) == 0:
                break
            at_us[active] += step_us[active]
            new = self.field.at(at_us[active], levels.pixel[active])
            here.put(active, new)
            step_us[active] = _step_us(new, level[active])
            done = np.abs(step_us[active]) <= _FOUND_US
            found[active[done]] = True
            active = active[~done]
        return found

    def columns(self, linearised: LinearisedEvents, of: Sequence[str]) -> FloatArray:
        """Derivatives of the times (n, columns), microseconds per unit; meaningless where nothing is known."""
        here, start, levels = linearised.here, linearised.start, linearised.levels
        per_rate = _US / np.where(linearised.smooth, here.rate, 1.0)[:, None]
        jump = linearised.jump[:, None]
        columns: list[FloatArray] = []
        for name in of:
            if name == "pose":
                smooth = -(here.pose - start.pose) * per_rate
                columns.append(np.where(jump, linearised.jump_pose * _US, smooth))
                continue
            if name == "contrast_threshold":
                one = np.stack([levels.on, -levels.off], 1) * per_rate
            elif name == "log_eps":
                one = -(here.log_eps - start.log_eps)[:, None] * per_rate
            elif name == "light":
                one = -((here.lights - start.lights) @ self._of_name) * per_rate
            else:
                moved = (here.rate - start.rate)[:, None] * per_rate
                columns.append(np.where(jump, _US, moved))
                continue
            columns.append(np.where(jump, 0.0, one))
        return np.concatenate([np.zeros((len(levels.pixel), 0)), *columns], 1)


class LinearisedEvents(NamedTuple):
    """Events where they cross their levels.

    Attributes:
        at_us: (n,) where log luma was looked at: the stamp of a refined event, the crossing near it of another.
        levels: of the events.
        start, here: log luma at the start of the run, and at ``at_us``.
        smooth: (n,) log luma reaches the level at ``at_us``, and rises or falls through it.
        jump: (n,) a ray of the pixel jumps there, for which an edge is known.
        jump_pose: (n, 6) seconds by an increment of the pose, of those that jump.
    """

    at_us: FloatArray
    levels: EventLevels
    start: LogLuma
    here: LogLuma
    smooth: Flags
    jump: Flags
    jump_pose: FloatArray


def event_time_jacobian(
    scene: Scene,
    events: EventArray,
    of: Sequence[str] = ("pose", "contrast_threshold"),
    camera: Camera | str | None = None,
    *,
    start_s: float = 0.0,
    **settings: Any,
) -> tuple[FloatArray, Flags]:
    """How the times of a run's events move with what the run was made with.

    An event is where log luma L of its pixel has changed by n_on C_on - n_off C_off since the start of the run. By the
    implicit function theorem its time moves with an unknown u by dt/du = -(dL/du(t) - dL/du(0) - dlevel/du) / (dL/dt).
    Where a ray of the pixel jumps because an edge of the geometry or of a shadow passes it, the time is that of the
    edge, whatever the level.

    >>> events = np.concatenate([packet.events for packet in simulate(scene, accuracy="exact")])
    >>> jacobian, ok = event_time_jacobian(scene, events, accuracy="exact")

    Args:
        scene: of the run, with its camera path.
        events: the whole stream of each of their pixels from the start of the run, because levels are counted: pixels
            may be left out, events of a pixel may not.
        of: names of the unknowns, whose columns follow each other: ``pose`` (6 columns: a constant increment of the
            whole camera path, position in world axes, metres, then a rotation vector in camera axes, radians, as in
            :meth:`CameraPoses.perturbed`), ``contrast_threshold`` (2: ON and OFF, natural-log units), ``log_eps`` (1:
            the dark level, luma), ``clock_offset`` (1: seconds by which the camera's path, all that moves, and the
            lights are late), ``light`` (one for each light of the scene: the logarithm of its strength).
        camera: of the run; None for the scene's, or the sensor's.
        start_s: of the run on the camera path.
        settings: of the run, by the names that :class:`~davis_rs.Simulator` takes.

    Returns:
        The Jacobian, float64 (n, columns), microseconds per unit, NaN where it is not known; and bool (n,), whether it
        is. It is not known where

        - log luma does not reach the event's level at its stamp (within ``AT_STAMP_US`` of a refined event, else
          within ``NEAR_US``), and no edge is found that makes a ray jump to it: the event is another run's, or a
          jump whose edge is not that of a triangle;
        - log luma does not move towards the level: its slope has the other sign than the event, or is below
          ``LEAST_SLOPE`` (a tangential crossing).

        Jumps are looked for in refined events only (``accuracy="exact"`` or ``refine=True``), because nobody knows when
        the others were.

    Raises:
        TypeError: for a setting that does not exist.
        ValueError: for an unknown that does not exist; for events that are not sorted, not in the sensor, or not
            within the run; for effects, and a scene that the native renderer does not take; and as
            :class:`~davis_rs.Simulator`.
        OSError: as :class:`~davis_rs.Simulator`.
    """
    for name in of:
        if name not in QUANTITIES:
            raise ValueError(f"of must name {', '.join(QUANTITIES)}; got {name!r}{did_you_mean(name, QUANTITIES)}")
    model = EventTimeModel(scene.crop(start_s), camera=camera, **settings)
    linearised = model.linearise(model.levels(events))
    ok = linearised.smooth | linearised.jump
    jacobian = model.columns(linearised, of)
    jacobian[~ok] = np.nan
    return jacobian, ok


def _parts(index: IntArray) -> list[IntArray]:
    """Numbers of events in parts that are worked on together."""
    return np.split(index, range(_TOGETHER, len(index), _TOGETHER)) if len(index) else []


def _step_us(here: LogLuma, level: FloatArray) -> FloatArray:
    """How far the crossing is, along the slope; infinitely where there is none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(_US * (level - here.value) / here.rate)
