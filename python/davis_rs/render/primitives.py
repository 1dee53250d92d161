"""Makes triangles of Mitsuba's spheres, disks, cylinders, curves, instances and masked meshes, for renderers without
noise, and lights that these know of its skies.

The outline of a round shape becomes a polygon. Its corners lie as far outside of the true outline as the middles of its
sides lie inside, and it has so many sides that both stay within :data:`OUTLINE_PX` wherever the camera's path is
closest. Normals and texture coordinates are those of the true shape at the corners, and linear in between. Curves
become tubes, see :mod:`curves`. Meshes whose
material has an opacity mask are cut along its outline, see :mod:`opacity_masks`.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .._mitsuba.types import Mitsuba, MitsubaBsdf, MitsubaEmitter, MitsubaScene, MitsubaShape
from ..geometry.camera import Camera
from ..scene.files.alpha_mask import TOLERANCE_TEXELS
from ..scene.meshes import Mesh, mitsuba_mesh
from ..scene.scene import Scene
from .closest_view import ClosestView
from .curves import CURVES, Curves, curve_mesh
from .diffuse_materials import children, is_null_lamp, nested_objects
from .mesh_buffers import MeshBuffers, mesh_attributes
from .motion.scene_motion import SceneMotion
from .motion.scene_updates import scene_motion
from .obstacles import plugin_name
from .opacity_masks import CutMesh, cut_mesh, is_masked
from .round_meshes import OUTLINE_PX, round_mesh
from .sun_and_sky import KIND as SUNSKY
from .sun_and_sky import as_known_lights

FloatArray = npt.NDArray[np.float64]

_MOST_OF_INSTANCES = 4_000_000
"""The most triangles of all instances; they are kept as they are where they would have more."""

_RINGS = 16
"""Rings of a disk whose colour differs from place to place: its texture coordinates are polar."""

_ROUND = ("sphere", "disk", "cylinder")


@dataclass
class Triangulated:
    """Says what was replaced in a scene.

    Attributes:
        scene: the scene to render: a new one where anything was replaced.
        shapes: how many round shapes and instances were.
        triangles: how many triangles they have.
        cut: how many meshes were cut along their opacity masks.
        outline_texels: how far an outline of a mask may have moved at most.
        off_px: how far an outline lies from the true one at most; NaN where no path is known.
        suns: how many directional lights there are in place of the suns of skies; None where no sky was replaced.
        open_curves: the numbers of the shapes that stand for curves with open ends: Mitsuba culls their backs.
        null_lamps: the numbers of the shapes that emit light and have no surface (``null``): they are not seen from
            behind.
    """

    scene: MitsubaScene
    shapes: int = 0
    triangles: int = 0
    cut: int = 0
    outline_texels: float = 0.0
    off_px: float = 0.0
    suns: int | None = None
    open_curves: tuple[int, ...] = ()
    null_lamps: tuple[int, ...] = ()

    @property
    def description(self) -> str:
        """Say what was replaced, for the message that names the renderer; empty if nothing was."""
        meshes = "1 mesh" if self.cut == 1 else f"{self.cut} meshes"
        coarse = f", to less than {self.outline_texels:g} texels" if self.outline_texels > TOLERANCE_TEXELS else ""
        cut = f"; {meshes} cut along the outlines of opacity masks{coarse}" if self.cut else ""
        suns = "1 directional light" if self.suns == 1 else f"{self.suns} directional lights"
        lamps = "; what is behind lamps of the material null is hidden" if self.null_lamps else ""
        more = cut + lamps + ("" if self.suns is None else f"; its sunsky made an environment map and {suns}")
        if not self.shapes:
            return more
        off = f", up to {self.off_px:.2g} px from their outlines" if self.off_px > OUTLINE_PX else ""
        shapes = "1 shape" if self.shapes == 1 else f"{self.shapes} shapes"
        return f"; {shapes} made of {self.triangles:,} triangles{off}{more}"

    def one_sided(self, names: Collection[str]) -> list[int]:
        """Return the numbers of the shapes whose backs are culled: those of these ids, open curves and null lamps."""
        ids, always = set(names), {*self.open_curves, *self.null_lamps}
        return [number for number, shape in enumerate(self.scene.shapes()) if shape.id() in ids or number in always]

    def note(self, cut: CutMesh) -> None:
        """Count a mesh of which a mask hides a part."""
        if cut.tolerance_texels is not None:
            self.cut += 1
            self.outline_texels = max(self.outline_texels, cut.tolerance_texels)


def as_triangles(
    scene: MitsubaScene, view: ClosestView, mi: Mitsuba, *, deforming: Collection[str] = ()
) -> Triangulated:
    """Replace round shapes and instances of a loaded scene by meshes, and cut meshes along their opacity masks.

    Shapes keep their order and ids. An instance of several shapes becomes as many, ``<id>_<number>``. A scene of which
    nothing is replaced is returned as it is: to load a large one again takes time.

    Args:
        scene: loaded under the variant in force. Its parts belong to the new scene afterwards.
        view: the path that the shapes are made for.
        deforming: ids of meshes that deform, which are not cut.
    """
    result = Triangulated(scene)
    shapes = list(scene.shapes())
    skies = [light for light in scene.emitters() if light.class_name() == SUNSKY]
    if not skies and not any(
        plugin_name(shape) in (*_ROUND, *CURVES, "instance") or is_masked(shape) for shape in shapes
    ):
        return result
    # A mesh that many instances show is cut once.
    cut_once = functools.cache(functools.partial(cut_mesh, mi=mi))
    groups = {str(child.id()): child for child in nested_objects(scene) if _is_group(child)}
    meshes: list[tuple[str, MitsubaShape]] = []
    kept_group = False
    of_instances = 0
    for shape in shapes:
        made: list[MitsubaShape] = []
        if is_masked(shape) and shape.id() not in deforming and (cut := cut_once(shape)) is not None:
            result.note(cut)
            meshes.append((str(shape.id()), _moved(shape, cut, np.eye(4), mi)))
            continue
        if plugin_name(shape) in _ROUND:
            made = [_round(shape, np.eye(4), view, mi, result)]
        elif plugin_name(shape) in CURVES:
            made = _tubes(shape, view, mi, result)
            if made and plugin_name(shape) == "bsplinecurve":
                result.open_curves += (len(meshes),)
        elif plugin_name(shape) == "instance":
            made = _copies(shape, groups, cut_once, view, mi, result)
            of_instances += sum(int(mesh.face_count()) for mesh in made)
            if of_instances > _MOST_OF_INSTANCES:
                made = []
            kept_group |= not made
        if not made:
            meshes.append((str(shape.id()), shape))
            continue
        result.shapes += 1
        result.triangles += sum(int(mesh.face_count()) for mesh in made)
        for number, mesh in enumerate(made):
            named = shape.id() and len(made) > 1
            meshes.append((f"{shape.id()}_{number}" if named else str(shape.id()), mesh))
    if skies or [mesh for _, mesh in meshes] != shapes:
        lights = [light for light in scene.emitters() if light.class_name() != "AreaLight" and light not in skies]
        known = [light for sky in skies for light in as_known_lights(sky, mi)]
        result.suns = len(known) - len(skies) if skies else None
        lights += known
        result.scene = _scene_of(scene, meshes, lights, list(groups.values()) if kept_group else [], mi)
    return result


def triangulated(
    scene: Scene, camera: Camera, loaded: MitsubaScene, mi: Mitsuba
) -> tuple[MitsubaScene, SceneMotion, ClosestView, Triangulated]:
    """Make a loaded scene one of triangles for a camera, and return it with its motion and the path's bound.

    Every user that takes a scene for the same camera gets the same triangles.

    Raises:
        ValueError: as :func:`scene_motion`.
    """
    motion = scene_motion(scene, loaded, mi)
    view = ClosestView(scene, camera, motion)
    made = as_triangles(loaded, view, mi, deforming=motion.deformations)
    made.null_lamps = tuple(number for number, shape in enumerate(made.scene.shapes()) if is_null_lamp(shape))
    if made.scene is not loaded:
        # Light profiles and paths name parts of the scene that is rendered.
        motion = scene_motion(scene, made.scene, mi)
    return made.scene, motion, view, made


def _is_group(node: MitsubaShape) -> bool:
    return str(node.class_name()).startswith("ShapeGroup")


def _scene_of(
    scene: MitsubaScene,
    shapes: list[tuple[str, MitsubaShape]],
    lights: list[MitsubaEmitter],
    groups: list[MitsubaShape],
    mi: Mitsuba,
) -> MitsubaScene:
    """Return a scene of these shapes, each with its id, and lights, under the integrator and the sensors of another."""
    named = [*shapes, *((str(node.id()), node) for node in [*groups, *lights])]
    content: dict[str, object] = {"type": "scene"}
    if scene.integrator() is not None:
        content["integrator"] = scene.integrator()
    # A camera may be in a medium.
    content |= {f"sensor_{number}": sensor for number, sensor in enumerate(scene.sensors())}
    for number, (name, node) in enumerate(named):
        # Shapes without an id need a key of their own here.
        content[name if name and name not in content else f"object_{number}"] = node
    made = mi.load_dict(content, optimize=False)
    for name, node in named:
        node.set_id(name)
    return made


def _copies(
    instance: MitsubaShape,
    groups: dict[str, MitsubaShape],
    cut_of: Callable[[MitsubaShape], CutMesh | None],
    view: ClosestView,
    mi: Mitsuba,
    result: Triangulated,
) -> list[MitsubaShape]:
    """Return meshes in place of an instance; none if its group holds shapes that cannot become meshes.

    Args:
        cut_of: cuts a masked mesh.
    """
    named = re.search(r'name = "([^"\n]*)"', str(instance))
    group = groups.get(named[1]) if named else None
    if group is None:
        return []
    matrix = _matrix(instance, mi)
    made = []
    for shape in nested_objects(group):
        if shape.is_mesh():
            left = cut_of(shape) if is_masked(shape) else None
            left = left or CutMesh(MeshBuffers.of(shape), shape.bsdf())
            result.note(left)
            made.append(_moved(shape, left, matrix, mi))
        elif plugin_name(shape) in _ROUND:
            made.append(_round(shape, matrix, view, mi, result))
        else:
            return []
    return made


def _matrix(shape: MitsubaShape, mi: Mitsuba) -> FloatArray:
    return np.array(mi.traverse(shape)["to_world"].matrix, np.float64).reshape(4, 4)


def _moved(shape: MitsubaShape, left: CutMesh, matrix: FloatArray, mi: Mitsuba) -> MitsubaShape:
    """Return a copy of what is left of a mesh, moved by a transform (4, 4)."""
    mesh, faces = left.mesh, left.mesh.faces.astype(np.int64)
    return _placed(shape, left.bsdf, mesh.positions, faces, mesh.texcoords, mesh.normals, matrix, mi)


def _round(
    shape: MitsubaShape, matrix: FloatArray, view: ClosestView, mi: Mitsuba, result: Triangulated
) -> MitsubaShape:
    """Return a mesh in place of a sphere, disk or cylinder that is moved by a transform (4, 4) after its own."""
    matrix = matrix @ _matrix(shape, mi)
    radius = float(np.linalg.norm(matrix[:3, :3], axis=0).max())
    box = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    if plugin_name(shape) == "cylinder":
        radius, box[:, 2] = float(np.linalg.norm(matrix[:3, :2], axis=0).max()), (box[:, 2] + 1) / 2
    elif plugin_name(shape) == "disk":
        box[:, 2] = 0.0
    radius_px = None
    if view.known:
        corners = box @ matrix[:3, :3].T + matrix[:3, 3]
        radius_px = radius * float(view.pixels_per_metre(corners[None], str(shape.id()))[0])
    textured = any(key.endswith(".to_uv") for key in mi.traverse(shape).keys())  # noqa: SIM118
    made = round_mesh(plugin_name(shape), radius_px, rings=_RINGS if textured else 1)
    result.off_px = float(np.fmax(result.off_px, made.off_px))
    mesh, normals = made.mesh, made.normals
    faces = mesh.faces
    if _faces_inwards(shape, mi):
        faces, normals = faces[:, ::-1], -normals
    return _placed(shape, shape.bsdf(), mesh.vertices, faces, mesh.uv, normals, matrix, mi)


def _tubes(shape: MitsubaShape, view: ClosestView, mi: Mitsuba, result: Triangulated) -> list[MitsubaShape]:
    """Return a mesh in place of curves; none if they have too many segments, or radii that no tube has."""
    parameters = mi.traverse(shape)
    points = np.array(parameters["control_points"], np.float64).reshape(-1, 4)
    firsts = np.array(parameters["segment_indices"], np.int64)
    points[:, 3] = np.maximum(points[:, 3], 0.0)
    if not points[:, 3].any():
        return []
    curves = Curves(points, firsts, is_spline=plugin_name(shape) == "bsplinecurve")
    made = curve_mesh(curves, view.pixels_per_metre(curves.boxes, str(shape.id())) if view.known else None)
    if made is None:
        return []
    result.off_px = float(np.fmax(result.off_px, made.off_px))
    mesh = made.mesh
    return [_placed(shape, shape.bsdf(), mesh.vertices, mesh.faces, mesh.uv, made.normals, np.eye(4), mi)]


def _faces_inwards(shape: MitsubaShape, mi: Mitsuba) -> bool:
    """Return whether the front of a round shape is the side towards its axis or centre; of a disk, towards -z."""
    own = _matrix(shape, mi)
    at, outwards = np.array([1.0, 0, 0]), np.array([1.0, 0, 0])
    if plugin_name(shape) == "disk":
        at, outwards = np.array([0.5, 0, 0]), np.array([0.0, 0, 1])
    point, outwards = own[:3, :3] @ at + own[:3, 3], np.linalg.inv(own[:3, :3]).T @ outwards
    outwards /= np.linalg.norm(outwards)
    hit = mi.PreliminaryIntersection3f()
    # All numbers are given: of one that is left out Dr.Jit ends the process.
    hit.t, hit.prim_index, hit.prim_uv = 1.0, 0, mi.Point2f(at[:2].tolist())
    ray = mi.Ray3f(mi.Point3f(*(point + outwards).tolist()), mi.Vector3f(*(-outwards).tolist()))
    normal = np.array(shape.compute_surface_interaction(ray, hit).n, np.float64).reshape(3)
    return bool(normal @ outwards < 0)


def _placed(
    shape: MitsubaShape,
    bsdf: MitsubaBsdf,
    vertices: FloatArray,
    faces: npt.NDArray[np.int64],
    uv: FloatArray | None,
    normals: FloatArray | None,
    matrix: FloatArray,
    mi: Mitsuba,
) -> MitsubaShape:
    """Return a mesh with a material, a shape's light and its media, whose vertices are moved by a transform (4, 4)."""
    linear = matrix[:3, :3]
    if np.linalg.det(linear) < 0:
        faces = faces[:, ::-1]
    if normals is not None:
        normals = normals @ np.linalg.inv(linear)
        normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    properties = mi.Properties()
    properties["bsdf"] = bsdf
    for name, medium in (("interior", shape.interior_medium()), ("exterior", shape.exterior_medium())):
        if medium is not None:
            properties[name] = medium
    if shape.is_emitter():
        light = shape.emitter()
        properties[str(light.id()) or "emitter"] = mi.load_dict(
            {"type": "area", "radiance": children(light)["radiance"], **({"id": light.id()} if light.id() else {})}
        )
    mesh = Mesh(vertices @ linear.T + matrix[:3, 3], faces, np.zeros((len(vertices), 2)) if uv is None else uv)
    made = mitsuba_mesh(mesh, properties, normals)
    for name, value in mesh_attributes(shape, mi):
        values = np.array(value, np.float32)
        made.add_attribute(name, values.size // (len(faces) if name.startswith("face_") else len(vertices)), values)
    return made
