"""A simulation as packets: effects are planned where that is asked for, then a simulator runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from .effect_planning import EffectPlan, plan_effects
from .effects import Effects, parse_effect
from .packet import Packet
from .scene.scene import Scene
from .sensor_parameters import SENSORS
from .settings import SimulationSettings, SimulatorSettings, ViewSettings, complete, only, takes_settings
from .simulator import Simulator

if TYPE_CHECKING:
    from typing_extensions import Unpack

AUTO = "auto"
"""In place of effects: those of the sensor whose omission would show."""


@takes_settings(SimulationSettings)
def simulate(
    scene: Scene, *, start_s: float = 0.0, duration_s: float | None = None, **settings: Unpack[SimulationSettings]
) -> Iterator[Packet]:
    """Simulate a DAVIS that moves through a scene along its camera path: a generator of packets, in bounded memory.

    >>> for packet in simulate(load_scene("three_planes"), duration_s=0.1):
    ...     print(packet.end_us, len(packet.events))

    Args:
        scene: with its camera path, see :meth:`Scene.with_trajectory`.
        start_s, duration_s: the part of it to simulate, by default all from ``start_s`` on; t = 0 of the sequence is at
            ``start_s``.
        {settings}

    Raises:
        TypeError, ValueError, OSError: as :func:`plan_effects`, :class:`Simulator` and :meth:`Simulator.run`, at the
            call or at the first packet.
    """
    return make_simulator(scene.crop(start_s, duration_s), settings)[0].run()


def make_simulator(scene: Scene, settings: Mapping[str, Any]) -> tuple[Simulator, EffectPlan | None]:
    """A simulator of a scene's camera path, and the plan of its effects where they were to be planned.

    Args:
        settings: those of :class:`~davis_rs.settings.SimulationSettings`.

    Raises:
        TypeError, ValueError, OSError: as :func:`simulate`.
    """
    given = complete(SimulationSettings, settings, of="simulate")
    named, planned = read_effects(given["effects"])
    plan: EffectPlan | None = None
    if planned:
        if given["sensor"] is None:
            # Its thresholds and effects are the default; the size stays the camera's.
            given["sensor"] = replace(SENSORS["davis240c"], width=None, height=None)
        plan = plan_effects(scene, keep=named, **only(ViewSettings, given))
        named = plan.effects
    return Simulator(scene, **only(SimulatorSettings, {**given, "effects": named})), plan


def read_effects(effects: Effects | str | Sequence[str] | None) -> tuple[Effects, bool]:
    """The effects that are named, and whether others are to be planned.

    Args:
        effects: :class:`~davis_rs.Effects`, or texts as :func:`~davis_rs.effects.parse_effect` takes them, ``auto``
            among them where others are to be planned.

    Raises:
        ValueError: for an effect that is not there or a malformed value.
    """
    if effects is None or isinstance(effects, Effects):
        return effects or Effects(), False
    texts = [effects] if isinstance(effects, str) else list(effects)
    return Effects.of(parse_effect(text) for text in texts if text != AUTO), AUTO in texts
