"""Reads the lights of a scene whose light is baked: checks them, and groups those that change apart from the rest."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..._core import IrradianceSampler
from ..._mitsuba.types import (
    Mitsuba,
    MitsubaBox,
    MitsubaEmitter,
    MitsubaIntegrator,
    MitsubaParameters,
    MitsubaScene,
    MitsubaShape,
    MitsubaValue,
)
from ...events.colour import Weights
from ...events.luma import LUMA_WEIGHTS
from ...geometry.lattice import rank1_lattice
from ..beam_lights import BEAMS, Slide, beam_light
from ..diffuse_materials import nested_objects
from ..media import has_more_than_absorption
from ..motion.scene_motion import STILL, SceneMotion
from ..obstacles import Obstacles, Unsuitable
from .irradiance import Irradiance, Paths, Surfaces, in_one_point, moved, turned
from .partial import PartialBake

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

SHARP = ("PointLight", "DirectionalEmitter", *BEAMS)
"""Their direct light is left to the renderer, with its exact shadows, and so is that of small lamps."""

_SKIES = ("ConstantBackgroundEmitter", "EnvironmentMapEmitter")
_SOFT = ("AreaLight", *_SKIES)

SMALL_LAMP = 4 / 512
"""A lamp is small below this share of the scene's diagonal: light maps, whose finest points are 1 / 512 apart, would
blur its shadows."""

_LARGEST_SKY, _LARGEST_REFLECTED_SKY = 4096, 2048
_RADIANCE_POINTS = 1024
"""Points on a shape from which the mean of its emission is taken where a texture says it."""
_PATH_DEPTH, _ROULETTE_DEPTH = -1, 5
_VOLUMETRIC = ("VolumetricPathIntegrator", "VolpathMisIntegratorImpl")
"""Without media that scatter they follow the same paths as ``path``."""
_MORE_NEXT_TO_LIGHT = ("MomentIntegrator", "AOVIntegrator")


def integrator_of(scene: MitsubaScene) -> MitsubaIntegrator:
    """Return the integrator whose light a scene shows; None where it names none.

    Mitsuba's ``moment`` and ``aov`` write more next to the light of the first integrator inside them.
    """
    integrator = scene.integrator()
    while integrator is not None and integrator.class_name() in _MORE_NEXT_TO_LIGHT:
        integrator = next(iter(nested_objects(integrator)), None)
    return integrator


def hides_lights(scene: MitsubaScene) -> bool:
    """Return whether a scene's integrator hides lights from the camera (``hide_emitters``).

    The camera sees through their shapes, and black in place of the sky. Mirrors see both.
    """
    return bool(getattr(integrator_of(scene), "hide_emitters", False))


def hidden_shapes(scene: MitsubaScene) -> list[int]:
    """Return the numbers of the shapes through which the camera sees, see :func:`hides_lights`."""
    if not hides_lights(scene):
        return []
    return [number for number, shape in enumerate(scene.shapes()) if shape.is_emitter()]


def follows_media(scene: MitsubaScene) -> bool:
    """Return whether a scene's integrator is one for volumes."""
    integrator = integrator_of(scene)
    return integrator is not None and integrator.class_name() in _VOLUMETRIC


def shows_absorption(scene: MitsubaScene) -> bool:
    """Return whether a scene shows what media absorb: its integrator is one for volumes, or it names none."""
    return integrator_of(scene) is None or follows_media(scene)


