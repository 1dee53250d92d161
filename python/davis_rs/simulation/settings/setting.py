"""What is declared of a setting, and how values are checked and read from text by that declaration."""

from __future__ import annotations

import inspect
import math
import re
import textwrap
import types
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, TypeVar, Union, cast, get_args, get_origin, get_type_hints

from ..._util.argument_checks import is_number
from ..._util.argument_error import ArgumentError
from ..._util.close_names import did_you_mean, names_of, no_argument, without_unit
from ...sensor.effects import EFFECTS

Settings = TypeVar("Settings")
"""A TypedDict that declares settings: its keys are known to type checkers and editors."""


@dataclass(frozen=True)
class Declared:
    """What a setting's annotation says besides its Python type.

    Attributes:
        help: one sentence, for ``--help``, docstrings and docs/settings.md.
        default: of Python, of the command line and of plans alike.
        default_help: what None stands for, where None is the default.
        unit: of the number; "" where it has none.
        low, high: the smallest and largest value that is allowed.
        above_low: ``low`` itself is not allowed.
        choices: the texts that are allowed; () for any.
        file_suffixes: a text that ends so names a file, which is allowed next to the choices.
        words: texts that may stand in the place of a number.
        metavar: how ``--help`` names the value.
        group: under which heading it stands.
        text: what a command line or a plan gives, where the Python type allows more: str or list (of texts); None:
            only Python has this setting.
    """

    help: str
    default: Any = None
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
    text: type | None = object


