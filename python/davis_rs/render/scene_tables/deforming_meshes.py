"""Gives the Rust core the meshes of a scene as they are deformed at an instant."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..._core import SceneRenderer
from ...geometry.trajectory.views import Views
from ...scene.deformation import Deformation, DeformedMesh
from ..mesh_buffers import MeshBuffers
from .mesh_triangles import MeshTriangles, flat_normal_maps

FloatArray = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class DeformingMesh:
    """Holds what does not change while the mesh of a shape deforms.

    Attributes:
        name: the shape's id.
        frame: its number in the core, 1, 2, ...
        first: the number of its first triangle.
        faces: (m, 3), the vertices of each triangle.
        uv: (m, 3, 2), texture coordinates of the corners, transformed as the texture says; None where it has one texel.
        side: -1 where the front is the side on which the corners run clockwise, else 1.
    """

    name: str
    frame: int
    first: int
    faces: npt.NDArray[np.uint32]
    uv: FloatArray | None
    side: float

    def triangles(self, mesh: DeformedMesh) -> MeshTriangles:
        """Return the triangles of the deformed mesh."""
        triangles = MeshTriangles(MeshBuffers(self.faces, mesh.positions, None, mesh.normals), uv=self.uv)
        triangles.replace_flat()
        return triangles


class _Form(NamedTuple):
    """Holds a mesh as it is at an instant; normal maps are None where it is flat."""

    triangles: MeshTriangles
    normal_maps: FloatArray | None


class DeformingMeshes:
    """Deforms the meshes of a core's scene; nobody else may use the core meanwhile.

    Args:
        core: with all triangles of the scene.
        meshes: those that deform; the others of the scene are rigid.
        deformations: by the meshes' names.
        planes: (n, 4), of all triangles.

    Attributes:
        planes: (n, 4), those of the last instant.
    """

    def __init__(
        self,
        core: SceneRenderer,
        meshes: Sequence[DeformingMesh],
        deformations: Mapping[str, Deformation],
        planes: FloatArray,
    ) -> None:
        self._core, self._deformations = core, deformations
        self._meshes = {mesh.frame: mesh for mesh in meshes}
        self.planes = planes.copy() if meshes else planes
        self._now: dict[int, _Form] = {}
        self._t_s = np.zeros(1)

    def __bool__(self) -> bool:
        """Return whether any mesh deforms."""
        return bool(self._meshes)

    def each(self, t_s: FloatArray) -> Iterator[int]:
        """Deform the meshes as they are at each of the times (n,), and yield its number."""
        every = [self._deformations[mesh.name].meshes(t_s) for mesh in self._meshes.values()]
        for number, deformed in enumerate(zip(*every, strict=True)):
            for mesh, form in zip(self._meshes.values(), deformed, strict=True):
                self._put(mesh, mesh.triangles(form))
            self._t_s = t_s[number : number + 1]
            yield number

    def deform(self, t_s: FloatArray) -> None:
        """Deform the meshes as they are at the one time (1,)."""
        for _ in self.each(t_s):
            pass

    def batches(self, views: Views, view: Indices) -> Iterator[tuple[Views, Indices, Indices]]:
        """Yield single pixels that see the meshes in the same form, deformed as they are then.

        Args:
            view: (m,) which of the views each pixel belongs to.

        Yields:
            Some of the views; of k pixels which of these they belong to (k,), and their rows (k,) in ``view``. Where no
            mesh deforms that is all at once, else one view after the other.
        """
        if not self or not len(view):
            yield views, view, np.arange(len(view))
            return
        seen = np.unique(view)
        for i in self.each(views.t_s[seen]):
            rows = np.flatnonzero(view == seen[i])
            yield views[int(seen[i]) : int(seen[i]) + 1], np.zeros_like(rows), rows

    def normal_maps(self, frame: int, triangle: Indices) -> FloatArray | None:
        """Return affine maps (m, 3, 4) to the shading normals of triangles (m,) of a mesh at the last instant; None
        for another object."""
        if frame not in self._meshes:
            return None
        maps = self._now[frame].normal_maps
        return (
            flat_normal_maps(self.planes[triangle, :3]) if maps is None else maps[triangle - self._meshes[frame].first]
        )

    def velocities(self, frame: int, triangle: Indices, points: FloatArray) -> FloatArray:
        """Return the velocities (m, 3) of points (m, 3) on triangles of a mesh, in its frame, at the last instant.

        Args:
            frame: the mesh's; others are rigid, and 0.
            triangle: (m,), numbers in the scene.
        """
        if frame not in self._meshes:
            return np.zeros_like(points)
        mesh = self._meshes[frame]
        (velocities,) = self._deformations[mesh.name].velocities(self._t_s)
        return self._at_points(frame, triangle, points, velocities)

    def followed(self, frame: int, triangle: Indices, points: FloatArray, later_s: FloatArray) -> FloatArray:
        """Return where points (m, 3) on triangles of a mesh at the last instant are at a later one (1,), in its
        frame."""
        if frame not in self._meshes:
            return points
        (form,) = self._deformations[self._meshes[frame].name].meshes(later_s)
        return self._at_points(frame, triangle, points, form.positions)

    def _at_points(self, frame: int, triangle: Indices, points: FloatArray, values: FloatArray) -> FloatArray:
        """Return values at points on triangles, given those at the mesh's vertices."""
        own = triangle - self._meshes[frame].first
        return self._now[frame].triangles.interpolated(own, points, values[self._meshes[frame].faces[own]])

    def _put(self, mesh: DeformingMesh, triangles: MeshTriangles) -> None:
        """Give the core the triangles of a mesh."""
        planes, none = triangles.planes() * mesh.side, np.zeros((triangles.count, 4))
        u, v = (none, none) if mesh.uv is None else triangles.texture_maps()
        normals = None if triangles.vertex_normals is None else triangles.normal_maps()[0] * mesh.side
        self._core.deform(
            mesh.frame,
            mesh.first,
            triangles.corners.ravel(),
            planes.ravel(),
            u.ravel(),
            v.ravel(),
            None if normals is None else normals.ravel(),
        )
        self.planes[mesh.first : mesh.first + triangles.count] = planes
        self._now[mesh.frame] = _Form(triangles, normals)
