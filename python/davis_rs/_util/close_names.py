"""Asks "did you mean ...?" for names that users type."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from difflib import get_close_matches
from functools import wraps
from typing import TypeVar

from .argument_error import ArgumentError
from .names_elsewhere import NAMES_ELSEWHERE

_UNITS = ("_hz", "_px", "_m_s", "_ms_per_min", "_m", "_rad", "_deg", "_s", "_ms", "_us", "_ns")
"""With which names of settings end."""

_SHORTEST = 4
"""A name of so many letters may stand for a longer one that it is a part of."""

_LISTED = 12
"""So many names are listed where none is close."""


def did_you_mean(given: str, names: Iterable[str], effects: Mapping[str, str] | None = None) -> str:
    """Return a question that names what was probably meant, to be put behind a message; "" where nothing is close.

    Args:
        names: that are allowed in its place.
        effects: effects that may be given, but not in its place: how, by their names.
    """
    effects = effects or {}
    folded = _folded(given)
    known = {_folded(name): name for name in names}
    elsewhere = None if folded in effects else NAMES_ELSEWHERE.get(folded)
    if elsewhere is None:
        either = {**effects, **known}
        same = [name for name in either if without_unit(name) == without_unit(folded)]
        close = same or get_close_matches(folded, known, 1, 0.6) or get_close_matches(folded, effects, 1, 0.75)
        close = close or [name for name in either if len(folded) >= _SHORTEST and folded in name]
        return f"; did you mean {either[close[0]]}?" if close else ""
    ours, whose = elsewhere.ours, f"{folded} in {elsewhere.whose}"
    note = f"; here {elsewhere.note}" if elsewhere.note else ""
    meant = known.get(ours) or known.get(without_unit(ours)) or effects.get(ours)
    if meant:
        return f"; did you mean {meant}? ({whose}{note})"
    return f" ({whose}{f' is {ours} here' if ours else note})"


def no_name_or_file(argument: str, given: str, names: Iterable[str], suffixes: Iterable[str]) -> ArgumentError:
    """Return the error for an argument that is neither a known name nor, by its suffix, a file."""
    names = list(names)
    known = f"{', '.join(names)}, or a file ({', '.join(suffixes)})"
    rule = f"{{{argument}}} must be one of {{}}, got {{!r}}{{}}"
    return ArgumentError(rule, known, given, did_you_mean(given, names))


def without_unit(name: str) -> str:
    """Return the name of a setting without the unit with which it ends."""
    return next((name.removesuffix(unit) for unit in _UNITS if name.endswith(unit)), name)


def names_of(taker: Callable[..., object]) -> list[str]:
    """List the arguments that a function or a class takes by name."""
    parameters = inspect.signature(taker).parameters.values()
    by_name = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    return [one.name for one in parameters if one.kind in by_name and one.name != "self"]


Taker = TypeVar("Taker", bound=Callable[..., object])


def names_checked(taker: Taker) -> Taker:
    """Make a function, or a class, refuse an argument that it does not have with the one that is close.

    Python does so itself from 3.13 on, but knows neither names of other simulators nor units.
    """
    if isinstance(taker, type):
        taker.__init__ = names_checked(taker.__init__)  # type: ignore[misc]
        return taker
    names = frozenset(names_of(taker))

    @wraps(taker)
    def checked(*arguments: object, **by_name: object) -> object:
        for name in by_name:
            if name not in names:
                raise TypeError(no_argument(taker, name, names_of(taker)))
        return taker(*arguments, **by_name)

    return checked  # type: ignore[return-value]  # it has the same signature


def no_argument(
    taker: Callable[..., object] | str, given: str, names: Iterable[str], effects: Mapping[str, str] | None = None
) -> str:
    """Say of an argument that a function does not have it, and name the one that is close.

    Args:
        taker: the function or class, or who else takes arguments.
        given: the argument.
        names, effects: as of :func:`did_you_mean`.
    """
    who = taker if isinstance(taker, str) else taker.__qualname__.removesuffix(".__init__")
    near = did_you_mean(given, names := list(names), effects)
    listed = f"; it has {', '.join(names)}" if len(names) <= _LISTED else ""
    return f"{who} has no argument {given!r}{near or listed}"


def _folded(name: str) -> str:
    return name.lstrip("-").replace("-", "_").lower()
