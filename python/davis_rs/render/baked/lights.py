"""What shines in a scene whose light is baked: what is checked of it, and what changes apart from the rest."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..._mitsuba.types import (
    Mitsuba,
    MitsubaBox,
    MitsubaEmitter,
    MitsubaIntegrator,
    MitsubaScene,
    MitsubaShape,
    MitsubaValue,
)
from ...events.luma import LUMA_WEIGHTS
from ..motion.scene_motion import STILL, SceneMotion
from ..motion.scene_scale import scale_scene
from ..motion.scene_updates import SceneUpdates, like, strength_key
from ..obstacles import Obstacles, Unsuitable
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


def paths_of(integrator: MitsubaIntegrator) -> Paths:
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
        rule = f"the scene asks for Mitsuba's {kind}; light is baked for its path and direct integrators"
        raise Unsuitable(rule, "name one of these")
    found = {name: int(value) for name, value in re.findall(r"(\w+_depth) = (-?\d+)", str(integrator))}
    depth = found.get("max_depth", _PATH_DEPTH)
    return Paths(-1 if depth >= 2**31 else depth, found.get("rr_depth", _ROULETTE_DEPTH))


def check_lights(scene: MitsubaScene, mi: Mitsuba) -> None:
    """Refuse kinds of light that are not baked.

    Raises:
        Unsuitable: with all of them.
    """
    obstacles = Obstacles()
    hidden = bool(getattr(scene.integrator(), "hide_emitters", False))
    for own_name, emitter in named_emitters(scene):
        kind = emitter.class_name()
        name = f"light {own_name!r}, a {kind},"
        with obstacles.collect():
            if kind not in (*SHARP, *_SOFT):
                lights = "point, spot, directional, area and constant lights and environment maps"
                raise Unsuitable(f"is not baked: {lights} are", "give it as one of these", name)
            if kind == "AreaLight" and "radiance.value" not in mi.traverse(emitter):
                raise textured_lamp(own_name)
            if kind == "AreaLight" and hidden:
                rule = "is hidden by the scene's integrator (hide_emitters)"
                raise Unsuitable(rule, "leave hide_emitters out", name)
    obstacles.refuse()


def check_strengths(scene: MitsubaScene, mi: Mitsuba) -> None:
    """Refuse, by a ValueError, lights whose radiance is negative or not finite."""
    for name, emitter in named_emitters(scene):
        parameters = mi.traverse(emitter)
        for key, values in ((key, _flat(parameters[key])) for key in parameters.keys()):  # noqa: SIM118
            if key.partition(".")[0] not in ("radiance", "intensity", "irradiance", "data", "scale"):
                continue
            wrong = ~(np.isfinite(values) & (values >= 0))
            if wrong.any():
                what = f"light {name!r}, a {emitter.class_name()}, has {key} {values[wrong][0]:g}"
                raise ValueError(f"{what}; light is finite and not negative")


def textured_lamp(name: str) -> Unsuitable:
    """What refuses a light of a shape that shines with a texture."""
    rule = "has a radiance that differs from place to place"
    return Unsuitable(rule, "give it one colour", f"light {name!r}")


def emissions(
    scene: MitsubaScene, mi: Mitsuba, counts: Sequence[int], names: Sequence[str]
) -> tuple[FloatArray, IntArray]:
    """Luma that each triangle emits from its front (t), and which of the groups of lights it belongs to (t).

    Args:
        counts: of the triangles of the scene's shapes.
        names: of the groups, see :func:`light_groups`.
    """
    luma, group = [], []
    for shape, count in zip(scene.shapes(), counts, strict=True):
        radiance, number = 0.0, 0
        if shape.is_emitter():
            radiance = float(_rgb(mi.traverse(shape.emitter())["radiance.value"]) @ LUMA_WEIGHTS)
            number = group_of(area_light_name(shape), names)
        luma.append(np.full(count, radiance))
        group.append(np.full(count, number))
    return np.concatenate(luma), np.concatenate(group)


def background_luma(scene: MitsubaScene, mi: Mitsuba, names: Sequence[str]) -> list[float]:
    """Luma of a ray that hits nothing, by each group of lights."""
    shown = [0.0] * len(names)
    if not getattr(scene.integrator(), "hide_emitters", False):
        for name, emitter in named_emitters(scene):
            if emitter.class_name() == "ConstantBackgroundEmitter":
                shown[group_of(name, names)] += float(_rgb(mi.traverse(emitter)["radiance.value"]) @ LUMA_WEIGHTS)
    return shown


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


def sky_map(scene: MitsubaScene, mi: Mitsuba, names: Sequence[str]) -> SkyMap | None:
    """The scene's environment map as it is seen; None where there is none, or the integrator hides it."""
    if getattr(scene.integrator(), "hide_emitters", False):
        return None
    for name, emitter in named_emitters(scene):
        if emitter.class_name() == "EnvironmentMapEmitter":
            import drjit as dr

            height = mi.traverse(emitter)["data"].shape[0]
            side = min(2 * height, _LARGEST_SKY)
            towards = _octahedral_directions(side)
            seen = dr.zeros(mi.SurfaceInteraction3f, len(towards))
            seen.wi = mi.Vector3f(*(mi.Float(np.ascontiguousarray(-column, np.float32)) for column in towards.T))
            rgb = np.array(emitter.eval(seen), np.float64).reshape(3, -1)
            texels = (np.asarray(LUMA_WEIGHTS) @ rgb).astype(np.float32)
            return SkyMap(group_of(name, names), side, texels.reshape(side + 2, side + 2))
    return None


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


