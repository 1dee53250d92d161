"""Computes how the times of events move with the camera's path, the thresholds and the light."""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from copy import copy
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .._util.argument_error import ArgumentError
from ..events.arrays import EventArray
from ..geometry.camera import Camera
from ..render.native.renderer import NativeRenderer
from ..scene.scene import Scene, check_scene
from ..simulation.simulator import Simulator
from .event_crossings import find_crossings
from .event_derivatives import EventTimeDerivatives, check_quantities
from .event_jumps import EventJumps
from .event_levels import EventLevels, count_levels
from .log_luma import LogLuma, LogLumaField
from .moved_path import MovedPath
from .pixel_means import MeanLogLumaField

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ..simulation.settings.keywords import SimulatorKeywords

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

STAMPED_US = 0.5
"""How long before its stamp a refined event is evaluated: the middle of its microsecond."""

AT_STAMP_US = (-1.5, 1.5)
"""Where the crossing of a refined event lies relative to that: within its microsecond, and a margin for rounding. If a
ray jumps by 1e-4 of log luma or more there, the crossing seems farther away."""

JUMPS_US = ((1.25, 0.25), (12.0, 10.0))
"""The windows before and after its stamp in which an event's jump is searched, one after the other: where the image
moves slowly, an edge needs many microseconds to move by what float32 rounds."""

AT_JUMP_US = ((0.25, 0.25),)
"""The window before and after a crossing in which its jump is searched."""

NEAR_US = 200.0
"""How far from its stamp the crossing of an event that was not refined is searched."""

AT_LEVEL = 0.05
"""By which fraction of a threshold the mean of a pixel may miss the level: the run's pixel changes ray by ray."""

EDGES = ("rays", "mean")
"""The values of ``edges``."""

_AT_ONCE = 1 << 12
"""How many jumps are searched in one call."""

LEAST_SLOPE = 0.02
"""Slope of log luma, per second, below which a crossing is tangential: a change of 1e-6 of log luma then moves it by 50
us."""

_US = 1e6


