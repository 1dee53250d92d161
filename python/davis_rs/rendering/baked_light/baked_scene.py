"""The baked light of a scene: from the cache, or computed now."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..._mitsuba import FAST, default_variant, load_scene_source, variant, versions
from ...progress import progress, say
from ...scene.scene import Scene
from ..matte import simplify_materials
from ..scene_texture import Unsuitable
from . import cache
from .bake import LightMaps, Surfaces, bake
from .lights import (
    SkyMap,
    background_luma,
    check_lights,
    emissions,
    irradiance_of,
    light_groups,
    numbers,
    paths_of,
    sky_map,
)

FloatArray = npt.NDArray[np.float64]

VERSION = 2
"""Of what is computed, so that light of older versions is not taken from the cache."""


_MOST_KNOWN = 4
_known: dict[str, LightMaps] = {}
"""The last that were used: a run makes several renderers of one scene."""


@dataclass(frozen=True)
class BakedLight:
    """Light on the surfaces of a scene, and what its lamps and its sky look like themselves.

    Attributes:
        maps: irradiance, for each group of lights.
        names: of the groups: "" for all lights that do not change, and the names of those that do.
        emitted: (t) luma that each triangle emits from its front.
        emitters: (t) the group that this belongs to.
        backgrounds: luma of a ray that hits nothing, by each group.
        sky: what such a ray sees in addition; None where there is no environment map.
        content: a hash of the scene's surfaces, materials and lights.
        cached: whether it is in the cache now.
    """

    maps: LightMaps
    names: list[str]
    emitted: FloatArray
    emitters: npt.NDArray[np.int64]
    backgrounds: list[float]
    sky: SkyMap | None
    content: str
    cached: bool

    @property
    def description(self) -> str:
        """What it is, for people."""
        maps = self.maps
        coarse = "" if maps.complete else ", coarser than asked for: that would take too much memory"
        return f"baked light at {maps.points:,} points, whose error is estimated at {100 * maps.error:.2g} %{coarse}"


def baked_light(scene: Scene, surfaces: Surfaces, changing: Sequence[str], error: float) -> BakedLight:
    """Bake a scene's light, or take it from the cache.

    Args:
        surfaces: of the scene, in the order of its shapes.
        changing: names of the lights whose strength changes.
        error: that is allowed, relative.

    Raises:
        Unsuitable: for lights or an integrator that this is not made for, or without LLVM.
        ValueError: for lights that cannot be.
    """
    name, why = default_variant()
    if name != FAST:
        raise Unsuitable(f"its light would have to be baked, which needs LLVM: {why}")
    with variant(FAST) as (mi, _):
        loaded = load_scene_source(scene.source(), mi)
        simplify_materials(loaded, mi, matte=scene.matte)
        if not loaded.emitters():
            raise Unsuitable("it has no lights")
        paths = paths_of(loaded.integrator())
        check_lights(loaded, mi)
        names = light_groups(loaded, changing)
        emitted, emitters = emissions(loaded, mi, surfaces.counts, names)
        backgrounds = background_luma(loaded, mi, names)
        sky = sky_map(loaded, mi, names)
        content = _content(loaded, mi, surfaces)
        settings = (VERSION, sorted(versions(FAST).items()), paths, names, error, content)
        key = hashlib.sha256(repr(settings).encode()).hexdigest()
        maps = _known.get(key)
        if maps is None and (maps := cache.load(key)) is not None:
            say(f"the scene's light was baked before, and comes from {cache.cache_folder()}")
        if maps is None:
            kept = cache.load_partial(key)
            with (
                progress("baking light", 0, unit="points") as bar,
                cache.kept_if_stopped(key, kept),
                irradiance_of(loaded, mi, names, kept) as lights,
            ):

                def seen(what: str, done: int, expected: int) -> None:
                    bar.total = max(bar.total, expected)
                    bar.to(done, what)

                maps = bake(surfaces, lights, error, seen=seen)
            say(f"the scene's light was baked in {maps.seconds:.3g} s, at {maps.points:,} points")
            cache.store(key, maps)
        while len(_known) >= _MOST_KNOWN:
            del _known[next(iter(_known))]
        _known[key] = maps
    return BakedLight(maps, names, emitted, emitters, backgrounds, sky, content, cache.holds(key))


def _content(scene: Any, mi: Any, surfaces: Surfaces) -> str:
    """A hash of surfaces, materials and lights."""
    digest = hashlib.sha256()
    for array in (surfaces.corners, surfaces.normals, surfaces.two_sided):
        digest.update(repr(array.shape).encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    for part in _parts(scene):
        parameters = mi.traverse(part)
        digest.update(f"{part.class_name()} {part}".encode())
        for name in sorted(key for key, _ in parameters):
            value = numbers(parameters[name])
            digest.update(f"{name} {value.shape} {value.dtype}".encode())
            digest.update(np.ascontiguousarray(value).tobytes())
    return digest.hexdigest()


def _parts(scene: Any) -> Iterable[Any]:
    yield from scene.shapes()
    yield from scene.emitters()
