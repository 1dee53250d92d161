"""Declares settings as fields of frozen dataclasses, and checks values by what is declared.

:func:`declare` puts a :class:`Declared` into a field's metadata; :func:`settings_of` reads it back; :func:`complete`
checks values and makes the dataclass. All that takes settings goes this way, so that all refuse the same values in the
same words.
"""

from __future__ import annotations

import inspect
import math
import re
import textwrap
import types
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

from ..._util.argument_checks import is_number
from ..._util.argument_error import ArgumentError
from ..._util.close_names import did_you_mean, names_of, no_argument, without_unit
from ..._util.former_names import with_present_names
from ...sensor.effects import EFFECTS

Value = TypeVar("Value")


@dataclass(frozen=True)
class Declared:
    """Holds what a setting has besides its name and its Python type.

    Attributes:
        help: one sentence, for ``--help``, docstrings and docs/settings.md.
        default: of Python, of the command line and of plans alike; :func:`declare` fills it in.
        default_help: what None stands for, where None is the default.
        unit: of the number; "" where it has none.
        low, high: the smallest and largest value that is allowed.
        above_low: ``low`` itself is not allowed.
        choices: the texts that are allowed; () for any.
        file_suffixes: a text that ends so names a file, which is allowed next to the choices.
        words: texts that may stand in the place of a number.
        metavar: how ``--help`` names the value.
        group: under which heading it stands.
        former_name: under which it was known; it is still taken, with a line that says the present one.
        text: what a command line or a plan gives, where the Python type allows more: str or list (of texts); None:
            only Python has this setting.
    """

    help: str
    default: object = None
    default_help: str = ""
    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    above_low: bool = False
    choices: tuple[str, ...] = ()
    file_suffixes: tuple[str, ...] = ()
    words: tuple[str, ...] = ()
    metavar: str | None = None
    group: str = "camera and pixel"
    former_name: str = ""
    text: type | None = object


def declare(default: Value, declared: Declared) -> Value:
    """Declare a field of a dataclass that derives from :class:`Settings`.

    Args:
        default: of the field.
        declared: help, unit, range and whatever else options, keys and checks need.

    Returns:
        A ``dataclasses.field``; to type checkers it is the default.
    """
    return field(default=default, metadata={_DECLARED: replace(declared, default=default)})