class EventTimeModel:
    """Computes the times of a run's events as functions of its unknowns.

    Args:
        scene: with the camera path of the run, from the run's start on.
        thresholds: (2,) or, of each pixel, (2, H, W): ON and OFF, natural-log units; None for those of the settings.
        edges: ``rays`` or ``mean``, see :func:`event_time_jacobian`.
        settings: of the run.

    Raises:
        TypeError, ValueError, OSError: as :class:`~davis_rs.Simulator`; ValueError for a scene that another renderer
            than the native one renders, for lights that throw a picture with edges, for effects, whose events are not
            where log luma reaches a level, and for thresholds of another shape or not > 0.
    """

    def __init__(
        self,
        scene: Scene,
        thresholds: npt.ArrayLike | None = None,
        *,
        edges: str = "rays",
        **settings: Unpack[SimulatorKeywords],
    ) -> None:
        if edges not in EDGES:
            raise ArgumentError("{edges} must be {}, got {!r}", " or ".join(map(repr, EDGES)), edges)
        simulator = Simulator(scene, **settings)
        renderer = simulator.renderer
        if not isinstance(renderer, NativeRenderer):
            raise ValueError(
                "derivatives of event times need the native renderer, which takes diffuse meshes; this is the "
                f"{renderer.name}: {renderer.reason}"
            )
        for light in renderer.table.lights:
            if light.slide is not None and renderer.table.slides[light.slide[0]].has_edges:
                raise ValueError(
                    f"derivatives of event times do not follow the edges of what light {light.name!r} throws, at which "
                    "light jumps; they follow a spot with a bitmap of the filter_type bilinear"
                )
        effects = [*simulator.effects.engine_settings()]
        effects += ["custom_effects"] if simulator.custom_effects else []
        effects += ["an effect of the lens"] if renderer.optics is not None else []
        effects += ["start phases"] if simulator.start_phase != "zero" else []
        if effects:
            raise ValueError(f"derivatives of event times are those of ideal pixels, without {', '.join(effects)}")
        self.simulator, self.refined = simulator, simulator.refine
        self.path = simulator.scene.path
        of_means = edges == "mean"
        self.field = (MeanLogLumaField if of_means else LogLumaField)(renderer, self.path, simulator.log_eps)
        self.jumps = None if of_means else EventJumps(self.field)
        self.thresholds = _threshold_maps(simulator, thresholds)

    def changed(self, increments: npt.ArrayLike | None, thresholds: npt.ArrayLike | None) -> EventTimeModel:
        """Return the model with the path moved, see :class:`MovedPath`, or with other thresholds; None changes
        nothing."""
        other = copy(self)
        if increments is not None:
            other.path = MovedPath(self.path, increments)
            other.field = type(self.field)(self.field.renderer, other.path, self.field.log_eps)
            other.jumps = None if self.jumps is None else EventJumps(other.field)
        if thresholds is not None:
            other.thresholds = _threshold_maps(self.simulator, thresholds)
        return other

    def levels(self, events: npt.ArrayLike) -> EventLevels:
        """Count the levels of events, see :func:`event_time_jacobian`."""
        camera = self.simulator.camera
        return count_levels(events, camera.width, camera.height, self.path.duration_s * _US)

    def linearise(self, levels: EventLevels) -> EventTimeDerivatives:
        """Evaluate log luma and its derivatives at each event of a run, and at the start of the run."""
        if not self.refined:
            return self.search(levels, NEAR_US)[0]
        start, level = self.start_and_level(levels)
        at_us = np.maximum(levels.t_us - STAMPED_US, 0.0)
        here = self.field.at(at_us, levels.pixel)
        step_us = _step_us(here, level)
        smooth = (step_us >= AT_STAMP_US[0]) & (step_us <= AT_STAMP_US[1])
        if self.jumps is None:
            least = self.thresholds[:, levels.pixel].min(0)
            smooth = np.abs(level - here.value) <= AT_LEVEL * least
        jump, jump_pose = self._find_jumps(levels.t_us, levels, level, ~smooth, JUMPS_US)
        return self._derivatives(at_us, levels, start, here, smooth, jump, jump_pose)

    def search(self, levels: EventLevels, within_us: float) -> tuple[EventTimeDerivatives, Flags]:
        """Find the crossing of each event's level next to its stamp, with log luma and its derivatives there.

        Returns:
            The derivatives at the crossings, and (n,) whether there is a crossing.
        """
        start, level = self.start_and_level(levels)
        crossings = find_crossings(self.field, levels.t_us, levels.pixel, levels.sign, level, within_us=within_us)
        jumps = crossings.known & ~crossings.smooth
        jump, jump_pose = self._find_jumps(crossings.t_us, levels, level, jumps, AT_JUMP_US)
        derivatives = self._derivatives(
            crossings.t_us, levels, start, crossings.here, crossings.smooth, jump, jump_pose
        )
        return derivatives, crossings.known

    def start_and_level(self, levels: EventLevels) -> tuple[LogLuma, FloatArray]:
        """Return log luma of each event's pixel at the start of the run, and the level (n,) of the event."""
        pixels, of_pixel = np.unique(levels.pixel, return_inverse=True)
        start = self.field.at_start(pixels).take(of_pixel)
        on, off = self.thresholds[:, levels.pixel]
        return start, start.value + levels.on * on - levels.off * off

    def _find_jumps(
        self,
        at_us: FloatArray,
        levels: EventLevels,
        level: FloatArray,
        which: Flags,
        windows_us: Sequence[tuple[float, float]],
    ) -> tuple[Flags, FloatArray]:
        """Return whether a ray's jump near an instant makes an event, and how the event's time moves with the pose."""
        jump, jump_pose = np.zeros(len(level), np.bool_), np.zeros((len(level), 6))
        if self.jumps is None:
            return jump, jump_pose
        for before_us, after_us in windows_us:
            for index in _blocks(np.flatnonzero(which & ~jump)):
                jumps = self.jumps.find(
                    np.maximum(at_us[index] - before_us, 0.0),
                    np.minimum(at_us[index] + after_us, self.path.duration_s * _US),
                    levels.pixel[index],
                    levels.sign[index],
                    np.exp(level[index]) - self.field.log_eps,
                )
                jump[index], jump_pose[index] = jumps.known, jumps.pose
        return jump, jump_pose

    def _derivatives(
        self,
        t_us: FloatArray,
        levels: EventLevels,
        start: LogLuma,
        here: LogLuma,
        smooth: Flags,
        jump: Flags,
        jump_pose: FloatArray,
    ) -> EventTimeDerivatives:
        rising = (here.rate * levels.sign >= LEAST_SLOPE) & np.isfinite(start.rate)
        return EventTimeDerivatives(t_us, levels, start, here, smooth & rising, self.field, jump, jump_pose)