@dataclass(frozen=True)
class Setting:
    """A setting of a simulation: its name, its type and what is declared of it.

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
        """Its name in plans: without the unit, which the docs tell."""
        return without_unit(self.name)

    @property
    def option(self) -> str:
        """Its option of the command line; one of a list is given at a time."""
        key = self.key.removesuffix("s") if self.kind is list else self.key
        return "--" + key.replace("_", "-")

    @property
    def range_text(self) -> str:
        """The allowed values in words; "" where any value of the type is allowed."""
        one = self.declared
        if one.choices:
            file = (f"a file ({', '.join(one.file_suffixes)})",) if one.file_suffixes else ()
            return ", or ".join([", ".join(one.choices), *file])
        if one.low == -math.inf and one.high == math.inf:
            return ""
        low, high = _number(one.low), _number(one.high)
        if one.high == math.inf:
            numbers = f"{'>' if one.above_low else '>='} {low}"
        else:
            numbers = f"> {low} and <= {high}" if one.above_low else f"{low}..{high}"
        return ", or ".join([numbers, *one.words])

    def check(self, value: Any) -> None:
        """Refuse a value that the declaration does not allow.

        Raises:
            ArgumentError: naming the setting, the range or choices, and the value.
        """
        fault = self._fault(value)
        if fault is not None:
            raise ArgumentError("{setting} must {}", fault, setting=self.name)

    def _fault(self, value: Any) -> str | None:
        """What the value must be, and is not; None where it is allowed."""
        one = self.declared
        if value is None:
            return "be given, got None" if one.default is not None else None
        if isinstance(value, str) and value in one.words:
            return None
        if one.choices and isinstance(value, str) and not self._is_choice(value):
            return f"be one of {self.range_text}, got {value!r}{did_you_mean(value, one.choices)}"
        if self.types not in ((int,), (float,)):
            fits = isinstance(value, self.types)
            form = f" ({one.metavar})" if one.metavar and str in self.types else ""
            return None if fits else f"be {self.annotation.removesuffix(' | None')}{form}, got {value!r}"
        whole = self.types == (int,)
        wanted = ", or ".join(["an integer" if whole else "a number", *one.words])
        unit = f" {one.unit}" if one.unit else ""
        if not is_number(value, whole=whole):
            return f"be {wanted}, got {value!r}"
        if not math.isfinite(value):
            return f"be finite, got {value!r}"
        if not one.low <= value <= one.high or (one.above_low and value == one.low):
            return f"be {self.range_text}{unit}, got {value!r}"
        return None

    def _is_choice(self, text: str) -> bool:
        suffixes = self.declared.file_suffixes
        return text in self.declared.choices or bool(suffixes and text.lower().endswith(suffixes))


@cache
def settings_of(declaration: type) -> Mapping[str, Setting]:
    """The settings that a TypedDict declares, by name, those of its bases first."""
    found = {}
    for name, hint in get_type_hints(declaration, include_extras=True).items():
        if get_origin(hint) is not Annotated:
            raise TypeError(f"{declaration.__name__}.{name} is not declared: Annotated[..., Declared(...)] is needed")
        annotation, declared = get_args(hint)
        kind = _kind(annotation) if declared.text is object else declared.text
        types = tuple(get_origin(one) or one for one in _members(annotation) if one is not type(None))
        if declared.words:
            types = tuple(one for one in types if one is not str)
        found[name] = Setting(name, _shown(annotation), types, kind, declared)
    return found


def complete(declaration: type[Settings], given: Mapping[str, object], *, of: Callable[..., Any] | str) -> Settings:
    """The given settings, checked, and the defaults of all others.

    Args:
        declaration: the TypedDict that declares them.
        given: by their names.
        of: the function or class that takes them, or who else does, for messages.

    Raises:
        TypeError: for a name that is not declared, with the one that is close.
        ArgumentError: for a value that is not allowed.
    """
    declared = settings_of(cast(type, declaration))
    for name, value in given.items():
        if name not in declared:
            known = declared if isinstance(of, str) else names_of(of)
            effects = {effect: f"effects={{{effect!r}: ...}}" for effect in EFFECTS} if "effects" in declared else {}
            raise TypeError(no_argument(of, name, known, effects))
        declared[name].check(value)
    return cast(Settings, {name: given.get(name, setting.declared.default) for name, setting in declared.items()})


def only(declaration: type[Settings], given: Mapping[str, object]) -> Settings:
    """Return those of the given settings that a declaration has."""
    declared = settings_of(cast(type, declaration))
    return cast(Settings, {name: value for name, value in given.items() if name in declared})


Taker = TypeVar("Taker", bound=Callable[..., Any])


def takes_settings(declaration: type) -> Callable[[Taker], Taker]:
    """Mark a function or a class whose ``**settings`` are those of a declaration.

    ``inspect.signature`` and ``help()`` then show each of them: the signature with its default, and the docstring with
    a line of its own in place of the line ``{settings}``.
    """

    def mark(taker: Taker) -> Taker:
        settings = settings_of(declaration).values()
        function: Any = vars(taker)["__init__"] if isinstance(taker, type) else taker
        plain = inspect.signature(function)
        kept = [one for one in plain.parameters.values() if one.kind is not inspect.Parameter.VAR_KEYWORD]
        listed = [
            inspect.Parameter(
                one.name, inspect.Parameter.KEYWORD_ONLY, default=one.declared.default, annotation=one.annotation
            )
            for one in settings
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
    """A line of a docstring's Args."""
    one = setting.declared
    facts = ", ".join(part for part in (setting.annotation, one.unit, setting.range_text) if part)
    default = one.default_help if one.default is None else repr(one.default)
    return f"{setting.name} ({facts}): {one.help}{f'; default: {default}' if default else ''}."


def _number(value: float) -> str:
    """A bound of a range, as people write it."""
    if value == 2**64 - 1:
        return "2^64 - 1"
    return str(int(value)) if math.isfinite(value) and value == int(value) else f"{value:g}"


def _kind(annotation: Any) -> type | None:
    kinds = [one for one in _members(annotation) if one is not type(None)]
    if len(kinds) != 1 or kinds[0] not in (float, int, bool, str):
        raise TypeError(f"how is {annotation} given as text? Declared(text=...) must say so")
    kind: type = kinds[0]
    return kind


def _members(annotation: Any) -> tuple[Any, ...]:
    return get_args(annotation) if get_origin(annotation) in (Union, types.UnionType) else (annotation,)


def _shown(annotation: Any) -> str:
    names = (str(one) if get_origin(one) else one.__name__ for one in _members(annotation))
    names = ("None" if name == "NoneType" else name for name in names)
    return re.sub(r"\b(?:\w+\.)+", "", " | ".join(names))
