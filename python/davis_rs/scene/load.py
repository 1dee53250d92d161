"""Loads scenes by name or file, and finds where a camera starts in them."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from .._mitsuba.animated_transforms import Motion
from .._mitsuba.files import XmlFile
from .._mitsuba.types import Mitsuba, MitsubaObject
from .._mitsuba.variants import default_variant, load_scene_file, variant
from .._util.argument_error import ArgumentError
from .._util.close_names import did_you_mean, names_checked
from ..geometry.camera import Camera
from ..geometry.pose import FloatArray, Pose
from ..geometry.trajectory.trajectory import SegmentTrajectory, Trajectory
from .builtin.checkerboard_scene import checkerboard
from .builtin.fence_scene import fence
from .builtin.planes_and_walls import three_planes, three_walls
from .files.gltf_scene import gltf_scene
from .files.mesh_scene import READERS as MESH_READERS
from .files.mesh_scene import Axis, mesh_scene, sun_behind, usual_light
from .keyframes import keyframe_path
from .lost_looks import UNKNOWN, LostLook
from .repairs import SceneFileWarning
from .scene import Scene, check_scene

BUILTIN_SCENES = {
    "three_planes": three_planes,
    "three_walls": three_walls,
    "fence": fence,
    "checkerboard": checkerboard,
}


GLTF = (".gltf", ".glb")
"""Suffixes of files that hold whole scenes."""

_FILE_ROUNDING = 1e-3
"""By so much numbers of a camera's matrix may stretch it that a file writes with few digits."""

_VIDEOS = (".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v")
_CONVERTIBLE = (".fbx", ".stl", ".dae", ".usd", ".usda", ".usdc", ".usdz", ".3ds", ".abc", ".off")


