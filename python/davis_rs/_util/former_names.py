"""Keeps former names of arguments and attributes working, each with a warning that says the present name."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Mapping
from functools import wraps
from typing import TypeVar

_PACKAGE = __name__.partition(".")[0]

Taker = TypeVar("Taker", bound=Callable[..., object])
Value = TypeVar("Value")


def is_now(former: str, name: str) -> str:
    """Say that a name was changed, in one line."""
    return f"{former} is called {name} now"


def with_present_names(given: Mapping[str, Value], present: Mapping[str, str]) -> dict[str, Value]:
    """Return arguments by their present names.

    Args:
        given: arguments by name.
        present: present names by former ones.

    Warns:
        DeprecationWarning: for each former name, at the line outside of this package that gave it.

    Raises:
        TypeError: if an argument is given by both names.
    """
    renamed: dict[str, Value] = {}
    for name, value in given.items():
        if name in present:
            if present[name] in given:
                raise TypeError(f"{present[name]} is given twice, once by its former name {name}")
            _warn(name, present[name])
        renamed[present.get(name, name)] = value
    return renamed


def takes_former_names(**present: str) -> Callable[[Taker], Taker]:
    """Make a function or a class take arguments by their former names too.

    Args:
        present: present names by former ones.
    """

    def mark(taker: Taker) -> Taker:
        if isinstance(taker, type):
            taker.__init__ = mark(taker.__init__)  # type: ignore[misc]
            return taker

        @wraps(taker)
        def renamed(*arguments: object, **by_name: object) -> object:
            return taker(*arguments, **with_present_names(by_name, present))

        return renamed  # type: ignore[return-value]  # it has the same signature

    return mark


class FormerAttribute:
    """Gives an attribute by its former name, with a DeprecationWarning.

    >>> class Cube:
    ...     volume = 1.0
    ...     size = FormerAttribute("volume")

    Args:
        name: the attribute's present name.
    """

    def __init__(self, name: str) -> None:
        self._name, self._former = name, ""

    def __set_name__(self, owner: type, former: str) -> None:
        self._former = former

    def __get__(self, instance: object, owner: type | None = None) -> object:
        if instance is None:
            return self
        _warn(self._former, self._name)
        return getattr(instance, self._name)


def _warn(former: str, name: str) -> None:
    """Warn at the innermost line outside of this package: only there does Python show the warning by default."""
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] == _PACKAGE:
        level, frame = level + 1, frame.f_back
    warnings.warn(is_now(former, name), DeprecationWarning, stacklevel=level)
