"""Reads the meshes of a glTF file as triangles.

Source: Khronos Group, glTF 2.0 Specification, section 3.7 (geometry).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...geometry.pose import FloatArray
from ..lost_looks import BRUSHED, BUMPS, TRANSPARENCY
from ..mesh_part import MeshPart, charge_triangles, unit_normals
from ..repairs import Repairs
from ..texture_file import EncodedTexture
from .gltf_file import DRACO, GltfFile, Item, plain
from .gltf_materials import GltfMaterial, GltfMaterials
from .rounding import ROUNDING, within
from .triangulation import cut_strip, distinct, has_area

MOST_TRIANGLES = 4_000_000
"""The most triangles of a scene. Nodes may show one mesh many times, so a small file could ask for any number."""

_SUM_OFF = 0.05
"""By how much the sum of a vertex's weights may differ from 1: a few numbers of 8 bits."""

_MORPHED = ("POSITION", "NORMAL")
"""What morph targets move; nothing here depends on tangents."""

_WITHOUT_SURFACE = {0: "points", 1: "lines", 2: "lines", 3: "lines"}
COLOURS_LOST = "different colours of vertices"
_COLOURS_CUT = "colours of vertices beyond 0 to 1 (they are cut there)"


class Vertices(NamedTuple):
    """Holds the vertices of triangles that deform, in their node's own axes.

    Attributes:
        faces: (m, 3), the vertices of each triangle.
        positions: (u, 3).
        normals: (u, 3), unit; None without.
        joints: (u, k), numbers of joints of the skin.
        weights: (u, k), of the joints, with a sum of 1.
        targets: (T, u, 3), displacements of the morph targets.
        target_normals: (T, u, 3).
    """

    faces: npt.NDArray[np.int64]
    positions: FloatArray
    normals: FloatArray | None
    joints: npt.NDArray[np.int64]
    weights: FloatArray
    targets: FloatArray
    target_normals: FloatArray


PrimitiveKind = tuple[int | None, bool, bool, tuple[float, ...] | None]
"""Material, whether there are normals, whether there are colours, and the tint."""


class Primitive(NamedTuple):
    """Holds triangles of one material, in their node's own axes, uv as in the file (v downwards).

    Attributes:
        corners: (m, 3, 3).
        normals, colours: (m, 3, 3) or None.
        uv: (m, 3, 2) or None.
        tint: (3,), the colour of all its vertices where that is one; None for white, or with ``colours``.
        lost: the kinds of their looks that are not shown, besides those of the material.
        vertices: of triangles that were read to be deformed; None else.
    """

    material: int | None
    corners: FloatArray
    normals: FloatArray | None
    uv: FloatArray | None
    colours: FloatArray | None
    tint: FloatArray | None = None
    lost: tuple[str, ...] = ()
    vertices: Vertices | None = None

    def placed(self, matrices: FloatArray) -> Primitive:
        """Return k copies of the primitive, one for each of the transforms (k, 4, 4).

        The corners of mirrored copies are reversed, so that they run counterclockwise on the same side as before.
        """
        linear, offset = matrices[:, :3, :3], matrices[:, None, :3, 3]
        mirrored = np.linalg.det(linear) < 0
        shape = len(matrices), *self.corners.shape[:2]

        def each(values: FloatArray) -> FloatArray:
            """Return values at the corners of all copies, (k m, 3, ...), from those of each copy or of one for all."""
            values = np.broadcast_to(values.reshape(-1, *shape[1:], values.shape[-1]), (*shape, values.shape[-1]))
            turned = np.where(mirrored[:, None, None, None], values[:, :, ::-1], values)
            return turned.reshape(-1, 3, values.shape[-1])

        normals = self.normals
        if normals is not None:
            rows = [np.cross(linear[:, (i + 1) % 3], linear[:, (i + 2) % 3]) for i in range(3)]
            cofactor = np.stack(rows, 1) * np.where(mirrored, -1.0, 1.0)[:, None, None]
            normals = each(normals.reshape(-1, 3) @ cofactor.swapaxes(1, 2))
            length = np.linalg.norm(normals, axis=2, keepdims=True)
            normals = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)
        return self._replace(
            corners=each(self.corners.reshape(-1, 3) @ linear.swapaxes(1, 2) + offset),
            normals=normals,
            uv=None if self.uv is None else each(self.uv),
            colours=None if self.colours is None else each(self.colours),
        )

    @property
    def kind(self) -> PrimitiveKind:
        """Return what primitives of one shape have in common."""
        tint = None if self.tint is None else tuple(self.tint.tolist())
        return self.material, self.normals is not None, self.colours is not None, tint