def paths_of(scene: MitsubaScene) -> Paths:
    """Return the paths that a scene's integrator follows.

    Raises:
        Unsuitable: for one that does more, or other things, than to follow light between surfaces.
    """
    integrator = integrator_of(scene)
    if integrator is None:
        return ALL_PATHS
    kind = integrator.class_name()
    if kind == "DirectIntegrator":
        return Paths(2, _ROULETTE_DEPTH)
    if kind in _VOLUMETRIC and has_more_than_absorption(scene):
        rule = "it has a medium (fog, milk), which only Mitsuba's integrators render"
        raise Unsuitable(rule, "take the medium away, and name the integrator path")
    if kind != "PathIntegrator" and kind not in _VOLUMETRIC:
        rule = f"the scene asks for Mitsuba's {kind}; light is baked for its path and direct integrators"
        raise Unsuitable(rule, "name one of these")
    depths = {name: int(value) for name, value in re.findall(r"(\w+_depth) = (-?\d+)", str(integrator))}
    depth = depths.get("max_depth", _PATH_DEPTH)
    return Paths(-1 if depth >= 2**31 else depth, depths.get("rr_depth", _ROULETTE_DEPTH))


ALL_PATHS = Paths(_PATH_DEPTH, _ROULETTE_DEPTH)
"""Paths of any length, where a scene names no integrator."""


def check_lights(scene: MitsubaScene, mi: Mitsuba, *, soft: bool = False) -> None:
    """Refuse kinds of light that are not baked.

    Args:
        soft: area lights may have textures, see :attr:`~davis_rs.Scene.soft_light`.

    Raises:
        Unsuitable: with all of them.
    """
    obstacles = Obstacles()
    for own_name, emitter in named_emitters(scene):
        kind = emitter.class_name()
        name = f"light {own_name!r}, a {kind},"
        with obstacles.collect():
            if kind not in (*SHARP, *_SOFT):
                lights = "projectors, point, spot, directional, area and constant lights and environment maps"
                raise Unsuitable(f"is not baked: {lights} are", "give it as one of these", name)
            if kind == "AreaLight" and not soft and "radiance.value" not in mi.traverse(emitter):
                raise textured_lamp(own_name)
            if kind == "EnvironmentMapEmitter" and not _is_rotation(mi.traverse(emitter)):
                raise Unsuitable("is stretched by its transform", "turn it only", name)
    obstacles.refuse()


def check_strengths(scene: MitsubaScene, mi: Mitsuba, *, soft: bool = False) -> None:
    """Refuse, by a ValueError, lights whose radiance is negative or not finite.

    Args:
        soft: area lights may have textures, of which single texels may be negative where the lookup is not.
    """
    for name, emitter in named_emitters(scene):
        parameters = mi.traverse(emitter)
        for key, values in ((key, _flat(parameters[key])) for key in parameters.keys()):  # noqa: SIM118
            what, _, part = key.partition(".")
            if part == "to_uv" or what not in ("radiance", "intensity", "irradiance", "texture", "data", "scale"):
                continue
            texels = soft and emitter.class_name() == "AreaLight" and key == "radiance.data"
            wrong = ~(np.isfinite(values) & (texels | (values >= 0)))
            if wrong.any():
                fault = f"light {name!r}, a {emitter.class_name()}, has {key} {values[wrong][0]:g}"
                raise ValueError(f"{fault}; light is finite and not negative")


def textured_lamp(name: str) -> Unsuitable:
    """Make the error for a shape that shines with a texture."""
    rule = "has a radiance that differs from place to place"
    return Unsuitable(rule, "give it one colour", f"light {name!r}")


def mean_radiance(shape: MitsubaShape, mi: Mitsuba) -> FloatArray:
    """Return the radiance (3,) of a shape's area light, the mean over its area."""
    emitter = shape.emitter()
    parameters = mi.traverse(emitter)
    if "radiance.value" in parameters:
        return _rgb(parameters["radiance.value"])
    total = np.zeros(3)
    for x, y in rank1_lattice(_RADIANCE_POINTS) + 0.5:
        interaction = mi.SurfaceInteraction3f()
        interaction.uv = shape.sample_position(0.0, mi.Point2f(float(x), float(y))).uv
        interaction.wi = mi.Vector3f(0, 0, 1)
        total += np.array(emitter.eval(interaction), np.float64).reshape(3)
    return total / _RADIANCE_POINTS


