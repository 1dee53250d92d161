"""Copies the buffers of a Mitsuba mesh into arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .._mitsuba.types import JitFloat, Mitsuba, MitsubaShape, MitsubaValue

FloatArray = npt.NDArray[np.float64]


_BUFFERS = ("vertex_positions", "vertex_normals", "vertex_texcoords")


def mesh_attributes(shape: MitsubaShape, mi: Mitsuba) -> list[tuple[str, MitsubaValue]]:
    """Return the names and values of what a mesh has at its vertices or faces besides :class:`MeshBuffers`."""
    return [
        (name, value)
        for name, value in mi.traverse(shape)
        if name.startswith(("vertex_", "face_")) and name not in _BUFFERS
    ]


class MeshBuffers(NamedTuple):
    """Holds the vertices of a mesh, their texture coordinates, and their normals where it is smooth."""

    faces: npt.NDArray[np.uint32]
    positions: FloatArray
    texcoords: FloatArray | None
    normals: FloatArray | None

    @classmethod
    def of(cls, shape: MitsubaShape) -> MeshBuffers:
        """Copy the buffers of a Mitsuba mesh."""

        def values(buffer: JitFloat, width: int) -> FloatArray:
            return np.array(buffer, np.float64).reshape(-1, width)

        smooth = shape.has_vertex_normals() and "face_normals = 0" in str(shape)
        return cls(
            np.array(shape.faces_buffer()).reshape(-1, 3),
            values(shape.vertex_positions_buffer(), 3),
            values(shape.vertex_texcoords_buffer(), 2) if shape.has_vertex_texcoords() else None,
            values(shape.vertex_normals_buffer(), 3) if smooth else None,
        )
