"""Gives the baked light of a scene: from the cache, or computed now."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt

from ..._mitsuba.types import Mitsuba, MitsubaObject, MitsubaScene, MitsubaShape
from ..._mitsuba.variants import SCALAR, versions
from ..._util.last_used import keep_last
from ..._util.progress import progress, say
from ..._util.quantities import percent
from ...events.colour import Weights
from ...events.luma import LUMA_WEIGHTS
from ...geometry.camera import Camera
from ...geometry.trajectory.steered import SteeredPath
from ...geometry.trajectory.views import Views
from ...scene.load import start_pose
from ...scene.scene import Scene
from ..diffuse_materials import is_two_sided
from ..motion.scene_motion import SceneMotion
from ..obstacles import Obstacles, Unsuitable
from . import cache
from .bake import FULL_EFFORT, QUICK_EFFORT, Effort, bake
from .instants import AT_START, MOST_INSTANTS, MotionTimes, hats, motion_times, travelling
from .irradiance import Irradiance, Paths, Surfaces
from .light_maps import LightMaps, check_maps
from .lights import (
    ALL_PATHS,
    ColouredLight,
    SkyMap,
    background_luma,
    check_lights,
    check_strengths,
    coloured_light,
    emissions,
    irradiance_of,
    light_groups,
    numbers,
    paths_of,
    sky_map,
    slides,
    small_lamps,
)
from .seen_places import SeenPlaces, camera_that_looks, views_that_look

FloatArray = npt.NDArray[np.float64]

VERSION = 8
"""Of what is computed, so that light of older versions is not taken from the cache."""


MOST_CORNERS, MOST_CORNERS_WITH_MOTION = 100_000, 400_000
"""Of meshes, at most, whose light is baked as finely as is asked for without a request by name. More are baked quickly
where nothing moves."""

MOST_QUICK_SIDES = 1_000_000
"""Sides of triangles that reflect, of meshes whose light is baked quickly."""

_LEAST_REACH = 0.02
"""A room into which less than this share of the sky's light comes, and no other, counts as closed."""

_PLACES_ON_PATH, _REACH_SAMPLES = 5, 256
"""Where it is seen whether any light comes to the camera."""

_MOST_KNOWN = 4
_known: dict[str, LightMaps] = {}
"""The last that were used: a run makes several renderers of one scene."""