def emissions(
    scene: MitsubaScene,
    mi: Mitsuba,
    counts: Sequence[int],
    names: Sequence[str],
    weights: Weights,
    *,
    soft: bool = False,
) -> tuple[FloatArray, IntArray]:
    """Return luma that each triangle emits from its front (t), and which of the groups of lights it belongs to (t).

    Args:
        counts: of the triangles of the scene's shapes.
        names: of the groups, see :func:`light_groups`.
        weights: of linear red, green and blue in luma.
        soft: what shapes emit is in their textures.
    """
    luma, group = [], []
    for shape, count in zip(scene.shapes(), counts, strict=True):
        radiance, number = 0.0, 0
        if shape.is_emitter() and not soft:
            radiance = float(_rgb(mi.traverse(shape.emitter())["radiance.value"]) @ weights)
            number = group_of(area_light_name(shape), names)
        luma.append(np.full(count, radiance))
        group.append(np.full(count, number))
    return np.concatenate(luma), np.concatenate(group)


def background_luma(
    scene: MitsubaScene, mi: Mitsuba, names: Sequence[str], weights: Weights = LUMA_WEIGHTS
) -> list[float]:
    """Return the luma of a ray that hits nothing, by each group of lights; ``weights`` as in :func:`emissions`."""
    shown = [0.0] * len(names)
    if not hides_lights(scene):
        for name, emitter in named_emitters(scene):
            if emitter.class_name() == "ConstantBackgroundEmitter":
                shown[group_of(name, names)] += float(_rgb(mi.traverse(emitter)["radiance.value"]) @ weights)
    return shown


@dataclass(frozen=True)
class SkyMap:
    """Holds what rays see that hit nothing: luma on an octahedral map of directions.

    Attributes:
        group: of lights that it belongs to.
        side: texels along a side.
        texels: float32 (side + 2, side + 2): around the map lies a frame of one texel.
    """

    group: int
    side: int
    texels: npt.NDArray[np.float32]


@dataclass(frozen=True)
class Environment:
    """Holds an environment map.

    Attributes:
        texels: float32 (height, width, 3), radiance. The middles of columns lie around the y axis; the first and the
            last row are at the poles.
        to_map: float64 (3, 3), takes a direction of the world to the axes of the map.
    """

    texels: npt.NDArray[np.float32]
    to_map: FloatArray

    @classmethod
    def of(cls, emitter: MitsubaEmitter, mi: Mitsuba) -> Environment:
        """Take Mitsuba's map; around it lie a column that repeats the last one, and one that repeats the first."""
        parameters = mi.traverse(emitter)
        data = np.array(parameters["data"], np.float32)[:, 1:-1, :3]
        scale = np.float32(np.array(parameters["scale"]).reshape(()))
        to_map = np.linalg.inv(_linear(parameters)).astype(np.float64)
        return cls(np.ascontiguousarray(data * scale), to_map)

    def seen(self, directions: FloatArray) -> FloatArray:
        """Return radiance (n, 3) from unit directions (n, 3)."""
        height, width = self.texels.shape[:2]
        x, y, z = self.to_map @ directions.T
        along = (np.arctan2(x, -z) / (2 * np.pi)) % 1.0 * width - 0.5
        down = np.arccos(np.clip(y, -1.0, 1.0)) / np.pi * (height - 1)
        column, row = np.floor(along).astype(int), np.minimum(down.astype(int), height - 2)
        right, below = (along - column)[:, None], (down - row)[:, None]
        upper, lower = (
            self.texels[k, column % width] * (1 - right) + self.texels[k, (column + 1) % width] * right
            for k in (row, row + 1)
        )
        return np.asarray(upper * (1 - below) + lower * below)


def _linear(parameters: MitsubaParameters) -> FloatArray:
    return np.array(parameters["to_world"].matrix, np.float64).reshape(4, 4)[:3, :3]


def _is_rotation(parameters: MitsubaParameters) -> bool:
    linear = _linear(parameters)
    return bool(np.allclose(linear @ linear.T, np.eye(3), atol=1e-4))


