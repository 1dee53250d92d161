"""Finds the keys of a plan that stand for a function's arguments, where a ``kind`` names the function."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

from .._util.array_types import JsonObject, JsonValue

_DEGREES = {"_deg": "_rad", "_deg_s": "_rad_s"}


@dataclass(frozen=True)
class Key:
    """Describes a key of a kind.

    Attributes:
        argument: of the function, that it sets.
        annotation: of that argument, which tells what values the key takes.
        needed: it must be given.
        degrees: the key's value is in degrees, the argument in radians.
    """

    argument: str
    annotation: str
    needed: bool = False
    degrees: bool = False


def keys_of(
    function: Callable[..., object],
    *,
    left_out: Collection[str] = (),
    renamed: Mapping[str, str] | None = None,
    optional: Collection[str] = (),
) -> dict[str, Key]:
    """Return the keys that stand for a function's arguments.

    Next to each angle in ``_rad`` or ``_rad_s`` there is one in degrees.

    Args:
        left_out: arguments that no key sets.
        renamed: keys that are called otherwise than their arguments, by the key.
        optional: arguments without a default that need not be given all the same.
    """
    back = {argument: key for key, argument in (renamed or {}).items()}
    keys: dict[str, Key] = {}
    for name, parameter in inspect.signature(function).parameters.items():
        if name in left_out:
            continue
        needed = parameter.default is inspect.Parameter.empty and name not in optional
        keys[back.get(name, name)] = Key(name, str(parameter.annotation), needed)
        for degrees, radians in _DEGREES.items():
            if name.endswith(radians):
                in_degrees = name.removesuffix(radians) + degrees
                keys[in_degrees] = Key(name, str(parameter.annotation), degrees=True)
    return keys


def called_with(keys: Mapping[str, Key], given: Mapping[str, JsonValue]) -> JsonObject:
    """Return the arguments that keys and their values stand for."""
    return {
        keys[key].argument: math.radians(value) if keys[key].degrees and value is not None else value
        for key, value in given.items()
    }