def event_time_jacobian(
    scene: Scene,
    events: EventArray,
    of: Sequence[str] = ("pose", "contrast_threshold"),
    camera: Camera | str | os.PathLike[str] | None = None,
    *,
    start_s: float = 0.0,
    edges: str = "rays",
    **settings: Any,
) -> tuple[FloatArray, Flags]:
    """Return the derivatives of the times of a run's events by the unknowns of the run.

    An event is where log luma L of its pixel has changed by n_on C_on - n_off C_off since the start of the run. By the
    implicit function theorem its time moves with an unknown u by dt/du = -(dL/du(t) - dL/du(0) - dlevel/du) / (dL/dt).
    Where a ray of the pixel jumps because an edge of the geometry or of a shadow passes it, the time is that of the
    edge, whatever the level.

    >>> run = {"accuracy": "exact", "pixel": "rays"}
    >>> events = np.concatenate([packet.events for packet in simulate(scene, **run)])
    >>> jacobian, ok = event_time_jacobian(scene, events, **run)

    Args:
        scene: of the run, with its camera path.
        events: the whole stream of each of their pixels from the start of the run, because levels are counted: pixels
            may be left out, events of a pixel may not.
        of: names of the unknowns, whose columns follow each other: ``pose`` (6 columns: a constant increment of the
            whole camera path, position in world axes, metres, then a rotation vector in camera axes, radians, as in
            :meth:`CameraPoses.perturbed`), ``contrast_threshold`` (2: ON and OFF, natural-log units), ``log_eps`` (1:
            the dark level, luma), ``clock_offset`` (1: seconds by which the camera's path, all that moves, and the
            lights are late), ``clock_drift`` (1: seconds a second by which they fall behind from the start on),
            ``light`` (one for each light of the scene: the logarithm of its strength).
        camera: of the run; None for the scene's, or the sensor's.
        start_s: of the run on the camera path.
        edges: which derivatives are computed where an edge passes a pixel. ``rays``: those of the run as simulated,
            with its rays, each of which jumps. ``mean``: those of the mean over the whole pixel, which the rays sample:
            the derivative has the integral along the edge, at the event and at the start of the run. That needs many
            rays (``rays_per_pixel`` from 256 on) and a scene at rest, and takes some milliseconds an event.
        settings: of the run, by the names that :class:`~davis_rs.Simulator` takes; ``pixel="rays"`` or a number of
            rays is among them, because derivatives are those of rays.

    Returns:
        The Jacobian, float64 (n, columns), microseconds per unit, NaN where it is not known; and bool (n,), whether it
        is. It is not known where

        - log luma does not reach the event's level (within ``AT_STAMP_US`` of the middle of a refined event's
          microsecond, else within ``NEAR_US`` of the stamp), and no edge is found that makes a ray jump to it: the
          event is another run's, or a jump whose edge is not that of a triangle;
        - an edge passes several rays at one instant, and they would move by other amounts: the
          time has a kink there;
        - log luma does not move towards the level: its slope has the other sign than the event, or is below
          ``LEAST_SLOPE`` (a tangential crossing).

        Jumps are searched for refined events only (``refine=True``, or ``accuracy="exact"`` by rays), because the times
        of the others are not exact.

    Warns:
        UserWarning: where fewer than half of the events are known, because then the settings may be another run's.

    Raises:
        TypeError: for a setting that does not exist.
        ValueError: for an unknown or a kind of edges that does not exist; for ``mean`` where something moves; for
            events that are not sorted, not in the sensor, or not within the run; for effects, and a scene that the
            native renderer does not take; and as
            :class:`~davis_rs.Simulator`.
        OSError: as :class:`~davis_rs.Simulator`.
    """
    check_quantities(of)
    derivatives = _derivatives(scene, events, camera, start_s=start_s, edges=edges, **settings)
    return derivatives.jacobian(of), derivatives.ok