@names_checked
def load_scene(
    name_or_path: str | Path,
    *,
    up: Axis | None = None,
    scale: float | None = None,
    animation: str | None = None,
    variables: Mapping[str, str] | None = None,
    grey_unknown: bool = False,
) -> Scene:
    """Load a built-in scene or a public sequence by name, a Mitsuba XML or glTF file, or an OBJ or PLY mesh.

    Names are keys of :data:`BUILTIN_SCENES` and of :data:`~davis_rs.scene.sequences.SEQUENCES`.

    The first perspective sensor of an XML file gives the scene's camera (field of view, size of the film, principal
    point) and its start (``to_world``). A mesh gets light, background and a camera path around it:
    :func:`~davis_rs.scene.files.mesh_scene.mesh_scene`. A glTF file (.gltf, .glb) brings its own:
    :func:`~davis_rs.scene.files.gltf_scene.gltf_scene`.

    Args:
        up: of a mesh or a glTF file, the axis that points up, ``"y"`` or ``"z"``; None: y for OBJ and glTF, z for PLY.
        scale: of these, metres in the file's unit; None: 1.
        animation: of a glTF file, the name of the one that is played; None: all, or the first where two move the same.
        variables: of a Mitsuba XML file, a value as text for each ``$name`` in it, before the file's own defaults.
        grey_unknown: take as grey (a reflectance of 0.5), which a warning tells, materials that are not known in a
            Mitsuba XML file, materials and textures that are missing of an OBJ or PLY mesh, and textures that are
            missing of a glTF file; else such a file is refused.

    Raises:
        ValueError: if it is neither a name nor a file that can be read, or Mitsuba cannot load the file; for ``up`` or
            ``scale`` of what is no mesh, ``animation`` of what is no glTF file or does not have it, ``variables`` of
            what is no XML file, or that it does not have, and ``grey_unknown`` of what is no file that is read.
        OSError: if the file cannot be read.

    Warns:
        SceneFileWarning: in one line, of all that is left out of a file, or taken otherwise than it says.
    """
    path = Path(name_or_path)
    suffix = path.suffix.lower()
    if variables and (suffix != ".xml" or not path.is_file()):
        raise ArgumentError("{variables} are for a Mitsuba XML file that is there, got {!r}", str(name_or_path))
    if grey_unknown and (suffix not in (".xml", *GLTF, *MESH_READERS) or not path.is_file()):
        raise ArgumentError(
            "{grey_unknown} is for a Mitsuba XML file, a glTF file, or an OBJ or a PLY mesh that is there, got {!r}",
            str(name_or_path),
        )
    if animation is not None and (suffix not in GLTF or not path.is_file()):
        raise ArgumentError("{animation} is for a glTF file that is there, got {!r}", str(name_or_path))
    if suffix in MESH_READERS and path.is_file():
        return mesh_scene(path, up=up, scale=1.0 if scale is None else scale, grey_unknown=grey_unknown)
    if suffix in GLTF and path.is_file():
        return gltf_scene(
            path, up=up, scale=1.0 if scale is None else scale, animation=animation, grey_unknown=grey_unknown
        )
    if suffix == ".blend":
        raise ValueError(f"{path}: Blender's files are not read; in Blender choose File, Export, glTF 2.0 (.glb)")
    if suffix in _CONVERTIBLE:
        raise ValueError(
            f"{path}: {suffix} files are not read; import the file in Blender and choose File, Export, glTF 2.0 "
            "(.glb) or Wavefront (.obj)"
        )
    if up is not None or scale is not None:
        raise ArgumentError(
            "{up} and {scale} are for a mesh that is there (OBJ, PLY or glTF), got {!r}", str(name_or_path)
        )
    if str(name_or_path) in BUILTIN_SCENES:
        return BUILTIN_SCENES[str(name_or_path)]()
    from .sequences import SEQUENCES  # many small scenes, which `import davis_rs` need not wait for

    if str(name_or_path) in SEQUENCES:
        return SEQUENCES[str(name_or_path)].scene()
    if not path.is_file() and suffix in (".xml", *GLTF, *MESH_READERS):
        raise ValueError(f"{path}: there is no such scene file")
    if not path.is_file():
        raise ValueError(
            f"scene {str(name_or_path)!r} is neither one of {', '.join(BUILTIN_SCENES)}, a sequence of the dataset, "
            "nor a file (Mitsuba XML, glTF, OBJ or PLY)" + did_you_mean(path.name, [*BUILTIN_SCENES, *SEQUENCES])
        )
    if suffix != ".xml":
        raise ValueError(
            f"{path}: a scene file must be a Mitsuba scene (.xml), glTF ({', '.join(GLTF)}) or a mesh "
            f"({', '.join(MESH_READERS)}), got {suffix!r}"
            + ("; davis-rs frames makes events of a video" if suffix in _VIDEOS else "")
        )
    return _scene_of_file(path, dict(variables or {}), grey_unknown)


def start_pose(scene: Scene) -> Pose:
    """Return where a camera starts in a scene: its trajectory's first pose, or the scene's own start.

    Raises:
        TypeError: for what is no scene.
        ValueError: if it has neither.
    """
    check_scene(scene)
    if scene.trajectory is not None:
        return scene.trajectory.pose(0.0)
    if scene.start is None:
        raise ValueError(f"scene {scene.name!r} has neither a trajectory nor a sensor that a trajectory could start at")
    return scene.start


def moves_paths(scene: Scene) -> bool:
    """Return whether the trajectory of a file is moved to a scene's start, where the user does not say.

    It is in a scene that is built in or drawn, because no trajectory was recorded there. A file's world may be that of
    the trajectory.
    """
    return scene.file is None


