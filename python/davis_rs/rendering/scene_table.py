"""A diffuse scene of triangles as flat tables: what the table kernel gathers from instead of asking Mitsuba.

Each triangle becomes one record: its plane, and affine maps from a point on it to texture coordinates (and to the
interpolated normal, where a mesh is smooth). All textures lie in one flat buffer of texels, already weighted to luma:
one buffer for each light colour, so that a red light sees the red of a texture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..luma import LUMA_WEIGHTS
from .scene_texture import TextureTable, Unsuitable

__all__ = ["Light", "SceneTable", "Unsuitable"]

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Light:
    """One light: its kind, colour group, strength and id.

    ``vector`` is the position (point, metres) or the direction that light travels (directional, unit).
    """

    kind: str
    group: int
    strength: float
    vector: FloatArray
    name: str = ""


class SceneTable:
    """The tables of a Mitsuba scene.

    Args:
        moving: ids of shapes that move; each is in tables and rays of its own frame.

    Attributes:
        scene: a Mitsuba scene of all that stands still, for its ray tracing.
        bodies: a Mitsuba scene for each shape that moves.
        first_record: uint32, record of a shape's first triangle, by the shape's registry number.
        planes: float32 (n, 4): unit normal and offset, n . p + offset = 0.
        u_maps, v_maps: float32 (n, 4): u = map[:3] . p + map[3].
        normal_maps: float32 (n, 3, 4), the interpolated vertex normal before normalisation; None where all is flat.
        textures: the textures, and which one each record has.
        two_sided: uint32 (n): 1 where the back of the surface reflects too.
        lights: the lights.

    Raises:
        Unsuitable: naming the first thing in the scene that the table kernel cannot render.
    """

    def __init__(
        self, scene: Any, mi: Any, dr: Any, *, shadows: bool, any_integrator: bool, moving: Sequence[str] = ()
    ) -> None:
        self.scene, self.shadows, self.bodies = scene, shadows, list[Any]()
        self._hides_lights = bool(getattr(scene.integrator(), "hide_emitters", False))
        if not any_integrator:
            _check_integrator(scene.integrator())
        colours: list[FloatArray] = []
        self.lights = [_light(emitter, mi, colours) for emitter in scene.emitters()]
        planes, maps_u, maps_v, normals, two_sided, records_of = [], [], [], [], [], {}
        self.textures = TextureTable(mi, [np.asarray(LUMA_WEIGHTS) * colour for colour in colours])
        smooth = False
        count = 0
        for shape in scene.shapes():
            if not shape.is_mesh():
                raise Unsuitable(f"shape {shape.id()!r} is a {shape.class_name()}, not made of triangles")
            number = int(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)).numpy()[0])
            records_of[number] = count
            mesh = _Mesh(shape)
            two_sided.append(np.full(mesh.count, self.textures.add(shape, mesh.count), np.uint32))
            u, v = mesh.texture_maps()
            maps_u.append(u)
            maps_v.append(v)
            normal, is_smooth = mesh.normal_maps()
            # Which side is the front matters only where the back is another.
            turned = np.ones(mesh.count) if two_sided[-1].any() else mesh.turned(normal, mi, dr)
            planes.append(mesh.planes() * turned[:, None])
            normals.append(normal * turned[:, None, None])
            smooth |= is_smooth
            count += mesh.count
        self.first_record = np.zeros(max(records_of) + 1, np.uint32)
        for number, first in records_of.items():
            self.first_record[number] = first
        self.planes = np.concatenate(planes).astype(np.float32)
        self.u_maps = np.concatenate(maps_u).astype(np.float32)
        self.v_maps = np.concatenate(maps_v).astype(np.float32)
        self.normal_maps = np.concatenate(normals).astype(np.float32) if smooth else None
        self.two_sided = np.concatenate(two_sided)
        if moving:
            shapes = scene.shapes()
            self.scene = _part_of([shape for shape in shapes if shape.id() not in moving], mi)
            self.bodies = [_part_of([shape for shape in shapes if shape.id() == name], mi) for name in moving]

    @property
    def background_luma(self) -> float:
        """Luma of a ray that hits nothing: the radiance of the constant lights, unless the scene hides its lights."""
        return float(self.background(self.lights))

    def background(self, lights: Sequence[Light]) -> Any:
        """:attr:`background_luma` under these lights, whose strengths may be Dr.Jit arrays."""
        if self._hides_lights:
            return 0.0
        groups = [float(weights.sum()) for weights in self.textures.group_weights]
        return sum(light.strength * groups[light.group] for light in lights if light.kind == "constant")


class _Mesh:
    """A mesh's triangles in float64."""

    def __init__(self, shape: Any) -> None:
        self.shape = shape
        faces = np.array(shape.faces_buffer()).reshape(-1, 3)
        self.corners = self._per_corner(shape.vertex_positions_buffer(), faces, 3)
        self.uv = self._per_corner(shape.vertex_texcoords_buffer(), faces, 2) if shape.has_vertex_texcoords() else None
        smooth = shape.has_vertex_normals() and "face_normals = 0" in str(shape)
        self.vertex_normals = self._per_corner(shape.vertex_normals_buffer(), faces, 3) if smooth else None
        self.count = len(faces)
        edges = self.corners[:, 1:] - self.corners[:, :1]
        cross = np.cross(edges[:, 0], edges[:, 1])
        area = np.linalg.norm(cross, axis=1, keepdims=True)
        # A triangle without area is never hit; any plane will do for it.
        self.normals = np.divide(cross, area, out=np.zeros_like(cross), where=area > 0)
        # Gradients of the two barycentric coordinates over the plane: b = gradient . (p - corner 0).
        double_area = np.where(area > 0, area, 1.0)
        self.gradients = (
            np.stack([np.cross(edges[:, 1], self.normals), np.cross(self.normals, edges[:, 0])], 1)
            / double_area[:, None]
        )

    @staticmethod
    def _per_corner(buffer: Any, faces: npt.NDArray[Any], width: int) -> FloatArray:
        return np.array(buffer, np.float64).reshape(-1, width)[faces]

    def planes(self) -> FloatArray:
        offsets = -np.einsum("ij,ij->i", self.normals, self.corners[:, 0])
        return np.concatenate([self.normals, offsets[:, None]], 1)

    def affine(self, values: FloatArray) -> FloatArray:
        """(n, 4) maps that take the values (n, 3) at a triangle's three corners, and are linear between."""
        slopes = np.einsum("ij,ijk->ik", values[:, 1:] - values[:, :1], self.gradients)
        offsets = values[:, 0] - np.einsum("ij,ij->i", slopes, self.corners[:, 0])
        return np.concatenate([slopes, offsets[:, None]], 1)

    def texture_maps(self) -> tuple[FloatArray, FloatArray]:
        if self.uv is None:
            # Without texture coordinates Mitsuba takes the barycentric ones.
            barycentric = np.broadcast_to(np.array([[0.0, 1, 0], [0, 0, 1]]), (self.count, 2, 3))
            return self.affine(barycentric[:, 0]), self.affine(barycentric[:, 1])
        return self.affine(self.uv[..., 0]), self.affine(self.uv[..., 1])

    def normal_maps(self) -> tuple[FloatArray, bool]:
        """(n, 3, 4) maps of the shading normal, and whether any triangle is smooth (has it differ from its plane's)."""
        flat = np.zeros((self.count, 3, 4))
        flat[..., 3] = self.normals
        if self.vertex_normals is None:
            return flat, False
        maps = np.stack([self.affine(self.vertex_normals[..., axis]) for axis in range(3)], 1)
        differs = np.abs(self.vertex_normals - self.normals[:, None]).max() > 1e-5
        return maps, bool(differs)

    def turned(self, normal_maps: FloatArray, mi: Any, dr: Any) -> FloatArray:
        """For each triangle -1 where Mitsuba's normal is the opposite (flipped, or a mirrored rectangle), else 1."""
        centre = mi.PreliminaryIntersection3f()
        centre.t = dr.ones(mi.Float, self.count)
        centre.prim_index = dr.arange(mi.UInt32, self.count)
        centre.prim_uv = mi.Point2f(1 / 3)
        ray = mi.Ray3f(mi.Point3f(0), mi.Vector3f(0, 0, 1))
        theirs = self.shape.compute_surface_interaction(ray, centre).sh_frame.n.numpy().T
        ours = np.einsum("nij,nj->ni", normal_maps[..., :3], self.corners.mean(1)) + normal_maps[..., 3]
        return np.where((ours * theirs).sum(-1) < 0, -1.0, 1.0)