_DECLARED = "declared"
"""The key of a field's metadata."""


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Holds settings, each a field with a default that comes from :func:`declare`; the base of all declarations."""

    def by_name(self) -> dict[str, object]:
        """Return the settings by name, in the order of their declaration; values are not copied."""
        return {name: getattr(self, name) for name in settings_of(type(self))}


SettingsType = TypeVar("SettingsType", bound=Settings)


@dataclass(frozen=True)
class Setting:
    """Describes a setting as options, keys and checks see it: its name, its type and what is declared of it.

    Attributes:
        name: of the Python argument, and in meta.json; it ends with the unit where there is one.
        annotation: the Python type as text.
        types: the classes of Python's values; of a number, without that of its words.
        kind: of a value from a command line or a plan: float, int, bool, str, or list (of texts); None if only Python
            has this setting.
    """

    name: str
    annotation: str
    types: tuple[type, ...]
    kind: type | None
    declared: Declared

    @property
    def key(self) -> str:
        """Return its name in plans: without the unit, which the docs tell."""
        return without_unit(self.name)

    @property
    def option(self) -> str:
        """Return its option of the command line; a list is given one value at a time."""
        key = self.key.removesuffix("s") if self.kind is list else self.key
        return "--" + key.replace("_", "-")

    @property
    def range_text(self) -> str:
        """Return the allowed values in words; "" where any value of the type is allowed."""
        declared = self.declared
        if declared.choices:
            file = (f"a file ({', '.join(declared.file_suffixes)})",) if declared.file_suffixes else ()
            return ", or ".join([", ".join(declared.choices), *file])
        if declared.low == -math.inf and declared.high == math.inf:
            return ""
        low, high = _number(declared.low), _number(declared.high)
        if declared.high == math.inf:
            numbers = f"{'>' if declared.above_low else '>='} {low}"
        else:
            numbers = f"> {low} and <= {high}" if declared.above_low else f"{low}..{high}"
        return ", or ".join([numbers, *declared.words])

    def check(self, value: object) -> None:
        """Refuse a value that the declaration does not allow.

        Raises:
            ArgumentError: naming the setting, the range or choices, and the value.
        """
        fault = self._fault(value)
        if fault is not None:
            raise ArgumentError("{setting} must {}", fault, setting=self.name)

    def _fault(self, value: object) -> str | None:
        """Say what the value must be and is not; return None where it is allowed."""
        declared = self.declared
        if value is None:
            return "be given, got None" if declared.default is not None else None
        if isinstance(value, str) and value in declared.words:
            return None
        if declared.choices and isinstance(value, str) and not self._is_choice(value):
            return f"be one of {self.range_text}, got {value!r}{did_you_mean(value, declared.choices)}"
        if self.types not in ((int,), (float,)):
            fits = isinstance(value, self.types)
            form = f" ({declared.metavar})" if declared.metavar and str in self.types else ""
            return None if fits else f"be {self.annotation.removesuffix(' | None')}{form}, got {value!r}"
        whole = self.types == (int,)
        wanted = ", or ".join(["an integer" if whole else "a number", *declared.words])
        unit = f" {declared.unit}" if declared.unit else ""
        if not is_number(value, whole=whole):
            return f"be {wanted}, got {value!r}"
        if not math.isfinite(value):
            return f"be finite, got {value!r}"
        if not declared.low <= value <= declared.high or (declared.above_low and value == declared.low):
            return f"be {self.range_text}{unit}, got {value!r}"
        return None

    def _is_choice(self, text: str) -> bool:
        suffixes = self.declared.file_suffixes
        return text in self.declared.choices or bool(suffixes and text.lower().endswith(suffixes))


_READ: dict[type[Settings], Mapping[str, Setting]] = {}
"""What :func:`settings_of` has read: type hints are slow to resolve."""


def settings_of(declaration: type[Settings]) -> Mapping[str, Setting]:
    """Return the settings that a dataclass declares, by name, those of its bases first."""
    if declaration not in _READ:
        hints = get_type_hints(declaration)
        _READ[declaration] = {
            each.name: _setting(each.name, hints[each.name], each.metadata[_DECLARED]) for each in fields(declaration)
        }
    return _READ[declaration]


def former_names_of(declaration: type[Settings]) -> dict[str, str]:
    """Return the present names of settings by former ones."""
    settings = settings_of(declaration).values()
    return {each.declared.former_name: each.name for each in settings if each.declared.former_name}


def _setting(name: str, annotation: object, declared: Declared) -> Setting:
    kind = _kind(annotation) if declared.text is object else declared.text
    types = tuple(get_origin(member) or member for member in _members(annotation) if member is not type(None))
    if declared.words:
        types = tuple(member for member in types if member is not str)
    return Setting(name, _shown(annotation), types, kind, declared)


def complete(
    declaration: type[SettingsType], given: Mapping[str, object], *, taker: Callable[..., object] | str
) -> SettingsType:
    """Check the given settings and add the defaults of all others.

    Args:
        declaration: the dataclass that declares them.
        given: by their names.
        taker: the function or class that takes them, or who else does, for messages.

    Raises:
        TypeError: for a name that is not declared, with the one that is close; for a setting that is given by its
            former name too.
        ArgumentError: for a value that is not allowed.
    """
    declared = settings_of(declaration)
    given = with_present_names(given, former_names_of(declaration))
    for name, value in given.items():
        if name not in declared:
            known = declared if isinstance(taker, str) else names_of(taker)
            effects = {effect: f"effects={{{effect!r}: ...}}" for effect in EFFECTS} if "effects" in declared else {}
            raise TypeError(no_argument(taker, name, known, effects))
        declared[name].check(value)
    return declaration(**given)


def only(declaration: type[SettingsType], settings: Settings) -> SettingsType:
    """Return those of the settings that a smaller declaration has."""
    return declaration(**{name: getattr(settings, name) for name in settings_of(declaration)})


Taker = TypeVar("Taker", bound=Callable[..., object])


def takes_settings(declaration: type[Settings]) -> Callable[[Taker], Taker]:
    """Mark a function or a class whose ``**settings`` are those of a declaration.

    ``inspect.signature`` and ``help()`` then show each of them: the signature with its default, and the docstring with
    a line of its own in place of the line ``{settings}``.
    """

    def mark(taker: Taker) -> Taker:
        settings = settings_of(declaration).values()
        function: Any = vars(taker)["__init__"] if isinstance(taker, type) else taker
        plain = inspect.signature(function)
        kept = [each for each in plain.parameters.values() if each.kind is not inspect.Parameter.VAR_KEYWORD]
        listed = [
            inspect.Parameter(
                each.name, inspect.Parameter.KEYWORD_ONLY, default=each.declared.default, annotation=each.annotation
            )
            for each in settings
        ]
        function.__signature__ = plain.replace(parameters=[*kept, *listed])
        indent, mark, _ = (taker.__doc__ or "").partition("{settings}")
        if mark:
            margin = indent[indent.rindex("\n") :]
            lines = (
                textwrap.fill(line, 118 - len(margin), subsequent_indent="    ") for line in map(_argument, settings)
            )
            taker.__doc__ = (taker.__doc__ or "").replace("{settings}", "\n".join(lines).replace("\n", margin), 1)
        return taker

    return mark


def _argument(setting: Setting) -> str:
    """Return a line of a docstring's Args."""
    declared = setting.declared
    facts = ", ".join(fact for fact in (setting.annotation, declared.unit, setting.range_text) if fact)
    default = declared.default_help if declared.default is None else repr(declared.default)
    return f"{setting.name} ({facts}): {declared.help}{f'; default: {default}' if default else ''}."


def _number(value: float) -> str:
    """Write a bound of a range as people do."""
    if value == 2**64 - 1:
        return "2^64 - 1"
    return str(int(value)) if math.isfinite(value) and value == int(value) else f"{value:g}"


def _kind(annotation: object) -> type | None:
    kinds = [member for member in _members(annotation) if member is not type(None)]
    if len(kinds) != 1 or kinds[0] not in (float, int, bool, str):
        raise TypeError(f"how is {annotation} given as text? Declared(text=...) must say so")
    kind: type = kinds[0]
    return kind


def _members(annotation: object) -> tuple[Any, ...]:
    return get_args(annotation) if get_origin(annotation) in (Union, types.UnionType) else (annotation,)


def _shown(annotation: object) -> str:
    names = (str(member) if get_origin(member) else member.__name__ for member in _members(annotation))
    names = ("None" if name == "NoneType" else name for name in names)
    return re.sub(r"\b(?:\w+\.)+", "", " | ".join(names))
