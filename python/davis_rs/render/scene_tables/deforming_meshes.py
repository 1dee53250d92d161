"""Gives the Rust core the meshes of a scene as they are deformed at an instant."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..._core import SceneRenderer
from ...scene.deformation import Deformation, DeformedMesh
from ..mesh_buffers import MeshBuffers
from .mesh_triangles import MeshTriangles

FloatArray = npt.NDArray[np.float64]


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
        return triangles.with_area()

    def put(self, core: SceneRenderer, triangles: MeshTriangles) -> FloatArray:
        """Give the core the triangles, and return their planes (m, 4)."""
        planes = triangles.planes() * self.side
        none = np.zeros((triangles.count, 4))
        u, v = (none, none) if self.uv is None else triangles.texture_maps()
        normals = None if triangles.vertex_normals is None else triangles.normal_maps()[0] * self.side
        core.deform(
            self.frame,
            self.first,
            triangles.corners.ravel(),
            planes.ravel(),
            u.ravel(),
            v.ravel(),
            None if normals is None else normals.ravel(),
        )
        return planes


class DeformingMeshes:
    """Deforms the meshes of a core's scene; nobody else may use the core meanwhile.

    Args:
        core: with all triangles of the scene.
        meshes: those that deform.
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
        self._core, self._meshes, self._deformations = core, meshes, deformations
        self.planes = planes.copy() if meshes else planes
        self._now: dict[int, MeshTriangles] = {}

    def __bool__(self) -> bool:
        return bool(self._meshes)

    def each(self, t_s: FloatArray) -> Iterator[int]:
        """Deform the meshes as they are at each of the times (n,), and yield its number."""
        every = [self._deformations[mesh.name].meshes(t_s) for mesh in self._meshes]
        for number, deformed in enumerate(zip(*every, strict=True)):
            for mesh, form in zip(self._meshes, deformed, strict=True):
                triangles = mesh.triangles(form)
                self.planes[mesh.first : mesh.first + triangles.count] = mesh.put(self._core, triangles)
                self._now[mesh.frame] = triangles
            yield number

    def normal_maps(self, frame: int, triangle: npt.NDArray[np.int64]) -> FloatArray | None:
        """Return affine maps (m, 3, 4) to the shading normals of triangles (m,) of a mesh at the last instant; None
        for another object."""
        mesh = self._mesh(frame)
        return None if mesh is None else self._now[frame].normal_maps()[0][triangle - mesh.first]

    def velocities(self, frame: int, triangle: npt.NDArray[np.int64], points: FloatArray, t_s: float) -> FloatArray:
        """Return the velocities (m, 3) of points (m, 3) on triangles of a mesh, in its frame, at the last instant.

        Args:
            frame: the mesh's; 0 for those of other objects.
            triangle: (m,), numbers in the scene.
            t_s: the instant.
        """
        mesh = self._mesh(frame)
        if mesh is None or not len(triangle):
            return np.zeros_like(points)
        (velocities,) = self._deformations[mesh.name].velocities(np.array([t_s]))
        return self._now[frame].interpolated(
            triangle - mesh.first, points, velocities[mesh.faces[triangle - mesh.first]]
        )

    def followed(self, frame: int, triangle: npt.NDArray[np.int64], points: FloatArray, later_s: float) -> FloatArray:
        """Return where points (m, 3) on triangles of a mesh at the last instant are at a later one, in its frame."""
        mesh = self._mesh(frame)
        if mesh is None or not len(triangle):
            return points
        (form,) = self._deformations[mesh.name].meshes(np.array([later_s]))
        own = triangle - mesh.first
        return self._now[frame].interpolated(own, points, form.positions[mesh.faces[own]])

    def _mesh(self, frame: int) -> DeformingMesh | None:
        return next((mesh for mesh in self._meshes if mesh.frame == frame), None)