def _part_of(shapes: list[Any], mi: Any) -> Any:
    """A Mitsuba scene of some of a scene's shapes, for its ray tracing alone."""
    names = [shape.id() for shape in shapes]
    part = mi.load_dict({"type": "scene", **{f"shape_{i}": shape for i, shape in enumerate(shapes)}}, optimize=False)
    for shape, name in zip(shapes, names, strict=True):  # loading has named them anew
        shape.set_id(name)
    return part


def _check_integrator(integrator: Any) -> None:
    if integrator is None:
        raise Unsuitable("the scene names no integrator, so a path tracer renders it; the table kernel is for 'direct'")
    if integrator.class_name() != "DirectIntegrator":
        raise Unsuitable(
            f"the scene asks for Mitsuba's {integrator.class_name()}, which the table kernel (direct light only) is not"
        )


def _light(emitter: Any, mi: Any, colours: list[FloatArray]) -> Light:
    """The emitter as a light; its colour joins ``colours`` unless one of the same hue is there."""
    kind = emitter.class_name()
    parameters = mi.traverse(emitter)
    names = {
        "PointLight": ("point", "intensity.value"),
        "DirectionalEmitter": ("directional", "irradiance.value"),
        "ConstantBackgroundEmitter": ("constant", "radiance.value"),
    }
    if kind not in names or names[kind][1] not in parameters:
        raise Unsuitable(f"a light is a {kind}, not a point, directional or constant one of one colour")
    kind, name = names[kind]
    rgb = np.broadcast_to(np.array(parameters[name], np.float64).reshape(-1), (3,))
    strength = float(rgb.max())
    colour = rgb / strength if strength > 0 else np.ones(3)
    group = next((i for i, known in enumerate(colours) if np.allclose(known, colour, atol=1e-6)), len(colours))
    if group == len(colours):
        colours.append(colour)
    vector = np.zeros(3)
    if kind == "point":
        vector = np.array(parameters["position"], np.float64).reshape(3)
    elif kind == "directional":
        vector = np.array(parameters["to_world"].matrix, np.float64).reshape(4, 4)[:3, 2]
        vector = vector / np.linalg.norm(vector)
    return Light(kind, group, strength, vector, emitter.id())
