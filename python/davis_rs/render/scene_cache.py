"""Caches what renderers make of a scene, for the next simulation of the same scene in this process.

Caching is opt-in, because a source may not be deterministic.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from typing import TypeVar

_Result = TypeVar("_Result")

_MOST = 12
"""How many results are kept: some three of each of the last few scenes."""

_cache: OrderedDict[Hashable, object] | None = None


def enable_scene_cache() -> None:
    """Switch the cache on until the process ends; the caller promises that a source gives the same scene each time."""
    global _cache
    _cache = OrderedDict() if _cache is None else _cache


@contextmanager
def shared_scenes() -> Iterator[None]:
    """Share what is made of scenes among all renderers that are made in this block, such as those of a rig's cameras.

    Where the cache is on already, nothing changes; else it is off again after the block.
    """
    global _cache
    before = _cache
    enable_scene_cache()
    try:
        yield
    finally:
        _cache = before


def cached(key: Hashable, make: Callable[[], _Result]) -> _Result:
    """Return ``make()``, or its earlier result for the same key where the cache is on."""
    if _cache is None:
        return make()
    if key not in _cache:
        result = make()
        _cache[key] = result
        while len(_cache) > _MOST:
            _cache.popitem(last=False)
        return result
    _cache.move_to_end(key)
    return _cache[key]  # type: ignore[return-value]
