"""Composes effects."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields
from typing import Any, TypeAlias

from ..._util.argument_error import ArgumentError
from ..._util.close_names import did_you_mean, names_checked
from ..._util.html_table import html_table
from ..._util.quantities import with_unit
from .aps import Aps
from .effect import Effect, EngineEffect
from .hot_pixels import HotPixels
from .leak_rate import LeakRate
from .lens_blur import LensBlur
from .photoreceptor_bandwidth import PhotoreceptorBandwidth
from .readout import Readout
from .refractory_period import RefractoryPeriod
from .shot_noise import ShotNoise
from .threshold_mismatch import ThresholdMismatch
from .vignetting import Vignetting

EFFECTS: dict[str, type[Effect]] = {
    effect.name: names_checked(effect)
    for effect in (
        Vignetting,
        LensBlur,
        PhotoreceptorBandwidth,
        ThresholdMismatch,
        RefractoryPeriod,
        LeakRate,
        ShotNoise,
        HotPixels,
        Readout,
        Aps,
    )
}
"""All effects by name, in the order in which light and events meet them."""

NOISE = ("leak_rate_hz", "shot_noise_rms", "hot_pixels")
"""The effects that make events without a change of light, or move others at random."""

PLANNED = "auto"
"""Given instead of effects, or among them: adds the effects of the sensor that matter in the scene."""


@dataclass(frozen=True, init=False)
class Effects:
    """Holds the effects that make a sensor differ from ideal pixels; each is off unless it is given.

    >>> Effects(refractory_period_us=100, leak_rate_hz=0.1)

    Each argument is an object of the effect's class, a number (its first parameter), or its parameters by name in a
    mapping. An effect with neutral values is off, and becomes None; over a sensor's (:meth:`with_defaults`) it switches
    that one off. The class of an effect documents what it does.

    Raises:
        TypeError: for an effect that does not exist, with the one that is close.
        ValueError: for values out of range, naming the effect, the value and the range.
    """

    vignetting: Vignetting | None
    lens_blur_px: LensBlur | None
    photoreceptor_bandwidth_hz: PhotoreceptorBandwidth | None
    threshold_mismatch: ThresholdMismatch | None
    refractory_period_us: RefractoryPeriod | None
    leak_rate_hz: LeakRate | None
    shot_noise_rms: ShotNoise | None
    hot_pixels: HotPixels | None
    readout: Readout | None
    aps: Aps | None
    switched_off: frozenset[str] = field(repr=False, compare=False)
    """The effects that were given with neutral values. Combined with other effects, they switch theirs off."""

    @names_checked
    def __init__(
        self,
        *,
        vignetting: Vignetting | float | None = None,
        lens_blur_px: LensBlur | float | None = None,
        photoreceptor_bandwidth_hz: PhotoreceptorBandwidth | float | None = None,
        threshold_mismatch: ThresholdMismatch | float | None = None,
        refractory_period_us: RefractoryPeriod | float | None = None,
        leak_rate_hz: LeakRate | float | None = None,
        shot_noise_rms: ShotNoise | float | None = None,
        hot_pixels: HotPixels | float | None = None,
        readout: Readout | float | None = None,
        aps: Aps | float | None = None,
        switched_off: Iterable[str] = (),
    ) -> None:
        given = locals()
        neutral = {name for name in switched_off if _class_of(name, EFFECTS)}
        for name, effect_class in EFFECTS.items():
            value = given[name]
            if value is not None:
                value = _effect_of(name, effect_class, value)
            if value is not None and value.neutral:
                neutral.add(name)
                value = None
            elif value is not None:
                neutral.discard(name)
            object.__setattr__(self, name, value)
        object.__setattr__(self, "switched_off", frozenset(neutral))

    @classmethod
    def of(cls, effects: Iterable[Effect]) -> Effects:
        """Combine effects; of several of one kind, the last one counts."""
        given: dict[str, Any] = {effect.name: effect for effect in effects}
        return cls(**given)

    def with_defaults(self, others: Effects) -> Effects:
        """Return these effects and those of ``others`` not given here (an effect with a neutral value counts as
        given)."""
        kept = [effect for effect in others if effect.name not in self.switched_off]
        return Effects.of([*kept, *self]).without(self.switched_off)

    def without(self, names: Iterable[str]) -> Effects:
        """Return these effects with the named ones switched off: no defaults bring them back."""
        off = frozenset(names)
        kept: dict[str, Any] = {effect.name: effect for effect in self if effect.name not in off}
        return Effects(**kept, switched_off=self.switched_off | off)

    def __iter__(self) -> Iterator[Effect]:
        """Iterate over the effects that are on, in the order in which light and events meet them."""
        return (effect for name in EFFECTS if (effect := getattr(self, name)) is not None)

    def _repr_html_(self) -> str:
        rows = [
            (effect.name, ", ".join(f"{name} = {with_unit(name, value)}" for name, value in effect.settings().items()))
            for effect in self
        ]
        off = [(name, "switched off") for name in EFFECTS if name in self.switched_off]
        return html_table("Effects", [*rows, *off] or [("none", "ideal pixels")])

    @property
    def optical(self) -> Effects:
        """Return the effects of the lens, which act on luma."""
        return Effects.of(effect for effect in self if effect.acts_on == "luma")

    @property
    def noiseless(self) -> Effects:
        """Return the effects without leak, shot noise and hot pixels."""
        return self.without(NOISE)

    def __bool__(self) -> bool:
        """Return whether any effect is on."""
        return any(True for _ in self)

    def engine_settings(self) -> dict[str, dict[str, float | None]]:
        """Return the parameters of the effects that the crossing engine simulates, by effect."""
        return {effect.name: effect.settings() for effect in self if isinstance(effect, EngineEffect)}

    def describe(self) -> dict[str, dict[str, object]]:
        """Return the parameters of all effects that are on, by effect, in JSON's types; infinity is text."""
        return {
            effect.name: {name: "inf" if value == math.inf else value for name, value in effect.settings().items()}
            for effect in self
        }


