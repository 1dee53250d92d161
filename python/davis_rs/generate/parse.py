"""Turns what YAML holds into the nodes of a plan: values of the right type, or distributions that give such values."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from .._util.close_names import did_you_mean
from ..sensor.effects import EFFECTS
from .distributions import Choice, Distribution, Integers, LogUniform, Normal, Uniform
from .kinds import Key
from .motion import MOTIONS, motion_keys
from .random_scene import RANDOM_SCENES, scene_keys

DISTRIBUTIONS = {
    "uniform": "a number",
    "log_uniform": "a number",
    "normal": "a number",
    "integers": "an integer",
    "choice": "anything",
}
"""The distributions by the key that tells them, and what they give."""

Parser = Callable[[object, "Where"], object]


@dataclass(frozen=True)
class Where:
    """Says where in a plan a value stands, for messages."""

    file: Path
    path: str = ""

    def at(self, key: object) -> Where:
        """Return where a key, or an item of a list, stands within this."""
        return Where(self.file, f"{self.path}.{key}" if self.path else str(key))

    def refuse(self, rule: str, value: object) -> NoReturn:
        """Raise the ValueError that names file, key path, rule and value."""
        raise ValueError(f"{self.file}: {self.path or 'the plan'}: must be {rule}, got {value!r}")

    def mapping(self, value: object, rule: str) -> dict[str, object]:
        """Return ``value`` if it is a mapping from texts."""
        if not isinstance(value, dict):
            self.refuse(rule, value)
        for key in value:
            if not isinstance(key, str):
                self.refuse("a mapping whose keys are texts", key)
        return value

    def unknown(
        self, key: str, known: Mapping[str, object] | tuple[str, ...], effects: Mapping[str, str] | None = None
    ) -> NoReturn:
        """Refuse a key that is not among those that are known; ``effects`` as of :func:`did_you_mean`."""
        near = did_you_mean(key, known, effects) or f"; there are {', '.join(known)}"
        raise ValueError(f"{self.file}: {self.at(key).path}: there is no such key{near}")


def value_of(rule: str, *, none: bool = True, words: tuple[str, ...] = ()) -> Parser:
    """Return the parser of a value: "a number", "an integer", "a text" or "true or false".

    Args:
        none: null may stand for it.
        words: so may these texts.
    """

    def parse(value: object, where: Where) -> object:
        if isinstance(value, dict):
            return _distribution(value, where, parse, rule)
        if not ((none and value is None) or _fits(rule, value) or (isinstance(value, str) and value in words)):
            where.refuse(f"{rule} or a distribution ({', '.join(DISTRIBUTIONS)})", value)
        return value

    return parse


def motion(value: object, where: Where) -> object:
    """Parse a motion: a mapping with its kind, or a choice of such."""
    if value is None:
        return None
    given = where.mapping(value, "a mapping with the motion's kind")
    if "choice" in given:
        return _distribution(given, where, motion, "a motion")
    return _of_kind(given, where, {kind: motion_keys(kind) for kind in MOTIONS}, "motion")


def scene(value: object, where: Where) -> object:
    """Parse a scene: a name or a file, a mapping with the kind of one that is drawn, or a choice of such.

    The name of a kind alone stands for the mapping without other keys.
    """
    if isinstance(value, str) and value in RANDOM_SCENES:
        value = {"kind": value}
    if isinstance(value, dict) and "choice" in value:
        return _distribution(value, where, scene, "a scene")
    if isinstance(value, dict) and "kind" in value:
        given = where.mapping(value, "a mapping with the scene's kind")
        return _of_kind(given, where, {kind: scene_keys(kind) for kind in RANDOM_SCENES}, "scene")
    if isinstance(value, dict) and not value.keys() & DISTRIBUTIONS.keys():
        where.refuse("a name or a file, a mapping with the scene's kind, or a choice of such", value)
    return value_of("a text", none=False)(value, where)


def start_pose(value: object, where: Where) -> object:
    """Parse where a camera's path starts."""
    if value is None:
        return None
    given = where.mapping(value, f"a mapping of {', '.join(START_POSE)}")
    if "choice" in given:
        return _distribution(given, where, start_pose, "a start")
    for key, node in given.items():
        if key not in START_POSE:
            where.unknown(key, START_POSE)
        if key != "time" and not (isinstance(node, list) and len(node) == 3):
            where.at(key).refuse("a list of three numbers: right, down, ahead", node)
    number = value_of("a number", none=False)
    return {key: (number if key == "time" else _numbers)(node, where.at(key)) for key, node in given.items()}


START_POSE = ("time", "position_m", "rotation_deg")
"""Where on the scene's own path, and how far from it: in camera axes, rotation as a rotation vector."""


def _of_kind(
    given: dict[str, object], where: Where, kinds: Mapping[str, Mapping[str, Key]], subject: str
) -> dict[str, object]:
    """Parse a mapping that names a function by its kind, and has its arguments."""
    kind = given.get("kind")
    if not isinstance(kind, str) or kind not in kinds:
        where.at("kind").refuse(f"one of {', '.join(kinds)}", kind)
    known = kinds[kind]
    parsed: dict[str, object] = {"kind": kind}
    for key, node in given.items():
        if key == "kind":
            continue
        if key not in known:
            where.unknown(key, ("kind", *known))
        if known[key].degrees and (other := known[key].argument) in given:
            where.at(key).refuse(f"the only one, but {other} is given as well", node)
        parsed[key] = _ARGUMENTS.get(known[key].annotation, value_of("a text", none=False))(node, where.at(key))
    arguments = {known[key].argument for key in parsed if key != "kind"}
    for name, wanted in known.items():
        if wanted.needed and wanted.argument not in arguments:
            raise ValueError(f"{where.file}: {where.path}: a {subject} of kind {kind} needs {name}")
    return parsed