class GltfMeshes:
    """Reads the meshes of a file, each on first use."""

    def __init__(self, file: GltfFile, materials: GltfMaterials, repairs: Repairs) -> None:
        self._file, self._materials, self._repairs = file, materials, repairs
        self._known: dict[int, list[Primitive]] = {}
        self._triangles = 0

    def of(self, node: Item, where: str, count: int = 1) -> list[Primitive]:
        """Return the primitives of a node's mesh, which it shows ``count`` times."""
        file, index = self._file, node.mesh
        if index not in self._known:
            self._known[index] = self._read(node, where)
        each = sum(len(primitive.corners) for primitive in self._known[index])
        charge_triangles(file.budget, count * each, 2 * (3 + 3 + 2 + 3), f"{where}: {count} of its mesh")
        self._count(count * each, where)
        return self._known[index]

    def deforming(self, node: Item, where: str, joints: int) -> list[Primitive]:
        """Return the primitives of a node's mesh with their vertices and morph targets, and how so many joints of a
        skin move them; without a skin there are none."""
        primitives = self._read(node, where, joints)
        counts = {len(primitive.vertices.targets) for primitive in primitives if primitive.vertices is not None}
        if len(counts) > 1:
            got = " and ".join(map(str, sorted(counts)))
            raise self._file.error(where, f"all parts of its mesh must have as many morph targets, got {got}")
        self._count(sum(len(primitive.corners) for primitive in primitives), where)
        return primitives

    def _count(self, triangles: int, where: str) -> None:
        self._triangles += triangles
        if self._triangles > MOST_TRIANGLES:
            has = f"this one has {self._triangles} or more"
            raise self._file.error(where, f"a scene may have {MOST_TRIANGLES} triangles with all copies, {has}")

    def morph_strengths(self, node: Item, where: str) -> FloatArray:
        """Return the strengths (T,) of a node's morph targets at rest.

        Raises:
            DecodeError: for another number of them than the mesh has targets.
        """
        mesh = self._file.item("meshes", node.mesh, f"{where}.mesh")
        parts: list[Item] = [part for part in mesh.primitives or [] if isinstance(part, Item)]
        count = max((len(part.targets or []) for part in parts), default=0)
        given = node.weights or mesh.weights or []
        strengths = self._file.numbers(given, f"{where}: weights", len(given) if isinstance(given, list) else count)
        if not (np.abs(strengths) > ROUNDING).any():
            return np.zeros(count)
        if len(strengths) != count:
            raise self._file.error(where, f"has strengths of {len(strengths)} morph targets, and its mesh has {count}")
        return strengths

    def _read(self, node: Item, where: str, joints: int | None = None) -> list[Primitive]:
        """Read a node's mesh; its vertices too where it deforms, by so many joints."""
        mesh = self._file.item("meshes", node.mesh, f"{where}.mesh")
        given_parts = mesh.primitives or []
        if not isinstance(given_parts, list):
            raise self._file.error(f"meshes[{node.mesh}].primitives", f"must be a list, got {plain(given_parts)}")
        named = {f"meshes[{node.mesh}].primitives[{i}]": given for i, given in enumerate(given_parts)}
        for name, given in named.items():
            if not isinstance(given, Item):
                raise self._file.error(name, f"must be an object, got {plain(given)}")
        read = (self._primitive(given, name, joints) for name, given in named.items() if self._has_surface(given, name))
        return [primitive for primitive in read if len(primitive.corners)]

    def _mode(self, item: Item, where: str) -> int:
        return 4 if item.mode is None else self._file.whole(item.mode, f"{where}.mode", "of a kind of primitives", 6)

    def _has_surface(self, item: Item, where: str) -> bool:
        """Return whether there is something to see, and note points and lines, which are left out."""
        primitives = _WITHOUT_SURFACE.get(self._mode(item, where))
        if primitives is not None:
            self._repairs.add(f"parts made of {primitives}, which have no surface, left out", 1, where)
        return primitives is None

    def _primitive(self, item: Item, where: str, joints: int | None) -> Primitive:
        file = self._file
        file.budget.check_time("reading its meshes")
        mode = self._mode(item, where)
        given = item.attributes if isinstance(item.attributes, dict) else {}
        attributes = {name: value for name, value in given.items() if value is not None}
        if "POSITION" not in attributes:
            raise file.error(where, "has no POSITION")
        packed = (item.extensions or {}).get(DRACO)
        if packed is not None and file.unbacked(attributes["POSITION"], where):
            accessors = attributes if item.indices is None else {**attributes, "indices": item.indices}
            as_said = file.unpack_draco(packed, accessors, where)
            note = "parts have more or fewer vertices or triangles in Draco's data than the file says: the data decide"
            self._repairs.add(note, int(not as_said), where)
        positions = self._attribute(attributes, "POSITION", where, (3,))
        assert positions is not None
        faces = self._faces(item, mode, len(positions), where)
        file.budget.count(len(faces), "triangles")
        whole = has_area(positions[faces])
        self._repairs.add("triangles without area are left out", int((~whole).sum()), where)
        faces = faces[whole]
        material = self._materials[item.material]
        if material.hidden:
            self._repairs.add("triangles that the alpha of their material hides are left out", len(faces), where)
            faces = faces[:0]
        if len(faces) > MOST_TRIANGLES:
            raise file.error(where, f"a scene may have {MOST_TRIANGLES} triangles, this one has more")
        vertices = {
            "NORMAL": self._attribute(attributes, "NORMAL", where, (3,), finite=False),
            "COLOR_0": self._attribute(attributes, "COLOR_0", where, (3, 4)),
        }
        for name, values in vertices.items():
            if values is not None and len(values) != len(positions):
                raise file.error(where, f"has {len(values)} of {name} for {len(positions)} of POSITION")
        charge_triangles(file.budget, len(faces), 3 + 3 + 2 + 3, where)
        corners, normals = positions[faces], vertices["NORMAL"]
        uv = self._uv(attributes, material, len(positions), where)
        colours, tint, lost = self._colours(vertices["COLOR_0"], material)
        return Primitive(
            item.material,
            corners,
            None if normals is None else unit_normals(normals[faces], corners, where, self._repairs),
            None if uv is None else uv[faces],
            None if colours is None else colours[faces] * (1.0 if material.is_textured else material.factor),
            tint,
            lost,
            None if joints is None else self._vertices(item, attributes, (faces, positions, normals), joints, where),
        )

    def _vertices(
        self,
        item: Item,
        attributes: dict[str, object],
        mesh: tuple[npt.NDArray[np.int64], FloatArray, FloatArray | None],
        joint_count: int,
        where: str,
    ) -> Vertices:
        """Return vertices with what deforms them; without joints all follow joint 0."""
        file, (faces, positions, normals) = self._file, mesh
        count = len(positions)
        joints, weights = np.zeros((count, 1), np.int64), np.ones((count, 1))
        if joint_count:
            sets = sorted(name.removeprefix("JOINTS_") for name in attributes if name.startswith("JOINTS_"))
            if not sets:
                raise file.error(where, "is shown with a skin, so it must have JOINTS_0 and WEIGHTS_0")
            parts = [self._influences(attributes, number, count, joint_count, where) for number in sets]
            joints, weights = (np.concatenate(together, 1) for together in zip(*parts, strict=True))
            total = weights.sum(1, keepdims=True)
            lost = (total <= 0)[:, 0]
            self._repairs.add("vertices without a joint follow the skin's first one", int(lost.sum()), where)
            joints[lost], weights[lost, 0], total[lost] = 0, 1.0, 1.0
            off = int((np.abs(total - 1) > _SUM_OFF).sum())
            self._repairs.add("vertices whose joints' weights do not add up to 1 have them scaled", off, where)
            weights = weights / total
        moved = item.targets or []
        if not isinstance(moved, list) or not all(isinstance(target, dict) for target in moved):
            raise file.error(f"{where}.targets", "must be a list of objects")
        file.budget.take(2 * 3 * 8 * count * len(moved), f"{where}: {len(moved)} morph targets")
        targets = np.zeros((2, len(moved), count, 3))
        for number, target in enumerate(moved):
            others = sorted(name for name in map(str, target) if name not in (*_MORPHED, "TANGENT"))
            self._repairs.add(f"morph targets of {' and '.join(others)}, which are left out", bool(others), where)
            for kind, name in enumerate(_MORPHED):
                values = self._attribute({**target}, name, f"{where}.targets[{number}]", (3,))
                if values is None:
                    continue
                if len(values) != count:
                    rule = f"has {len(values)} of {name} for {count} of POSITION"
                    raise file.error(f"{where}.targets[{number}]", rule)
                targets[kind, number] = values
        if normals is not None:
            normals = _unit_at_vertices(normals, positions, faces)
        return Vertices(faces, positions, normals, joints, weights, *targets)

    def _influences(
        self, attributes: dict[str, object], number: str, count: int, joint_count: int, where: str
    ) -> tuple[npt.NDArray[np.int64], FloatArray]:
        """Return the joints (u, 4) of a set, and their weights."""
        joints = self._file.array(attributes[f"JOINTS_{number}"], f"{where}: JOINTS_{number}", width=(4,))
        weights = self._attribute(attributes, f"WEIGHTS_{number}", where, (4,))
        if weights is None or len(weights) != count or len(joints) != count:
            raise self._file.error(where, f"must have as many of JOINTS_{number} and WEIGHTS_{number} as of POSITION")
        if joints.dtype.kind not in "iu":
            raise self._file.error(f"{where}: JOINTS_{number}", "must be integers")
        weights = np.array(weights)
        if (weights < -ROUNDING).any():
            raise self._file.error(f"{where}: WEIGHTS_{number}", f"must not be negative, got {weights.min():g}")
        weights = np.maximum(weights, 0.0)
        joints = np.where(weights > 0, joints, 0).astype(np.int64)  # what has no weight may name any joint
        if count and not (joints.min() >= 0 and joints.max() < joint_count):
            raise self._file.error(f"{where}: JOINTS_{number}", f"name joint {joints.max()} of {joint_count}")
        return joints, weights

    def _colours(
        self, given: FloatArray | None, material: GltfMaterial
    ) -> tuple[FloatArray | None, FloatArray | None, tuple[str, ...]]:
        """Return the colours of vertices (v, 3), or the one of all of them (3,), each None where it is not shown; and
        the kinds of looks that are lost."""
        if given is None:
            return None, None, ()
        lost = []
        colours = np.clip(given[:, :3], 0.0, 1.0)
        if within(given[:, :3], 0.0, 1.0) is None:
            lost.append(_COLOURS_CUT)
        if material.transparent and (given[:, 3:] < 1 - ROUNDING).any():
            lost.append(TRANSPARENCY)
        if (colours >= 1 - ROUNDING).all():
            return None, None, tuple(lost)
        if (np.ptp(colours, 0) <= ROUNDING).all():
            return None, colours[0], tuple(lost)
        if not material.is_paintable:
            return None, None, (*lost, COLOURS_LOST)
        return colours, None, tuple(lost)

    def _uv(self, attributes: dict[str, object], material: GltfMaterial, count: int, where: str) -> FloatArray | None:
        """Return the texture coordinates for the material's texture, transformed as the material says."""
        if material.uv_set is None:
            return None
        name = f"TEXCOORD_{material.uv_set}"
        uv = self._attribute(attributes, name, where, (2,))
        if uv is None and not material.looks_up:
            return None
        if uv is None or len(uv) != count:
            raise self._file.error(where, f"lacks the {name} that the texture of material {material.name} needs")
        moved: FloatArray = uv @ material.uv_transform[:, :2].T + material.uv_transform[:, 2]
        return moved

    def _attribute(
        self, attributes: dict[str, object], name: str, where: str, width: tuple[int, ...], *, finite: bool = True
    ) -> FloatArray | None:
        if name not in attributes:
            return None
        values = self._file.array(attributes[name], f"{where}: {name}", width=width, finite=finite)
        return np.asarray(values, np.float64)

    def _faces(self, item: Item, mode: int, count: int, where: str) -> npt.NDArray[np.int64]:
        """Return the vertices (m, 3) of triangles that are given as a list, a strip or a fan."""
        if item.indices is None:
            order = np.arange(count)
        else:
            values = self._file.array(item.indices, f"{where}: indices", width=(1,)).ravel()
            if values.dtype.kind not in "iu":
                raise self._file.error(f"{where}: indices", "must be integers")
            order = values.astype(np.int64, copy=False)
            if len(order) and not (order.min() >= 0 and order.max() < count):
                wrong = order[(order < 0) | (order >= count)][0]
                raise self._file.error(f"{where}: indices", f"name vertex {wrong} of {count}")
        if mode == 4:
            if len(order) % 3:
                raise self._file.error(where, f"{len(order)} corners make no whole number of triangles")
            return order.reshape(-1, 3)
        if mode == 5:
            return cut_strip(order)
        first = np.arange(max(0, len(order) - 2))
        return distinct(order[np.stack([0 * first, first + 1, first + 2], 1)])


