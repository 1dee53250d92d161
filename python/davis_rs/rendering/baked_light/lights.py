"""What shines in a scene whose light is baked: what is checked of it, and what changes apart from the rest."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ...luma import LUMA_WEIGHTS
from ..scene_motion import STILL, SceneMotion
from ..scene_names import SceneLight, light_named, scene_lights
from ..scene_scale import scale_scene
from ..scene_texture import Unsuitable
from ..scene_updates import LightStrength, SceneUpdates
from .irradiance import Irradiance
from .partial import PartialBake

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

SHARP = ("PointLight", "SpotLight", "DirectionalEmitter")
"""Their direct light is left to the renderer, with its exact shadows, and so is that of small lamps."""

_SKIES = ("ConstantBackgroundEmitter", "EnvironmentMapEmitter")
_SOFT = ("AreaLight", *_SKIES)

SMALL_LAMP = 4 / 512
"""A lamp is small below this share of the scene's diagonal: light maps, whose finest points are 1 / 512 apart, would
blur its shadows."""

_LARGEST_SKY = 4096
_PATH_DEPTH, _ROULETTE_DEPTH = -1, 5


@dataclass(frozen=True)
class Paths:
    """How long light's paths are, as Mitsuba's path tracer counts it: -1 for any length; 2 is direct light."""

    max_depth: int
    rr_depth: int

    @property
    def bounce(self) -> bool:
        """Whether light goes on from the first surface that it meets."""
        return self.max_depth < 0 or self.max_depth > 2


def paths_of(integrator: Any) -> Paths:
    """The paths that a scene's integrator follows.

    Raises:
        Unsuitable: for one that does more, or other things, than to follow light between surfaces.
    """
    if integrator is None:
        return Paths(_PATH_DEPTH, _ROULETTE_DEPTH)
    kind = integrator.class_name()
    if kind == "DirectIntegrator":
        return Paths(2, _ROULETTE_DEPTH)
    if kind != "PathIntegrator":
        raise Unsuitable(f"the scene asks for Mitsuba's {kind}; light is baked for its path and direct integrators")
    found = {name: int(value) for name, value in re.findall(r"(\w+_depth) = (-?\d+)", str(integrator))}
    depth = found.get("max_depth", _PATH_DEPTH)
    if depth in (0, 1):
        raise Unsuitable(f"paths of max_depth {depth} show lamps alone, and no light on surfaces")
    return Paths(-1 if depth >= 2**31 else depth, found.get("rr_depth", _ROULETTE_DEPTH))


def check_lights(scene: Any, mi: Any) -> None:
    """Refuse lights that cannot be.

    Raises:
        ValueError: for radiance that is negative or not finite.
        Unsuitable: for a kind of light that is not baked.
    """
    hidden = bool(getattr(scene.integrator(), "hide_emitters", False))
    for light in scene_lights(scene):
        kind, parameters = light.emitter.class_name(), mi.traverse(light.emitter)
        name = f"{light}, a {kind},"
        for key, values in ((key, _flat(parameters[key])) for key in parameters.keys()):  # noqa: SIM118
            if key.partition(".")[0] not in ("radiance", "intensity", "irradiance", "data", "scale"):
                continue
            wrong = ~(np.isfinite(values) & (values >= 0))
            if wrong.any():
                raise ValueError(f"{name} has {key} {values[wrong][0]:g}; light is finite and not negative")
        if kind not in (*SHARP, *_SOFT):
            raise Unsuitable(
                f"{name} is not baked: point, spot, directional, area and constant lights and environment maps are"
            )
        if kind == "AreaLight":
            if "radiance.value" not in parameters:
                raise Unsuitable(f"{name} has a radiance that differs from place to place")
            if hidden:
                raise Unsuitable(f"{name} is hidden by the scene's integrator (hide_emitters)")


@dataclass(frozen=True, eq=False)
class LightGroup:
    """Lights that are baked together, because their strengths change together.

    Attributes:
        name: of the profile that they follow; empty where their strengths do not change.
        lights: perhaps none.
        numbers: of the lights among those of the scene.
    """

    name: str
    lights: tuple[SceneLight, ...]
    numbers: tuple[int, ...]


def light_groups(scene: Any, changing: Sequence[str]) -> list[LightGroup]:
    """All lights that do not change in one group, and after it those that change, each in a group of its own.

    Args:
        changing: names of the lights that change.

    Raises:
        ValueError: for a name that no light has, or more than one.
    """
    lights = scene_lights(scene)
    owners = [light_named(name, lights).emitter for name in changing]
    numbers = [[n for n, light in enumerate(lights) if light.emitter is owner] for owner in owners]
    apart = {n for own in numbers for n in own}
    numbers.insert(0, [n for n in range(len(lights)) if n not in apart])
    return [
        LightGroup(name, tuple(lights[n] for n in own), tuple(own))
        for name, own in zip(("", *changing), numbers, strict=True)
    ]


def has_baked_light(scene: Any) -> bool:
    """Whether a scene has light that has to be known at points: all but the direct light of what is sharp."""
    lamps = small_lamps(scene)
    return paths_of(scene.integrator()).bounce or any(_is_soft(light, lamps) for light in scene_lights(scene))


def emissions(scene: Any, mi: Any, counts: Sequence[int], groups: Sequence[LightGroup]) -> tuple[FloatArray, IntArray]:
    """Luma that each triangle emits from its front (t), and which of the groups of lights it belongs to (t).

    Args:
        counts: of the triangles of the scene's shapes.
    """
    group_of = {id(light.emitter): number for number, group in enumerate(groups) for light in group.lights}
    luma, group = [], []
    for shape, count in zip(scene.shapes(), counts, strict=True):
        radiance, number = 0.0, 0
        if shape.is_emitter():
            radiance = _emitted_luma(shape.emitter(), mi)
            number = group_of[id(shape.emitter())]
        luma.append(np.full(count, radiance))
        group.append(np.full(count, number))
    return np.concatenate(luma), np.concatenate(group)


def background_luma(scene: Any, mi: Any, groups: Sequence[LightGroup]) -> list[float]:
    """Luma of a ray that hits nothing, by each group of lights."""
    if getattr(scene.integrator(), "hide_emitters", False):
        return [0.0] * len(groups)
    skies = [
        [light.emitter for light in group.lights if light.emitter.class_name() == "ConstantBackgroundEmitter"]
        for group in groups
    ]
    return [sum((_emitted_luma(sky, mi) for sky in own), 0.0) for own in skies]


def _emitted_luma(emitter: Any, mi: Any) -> float:
    """Luma of a lamp or a sky that is the same everywhere."""
    return float(_rgb(mi.traverse(emitter)["radiance.value"]) @ LUMA_WEIGHTS)


@dataclass(frozen=True)
class SkyMap:
    """What rays see that hit nothing: luma on an octahedral map of directions.

    Attributes:
        group: of lights that it belongs to.
        side: texels along a side.
        texels: float32 (side + 2, side + 2): around the map lies a frame of one texel.
    """

    group: int
    side: int
    texels: npt.NDArray[np.float32]


def sky_map(scene: Any, mi: Any, groups: Sequence[LightGroup]) -> SkyMap | None:
    """The scene's environment map as it is seen; None where there is none, or the integrator hides it."""
    if getattr(scene.integrator(), "hide_emitters", False):
        return None
    for number, group in enumerate(groups):
        for emitter in (light.emitter for light in group.lights):
            if emitter.class_name() == "EnvironmentMapEmitter":
                return SkyMap(number, *_seen_sky(emitter, mi))
    return None


