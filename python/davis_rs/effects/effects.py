"""The composition of effects."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import MISSING, Field, dataclass, field, fields
from typing import Any

from ..close_names import did_you_mean
from .aps import Aps
from .effect import Effect
from .engine_effect import EngineEffect
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
    effect.name: effect
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


@dataclass(frozen=True, init=False)
class Effects:
    """What makes a sensor differ from ideal pixels; each effect is off unless it is given.

    >>> Effects(refractory_period_us=100, leak_rate_hz=0.1)

    Each argument is an object of the effect's class, or a number: its first parameter. An effect with neutral values is
    off, and becomes None; over a sensor's (:meth:`with_defaults`) it switches that one off. What an effect does is said
    by its class.

    Raises:
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
    ) -> None:
        given, neutral = locals(), set()
        for name, effect_class in EFFECTS.items():
            value = given[name]
            if value is not None and not isinstance(value, effect_class):
                value = effect_class(value)  # type: ignore[call-arg]  # their first parameter
            if value is not None and value.neutral:
                neutral.add(name)
                value = None
            object.__setattr__(self, name, value)
        object.__setattr__(self, "switched_off", frozenset(neutral))

    @classmethod
    def of(cls, effects: Iterable[Effect]) -> Effects:
        """Combine effects; of several of one kind, the last one counts."""
        given: dict[str, Any] = {effect.name: effect for effect in effects}
        return cls(**given)

    def with_defaults(self, others: Effects) -> Effects:
        """Return these and, of the others, those not given here (an effect with a neutral value counts as given)."""
        kept = [effect for effect in others if effect.name not in self.switched_off]
        return Effects.of([*kept, *self]).without(self.switched_off)

    def without(self, names: Iterable[str]) -> Effects:
        """Return these, with the named ones switched off: no defaults bring them back."""
        off = frozenset(names)
        kept = Effects.of(effect for effect in self if effect.name not in off)
        object.__setattr__(kept, "switched_off", self.switched_off | off)
        return kept

    def __iter__(self) -> Iterator[Effect]:
        """The effects that are on, in the order in which light and events meet them."""
        return (effect for name in EFFECTS if (effect := getattr(self, name)) is not None)

    @property
    def optical(self) -> Effects:
        """Those that act on luma: the lens's."""
        return Effects.of(effect for effect in self if effect.acts_on == "luma")

    def __bool__(self) -> bool:
        """Whether any is on."""
        return any(True for _ in self)

    def engine_settings(self) -> dict[str, dict[str, Any]]:
        """Return the parameters, by effect, of those that the crossing engine simulates."""
        return {effect.name: effect.settings() for effect in self if isinstance(effect, EngineEffect)}

    def describe(self) -> dict[str, dict[str, Any]]:
        """Return the parameters of all that are on, by effect, in JSON's types for records; infinity is text."""
        return {
            effect.name: {name: "inf" if value == math.inf else value for name, value in effect.settings().items()}
            for effect in self
        }


def parse_effect(text: str, among: Mapping[str, type[Effect]] = EFFECTS) -> Effect:
    """Parse an effect of the command line: ``NAME``, ``NAME=VALUE``, or ``NAME=VALUE,PARAMETER=VALUE,...``.

    The first value may go without its parameter's name. ``none`` stands for None. ``among`` are the effects by name.

    Raises:
        ValueError: for an effect or a parameter that is not there, a missing or a malformed value.
    """
    name, _, rest = text.partition("=")
    if name not in among:
        raise ValueError(f"there is no effect {name!r}; there are {', '.join(among)}{did_you_mean(name, among)}")
    effect_class = among[name]
    parameters: list[Field[Any]] = [one for one in fields(effect_class) if one.init]  # type: ignore[arg-type]
    names = [parameter.name for parameter in parameters]
    values: dict[str, float | None] = {}
    for place, part in enumerate(rest.split(",") if rest else []):
        parameter, equals, value = part.rpartition("=")
        parameter = parameter if equals or place else names[0]
        if parameter not in names:
            raise ValueError(f"effect {name} has the parameters {', '.join(names)}, got {part!r}")
        values[parameter] = _number(f"{name} {parameter}", value)
    missing = [one.name for one in parameters if one.default is MISSING and one.name not in values]
    if missing:
        raise ValueError(f"effect {name} needs a value: {name}={missing[0].upper()}")
    return effect_class(**values)  # each checks its own


def _number(what: str, text: str) -> float | None:
    if text.lower() == "none":
        return None
    try:
        number = float(text)
    except ValueError:
        raise ValueError(f"{what} must be a number or none, got {text!r}") from None
    return int(number) if number.is_integer() and abs(number) < 2**53 else number