def event_time_derivatives(
    scene: Scene,
    events: EventArray,
    camera: Camera | str | os.PathLike[str] | None = None,
    *,
    start_s: float = 0.0,
    edges: str = "rays",
    **settings: Any,
) -> EventTimeDerivatives:
    """Return the derivatives of a run's event times, from which dense and sparse blocks can be made.

    >>> derivatives = event_time_derivatives(scene, events, accuracy="exact", pixel="rays")
    >>> jacobian = scipy.sparse.hstack([derivatives.control_points(20), derivatives.contrast_threshold_map()])

    Args, warnings and errors: those of :func:`event_time_jacobian`.
    """
    return _derivatives(scene, events, camera, start_s=start_s, edges=edges, **settings)


def _derivatives(
    scene: Scene,
    events: EventArray,
    camera: Camera | str | os.PathLike[str] | None,
    *,
    start_s: float,
    edges: str,
    **settings: Any,
) -> EventTimeDerivatives:
    check_scene(scene)
    model = EventTimeModel(scene.crop(start_s), camera=camera, edges=edges, **settings)
    derivatives = model.linearise(model.levels(events))
    known, total = np.count_nonzero(derivatives.ok), len(derivatives.ok)
    if 2 * known < total:
        warnings.warn(
            f"derivatives are known of {known:,} of {total:,} events: are the settings those of the run?", stacklevel=3
        )
    return derivatives


def _threshold_maps(simulator: Simulator, thresholds: npt.ArrayLike | None) -> FloatArray:
    """Return the ON and OFF thresholds of all pixels, (2, pixels), and check them."""
    camera = simulator.camera
    if thresholds is None:
        both = [[simulator.contrast_threshold], [simulator.contrast_threshold_off]]
        return np.repeat(np.array(both), camera.width * camera.height, axis=1)
    maps = np.array(thresholds, np.float64)
    if maps.shape == (2,):
        maps = np.tile(maps[:, None, None], (1, camera.height, camera.width))
    if maps.shape != (2, camera.height, camera.width):
        raise ArgumentError(
            "{thresholds} must have shape (2,) or (2, {}, {}), got {}", camera.height, camera.width, maps.shape
        )
    if not ((maps > 0) & (maps < np.inf)).all():
        raise ArgumentError("{thresholds} must be > 0 and finite, got {}", maps[~((maps > 0) & (maps < np.inf))][0])
    return maps.reshape(2, -1)


def _blocks(index: IntArray) -> list[IntArray]:
    """Split numbers of events into blocks that are processed together."""
    return np.split(index, range(_AT_ONCE, len(index), _AT_ONCE)) if len(index) else []


def _step_us(here: LogLuma, level: FloatArray) -> FloatArray:
    """Return the time to the crossing along the slope; infinite where there is none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(_US * (level - here.value) / here.rate)