def _seen_sky(emitter: Any, mi: Any) -> tuple[int, npt.NDArray[np.float32]]:
    """Side and texels of an environment map as a :class:`SkyMap`."""
    import drjit as dr

    height = mi.traverse(emitter)["data"].shape[0]
    side = min(2 * height, _LARGEST_SKY)
    towards = _octahedral_directions(side)
    seen = dr.zeros(mi.SurfaceInteraction3f, len(towards))
    seen.wi = mi.Vector3f(*(mi.Float(np.ascontiguousarray(-column, np.float32)) for column in towards.T))
    rgb = np.array(emitter.eval(seen), np.float64).reshape(3, -1)
    texels = (np.asarray(LUMA_WEIGHTS) @ rgb).astype(np.float32)
    return side, texels.reshape(side + 2, side + 2)


def _octahedral_directions(side: int) -> FloatArray:
    """Unit directions ((side + 2)^2, 3) of the texels' middles, row by row, those of the frame around them included."""
    at = 2 * (np.arange(-1, side + 1) + 0.5) / side - 1
    x, y = np.meshgrid(at, at)
    # Beyond an edge lies what is on the other half of that edge.
    for _ in range(2):
        beyond = np.abs(x) > 1
        x, y = np.where(beyond, np.sign(x) * 2 - x, x), np.where(beyond, -y, y)
        x, y = y, x
    z = 1 - np.abs(x) - np.abs(y)
    below = z < 0
    x, y = (np.where(below, (1 - np.abs(b)) * np.where(a < 0, -1, 1), a) for a, b in ((x, y), (y, x)))
    directions = np.stack([x, y, z], -1).reshape(-1, 3)
    return np.asarray(directions / np.linalg.norm(directions, axis=1, keepdims=True))


def small_lamps(scene: Any) -> list[SceneLight]:
    """The lights of shapes that are small next to the scene."""

    def diagonal(box: Any) -> float:
        return float(np.linalg.norm(_flat(box.max) - _flat(box.min)))

    limit = SMALL_LAMP * diagonal(scene.bbox())
    return [light for light in scene_lights(scene) if light.shape is not None and diagonal(light.shape.bbox()) < limit]


def _is_soft(light: SceneLight, small: Sequence[SceneLight]) -> bool:
    """Whether the direct light of a light is baked: it is of a kind without sharp shadows, and not a small lamp."""
    return light.emitter.class_name() in _SOFT and all(light.emitter is not lamp.emitter for lamp in small)