def sky_map(scene: MitsubaScene, mi: Mitsuba, names: Sequence[str], weights: Weights) -> SkyMap | None:
    """Return the scene's environment map as it is seen; None where there is none, or the integrator hides it.

    Args:
        weights: as in :func:`emissions`.
    """
    if hides_lights(scene):
        return None
    for name, emitter in named_emitters(scene):
        if emitter.class_name() == "EnvironmentMapEmitter":
            environment = Environment.of(emitter, mi)
            side = min(2 * len(environment.texels), _LARGEST_SKY)
            texels = (environment.seen(_octahedral_directions(side)) @ weights).astype(np.float32)
            return SkyMap(group_of(name, names), side, texels.reshape(side + 2, side + 2))
    return None


@dataclass(frozen=True)
class ColouredLight:
    """Holds what lights look like themselves in glossy surfaces, red, green and blue.

    Attributes:
        emitted: float64 (t, 3), radiance that each triangle emits from its front.
        backgrounds: float64 (k, 3), radiance of a ray that hits nothing, by each group of lights.
        sky: an environment map, whose texels (side, side, 3) have no frame and whose side is a power of two.
    """

    emitted: FloatArray
    backgrounds: FloatArray
    sky: SkyMap | None


def coloured_light(
    scene: MitsubaScene, mi: Mitsuba, counts: Sequence[int], names: Sequence[str], *, soft: bool = False
) -> ColouredLight:
    """Find what glossy surfaces reflect of the lights themselves, also of those that the integrator hides.

    Args:
        counts: of the triangles of the scene's shapes.
        names: of the groups, see :func:`light_groups`.
        soft: what shapes emit is in their textures.
    """
    emitted = np.zeros((len(counts), 3))
    for number, shape in enumerate(scene.shapes()):
        if shape.is_emitter() and not soft:
            emitted[number] = _rgb(mi.traverse(shape.emitter())["radiance.value"])
    backgrounds, sky = np.zeros((len(names), 3)), None
    for name, emitter in named_emitters(scene):
        if emitter.class_name() == "ConstantBackgroundEmitter":
            backgrounds[group_of(name, names)] += _rgb(mi.traverse(emitter)["radiance.value"])
        elif emitter.class_name() == "EnvironmentMapEmitter":
            environment = Environment.of(emitter, mi)
            side = min(2 ** int(np.ceil(np.log2(2 * len(environment.texels)))), _LARGEST_REFLECTED_SKY)
            inside = _octahedral_directions(side).reshape(side + 2, side + 2, 3)[1:-1, 1:-1]
            texels = environment.seen(inside.reshape(-1, 3)).astype(np.float32)
            sky = SkyMap(group_of(name, names), side, texels.reshape(side, side, 3))
    return ColouredLight(np.repeat(emitted, counts, axis=0), backgrounds, sky)


def _octahedral_directions(side: int) -> FloatArray:
    """Return unit directions ((side + 2)^2, 3) of the middles of texels, those of the frame included, row by row."""
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


def slides(scene: MitsubaScene, mi: Mitsuba) -> list[Slide]:
    """Return what the lights of a scene throw on surfaces."""
    beams = (beam_light(emitter, mi) for emitter in scene.emitters() if emitter.class_name() in BEAMS)
    return [beam.slide for beam in beams if beam.slide is not None]


def small_lamps(scene: MitsubaScene) -> list[MitsubaShape]:
    """Return the shapes that shine and are small next to the scene."""

    def diagonal(box: MitsubaBox) -> float:
        return float(np.linalg.norm(_flat(box.max) - _flat(box.min)))

    limit = SMALL_LAMP * diagonal(scene.bbox())
    return [shape for shape in scene.shapes() if shape.is_emitter() and diagonal(shape.bbox()) < limit]


def area_light_name(shape: MitsubaShape) -> str:
    """Return the name by which a profile finds the light of a shape."""
    return f"{shape.id()}.{shape.emitter().id()}"


