"""Puts a loaded Mitsuba scene into its state at an instant: objects moved, lights dimmed."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..._mitsuba.types import DrJit, Mitsuba, MitsubaParameters, MitsubaScene, MitsubaShape, MitsubaValue
from ...geometry.pose import FloatArray
from ...scene.deformation import Deformation
from ...scene.scene import Scene
from .scene_motion import SceneMotion, SceneState

_STRENGTHS = (
    *("scale", "intensity.value", "irradiance.value", "radiance.value"),
    *("intensity.data", "irradiance.data", "radiance.data"),
)


def scene_motion(scene: Scene, loaded: MitsubaScene, mi: Mitsuba) -> SceneMotion:
    """Return what moves and flickers in a loaded scene.

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
        _pose_key(name, shapes[name], parameters)
    for name in scene.lights:
        strength_key(name, parameters)
    for name, deformation in scene.deformations.items():
        _check_deformation(name, deformation, shapes[name], parameters)
    boxes = {name: [np.array(end).reshape(3) for end in _corners(shapes[name])] for name in scene.objects}
    boxes |= {name: list(deformation.box()) for name, deformation in scene.deformations.items()}
    return SceneMotion(scene.objects, scene.lights, boxes, deformations=scene.deformations)


def _check_deformation(name: str, deformation: Deformation, shape: MitsubaShape, parameters: MitsubaParameters) -> None:
    """Refuse a deformation of another number of vertices than the shape has."""
    if not _pose_key(name, shape, parameters).endswith("vertex_positions"):
        raise ValueError(f"object {name!r} is a {shape.class_name()}, which cannot deform; meshes can")
    mesh = next(iter(deformation.meshes(np.zeros(1))))
    if mesh.positions.shape != (shape.vertex_count(), 3):
        raise ValueError(
            f"the deformation of {name!r} has positions of shape {mesh.positions.shape}, and the mesh has "
            f"{shape.vertex_count()} vertices"
        )


def _corners(shape: MitsubaShape) -> tuple[MitsubaValue, MitsubaValue]:
    box = shape.bbox()
    return box.min, box.max


def _pose_key(name: str, shape: MitsubaShape, parameters: MitsubaParameters) -> str:
    """Return the name of the parameter that holds a shape's pose or its vertices."""
    for key in (f"{name}.to_world", f"{name}.vertex_positions"):
        if key in parameters:
            return key
    raise ValueError(f"object {name!r} is a {shape.class_name()}, which cannot move; meshes and simple shapes can")


def strength_key(name: str, parameters: MitsubaParameters) -> str:
    """Return the name of the parameter in which a light is linear.

    Args:
        name: the id of the light; empty where ``parameters`` are those of the light alone.
    """
    for strength in _STRENGTHS:
        key = f"{name}.{strength}" if name else strength
        if key in parameters:
            return key
    raise ValueError(f"light {name!r} has none of {', '.join(_STRENGTHS)}: its strength cannot change")


def owner_numbers(scene: MitsubaScene, motion: SceneMotion, mi: Mitsuba, dr: DrJit) -> npt.NDArray[np.uint32]:
    """Return for each registry number of a shape: 1, 2, ... for the moving objects, 0 for all else."""
    numbers = {name: number for number, name in enumerate(motion.objects, 1)}
    registered = [int(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)).numpy()[0]) for shape in scene.shapes()]
    owners = np.zeros(max(registered) + 1, np.uint32)
    owners[registered] = [numbers.get(shape.id(), 0) for shape in scene.shapes()]
    return owners


class SceneUpdates:
    """Moves a Mitsuba scene from state to state; each takes some milliseconds, because Mitsuba builds its BVH anew.

    It must be made and used under the variant that loaded the scene.
    """

    def __init__(self, scene: MitsubaScene, motion: SceneMotion, mi: Mitsuba) -> None:
        self._parameters = mi.traverse(scene)
        shapes = {shape.id(): shape for shape in scene.shapes()}
        keys = [_pose_key(name, shapes[name], self._parameters) for name in motion.objects]
        self._objects = [MovableShape(self._parameters, key) for key in keys]
        self._lights = [strength_key(name, self._parameters) for name in motion.lights]
        self._strengths = [np.array(self._parameters[key], np.float64) for key in self._lights]
        self._deformations = [motion.deformations.get(name) for name in motion.objects]
        self._poses = [np.full((4, 4), np.nan)] * len(self._objects)  # nowhere yet
        self._factors: list[float] = [1.0] * len(self._lights)

    def set(self, state: SceneState, instant: int) -> None:
        """Put the scene into its state at one instant; leave alone what does not change."""
        for number, (moving, poses) in enumerate(zip(self._objects, state.objects, strict=True)):
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = poses.rotations[instant], poses.positions[instant]
            deformation = self._deformations[number]
            if deformation is not None:
                (mesh,) = deformation.meshes(state.t_s[instant : instant + 1])
                moving.deform(mesh.positions * state.scale, mesh.normals)
            if deformation is not None or not np.array_equal(pose, self._poses[number]):
                moving.move_to(pose)
                self._poses[number] = pose
        for number, (key, factor) in enumerate(zip(self._lights, state.factors[instant].tolist(), strict=True)):
            if factor != self._factors[number]:
                self._parameters[key] = like(self._parameters[key], self._strengths[number] * factor)
                self._factors[number] = factor
        self._parameters.update()


def like(value: MitsubaValue, values: FloatArray) -> MitsubaValue:
    """Return ``values`` as the type that the parameter ``value`` has."""
    kind = type(value)
    if kind is float:
        return float(values)
    return kind(values.reshape(-1).tolist()) if values.size <= 3 else kind(values.astype(np.float32))


class MovableShape:
    """Moves a shape of a loaded scene, from the pose that it was loaded in."""

    def __init__(self, parameters: MitsubaParameters, key: str) -> None:
        self._parameters, self._key = parameters, key
        self._is_mesh = key.endswith("vertex_positions")
        if not self._is_mesh:
            self._matrix = np.array(parameters[key].matrix, np.float64).reshape(4, 4)
            return
        self._vertices = np.array(parameters[key], np.float64).reshape(-1, 3)
        self._normals_key = key.removesuffix("positions") + "normals"
        normals = np.array(parameters[self._normals_key], np.float64)
        self._normals = normals.reshape(-1, 3)

    def deform(self, vertices: FloatArray, normals: FloatArray | None) -> None:
        """Give a mesh other vertices (v, 3) and normals; :meth:`move_to` then puts it where it belongs."""
        self._vertices = vertices
        self._normals = np.empty((0, 3)) if normals is None or not len(self._normals) else normals

    def move_to(self, pose: FloatArray) -> None:
        """Move the shape by a pose (4, 4), which may also scale it evenly, from where it was loaded."""
        parameters = self._parameters
        if not self._is_mesh:
            parameters[self._key] = type(parameters[self._key])(pose @ self._matrix)
            return
        self._put(self._key, self._vertices @ pose[:3, :3].T + pose[:3, 3])
        if len(self._normals):
            # Mitsuba computes new normals with the vertices; so the mesh's own are set after them.
            parameters.update()
            scale = np.linalg.norm(pose[:3, 0])
            self._put(self._normals_key, self._normals @ pose[:3, :3].T / scale)

    def _put(self, key: str, values: FloatArray) -> None:
        self._parameters[key] = type(self._parameters[key])(values.astype(np.float32).ravel())
