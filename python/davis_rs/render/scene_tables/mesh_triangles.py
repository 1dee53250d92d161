"""Takes the triangles of a Mitsuba mesh: planes, and affine maps of a point to texture coordinates and normals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from ..._mitsuba.types import Mitsuba, MitsubaShape
from ..mesh_buffers import MeshBuffers

FloatArray = npt.NDArray[np.float64]

_SHRUNK = 1e-7
"""The size of a triangle that stands for one without an area, as a fraction of its largest coordinate."""

_PART = 1 << 14
"""Triangles of a part of a mesh: what is computed of so many stays in the processor's caches."""


class MeshTriangles:
    """The triangles of a mesh, or some of them, in float64.

    Args:
        buffers: of the mesh.
        part: of its triangles.
        uv: (n, 3, 2), texture coordinates of the corners in place of the mesh's own.

    Attributes:
        corners: (n, 3, 3), metres.
        faces: (n, 3), the vertices of each.
        uv: (n, 3, 2), texture coordinates of the corners; None where the mesh has none.
        count: n.
    """

    def __init__(self, buffers: MeshBuffers, part: slice = slice(None), uv: FloatArray | None = None) -> None:
        self.first, self.faces = part.start or 0, buffers.faces[part]
        self.uv = None if buffers.texcoords is None else buffers.texcoords[self.faces]
        self.uv = self.uv if uv is None else uv
        self.vertex_normals = None if buffers.normals is None else buffers.normals[self.faces]
        self.count = len(self.faces)
        self._set_corners(buffers.positions[self.faces])

    def _set_corners(self, corners: FloatArray) -> None:
        self.corners = corners
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

    @classmethod
    def parts(cls, shape: MitsubaShape, uv: FloatArray | None = None) -> Iterator[MeshTriangles]:
        """Yield the triangles of the mesh a part at a time, in their order, because millions at once take gigabytes.

        Args:
            uv: (n, 3, 2), texture coordinates of the corners in place of the mesh's own.
        """
        buffers = MeshBuffers.of(shape)
        for first in range(0, len(buffers.faces), _PART):
            rows = slice(first, first + _PART)
            yield cls(buffers, rows, None if uv is None else uv[rows])

    def replace_flat(self) -> None:
        """Replace triangles without an area by ones too small to be seen.

        The core leaves out what has no area; of a mesh that deforms it keeps all triangles, because each may get one.
        """
        flat = ~self.normals.any(1)
        if flat.any():
            corners = self.corners.copy()
            at = corners[flat, 0]
            size = _SHRUNK * np.maximum(np.abs(at).max(1), 1e-3)[:, None]
            corners[flat] = np.stack([at, at + size * [1, 0, 0], at + size * [0, 1, 0]], 1)
            self._set_corners(corners)

    def interpolated(self, triangle: npt.NDArray[np.int64], points: FloatArray, values: FloatArray) -> FloatArray:
        """Return values (m, 3) at points (m, 3) on triangles (m,), given those at their corners (m, 3, 3)."""
        along = np.einsum("mij,mj->mi", self.gradients[triangle], points - self.corners[triangle, 0])
        return np.asarray(values[:, 0] + np.einsum("mi,mij->mj", along, values[:, 1:] - values[:, :1]))

    def planes(self) -> FloatArray:
        """Return the planes (n, 4): unit normal and offset, normal . p + offset = 0."""
        offsets = -np.einsum("ij,ij->i", self.normals, self.corners[:, 0])
        return np.concatenate([self.normals, offsets[:, None]], 1)

    def affine(self, values: FloatArray) -> FloatArray:
        """Return the affine maps (n, 4) of a point that have the values (n, 3) at each triangle's corners."""
        slopes = np.einsum("ij,ijk->ik", values[:, 1:] - values[:, :1], self.gradients)
        offsets = values[:, 0] - np.einsum("ij,ij->i", slopes, self.corners[:, 0])
        return np.concatenate([slopes, offsets[:, None]], 1)

    def texture_maps(self) -> tuple[FloatArray, FloatArray]:
        """Return affine maps (n, 4) of a point to the texture coordinates u and v."""
        uv = self.corner_uv()
        return self.affine(uv[..., 0]), self.affine(uv[..., 1])

    def corner_uv(self) -> FloatArray:
        """Return the texture coordinates (n, 3, 2) of the corners; without any, as Mitsuba does, the barycentric
        ones."""
        if self.uv is not None:
            return self.uv
        return np.broadcast_to(np.array([[0.0, 0], [1, 0], [0, 1]]), (self.count, 3, 2))

    def normal_maps(self) -> tuple[FloatArray, bool]:
        """Return affine maps (n, 3, 4) of a point to the shading normal, and whether any triangle's normals vary."""
        if self.vertex_normals is None:
            return flat_normal_maps(self.normals), False
        maps = np.stack([self.affine(self.vertex_normals[..., axis]) for axis in range(3)], 1)
        differs = np.abs(self.vertex_normals - self.normals[:, None]).max(initial=0.0) > 1e-5
        return maps, bool(differs)

    def is_turned(self, shape: MitsubaShape, mi: Mitsuba) -> bool | None:
        """Return whether Mitsuba's normals are the opposite (flipped, or a mirrored rectangle); None without an area.

        All triangles of a mesh are turned alike, so the first one that has an area decides.
        """
        facing = np.flatnonzero(self.normals.any(1))
        if not len(facing):
            return None
        number = int(facing[0])
        centre = mi.PreliminaryIntersection3f()
        centre.t, centre.prim_index, centre.prim_uv = 1.0, self.first + number, mi.Point2f(1 / 3)
        ray = mi.Ray3f(mi.Point3f(0), mi.Vector3f(0, 0, 1))
        theirs = np.array(shape.compute_surface_interaction(ray, centre).sh_frame.n, np.float64).reshape(3)
        map_of = self.normal_maps()[0][number]
        ours = map_of[:, :3] @ self.corners[number].mean(0) + map_of[:, 3]
        return bool(ours @ theirs < 0)


def triangles_of_shapes(counts: Sequence[int], numbers: Sequence[int]) -> npt.NDArray[np.uint32] | None:
    """Return 1 for each triangle (t) of some shapes, else 0; None where there is none.

    Args:
        counts: how many triangles each shape has.
        numbers: of these shapes.
    """
    if not len(numbers):
        return None
    return np.repeat(np.isin(np.arange(len(counts)), numbers).astype(np.uint32), counts)


def flat_normal_maps(normals: FloatArray) -> FloatArray:
    """Return maps (n, 3, 4) of normals (n, 3) that are the same all over a triangle."""
    maps = np.zeros((len(normals), 3, 4))
    maps[..., 3] = normals
    return maps
