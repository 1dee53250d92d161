"""A loaded Mitsuba scene that is put into the state of an instant: objects moved, lights dimmed."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ..pose import FloatArray
from ..scene.scene import Scene
from .scene_motion import SceneMotion, SceneState
from .scene_names import SceneLight, light_named, scene_lights, shape_named

_STRENGTHS = (
    *("scale", "intensity.value", "irradiance.value", "radiance.value"),
    *("intensity.data", "irradiance.data", "radiance.data"),
)


def scene_motion(scene: Scene, loaded: Any, mi: Any) -> SceneMotion:
    """What moves and flickers in a scene that is loaded.

    Raises:
        ValueError: for an object or light that the scene does not have (the message names those that it has), or has
            more than once, or one that cannot move or change.
    """
    if not (scene.objects or scene.lights):
        return SceneMotion({}, {}, {})
    where = f"scene {scene.name!r}"
    parameters, lights = mi.traverse(loaded), scene_lights(loaded)
    shapes = {name: shape_named(name, loaded.shapes(), where) for name in scene.objects}
    for name, shape in shapes.items():
        _place_key(name, shape, parameters)
    for name in scene.lights:
        light = light_named(name, lights, where)
        strength_key(light, mi.traverse(light.emitter))
    boxes = {name: [np.array(end).reshape(3) for end in _corners(shape)] for name, shape in shapes.items()}
    return SceneMotion(scene.objects, scene.lights, boxes)


def _corners(shape: Any) -> tuple[Any, Any]:
    box = shape.bbox()
    return box.min, box.max


def _place_key(name: str, shape: Any, parameters: Any) -> str:
    """The parameter that places a shape."""
    for key in (f"{name}.to_world", f"{name}.vertex_positions"):
        if key in parameters:
            return key
    raise ValueError(f"object {name!r} is a {shape.class_name()}, which cannot move; meshes and simple shapes can")


def strength_key(light: SceneLight, parameters: Any) -> str:
    """The parameter, of the light's own, in which it is linear.

    Raises:
        ValueError: if there is none.
    """
    for key in _STRENGTHS:
        if key in parameters:
            return key
    raise ValueError(f"{light} has none of {', '.join(_STRENGTHS)}: its strength cannot change")


class LightStrength:
    """The strength of a light, as a multiple of what it was."""

    def __init__(self, light: SceneLight, mi: Any) -> None:
        self._parameters = mi.traverse(light.emitter)
        self._key = strength_key(light, self._parameters)
        self._values = np.array(self._parameters[self._key], np.float64)
        self._factor = 1.0

    def set(self, factor: float) -> None:
        """Make the light this strong; what is so already is left alone."""
        if factor != self._factor:
            self._parameters[self._key] = like(self._parameters[self._key], self._values * factor)
            self._parameters.update()
            self._factor = factor


def owner_numbers(scene: Any, motion: SceneMotion, mi: Any, dr: Any) -> npt.NDArray[np.uint32]:
    """The number of each shape by its registry number: 1, 2, ... for the objects that move, 0 for all else."""
    numbers = {name: number for number, name in enumerate(motion.objects, 1)}
    registered = [int(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)).numpy()[0]) for shape in scene.shapes()]
    owners = np.zeros(max(registered) + 1, np.uint32)
    owners[registered] = [numbers.get(shape.id(), 0) for shape in scene.shapes()]
    return owners


class SceneUpdates:
    """Puts a Mitsuba scene into states, each a few milliseconds: Mitsuba builds its ray tracing anew for each.

    Made and used under the variant that loaded the scene.
    """

    def __init__(self, scene: Any, motion: SceneMotion, mi: Any) -> None:
        self._parameters = mi.traverse(scene)
        shapes, lights = scene.shapes(), scene_lights(scene)
        keys = [_place_key(name, shape_named(name, shapes), self._parameters) for name in motion.objects]
        self._objects = [PlacedShape(self._parameters, key) for key in keys]
        self._lights = [LightStrength(light_named(name, lights), mi) for name in motion.lights]
        self._poses = [np.full((4, 4), np.nan)] * len(self._objects)  # nowhere yet

    def set(self, state: SceneState, instant: int) -> None:
        """Bring the scene to one of a state's instants; what is there already is left alone."""
        for number, (moving, poses) in enumerate(zip(self._objects, state.objects, strict=True)):
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = poses.rotations[instant], poses.positions[instant]
            if not np.array_equal(pose, self._poses[number]):
                moving.place(pose)
                self._poses[number] = pose
        self._parameters.update()
        for light, factor in zip(self._lights, state.factors[instant].tolist(), strict=True):
            light.set(factor)


def like(value: Any, values: FloatArray) -> Any:
    """Numbers as a parameter of the kind that ``value`` is."""
    kind = type(value)
    if kind is float:
        return float(values)
    return kind(values.reshape(-1).tolist()) if values.size <= 3 else kind(values.astype(np.float32))


class PlacedShape:
    """A shape's place in its own frame, and how to move it."""

    def __init__(self, parameters: Any, key: str) -> None:
        self._parameters, self._key = parameters, key
        self._is_mesh = key.endswith("vertex_positions")
        if not self._is_mesh:
            self._matrix = np.array(parameters[key].matrix, np.float64).reshape(4, 4)
            return
        self._vertices = np.array(parameters[key], np.float64).reshape(-1, 3)
        self._normals_key = key.removesuffix("positions") + "normals"
        normals = np.array(parameters[self._normals_key], np.float64)
        self._normals = normals.reshape(-1, 3)

    def place(self, pose: FloatArray) -> None:
        """Move it by a pose (4, 4), which may also scale it evenly, from where its own frame has it."""
        parameters = self._parameters
        if not self._is_mesh:
            parameters[self._key] = type(parameters[self._key])(pose @ self._matrix)
            return
        self._put(self._key, self._vertices @ pose[:3, :3].T + pose[:3, 3])
        if len(self._normals):
            # Mitsuba makes normals anew with the vertices; the mesh's own come after.
            parameters.update()
            scale = np.linalg.norm(pose[:3, 0])
            self._put(self._normals_key, self._normals @ pose[:3, :3].T / scale)

    def _put(self, key: str, values: FloatArray) -> None:
        self._parameters[key] = type(self._parameters[key])(values.astype(np.float32).ravel())