def light_groups(scene: MitsubaScene, changing: Sequence[str]) -> list[str]:
    """Return the names of the groups of lights: "" for all that do not change, then those that do, each baked alone.

    A light that has no name has the id "" in Mitsuba: it belongs to all others, see :func:`group_of`.
    """
    known = [name for name, _ in named_emitters(scene)]
    return ["", *(name for name in changing if name in known)]


def group_name(name: str, names: Sequence[str]) -> str:
    """Return the name of the group that a light of this name belongs to, see :func:`group_of`."""
    return names[group_of(name, names)]


def group_of(name: str, names: Sequence[str]) -> int:
    """Return the group that a light of this name belongs to: 0 for all that no other group has."""
    return names.index(name, 1) if name in names[1:] else 0


def named_emitters(scene: MitsubaScene) -> list[tuple[str, MitsubaEmitter]]:
    """Return the lights of a scene, each with the name by which a profile finds it."""
    of_shapes = [(area_light_name(shape), shape.emitter()) for shape in scene.shapes() if shape.is_emitter()]
    others = [(emitter.id(), emitter) for emitter in scene.emitters() if emitter.class_name() != "AreaLight"]
    return [*of_shapes, *others]


def irradiance_of(
    scene: MitsubaScene,
    mi: Mitsuba,
    surfaces: Surfaces,
    names: Sequence[str],
    kept: PartialBake,
    motion: SceneMotion = STILL,
    *,
    paths: Paths | None = None,
    soft: bool = False,
) -> Callable[[float], list[Irradiance]]:
    """Return a function that gives the light of each group of lights at a time in seconds.

    Args:
        scene: whose shapes the surfaces are.
        names: see :func:`light_groups`.
        kept: what was computed before.
        motion: of the scene's objects.
        paths: of light; None: those that the scene's integrator follows.
        soft: area lights shine from both sides, and none counts as small, see :attr:`~davis_rs.Scene.soft_light`.
    """
    paths = paths_of(scene) if paths is None else paths
    groups = [_LightGroup(scene, mi, surfaces.counts, number, names, soft=soft) for number in range(len(names))]
    boxes = dict(zip(motion.objects, motion.boxes, strict=True))
    moving = SceneMotion(motion.objects, {}, boxes)
    still = functools.cache(lambda: _sampler(surfaces, groups, None))

    def at(t_s: float) -> list[Irradiance]:
        poses, sampler, when = None, still, ""
        if moving.objects:
            poses, when = _poses(moving, t_s), f" at {t_s!r} s"
            sampler = functools.cache(lambda: _sampler(surfaces, groups, poses))
        return [
            Irradiance(
                sampler,
                number,
                group.kinds,
                paths=paths,
                diagonal=surfaces.diagonal,
                name=name + when,
                kept=kept,
                poses=poses,
            )
            for number, (name, group) in enumerate(zip(names, groups, strict=True))
        ]

    return at


def _poses(motion: SceneMotion, t_s: float) -> FloatArray:
    """Return T_world_frame (k, 4, 4), the world's own first."""
    poses = np.tile(np.eye(4), (1 + len(motion.objects), 1, 1))
    for pose, views in zip(poses[1:], motion.at(np.array([t_s])).objects, strict=True):
        pose[:3, :3], pose[:3, 3] = views.rotations[0], views.positions[0]
    return poses