def small_lamps(scene: MitsubaScene) -> list[MitsubaShape]:
    """Shapes that shine and are small next to the scene."""

    def diagonal(box: MitsubaBox) -> float:
        return float(np.linalg.norm(_flat(box.max) - _flat(box.min)))

    limit = SMALL_LAMP * diagonal(scene.bbox())
    return [shape for shape in scene.shapes() if shape.is_emitter() and diagonal(shape.bbox()) < limit]


def area_light_name(shape: MitsubaShape) -> str:
    """The name by which a profile finds the light of a shape."""
    return f"{shape.id()}.{shape.emitter().id()}"


def light_groups(scene: MitsubaScene, changing: Sequence[str]) -> list[str]:
    """Names of the groups of lights: those that change, each baked alone, and before them "" for all others.

    A light that has no name has the id "" in Mitsuba: it belongs to all others, see :func:`group_of`.
    """
    known = [name for name, _ in named_emitters(scene)]
    return ["", *(name for name in changing if name in known)]


def group_of(name: str, names: Sequence[str]) -> int:
    """The group that a light of this name belongs to: 0 for all that no other group has."""
    return names.index(name, 1) if name in names[1:] else 0


def named_emitters(scene: MitsubaScene) -> list[tuple[str, MitsubaEmitter]]:
    """The lights of a scene, each with the name by which a profile finds it."""
    of_shapes = [(area_light_name(shape), shape.emitter()) for shape in scene.shapes() if shape.is_emitter()]
    others = [(emitter.id(), emitter) for emitter in scene.emitters() if emitter.class_name() != "AreaLight"]
    return [*of_shapes, *others]


@contextmanager
def irradiance_of(
    scene: MitsubaScene, mi: Mitsuba, names: Sequence[str], kept: PartialBake, motion: SceneMotion = STILL
) -> Iterator[Callable[[float], list[Irradiance]]]:
    """A function that gives the light of each group of lights at a time in seconds, to be computed one group at a time.

    Args:
        scene: loaded under Mitsuba's LLVM variant, which is in use; it is scaled where its size asks for that, and its
            objects are moved.
        names: see :func:`light_groups`.
        kept: what was computed before.
        motion: of the scene's objects.
    """
    integrator = scene.integrator() or mi.load_dict({"type": "path"})
    paths = paths_of(scene.integrator())
    scale = scale_scene(scene, integrator, mi)
    placing = _Placing(scene, motion, scale, mi) if motion.objects else None

    def at(t_s: float) -> list[Irradiance]:
        return [_Group(scene, mi, paths, scale, number, names, kept, placing, t_s) for number in range(len(names))]

    yield at


class _Placing:
    """Puts a scene's objects where they are at a time."""

    def __init__(self, scene: MitsubaScene, motion: SceneMotion, scale: float, mi: Mitsuba) -> None:
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


class _Group(Irradiance):
    """The light of some of a scene's emitters: the others are switched off while it is computed."""

    def __init__(
        self,
        scene: MitsubaScene,
        mi: Mitsuba,
        paths: Paths,
        scale: float,
        number: int,
        names: Sequence[str],
        kept: PartialBake,
        placing: _Placing | None,
        t_s: float,
    ) -> None:
        self._own_name, self._placing, self._t_s = names[number], placing, t_s
        # Lights are told apart by what they are, not by their names: those without one are called alike.
        small = [shape.emitter() for shape in small_lamps(scene)]
        soft, sharp, self._others = list[MitsubaEmitter](), list[MitsubaEmitter](), list[MitsubaEmitter]()
        for name, emitter in named_emitters(scene):
            if group_of(name, names) != number:
                self._others.append(emitter)
            elif emitter.class_name() in _SOFT and emitter not in small:
                soft.append(emitter)
            else:
                sharp.append(emitter)
        depths = {"max_depth": paths.max_depth, "rr_depth": paths.rr_depth}
        poses = None if placing is None else placing.poses(t_s)
        super().__init__(scene, mi, soft, sharp, **depths, scale=scale, kept=kept, poses=poses)
        self.bounces = self.bounces and bool(soft or sharp)

    def _name(self) -> str:
        return self._own_name if self._placing is None else f"{self._own_name} at {self._t_s!r} s"

    def _mean_of_part(self, *arguments: Any) -> FloatArray:
        if self._placing is not None:
            self._placing.put(self._t_s)
        if not self._others:
            return super()._mean_of_part(*arguments)
        kept = []
        for emitter in self._others:
            parameters = self._mi.traverse(emitter)
            key = strength_key("", parameters)
            kept.append((parameters, key, np.array(parameters[key], np.float64)))
        try:
            for parameters, key, values in kept:
                parameters[key] = like(parameters[key], values * 0.0)
                parameters.update()
            return super()._mean_of_part(*arguments)
        finally:
            for parameters, key, values in kept:
                parameters[key] = like(parameters[key], values)
                parameters.update()


def _rgb(value: MitsubaValue) -> FloatArray:
    return np.broadcast_to(_flat(value), (3,))


def numbers(value: MitsubaValue) -> npt.NDArray[Any]:
    """A parameter of Mitsuba's as an array."""
    # Colours have an attribute of the same name.
    return np.array(value.matrix if "Transform" in type(value).__name__ else value)


def _flat(value: MitsubaValue) -> FloatArray:
    return numbers(value).astype(np.float64).reshape(-1)
