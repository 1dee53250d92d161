"""Keeps the last few results that were used, so that a run computes them once."""

from __future__ import annotations

from typing import TypeVar

_Key = TypeVar("_Key")
_Result = TypeVar("_Result")


def keep_last(known: dict[_Key, _Result], key: _Key, result: _Result, most: int) -> None:
    """Keep a result as the one that was used last, and drop those that were used before the last ``most``."""
    known.pop(key, None)
    known[key] = result
    while len(known) > most:
        del known[next(iter(known))]