def _sampler(surfaces: Surfaces, groups: Sequence[_LightGroup], poses: FloatArray | None) -> IrradianceSampler:
    """Make the sampler of the scene with its lights, while bodies have these poses."""
    corners, fronts, normals = in_one_point(surfaces.corners, surfaces.clear), surfaces.fronts, surfaces.normals
    if poses is not None:
        of_corners = np.repeat(surfaces.frames, 3)
        corners = moved(poses, corners.reshape(-1, 3), of_corners)
        fronts, normals = turned(poses, fronts, surfaces.frames), turned(poses, normals.reshape(-1, 3), of_corners)
    return IrradianceSampler(
        corners=np.ascontiguousarray(corners).ravel(),
        normals=np.ascontiguousarray(fronts).ravel(),
        shading_normals=np.ascontiguousarray(normals).ravel(),
        uv=surfaces.uv.ravel(),
        textures=surfaces.texture_of,
        two_sided=surfaces.two_sided.astype(np.uint32),
        colours=surfaces.reflectances(),
        groups=[group.lights for group in groups],
    )


_Rgb = list[float]
_LampTuple = tuple[int, int, _Rgb, bool]


class _LightGroup:
    """Holds the lights of a scene that are baked together, as the core takes them.

    Args:
        counts: of the triangles of the scene's shapes.
        number: of the group among its ``names``.
        soft: as of :func:`irradiance_of`.

    Attributes:
        kinds: those that it has: ``lamps``, ``sky``, ``sharp``.
        lights: see :class:`~davis_rs._core.IrradianceSampler`.
    """

    def __init__(
        self, scene: MitsubaScene, mi: Mitsuba, counts: Sequence[int], number: int, names: Sequence[str], *, soft: bool
    ) -> None:
        first = np.cumsum([0, *counts]).tolist()
        small = [] if soft else small_lamps(scene)
        lamps, small_ones = list[_LampTuple](), list[_LampTuple]()
        # Lights are told apart by what they are, not by their names: those without one are called alike.
        for index, shape in enumerate(scene.shapes()):
            if shape.is_emitter() and group_of(area_light_name(shape), names) == number:
                radiance = mean_radiance(shape, mi).tolist()
                (small_ones if shape in small else lamps).append((first[index], counts[index], radiance, soft))
        constant: _Rgb | None = None
        environment: tuple[int, int, npt.NDArray[np.float32], list[_Rgb]] | None = None
        points, directions = list[Any](), list[Any]()
        for emitter in scene.emitters():
            kind = emitter.class_name()
            if kind == "AreaLight" or group_of(emitter.id(), names) != number:
                continue
            parameters = mi.traverse(emitter)
            if kind == "ConstantBackgroundEmitter":
                constant = _rgb(parameters["radiance.value"]).tolist()
            elif kind == "EnvironmentMapEmitter":
                sky = Environment.of(emitter, mi)
                height, width = sky.texels.shape[:2]
                environment = width, height, sky.texels.ravel(), sky.to_map.tolist()
            elif kind == "DirectionalEmitter":
                along = _linear(parameters)[:, 2]
                irradiance = _rgb(parameters["irradiance.value"]).tolist()
                directions.append(((along / np.linalg.norm(along)).tolist(), irradiance))
            elif kind == "PointLight":
                position = _flat(parameters["position"]).tolist()
                points.append((position, _rgb(parameters["intensity.value"]).tolist(), None, None))
            else:
                light = beam_light(emitter, mi)
                beam = None if light.angles is None else (light.axis.tolist(), light.angles)
                slide = None if light.slide is None else light.slide.core()
                points.append((light.position.tolist(), light.intensity.tolist(), beam, slide))
        self.lights = lamps, constant, environment, points, directions, small_ones
        kinds = {
            "lamps": bool(lamps),
            "sky": constant is not None or environment is not None,
            "sharp": bool(points or directions or small_ones),
        }
        self.kinds = frozenset(kind for kind, there in kinds.items() if there)


def _rgb(value: MitsubaValue) -> FloatArray:
    return np.broadcast_to(_flat(value), (3,))


def numbers(value: MitsubaValue) -> npt.NDArray[Any]:
    """Return a parameter of Mitsuba's as an array."""
    # Colours have an attribute of the same name.
    return np.asarray(value.matrix if "Transform" in type(value).__name__ else value)


def _flat(value: MitsubaValue) -> FloatArray:
    return numbers(value).astype(np.float64).reshape(-1)