@contextmanager
def irradiance_of(
    scene: Any, mi: Any, groups: Sequence[LightGroup], kept: PartialBake, motion: SceneMotion = STILL
) -> Iterator[Callable[[float], list[Irradiance]]]:
    """A function that gives the light of each group of lights at a time in seconds, to be computed one group at a time.

    Args:
        scene: loaded under Mitsuba's LLVM variant, which is in use; it is scaled where its size asks for that, and its
            objects are moved.
        groups: see :func:`light_groups`.
        kept: what was computed before.
        motion: of the scene's objects.

    Raises:
        ValueError: for a light of the scene that is not in one of the groups.
    """
    taken = {id(light.emitter) for group in groups for light in group.lights}
    for light in scene_lights(scene):
        if id(light.emitter) not in taken:
            raise ValueError(
                f"{light}, a {light.emitter.class_name()}, is in no group of lights: it would not be baked"
            )
    integrator = scene.integrator() or mi.load_dict({"type": "path"})
    paths = paths_of(scene.integrator())
    scale = scale_scene(scene, integrator, mi)
    placing = _Placing(scene, motion, scale, mi) if motion.objects else None
    small = small_lamps(scene)
    shares = [_Share.of(group, groups, small, mi) for group in groups]

    def at(t_s: float) -> list[Irradiance]:
        return [_ShareOfLight(scene, mi, paths, scale, share, kept, placing, t_s) for share in shares]

    yield at


class _Placing:
    """Puts a scene's objects where they are at a time."""

    def __init__(self, scene: Any, motion: SceneMotion, scale: float, mi: Any) -> None:
        boxes = dict(zip(motion.objects, motion.boxes, strict=True))
        self._motion, self._scale = SceneMotion(motion.objects, {}, boxes), scale
        self._updates = SceneUpdates(scene, self._motion, mi)
        self._t_s: float | None = None

    def poses(self, t_s: float) -> FloatArray:
        """T_world_frame (k, 4, 4), the world's own first."""
        found = np.tile(np.eye(4), (1 + len(self._motion.objects), 1, 1))
        for pose, views in zip(found[1:], self._motion.at(np.array([t_s])).objects, strict=True):
            pose[:3, :3], pose[:3, 3] = views.rotations[0], views.positions[0]
        return found

    def put(self, t_s: float) -> None:
        """Move what is not there yet."""
        if t_s != self._t_s:
            self._updates.set(self._motion.at(np.array([t_s])).scaled(self._scale), 0)
            self._t_s = t_s


class _Share(NamedTuple):
    """One group of lights, among all others.

    Attributes:
        key: tells it from other groups. Names could not: a light may have none, or that of another.
        soft, sharp: its emitters of which all light is baked, and those of which only what bounces is.
        others: the lights of all other groups.
    """

    key: str
    soft: list[Any]
    sharp: list[Any]
    others: list[LightStrength]

    @classmethod
    def of(cls, own: LightGroup, groups: Sequence[LightGroup], small: Sequence[SceneLight], mi: Any) -> _Share:
        others = [light for group in groups if group is not own for light in group.lights]
        return cls(
            str(own.numbers),
            [light.emitter for light in own.lights if _is_soft(light, small)],
            [light.emitter for light in own.lights if not _is_soft(light, small)],
            [LightStrength(light, mi) for light in others],
        )


class _ShareOfLight(Irradiance):
    """The light of one group: the others are switched off while it is computed."""

    def __init__(
        self,
        scene: Any,
        mi: Any,
        paths: Paths,
        scale: float,
        share: _Share,
        kept: PartialBake,
        placing: _Placing | None,
        t_s: float,
    ) -> None:
        self._key, self._others, self._placing, self._t_s = share.key, share.others, placing, t_s
        depths = {"max_depth": paths.max_depth, "rr_depth": paths.rr_depth}
        poses = None if placing is None else placing.poses(t_s)
        super().__init__(scene, mi, share.soft, share.sharp, **depths, scale=scale, kept=kept, poses=poses)
        self.bounces = self.bounces and bool(share.soft or share.sharp)

    def _name(self) -> str:
        return self._key if self._placing is None else f"{self._key} at {self._t_s!r} s"

    def _mean_of_part(self, *arguments: Any) -> FloatArray:
        if self._placing is not None:
            self._placing.put(self._t_s)
        try:
            for light in self._others:
                light.set(0.0)
            return super()._mean_of_part(*arguments)
        finally:
            for light in self._others:
                light.set(1.0)


def _rgb(value: Any) -> FloatArray:
    return np.broadcast_to(_flat(value), (3,))


def numbers(value: Any) -> npt.NDArray[Any]:
    """A parameter of Mitsuba's as an array."""
    # Colours have an attribute of the same name.
    return np.array(value.matrix if "Transform" in type(value).__name__ else value)


def _flat(value: Any) -> FloatArray:
    return numbers(value).astype(np.float64).reshape(-1)
