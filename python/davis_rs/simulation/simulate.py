"""Runs a simulation as packets: effects are planned and rays per pixel chosen where that is asked for, then it runs."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from .._util.argument_error import ArgumentError
from .._util.progress import doing
from .._util.quantities import percent
from ..events.packet import Packet
from ..scene.scene import Scene, check_scene
from ..sensor.effects import with_optics
from ..sensor.effects.effects import read_effects
from ..sensor.presets import SENSORS
from .monte_carlo_noise import estimate_noise_of
from .no_events import warned_without_events
from .noise_estimate import NoiseEstimate, NoiseWarning
from .planning import EffectPlan
from .planning.planner import planned_effects
from .settings import (
    AUTO_RAYS,
    PlanSettings,
    SimulationSettings,
    SimulatorSettings,
    complete,
    fixed_sensor,
    only,
    resolve,
    takes_settings,
)
from .simulator import Simulator

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from .settings.keywords import SimulationKeywords


@takes_settings(SimulationSettings)
def simulate(
    scene: Scene, *, start_s: float = 0.0, duration_s: float | None = None, **settings: Unpack[SimulationKeywords]
) -> Iterator[Packet]:
    """Simulate a DAVIS that moves through a scene along its camera path: a generator of packets, in bounded memory.

    >>> for packet in simulate(load_scene("three_planes"), duration_s=0.1):
    ...     print(packet.end_us, len(packet.events))

    Args:
        scene: with its camera path, see :meth:`Scene.with_trajectory`.
        start_s, duration_s: the part of it to simulate, by default all from ``start_s`` on; t = 0 of the sequence is at
            ``start_s``.
        {settings}

    Warns:
        NoEventsWarning: where a threshold is larger than all contrast from the dark level to white, and where there
            were no events at all.
        NoiseWarning: where more events than ``noise_share`` will be Monte Carlo noise.

    Raises:
        TypeError, ValueError, OSError: as :func:`plan_effects`, :class:`Simulator` and :meth:`Simulator.run`, at the
            call or at the first packet.
    """
    check_scene(scene)
    given = complete(SimulationSettings, settings, taker=simulate)
    made = make_simulator(scene.crop(start_s, duration_s), given)
    made.warn_of_noise(stacklevel=3)
    return made.packets()


@dataclass(frozen=True)
class MadeSimulator:
    """Holds a simulator, and what was found out before it was made.

    Attributes:
        plan: of its effects, where they were to be planned.
        noise: how many of its events will be Monte Carlo noise, where Mitsuba's integrators render.
        noise_share: how many may be.
        chose_rays_per_pixel: the number was to be chosen.
    """

    simulator: Simulator
    plan: EffectPlan | None
    noise: NoiseEstimate | None
    noise_share: float
    chose_rays_per_pixel: bool

    def packets(self, after_keyframe: Callable[[int, int], object] | None = None) -> Iterator[Packet]:
        """Yield the packets of :meth:`Simulator.run`, which is given ``after_keyframe``.

        Warns:
            NoEventsWarning: of a run without events.
        """
        simulator = self.simulator
        thresholds = (simulator.contrast_threshold, simulator.contrast_threshold_off)
        return warned_without_events(simulator.run(after_keyframe=after_keyframe), thresholds, simulator.log_eps)

    @property
    def noise_line(self) -> str:
        """Return what is to be said of noise and rays per pixel; "" where there is nothing to say."""
        rays_per_pixel = self.simulator.renderer.rays_per_pixel
        if self.noise is None or not self.noise.noisy:
            why = "draws nothing at random" if self.noise is None else "has no noise in this scene"
            name = self.simulator.renderer.name
            return (
                f"rays_per_pixel auto: {rays_per_pixel}, the default: the {name} {why}"
                if self.chose_rays_per_pixel
                else ""
            )
        if not self.chose_rays_per_pixel:
            hint = f"; with rays_per_pixel auto as many are taken as keep it below {100 * self.noise_share:g} %"
            return f"{self.noise}{hint if self._above else ''}"
        if not self.noise.known:
            return f"rays_per_pixel auto: {rays_per_pixel}, the default: {self.noise}"
        most = ", the most there are; still" if self._above else ";"
        return (
            f"rays_per_pixel auto: {rays_per_pixel}{most} about "
            f"{percent(self.noise.share_at(rays_per_pixel))} of the events are Monte Carlo noise, "
            f"at most {100 * self.noise_share:g} % were asked for"
        )

    def warn_of_noise(self, stacklevel: int) -> None:
        """Warn where more of the events will be noise than may be.

        Warns:
            NoiseWarning: with :attr:`noise_line`.
        """
        if self._above:
            warnings.warn(self.noise_line, NoiseWarning, stacklevel=stacklevel)

    @property
    def _above(self) -> bool:
        return self.noise is not None and self.noise.share_at(self.simulator.renderer.rays_per_pixel) > self.noise_share


def make_simulator(scene: Scene, settings: SimulationSettings) -> MadeSimulator:
    """Make a simulator of a scene's camera path; plan its effects and choose its rays per pixel where asked for.

    Effects are planned first, then noise is measured with the renderer, then the one simulator is made.

    Raises:
        ValueError, OSError: as :func:`simulate`.
    """
    settings = replace(settings, sensor=fixed_sensor(scene, settings.sensor))
    effects, planned = read_effects(settings.effects)
    plan: EffectPlan | None = None
    if planned:
        if settings.sensor is None:
            # Its thresholds and effects are the default; the size stays the camera's.
            settings = replace(settings, sensor=replace(SENSORS["davis240c"], width=None, height=None))
        doing("planning effects")
        plan = planned_effects(scene, only(PlanSettings, settings), keep=effects)
        effects = plan.effects
    elif settings.effects_tolerance is not None:
        raise ArgumentError(
            "{effects_tolerance} is {:g}, but no effects are planned: it is for {effects:auto}",
            settings.effects_tolerance,
        )
    chose_rays_per_pixel = settings.rays_per_pixel == AUTO_RAYS
    rays_per_pixel = None if chose_rays_per_pixel else settings.rays_per_pixel
    doing("loading the scene")
    resolved = resolve(
        scene, replace(only(SimulatorSettings, settings), effects=effects, rays_per_pixel=rays_per_pixel)
    )
    doing("making the renderer")
    renderer = resolved.renderer()
    doing("measuring noise")
    noise = estimate_noise_of(
        with_optics(renderer, resolved.effects),
        resolved.view.scene.path,
        contrast_threshold=resolved.view.contrast_threshold,
        contrast_threshold_off=resolved.view.contrast_threshold_off,
        log_eps=resolved.view.log_eps,
        sampling=resolved.sampling,
    )
    if chose_rays_per_pixel and noise is not None:
        rays_per_pixel = noise.rays_per_pixel_for(settings.noise_share)
        if rays_per_pixel != renderer.rays_per_pixel:
            resolved = replace(resolved, settings=replace(resolved.settings, rays_per_pixel=rays_per_pixel))
            renderer = resolved.renderer()
    doing("making the simulator")
    simulator = Simulator.of_resolved(resolved, renderer)
    return MadeSimulator(simulator, plan, noise, settings.noise_share, chose_rays_per_pixel)
