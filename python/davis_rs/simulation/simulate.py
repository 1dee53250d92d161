"""Runs a simulation as packets: effects are planned and samples chosen where that is asked for, then it runs."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from .._util.argument_error import ArgumentError
from ..events.packet import Packet
from ..scene.scene import Scene, check_scene
from ..sensor.effects import with_optics
from ..sensor.effects.effects import read_effects
from ..sensor.presets import SENSORS
from .monte_carlo_noise import estimate_noise_of
from .no_events import warned_without_events
from .noise_estimate import NoiseEstimate, NoiseWarning, percent
from .planning import EffectPlan
from .planning.planner import planned_effects
from .settings import (
    AUTO,
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
        chose_samples: the number of samples was to be chosen.
    """

    simulator: Simulator
    plan: EffectPlan | None
    noise: NoiseEstimate | None
    noise_share: float
    chose_samples: bool

    def packets(self) -> Iterator[Packet]:
        """Yield the packets of :meth:`Simulator.run`.

        Warns:
            NoEventsWarning: of a run without events.
        """
        simulator = self.simulator
        thresholds = (simulator.contrast_threshold, simulator.contrast_threshold_off)
        return warned_without_events(simulator.run(), thresholds, simulator.log_eps)

    @property
    def noise_line(self) -> str:
        """Return what is to be said of noise and samples; "" where there is nothing to say."""
        samples = self.simulator.renderer.rays
        if self.noise is None or not self.noise.noisy:
            why = "draws nothing at random" if self.noise is None else "has no noise in this scene"
            name = self.simulator.renderer.name
            return f"samples auto: {samples}, the default: the {name} {why}" if self.chose_samples else ""
        if not self.chose_samples:
            hint = f"; with samples auto as many are taken as keep it below {100 * self.noise_share:g} %"
            return f"{self.noise}{hint if self._above else ''}"
        if not self.noise.known:
            return f"samples auto: {samples}, the default: {self.noise}"
        most = ", the most there are; still" if self._above else ";"
        return (
            f"samples auto: {samples}{most} about {percent(self.noise.share_at(samples))} of the events are Monte "
            f"Carlo noise, at most {100 * self.noise_share:g} % were asked for"
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
        return self.noise is not None and self.noise.share_at(self.simulator.renderer.rays) > self.noise_share


def make_simulator(scene: Scene, settings: SimulationSettings) -> MadeSimulator:
    """Make a simulator of a scene's camera path; plan its effects and choose its samples where that is asked for.

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
        plan = planned_effects(scene, only(PlanSettings, settings), keep=effects)
        effects = plan.effects
    elif settings.effects_tolerance is not None:
        raise ArgumentError(
            "{effects_tolerance} is {:g}, but no effects are planned: it is for {effects:auto}",
            settings.effects_tolerance,
        )
    chose_samples = settings.samples == AUTO
    samples = None if chose_samples else settings.samples
    resolved = resolve(scene, replace(only(SimulatorSettings, settings), effects=effects, samples=samples))
    renderer = resolved.renderer()
    noise = estimate_noise_of(
        with_optics(renderer, resolved.effects),
        resolved.view.scene.path,
        contrast_threshold=resolved.view.contrast_threshold,
        contrast_threshold_off=resolved.view.contrast_threshold_off,
        log_eps=resolved.view.log_eps,
        sampling=resolved.sampling,
    )
    if chose_samples and noise is not None:
        samples = noise.samples_for(settings.noise_share)
        if samples != renderer.rays:
            resolved = replace(resolved, settings=replace(resolved.settings, samples=samples))
            renderer = resolved.renderer()
    simulator = Simulator.of_resolved(resolved, renderer)
    return MadeSimulator(simulator, plan, noise, settings.noise_share, chose_samples)