def _scene_of_file(path: Path, variables: dict[str, str], grey_unknown: bool) -> Scene:
    """Load a Mitsuba XML file, with the camera and the start that its first sensor gives, and what moves in it."""
    source = XmlFile(path, variables, grey_unknown)
    camera: Camera | None = None
    start: Pose | None = None
    trajectory: Trajectory | None = None
    with variant(default_variant()[0]) as (mi, _):
        loaded = load_scene_file(source, mi)
        duration_s = max((float(motion.times[-1]) for motion in loaded.motions), default=0.0)

        def path_of(motion: Motion, pose: Callable[[FloatArray], Pose]) -> Trajectory:
            return keyframe_path(motion.times, [pose(matrix) for matrix in motion.poses], duration_s, motion.id)

        shapes = {shape.id() for shape in loaded.scene.shapes()}
        objects = {
            motion.id: path_of(motion, Pose.from_matrix)
            for motion in loaded.motions
            if motion.tag == "shape" and motion.id in shapes
        }
        if sensors := loaded.scene.sensors():
            camera = _camera(sensors[0], mi)
            matrix = np.array(mi.traverse(sensors[0])["to_world"].matrix, np.float64).reshape(4, 4)
            if camera is None:  # the size of its image is that of its axes
                matrix[:3, :3] /= np.maximum(np.linalg.norm(matrix[:3, :3], axis=0), 1e-30)
                loaded.notes.append(
                    "its first sensor is not perspective, so it says no more than where a camera starts"
                )
            start = _pose(matrix)
            trajectory = SegmentTrajectory(start, start, duration_s) if objects else None
            for motion in loaded.motions:
                if motion.tag == "sensor" and motion.id == sensors[0].id():
                    trajectory = path_of(motion, _pose)
        first = {sensors[0].id()} if sensors else set[str]()
        still = [f"{motion.tag} {motion.id!r}" for motion in loaded.motions if motion.id not in {*objects, *first}]
        if still:
            loaded.notes.append(f"the motion of {', '.join(still)} is left out: the camera is the first sensor")
        if not loaded.scene.emitters():
            loaded.notes.append("it has no lights, so a sun behind the camera and light from all sides are added")
            lights = usual_light(None) if start is None else sun_behind(start.rotation)
            source = replace(source, lights=lights)
        if loaded.notes:
            warnings.warn(f"{path}: {'; '.join(loaded.notes)}", SceneFileWarning, stacklevel=3)
    return Scene(
        name=path.stem,
        source=lambda: source,
        file=path,
        camera=camera,
        start=start,
        trajectory=trajectory,
        objects=objects,
        variables=variables,
        lost_looks=tuple(LostLook(UNKNOWN, (grey.name,), grey.shapes) for grey in loaded.grey),
    )


def _nearest_rotation(matrix: FloatArray) -> FloatArray:
    """Return the rotation next to a matrix that is one but for its rounding in a file; any other as it is."""
    left, stretch, right = np.linalg.svd(matrix)
    return left @ right if np.abs(stretch - 1.0).max() < _FILE_ROUNDING else matrix


def _pose(matrix: FloatArray) -> Pose:
    """Return the pose of a camera, of a sensor's matrix (4, 4)."""
    # Mitsuba's cameras look along z too, but their x points left and their y up.
    matrix = matrix @ np.diag([-1.0, -1.0, 1.0, 1.0])
    if np.linalg.det(matrix[:3, :3]) < 0.0:
        warnings.warn(
            "the scene's camera mirrors its image, as no real camera does: the mirror is left out",
            SceneFileWarning,
            stacklevel=2,
        )
        matrix = matrix @ np.diag([-1.0, 1.0, 1.0, 1.0])
    matrix[:3, :3] = _nearest_rotation(matrix[:3, :3])
    return Pose.from_matrix(matrix)


def _camera(sensor: MitsubaObject, mi: Mitsuba) -> Camera | None:
    """Return a sensor's pinhole camera, None if it is not a perspective one."""
    parameters = mi.traverse(sensor)
    if "x_fov" not in parameters:
        return None
    if "aperture_radius" in parameters:
        warnings.warn("the scene's thin lens is taken as a pinhole: depth of field is not simulated", stacklevel=2)
    film = sensor.film()
    (full_width, full_height), (left, top) = film.size(), film.crop_offset()
    width, height = film.crop_size()
    focal = full_width / (2 * math.tan(math.radians(float(np.ravel(parameters["x_fov"])[0])) / 2))
    offset_x, offset_y = (
        float(np.ravel(parameters[f"principal_point_offset_{axis}"])[0])
        if f"principal_point_offset_{axis}" in parameters
        else 0.0
        for axis in "xy"
    )
    cx = (0.5 - offset_x) * full_width - 0.5 - left
    cy = (0.5 - offset_y) * full_height - 0.5 - top
    return Camera(int(width), int(height), focal, focal, cx, cy)