EffectsLike: TypeAlias = Effects | Effect | Mapping[str, object] | str | Sequence[str | Effect]
"""What may be given as effects: Effects; one effect, or its text (see :func:`parse_effect`); several of these; or, by
their names, objects, numbers or parameters by name."""


def read_effects(given: EffectsLike | None) -> tuple[Effects, bool]:
    """Read effects from all that may be given, none from None; and whether others are to be planned.

    Raises:
        ValueError: for an effect or a parameter that is not there, a value that is missing, malformed or out of range.
    """
    if isinstance(given, Effects):
        return given, False
    if isinstance(given, str):
        given = [given]
    planned = isinstance(given, Sequence) and PLANNED in given
    named = [one for one in given if one != PLANNED] if planned else given  # type: ignore[union-attr]
    return Effects.of(named_effects(named).values()), planned


def effects_of(given: EffectsLike | None, *, not_planned: str) -> Effects:
    """Read effects as :func:`read_effects` does, where nothing can be planned.

    Args:
        not_planned: why ``auto`` is refused, and what to do instead; a part of the rule of an :class:`ArgumentError`.

    Raises:
        ArgumentError: for ``auto``.
        ValueError: as there.
    """
    effects, planned = read_effects(given)
    if planned:
        raise ArgumentError(f"{{effects:auto}} {not_planned}")
    return effects


def named_effects(
    given: Effect | Mapping[str, object] | str | Iterable[str | Effect] | None,
    among: Mapping[str, type[Effect]] = EFFECTS,
) -> dict[str, Effect]:
    """Read effects by name; of several of one kind the last one counts.

    Args:
        given: see :data:`EffectsLike`.
        among: the effects that there are, by name.

    Raises:
        ValueError: as :func:`effects_of`.
    """
    if isinstance(given, Mapping):
        return {name: _effect_of(name, _class_of(name, among), value) for name, value in given.items()}
    if given is None or isinstance(given, str | Effect):
        given = () if given is None else (given,)
    by_name: dict[str, Effect] = {}
    for item in given if isinstance(given, Iterable) else (given,):
        effect = parse_effect(item, among) if isinstance(item, str) else item
        names = [name for name, effect_class in among.items() if isinstance(effect, effect_class)]
        if not names:
            raise ValueError(f"effects must be Effects, a mapping by name, or texts NAME=VALUE, got {item!r}")
        by_name[names[0]] = effect
    return by_name


def parse_effect(text: str, among: Mapping[str, type[Effect]] = EFFECTS) -> Effect:
    """Parse an effect of the command line: ``NAME``, ``NAME=VALUE``, or ``NAME=VALUE,PARAMETER=VALUE,...``.

    The first value may go without its parameter's name. ``none`` stands for None. ``among`` are the effects by name.

    Raises:
        ValueError: for an effect or a parameter that is not there, a missing or a malformed value.
    """
    name, _, rest = text.partition("=")
    effect_class = _class_of(name, among)
    values: dict[str, float | None] = {}
    for index, assignment in enumerate(rest.split(",") if rest else []):
        parameter, equals, value = assignment.rpartition("=")
        parameter = parameter if equals or index else _parameters(effect_class)[0].name
        _check_parameter(name, effect_class, parameter, assignment)
        values[parameter] = _number(f"{name} {parameter}", value)
    return _effect_of(name, effect_class, values)


def _class_of(name: str, among: Mapping[str, type[Effect]]) -> type[Effect]:
    if name not in among:
        raise ValueError(f"there is no effect {name!r}; there are {', '.join(among)}{did_you_mean(str(name), among)}")
    return among[name]


def _effect_of(name: str, effect_class: type[Effect], value: object) -> Effect:
    """Make an effect of a class from an object of it, its first parameter, or its parameters by name."""
    if isinstance(value, effect_class):
        return value
    if value is None or isinstance(value, Effect):
        raise ValueError(f"effect {name} must be {effect_class.__name__}, a number, or a mapping, got {value!r}")
    if not isinstance(value, Mapping):
        return effect_class(value)  # type: ignore[call-arg]
    for parameter in value:
        _check_parameter(name, effect_class, parameter, parameter)
    missing = [one.name for one in _parameters(effect_class) if one.default is MISSING and one.name not in value]
    if missing:
        raise ValueError(f"effect {name} needs a value: {name}={missing[0].upper()}")
    return effect_class(**value)  # each class checks its own values


def _check_parameter(name: str, effect_class: type[Effect], parameter: str, assignment: str) -> None:
    names = [one.name for one in _parameters(effect_class)]
    if parameter not in names:
        near = did_you_mean(str(parameter), names)
        raise ValueError(f"effect {name} has the parameters {', '.join(names)}, got {assignment!r}{near}")


def _parameters(effect_class: type[Effect]) -> list[Field[Any]]:
    return [one for one in fields(effect_class) if one.init]  # type: ignore[arg-type]  # they are dataclasses


def _number(name: str, text: str) -> float | None:
    if text.lower() == "none":
        return None
    try:
        number = float(text)
    except ValueError:
        raise ValueError(f"{name} must be a number or none, got {text!r}") from None
    return int(number) if number.is_integer() and abs(number) < 2**53 else number