def _unit_at_vertices(normals: FloatArray, positions: FloatArray, faces: npt.NDArray[np.int64]) -> FloatArray:
    """Return normals (u, 3) of unit length; one without a direction becomes the mean of its triangles' normals."""
    corners = positions[faces]
    around = np.zeros_like(positions)
    np.add.at(around, faces, np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, None])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    chosen = np.where((length > 0) & (length < np.inf), normals, around)  # False for NaN too
    length = np.linalg.norm(chosen, axis=1, keepdims=True)
    return np.divide(chosen, length, out=np.zeros_like(chosen), where=length > 0)


def joined_vertices(primitives: list[Primitive]) -> Vertices:
    """Join the vertices of primitives that deform, and are of one :attr:`Primitive.kind`."""
    parts = [primitive.vertices for primitive in primitives if primitive.vertices is not None]
    assert len(parts) == len(primitives)
    first = np.cumsum([0, *(len(part.positions) for part in parts[:-1])])
    width = max(part.joints.shape[1] for part in parts)

    def padded(values: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
        return np.pad(values, ((0, 0), (0, width - values.shape[1])))

    normals = None
    if parts[0].normals is not None:
        normals = np.concatenate([part.normals for part in parts if part.normals is not None])
    return Vertices(
        np.concatenate([part.faces + start for part, start in zip(parts, first, strict=True)]),
        np.concatenate([part.positions for part in parts]),
        normals,
        np.concatenate([padded(part.joints) for part in parts]).astype(np.int64),
        np.concatenate([padded(part.weights) for part in parts]).astype(np.float64),
        np.concatenate([part.targets for part in parts], 1),
        np.concatenate([part.target_normals for part in parts], 1),
    )


def joined(primitives: list[Primitive], material: GltfMaterial) -> MeshPart:
    """Join primitives of one :attr:`Primitive.kind` to one part."""
    first = primitives[0]

    def together(name: str) -> FloatArray | None:
        arrays = [getattr(primitive, name) for primitive in primitives]
        return None if arrays[0] is None else np.concatenate(arrays)

    corners, uv, colours = together("corners"), together("uv"), together("colours")
    assert corners is not None
    lost = [*material.lost, *(what for primitive in primitives for what in primitive.lost)]
    reflectance, glass = material.reflectance, material.glass
    if first.tint is not None:
        if isinstance(reflectance, EncodedTexture):
            reflectance = reflectance.tinted(reflectance.tint * first.tint)
        else:
            reflectance = reflectance * first.tint
        glass = None if glass is None else glass._replace(tint=glass.tint * first.tint)
    normal_texture = material.normal_texture
    if normal_texture is not None and uv is None:
        normal_texture = None  # it has no tangents
        lost.append(BUMPS)
    metal = material.metal
    if metal is not None and metal.anisotropic != 0 and (uv is None or colours is not None):
        # Colours of vertices take texture coordinates of their own.
        metal = metal._replace(anisotropic=0.0)
        lost.append(BRUSHED)
    return MeshPart(
        corners,
        None if uv is None else uv * [1, -1] + [0, 1],
        together("normals") if first.normals is not None else None,
        reflectance,
        colours,
        material.name,
        material.files,
        material.wrap,
        tuple(dict.fromkeys(lost)),
        metal,
        material.nearest,
        material.emission,
        material.unlit,
        material.blend,
        glass,
        material.one_sided,
        normal_texture,
    )
