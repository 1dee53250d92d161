"""Takes the triangles of a Mitsuba mesh: planes, and affine maps of a point to texture coordinates and normals."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..._mitsuba.types import JitFloat, Mitsuba, MitsubaShape

FloatArray = npt.NDArray[np.float64]


class MeshTriangles:
    """The triangles of a mesh, in float64.

    Attributes:
        corners: (n, 3, 3), metres.
        faces: (n, 3), the vertices of each.
        uv: (n, 3, 2), texture coordinates of the corners; None where the mesh has none.
        count: n.
    """

    def __init__(self, shape: MitsubaShape) -> None:
        self.shape = shape
        faces = np.array(shape.faces_buffer()).reshape(-1, 3)
        self.faces = faces.astype(np.int64)
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
    def _per_corner(buffer: JitFloat, faces: npt.NDArray[np.uint32], width: int) -> FloatArray:
        return np.array(buffer, np.float64).reshape(-1, width)[faces]

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
        if self.uv is None:
            # Without texture coordinates Mitsuba takes the barycentric ones.
            barycentric = np.broadcast_to(np.array([[0.0, 1, 0], [0, 0, 1]]), (self.count, 2, 3))
            return self.affine(barycentric[:, 0]), self.affine(barycentric[:, 1])
        return self.affine(self.uv[..., 0]), self.affine(self.uv[..., 1])

    def normal_maps(self) -> tuple[FloatArray, bool]:
        """Return affine maps (n, 3, 4) of a point to the shading normal, and whether any triangle's normals vary."""
        flat = np.zeros((self.count, 3, 4))
        flat[..., 3] = self.normals
        if self.vertex_normals is None:
            return flat, False
        maps = np.stack([self.affine(self.vertex_normals[..., axis]) for axis in range(3)], 1)
        differs = np.abs(self.vertex_normals - self.normals[:, None]).max() > 1e-5
        return maps, bool(differs)

    def turned(self, normal_maps: FloatArray, mi: Mitsuba) -> float:
        """Return -1 where Mitsuba's normals are the opposite (flipped, or a mirrored rectangle), else 1.

        All triangles of a mesh are turned alike, so the first one that has an area decides.
        """
        facing = np.flatnonzero(self.normals.any(1))
        if not len(facing):
            return 1.0
        number = int(facing[0])
        centre = mi.PreliminaryIntersection3f()
        centre.t, centre.prim_index, centre.prim_uv = 1.0, number, mi.Point2f(1 / 3)
        ray = mi.Ray3f(mi.Point3f(0), mi.Vector3f(0, 0, 1))
        theirs = np.array(self.shape.compute_surface_interaction(ray, centre).sh_frame.n, np.float64).reshape(3)
        ours = normal_maps[number, :, :3] @ self.corners[number].mean(0) + normal_maps[number, :, 3]
        return -1.0 if ours @ theirs < 0 else 1.0
