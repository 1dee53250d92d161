"""Caches what renderers make of a scene, for the next simulation of the same scene in this process.

Caching is opt-in, because a source may not be deterministic.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import TypeVar

_Made = TypeVar("_Made")

_MOST = 12
"""Of what is kept: three things each of the last few scenes."""

_kept: OrderedDict[Hashable, object] | None = None


def keep_scenes() -> None:
    """Keep what is made of the last few scenes, until the process ends: their sources give the same each time."""
    global _kept
    _kept = OrderedDict() if _kept is None else _kept


def kept(key: Hashable, make: Callable[[], _Made]) -> _Made:
    """What ``make`` gives, or gave when it was last called with this key, where scenes are kept."""
    if _kept is None:
        return make()
    if key not in _kept:
        made = make()
        _kept[key] = made
        while len(_kept) > _MOST:
            _kept.popitem(last=False)
        return made
    _kept.move_to_end(key)
    return _kept[key]  # type: ignore[return-value]