def effects(value: object, where: Where) -> object:
    """Parse effects: texts, ``auto`` among them, a mapping from names to values or parameters, or a choice."""
    return _effects(value, where, automatic=True)


def imu_effects(value: object, where: Where) -> object:
    """Parse the IMU's effects: as :func:`effects`, without ``auto``."""
    return _effects(value, where, automatic=False)


def _effects(value: object, where: Where, *, automatic: bool) -> object:
    rule = "a mapping from effects to their values, or texts NAME=VALUE" + (", or auto" if automatic else "")
    texts = [value] if isinstance(value, str) else value
    if value is None:
        return value
    if isinstance(texts, list) and texts and all(isinstance(text, str) for text in texts):
        if not all("=" in text or text in EFFECTS or (automatic and text == "auto") for text in texts):
            where.refuse(rule, value)
        return value
    given = where.mapping(value, rule)
    if "choice" in given:
        return _distribution(given, where, lambda option, at: _effects(option, at, automatic=automatic), "effects")
    number = value_of("a number")
    parsed: dict[str, object] = {}
    for name, node in given.items():
        at = where.at(name)
        if isinstance(node, dict) and not node.keys() & DISTRIBUTIONS.keys():
            parameters = at.mapping(node, "a mapping from parameters to numbers")
            parsed[name] = {key: number(given, at.at(key)) for key, given in parameters.items()}
        else:
            parsed[name] = number(node, at)
    return parsed


def _numbers(value: object, where: Where) -> tuple[object, ...]:
    """Parse a list of numbers, each of which may be a distribution."""
    if not isinstance(value, list):
        where.refuse("a list of numbers", value)
    number = value_of("a number", none=False)
    return tuple(number(item, where.at(index)) for index, item in enumerate(value))


_ARGUMENTS: dict[str, Parser] = {
    "float": value_of("a number", none=False),
    "float | None": value_of("a number"),
    "int": value_of("an integer", none=False),
    "int | None": value_of("an integer"),
    "bool": value_of("true or false", none=False),
    "npt.ArrayLike": _numbers,
}
"""The parsers of arguments, by their annotations; texts for all others."""


def _distribution(value: dict[str, object], where: Where, parse: Parser, rule: str) -> Distribution:
    """Make the distribution that a mapping describes, where ``rule`` says what is wanted."""
    which = [key for key in value if key in DISTRIBUTIONS]
    if len(which) != 1:
        where.refuse(f"{rule} or one distribution ({', '.join(DISTRIBUTIONS)})", value)
    name = which[0]
    gives = DISTRIBUTIONS[name]
    if gives not in (rule, "anything") and (rule, gives) != ("a number", "an integer"):
        where.refuse(f"{rule}, or a distribution of such", value)
    more = {"choice": ("weights",), "normal": ("min", "max")}.get(name, ())
    for key in value:
        if key not in (name, *more):
            where.unknown(str(key), (name, *more))
    listed = value[name]
    if not isinstance(listed, list):
        where.at(name).refuse("a list", listed)
    try:
        if name == "choice":
            options = tuple(parse(option, where.at(f"choice[{index}]")) for index, option in enumerate(listed))
            weights = _all_fit("a number", value.get("weights", []), where.at("weights"))
            return Choice(options, tuple(map(float, weights)))
        numbers = _all_fit("an integer" if name == "integers" else "a number", listed, where.at(name), 2)
        if name == "integers":
            return Integers(*map(int, numbers))
        if name == "normal":
            bounds = {key: float(_all_fit("a number", [value[key]], where.at(key))[0]) for key in more if key in value}
            mean, sigma = map(float, numbers)
            return Normal(mean, sigma, bounds.get("min", -math.inf), bounds.get("max", math.inf))
        return {"uniform": Uniform, "log_uniform": LogUniform}[name](*map(float, numbers))
    except ValueError as error:
        if str(error).startswith(f"{where.file}: "):
            raise
        raise ValueError(f"{where.file}: {where.path}: {name}: {error}, got {value!r}") from None


def _all_fit(rule: str, values: object, where: Where, count: int | None = None) -> list[float]:
    """Return a list of numbers that fit, or refuse it."""
    if not isinstance(values, list) or not all(_fits(rule, value) for value in values):
        where.refuse(f"a list of values that are each {rule}", values)
    if count is not None and len(values) != count:
        where.refuse(f"a list of {count}", values)
    return values


def _fits(rule: str, value: object) -> bool:
    # Integers of YAML have any number of digits, and may stand wherever numbers do.
    largest = sys.float_info.max
    finite = isinstance(value, int | float) and not isinstance(value, bool) and -largest <= value <= largest
    return {
        "a number": finite,
        "an integer": finite and isinstance(value, int),
        "a text": isinstance(value, str),
        "true or false": isinstance(value, bool),
    }[rule]
