"""A loaded Mitsuba scene that is put into the state of an instant: objects moved, lights dimmed."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ...geometry.pose import FloatArray
from ...scene.scene import Scene
from .scene_motion import SceneMotion, SceneState

_STRENGTHS = (
    *("scale", "intensity.value", "irradiance.value", "radiance.value"),
    *("intensity.data", "irradiance.data", "radiance.data"),
)


def scene_motion(scene: Scene, loaded: Any, mi: Any) -> SceneMotion:
    """What moves and flickers in a scene that is loaded.

    Raises:
        ValueError: for an object or light that the scene does not have (the message names those that it has), or one
            that cannot move or change.
    """
    if not (scene.objects or scene.lights):
        return SceneMotion({}, {}, {})
    parameters = mi.traverse(loaded)
    shapes = {shape.id(): shape for shape in loaded.shapes()}
    split = [key.rpartition(".") for key in list(parameters.keys())]
    lights = [name for name, _, parameter in split if parameter == "sampling_weight"]
    for kind, asked, known in (("object", scene.objects, shapes), ("light", scene.lights, lights)):
        unknown = [name for name in asked if name not in known]
        if unknown:
            raise ValueError(f"scene {scene.name!r} has no {kind} {unknown[0]!r}; it has {', '.join(known) or 'none'}")
    for name in scene.objects:
        _place_key(name, shapes[name], parameters)
    for name in scene.lights:
        strength_key(name, parameters)
    boxes = {name: [np.array(end).reshape(3) for end in _corners(shapes[name])] for name in scene.objects}
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


def strength_key(name: str, parameters: Any) -> str:
    """The parameter in which a light is linear.

    Args:
        name: of the light; empty for parameters of the light alone.
    """
    for strength in _STRENGTHS:
        key = f"{name}.{strength}" if name else strength
        if key in parameters:
            return key
    raise ValueError(f"light {name!r} has none of {', '.join(_STRENGTHS)}: its strength cannot change")


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
        shapes = {shape.id(): shape for shape in scene.shapes()}
        keys = [_place_key(name, shapes[name], self._parameters) for name in motion.objects]
        self._objects = [PlacedShape(self._parameters, key) for key in keys]
        self._lights = [strength_key(name, self._parameters) for name in motion.lights]
        self._strengths = [np.array(self._parameters[key], np.float64) for key in self._lights]
        self._poses = [np.full((4, 4), np.nan)] * len(self._objects)  # nowhere yet
        self._factors: list[float] = [1.0] * len(self._lights)

    def set(self, state: SceneState, instant: int) -> None:
        """Bring the scene to one of a state's instants; what is there already is left alone."""
        for number, (moving, poses) in enumerate(zip(self._objects, state.objects, strict=True)):
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = poses.rotations[instant], poses.positions[instant]
            if not np.array_equal(pose, self._poses[number]):
                moving.place(pose)
                self._poses[number] = pose
        for number, (key, factor) in enumerate(zip(self._lights, state.factors[instant].tolist(), strict=True)):
            if factor != self._factors[number]:
                self._parameters[key] = like(self._parameters[key], self._strengths[number] * factor)
                self._factors[number] = factor
        self._parameters.update()


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
