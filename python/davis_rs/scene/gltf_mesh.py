"""The meshes of a glTF file as triangles.

Source: Khronos Group, glTF 2.0 Specification, section 3.7 (geometry).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..pose import FloatArray
from .gltf_file import GltfFile, plain
from .gltf_materials import GltfMaterials, Matte
from .mesh_part import MeshPart

MOST_TRIANGLES = 4_000_000
"""Of a scene: nodes may show one mesh many times, so a small file could ask for any number."""

_POINTS_AND_LINES = (0, 1, 2, 3)


class Primitive(NamedTuple):
    """Triangles of one material, in their node's own axes, uv as in the file (v downwards).

    Attributes:
        corners: (m, 3, 3).
        normals, colours: (m, 3, 3) or None.
        uv: (m, 3, 2) or None.
    """

    material: int | None
    corners: FloatArray
    normals: FloatArray | None
    uv: FloatArray | None
    colours: FloatArray | None

    def placed(self, matrix: FloatArray) -> Primitive:
        """Return the primitive as a transform (4, 4) places it."""
        linear = matrix[:3, :3]
        normals = self.normals
        if normals is not None:
            cofactor = np.stack([np.cross(linear[(i + 1) % 3], linear[(i + 2) % 3]) for i in range(3)])
            normals = normals @ cofactor.T * np.where(np.linalg.det(linear) < 0, -1.0, 1.0)
            length = np.linalg.norm(normals, axis=2, keepdims=True)
            normals = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)
        return self._replace(corners=self.corners @ linear.T + matrix[:3, 3], normals=normals)

    @property
    def kind(self) -> tuple[int | None, bool, bool]:
        """What primitives of one shape have in common."""
        return self.material, self.normals is not None, self.colours is not None


class GltfMeshes:
    """The meshes of a file, each read when it is asked for.

    Attributes:
        left_out: what of them is not taken.
    """

    def __init__(self, file: GltfFile, materials: GltfMaterials) -> None:
        self._file, self._materials = file, materials
        self._known: dict[int, list[Primitive]] = {}
        self._triangles = 0
        self.left_out: dict[str, None] = {}

    def of(self, node: Any, place: str) -> list[Primitive]:
        """The primitives of a node's mesh."""
        file, index = self._file, node.mesh
        mesh = file.item("meshes", index, f"{place}.mesh")
        if node.skin is not None:
            raise file.error(place, "has a skin (an armature's deformation), which is not read: apply it before export")
        weights = getattr(node, "weights", None) or mesh.weights or []
        if any(weights):
            raise file.error(f"meshes[{index}]", "is deformed by morph targets, which are not read: apply them")
        if index not in self._known:
            found = (
                self._primitive(primitive, f"meshes[{index}].primitives[{number}]")
                for number, primitive in enumerate(mesh.primitives or [])
            )
            self._known[index] = [primitive for primitive in found if primitive is not None]
        self._triangles += sum(len(primitive.corners) for primitive in self._known[index])
        if self._triangles > MOST_TRIANGLES:
            raise file.error(place, f"a scene may have {MOST_TRIANGLES} triangles, this one has more")
        return self._known[index]

    def _primitive(self, item: Any, place: str) -> Primitive | None:
        file = self._file
        mode = 4 if item.mode is None else file.whole(item.mode, f"{place}.mode", "of a kind of primitives", 6)
        if mode in _POINTS_AND_LINES:
            self.left_out["points and lines"] = None
            return None
        given = getattr(item.attributes, "__dict__", {})
        attributes = {name: value for name, value in given.items() if value is not None}
        if "POSITION" not in attributes:
            raise file.error(place, "has no POSITION")
        if item.targets:
            self.left_out["morph targets (their weights are 0)"] = None
        positions = self._attribute(attributes, "POSITION", place, (3,))
        assert positions is not None
        faces = self._faces(item, mode, len(positions), place)
        if len(faces) > MOST_TRIANGLES:
            raise file.error(place, f"a scene may have {MOST_TRIANGLES} triangles, this one has more")
        vertices = {
            "NORMAL": self._attribute(attributes, "NORMAL", place, (3,)),
            "COLOR_0": self._attribute(attributes, "COLOR_0", place, (3, 4)),
        }
        for name, values in vertices.items():
            if values is not None and len(values) != len(positions):
                raise file.error(place, f"has {len(values)} of {name} for {len(positions)} of POSITION")
        colours, normals = vertices["COLOR_0"], vertices["NORMAL"]
        if colours is not None:
            colours = np.clip(colours[:, :3], 0.0, 1.0)
            if (colours == 1).all():
                colours = None
        matte = self._materials[item.material]
        uv = self._uv(attributes, matte, len(positions), place)
        if colours is not None and uv is not None:
            self.left_out[f"colours of vertices on the texture of {matte.name}"] = None
            colours = None
        return Primitive(
            item.material,
            positions[faces],
            None if normals is None else normals[faces],
            None if uv is None else uv[faces],
            None if colours is None else colours[faces] * matte.factor,
        )

    def _uv(self, attributes: dict[str, Any], matte: Matte, count: int, place: str) -> FloatArray | None:
        """The texture coordinates that the material's texture takes, as it transforms them."""
        if matte.uv_set is None:
            return None
        name = f"TEXCOORD_{matte.uv_set}"
        uv = self._attribute(attributes, name, place, (2,))
        if uv is None or len(uv) != count:
            raise self._file.error(place, f"lacks the {name} that the texture of material {matte.name} needs")
        moved: FloatArray = uv @ matte.uv_transform[:, :2].T + matte.uv_transform[:, 2]
        return moved

    def _attribute(
        self, attributes: dict[str, Any], name: str, place: str, width: tuple[int, ...]
    ) -> FloatArray | None:
        if name not in attributes:
            return None
        return self._file.array(attributes[name], f"{place}: {name}", width=width).astype(np.float64)

    def _faces(self, item: Any, mode: int, count: int, place: str) -> npt.NDArray[np.int64]:
        if item.indices is None:
            order = np.arange(count)
        else:
            order = self._file.array(item.indices, f"{place}: indices", width=(1,)).ravel()
            if order.dtype.kind not in "iu":
                raise self._file.error(f"{place}: indices", "must be integers")
            if len(order) and not (order.min() >= 0 and order.max() < count):
                wrong = order[(order < 0) | (order >= count)][0]
                raise self._file.error(f"{place}: indices", f"name vertex {wrong} of {count}")
        if mode == 4:
            if len(order) % 3:
                raise self._file.error(place, f"{len(order)} corners make no whole number of triangles")
            return order.reshape(-1, 3)
        first = np.arange(max(0, len(order) - 2))
        if mode == 5:
            odd = first % 2
            return order[np.stack([first, first + 1 + odd, first + 2 - odd], 1)]
        return order[np.stack([0 * first, first + 1, first + 2], 1)]


def joined(primitives: list[Primitive], matte: Matte) -> MeshPart:
    """Primitives of one :attr:`Primitive.kind` as one part."""
    first = primitives[0]

    def together(name: str) -> FloatArray | None:
        parts = [getattr(primitive, name) for primitive in primitives]
        return None if parts[0] is None else np.concatenate(parts)

    corners, uv = together("corners"), together("uv")
    assert corners is not None
    return MeshPart(
        corners,
        None if uv is None else uv * [1, -1] + [0, 1],
        together("normals") if first.normals is not None else None,
        matte.reflectance,
        together("colours"),
        matte.name,
        matte.files,
        matte.wrap,
    )


def shown(names: dict[str, None]) -> str:
    """Names in a message: the first few."""
    listed = [plain(name)[1:-1] for name in names]
    return ", ".join(listed[:4]) + (f" and {len(listed) - 4} more" if len(listed) > 4 else "")