@dataclass(frozen=True)
class BakedLight:
    """Holds the light on the surfaces of a scene, and what its lamps and its sky look like themselves.

    Attributes:
        maps: irradiance, for each instant and group of lights.
        times: when bodies are where, of the scene.
        names: of the groups: "" for all lights that do not change, and the names of those that do.
        emitted: (t) luma that each triangle emits from its front.
        emitters: (t) the group that this belongs to.
        backgrounds: luma of a ray that hits nothing, by each group.
        sky: what such a ray sees in addition; None where there is no environment map.
        content: a hash of the scene's surfaces, materials and lights.
        cached: whether it is in the cache now.
        coloured: what glossy surfaces reflect of the lights; None where all are diffuse.
        effort: that the bake could cost.
        moving: whether objects move or deform in it.
    """

    maps: LightMaps
    times: MotionTimes
    names: list[str]
    emitted: FloatArray
    emitters: npt.NDArray[np.int64]
    backgrounds: list[float]
    sky: SkyMap | None
    content: str
    cached: bool
    coloured: ColouredLight | None
    effort: Effort
    moving: bool

    @property
    def description(self) -> str:
        """Describe the light, for people."""
        maps = self.maps
        quick = "; it is a quick bake (--renderer baked obeys --bake-error)" if self.effort is QUICK_EFFORT else ""
        coarse = "" if maps.complete else f"; it is coarser than asked for, because {self._limits}"
        start = ""
        if self.moving and self.times is AT_START:
            start = "; it is that of the start, and stays on surfaces that move"
        return f"baked light at {maps.points:,} points, whose error is estimated at {self.errors}{start}{coarse}{quick}"

    @property
    def errors(self) -> str:
        """Say how much the light errs, for people."""
        maps, count = self.maps, len(self.maps.instants)
        error = percent(maps.error)
        if count == 1:
            return error
        return f"{error}, and at up to {percent(maps.motion_error)} between its {count} instants where bodies change it"

    @property
    def _limits(self) -> str:
        most = f"{self.effort.most_points:,} points each besides the corners of triangles"
        points = f"the light of lamps, of the sky and of bounces has at most {most}"
        return points if len(self.maps.instants) == 1 else f"{points}, and the motion at most {MOST_INSTANTS} instants"

    def at(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return how much the light of each instant (k) counts at times (n,), and its rates per second, (n, k) each.

        Raises:
            ValueError: for times that it is not baked for.
        """
        self.times.check(t_s)
        return hats(self.maps.instants, t_s)


def light_paths(scene: Scene, loaded: MitsubaScene) -> Paths:
    """Return which paths of light are baked.

    Raises:
        Unsuitable: for an integrator that does more, or other things, than to follow light between surfaces.
    """
    return ALL_PATHS if scene.soft_light else paths_of(loaded)


def check_baking(scene: Scene, loaded: MitsubaScene, mi: Mitsuba, motion: SceneMotion, *, by_name: bool) -> None:
    """Refuse a scene whose light cannot be baked.

    Args:
        scene: the scene.
        loaded: the same, under the variant in force.
        motion: of its objects.
        by_name: the user asked for baked light, so that it may take hours.

    Raises:
        Unsuitable: with all lights that this is not made for, or for another integrator.
    """
    obstacles = Obstacles()
    with obstacles.collect():
        if not loaded.emitters():
            raise Unsuitable("it has no lights", "give it one")
    with obstacles.collect():
        light_paths(scene, loaded)
    with obstacles.collect():
        check_lights(loaded, mi, soft=scene.soft_light)
    effort = _effort(scene, loaded, motion, by_name=by_name)
    stays = _stays(scene, effort)
    if not stays:
        _check_motion(motion, obstacles)
    for shape in () if scene.soft_light else small_lamps(loaded):
        with obstacles.collect():
            if shape.id() in motion.objects:
                rule = "moves: its sharp shadows would have to move with it"
                raise Unsuitable(rule, "let it rest", f"the small lamp {shape.id()!r}")
    if effort is QUICK_EFFORT:
        with obstacles.collect():
            if motion.objects and not stays and not motion.deformations:
                large = f"in meshes of more than {MOST_CORNERS_WITH_MOTION:,} corners"
                raise Unsuitable(f"light of objects that move, {large}, is baked on request alone", _ASK)
        with obstacles.collect():
            sides = sum(shape.face_count() * _sides(shape) for shape in _meshes(loaded))
            if sides > MOST_QUICK_SIDES:
                rule = f"it has {sides:,} sides of triangles, and the limit of a quick bake is {MOST_QUICK_SIDES:,}"
                raise Unsuitable(rule, _ASK)
    obstacles.refuse()


def _check_motion(motion: SceneMotion, obstacles: Obstacles) -> None:
    """Refuse what moves in a way that light cannot follow."""
    for name, path in motion.objects.items():
        with obstacles.collect():
            if isinstance(path, SteeredPath):
                rule = "moves as a caller decides: its light cannot be computed in advance"
                raise Unsuitable(
                    rule, "give it a path (scene.objects), or light that needs no bake", f"object {name!r}"
                )
    for name in motion.deformations:
        with obstacles.collect():
            raise Unsuitable("deforms: light cannot be baked on it", "bake a scene without it", f"object {name!r}")


_ASK = "ask for it (--renderer baked, renderer='baked')"


def _effort(scene: Scene, loaded: MitsubaScene, motion: SceneMotion, *, by_name: bool) -> Effort:
    """Return how much a bake may cost.

    One that was asked for by name may take hours. Else it is a quick one where a file does not say which light it wants
    (:attr:`Scene.soft_light`), and where meshes have more than :data:`MOST_CORNERS`. Light of objects that
    move is baked at several instants, which a quick bake does not do.
    """
    if by_name:
        return FULL_EFFORT
    most = MOST_CORNERS_WITH_MOTION if motion.objects else MOST_CORNERS
    # Of soft light corners need not be counted, which takes time for many shapes.
    quick = scene.soft_light or sum(_corners(shape) for shape in _meshes(loaded)) > most
    return QUICK_EFFORT if quick else FULL_EFFORT


def _stays(scene: Scene, effort: Effort) -> bool:
    """Return whether light is baked as it is at the start alone, and stays so while objects move."""
    return scene.soft_light and effort is QUICK_EFFORT


def _meshes(loaded: MitsubaScene) -> list[MitsubaShape]:
    return [shape for shape in loaded.shapes() if shape.is_mesh()]


def _sides(shape: MitsubaShape) -> int:
    """Return how many sides of a shape's triangles reflect."""
    return 2 if is_two_sided(shape.bsdf()) else 1


def _corners(shape: MitsubaShape) -> int:
    """Estimate at how many corners of a mesh light is baked at least, those of backs that reflect included."""
    flat = "face_normals = 1" in str(shape)
    return int(3 * shape.face_count() if flat else shape.vertex_count()) * _sides(shape)


def baked_light(
    scene: Scene,
    loaded: MitsubaScene,
    mi: Mitsuba,
    motion: SceneMotion,
    surfaces: Surfaces,
    error: float,
    *,
    by_name: bool = True,
    weights: Weights = LUMA_WEIGHTS,
    seen_places: Callable[[Camera, Views], SeenPlaces],
) -> BakedLight:
    """Bake a scene's light, or take it from the cache.

    Args:
        scene: that :func:`check_baking` takes. Where its objects move, light is baked at several instants.
        loaded: the same, loaded under the scalar variant, of triangles.
        motion: of its objects.
        surfaces: of the scene, in the order of its shapes.
        error: that is allowed, relative.
        by_name: as in :func:`check_baking`.
        weights: of linear red, green and blue in the luma of lamps and of the sky themselves. Maps have all three.
        seen_places: what a camera sees of the surfaces at some views. A quick bake is finest there.

    Raises:
        ValueError: for lights that cannot be.
        Unsuitable: if the bake of soft light is a quick one, and no light reaches the scene's camera.
    """
    check_strengths(loaded, mi, soft=scene.soft_light)
    paths = light_paths(scene, loaded)
    effort = _effort(scene, loaded, motion, by_name=by_name)
    error = max(error, effort.least_error)
    names = light_groups(loaded, list(motion.lights))
    duration_s = None if scene.trajectory is None else scene.trajectory.duration_s
    stays = _stays(scene, effort)
    times = AT_START if stays else motion_times(motion, duration_s)
    if stays and (gone := travelling(motion, duration_s)).any():
        # What leaves its place must not leave its shadow there.
        surfaces = replace(surfaces, clear=surfaces.clear | np.append(False, gone)[surfaces.frames])
    emitted, emitters = emissions(loaded, mi, surfaces.counts, names, weights, soft=scene.soft_light)
    content = _content(loaded, mi, surfaces, _poses(motion, times))
    camera, views = camera_that_looks(scene), views_that_look(scene) if effort is QUICK_EFFORT else None
    looks = None if views is None else (camera, views.positions.tobytes(), views.rotations.tobytes())
    settings = (VERSION, sorted(versions(SCALAR).items()), paths, names, error, effort, content, looks)
    key = hashlib.sha256(repr(settings).encode()).hexdigest()
    maps = _known.get(key)
    check = partial(
        check_maps, two_sided=surfaces.two_sided, bumpy=surfaces.bumpy, lights=len(names), tests=times.tests
    )
    if maps is None and (maps := cache.load(key, check)) is not None:
        say(f"the scene's light was baked before, and comes from {cache.cache_folder()}")
    if maps is None:
        kept = cache.load_partial(key)
        lights_at = irradiance_of(loaded, mi, surfaces, names, kept, motion, paths=paths, soft=scene.soft_light)
        if scene.soft_light and effort is QUICK_EFFORT:
            _check_reach(scene, lights_at(0.0), sum(background_luma(loaded, mi, names)))
        with progress("baking light", 0, unit="points") as bar, cache.kept_if_stopped(key, kept):

            def told(task: str, done: int, expected: int) -> None:
                bar.total = max(bar.total, expected)
                bar.to(done, task)

            seen = None if views is None else seen_places(camera, views)
            maps = bake(surfaces, times, lights_at, error, effort=effort, seen=seen, told=told)
        say(f"the scene's light was baked in {maps.seconds:.3g} s, at {maps.points:,} points")
        cache.store(key, maps)
    keep_last(_known, key, maps, _MOST_KNOWN)
    return BakedLight(
        maps,
        times,
        names,
        emitted,
        emitters,
        background_luma(loaded, mi, names, weights),
        sky_map(loaded, mi, names, weights),
        content,
        cache.holds(key),
        coloured_light(loaded, mi, surfaces.counts, names, soft=scene.soft_light) if surfaces.looks else None,
        effort,
        bool(motion.objects),
    )


def _check_reach(scene: Scene, lights: Sequence[Irradiance], sky: float) -> None:
    """Refuse a scene whose camera is in a closed room under a sky, where there would be no light at all.

    Args:
        sky: luma of the sky.
    """
    if scene.trajectory is None:
        positions = start_pose(scene).position[None]
    else:
        times = np.linspace(0.0, scene.trajectory.duration_s, _PLACES_ON_PATH)
        positions = Views.along(scene.trajectory, times).positions
    normals = np.concatenate([np.eye(3), -np.eye(3)])
    at = np.repeat(positions, len(normals), axis=0), np.tile(normals, (len(positions), 1))
    light = sum((light.glimpsed(*at, _REACH_SAMPLES) + light.sharp(*at) for light in lights), np.zeros((len(at[0]), 3)))
    brightest = (light @ LUMA_WEIGHTS).reshape(len(positions), -1).max(1)
    if np.median(brightest) < _LEAST_REACH * sky:
        raise Unsuitable("no light reaches its camera, which is in a closed room under a sky", "give it a lamp")


def _poses(motion: SceneMotion, times: MotionTimes) -> FloatArray:
    """Return time and poses of the objects at all instants at which light may be baked, (instants, 1 + 12 objects)."""
    poses = motion.at(times.tests).objects
    poses_by_object = [np.hstack([pose.positions, pose.rotations.reshape(-1, 9)]) for pose in poses]
    return np.hstack([times.tests[:, None], *poses_by_object])


def _content(scene: MitsubaScene, mi: Mitsuba, surfaces: Surfaces, poses: FloatArray) -> str:
    """Return a hash of surfaces, materials and lights, and of how they move."""
    digest = hashlib.sha256(surfaces.looks)
    of_surfaces = (
        surfaces.corners,
        surfaces.clear,
        surfaces.normals,
        surfaces.two_sided,
        surfaces.frames,
        surfaces.bumpy,
    )
    for array in (*of_surfaces, poses):
        digest.update(repr(array.shape).encode())
        digest.update(np.ascontiguousarray(array).data)
    for plugin in _parts(scene):
        parameters = mi.traverse(plugin)
        digest.update(f"{plugin.class_name()} {plugin}".encode())
        for name in sorted(key for key, _ in parameters):
            value = numbers(parameters[name])
            digest.update(f"{name} {value.shape} {value.dtype}".encode())
            digest.update(np.ascontiguousarray(value).data)
    # Of the bitmaps that lights throw, Mitsuba tells neither filter nor wrap mode.
    for slide in slides(scene, mi):
        digest.update(repr(slide.core()[:5]).encode())
    return digest.hexdigest()


def _parts(scene: MitsubaScene) -> Iterable[MitsubaObject]:
    yield from scene.shapes()
    yield from scene.emitters()
