"""Makes triangles of spheres, disks and cylinders of radius 1, as fine as an outline asks for."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..scene.meshes import Mesh

FloatArray = npt.NDArray[np.float64]

OUTLINE_PX = 0.02
"""How far a polygon may lie from the outline that it stands for, pixels."""

MOST_TRIANGLES = 50_000
"""The most triangles of one round shape, or of one shape of curves."""

LEAST_SIDES, UNKNOWN_SIDES = 24, 128
"""The fewest sides around a shape, which keep its normals right; and the number where no path is known."""


class RoundMesh(NamedTuple):
    """Holds triangles in place of a round shape.

    Attributes:
        mesh: in the axes of the shape's transform.
        normals: (n, 3), outwards.
        off_px: how far its outline lies from the true one at most; NaN where no path is known.
    """

    mesh: Mesh
    normals: FloatArray
    off_px: float


def round_mesh(kind: str, radius_px: float | None, *, rings: int = 1) -> RoundMesh:
    """Make the triangles of a sphere, disk or cylinder of radius 1.

    Args:
        kind: ``sphere``, around the origin; ``disk``, in the plane z = 0, facing +z; or ``cylinder``, open, around the
            z axis from 0 to 1. Texture coordinates are Mitsuba's.
        radius_px: how many pixels the radius covers at most; None if that is not known.
        rings: of a disk.
    """
    most = {
        "sphere": int(np.sqrt(MOST_TRIANGLES)),
        "disk": MOST_TRIANGLES // (2 * rings),
        "cylinder": MOST_TRIANGLES // 2,
    }
    sides = UNKNOWN_SIDES
    # The middle of a side lies by 1 - cos(pi / sides), about pi^2 / (2 sides^2), below the circle through its ends.
    # Half of that lies on each side of the true circle. On a sphere, what both directions lose adds up.
    both = 2 if kind == "sphere" else 1
    if radius_px is not None:
        wanted = np.pi * np.sqrt(both * min(radius_px, 1e9) / (4 * OUTLINE_PX))
        sides = int(np.clip(2 * np.ceil(wanted / 2), LEAST_SIDES, most[kind] // 2 * 2))
    off = 1 - np.cos(np.pi / sides) ** both
    off_px = np.nan if radius_px is None else radius_px * off / (2 - off)
    wider = 2 / (2 - off)
    around = np.linspace(0.0, 2 * np.pi, sides + 1)
    cos, sin = np.cos(around), np.sin(around)
    cos[-1], sin[-1] = 1.0, 0.0
    if kind == "sphere":
        down = np.linspace(0.0, np.pi, sides // 2 + 1)[:, None]
        normals = np.stack([np.sin(down) * cos, np.sin(down) * sin, np.cos(down) + 0 * cos], -1)
        points = normals * wider
        u, v = np.broadcast_arrays(around / (2 * np.pi), down / np.pi)
    elif kind == "disk":
        out = np.linspace(0.0, 1.0, rings + 1)[:, None]
        points = np.stack([out * cos * wider, out * sin * wider, 0 * out * cos], -1)
        normals = np.broadcast_to(np.array([0.0, 0, 1]), points.shape)
        u, v = np.broadcast_arrays(out, around / (2 * np.pi))
    else:
        up = np.array([[0.0], [1.0]])
        normals = np.stack([cos + 0 * up, sin + 0 * up, 0 * up * cos], -1)
        points = np.stack([cos * wider + 0 * up, sin * wider + 0 * up, up + 0 * cos], -1)
        u, v = np.broadcast_arrays(around / (2 * np.pi), up)
    uv = np.stack([u, v], -1).astype(np.float64)
    # Where all directions meet, each triangle takes the one in its middle.
    if kind == "sphere":
        uv[0, :-1, 0] += 0.5 / sides
        uv[-1, 1:, 0] -= 0.5 / sides
    elif kind == "disk":
        uv[0, :-1, 1] += 0.5 / sides
    rows, columns = points.shape[:2]
    faces = grid_faces(rows, columns)
    if kind == "cylinder":
        faces = faces[:, ::-1]
    vertices = points.reshape(-1, 3)
    faces = faces[face_areas(vertices, faces) > 1e-12]
    return RoundMesh(Mesh(vertices, faces, uv.reshape(-1, 2)), normals.reshape(-1, 3), off_px)


def grid_faces(rows: int, columns: int) -> npt.NDArray[np.int64]:
    """Return two triangles (n, 3) for each cell of a grid of vertices, numbered row by row.

    Their normals are those of the cross product of the directions to the next row and to the next column.
    """
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (corner.ravel() for corner in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    return np.concatenate([np.stack([a, d, c], 1), np.stack([a, c, b], 1)])


def face_areas(vertices: FloatArray, faces: npt.NDArray[np.int64]) -> FloatArray:
    """Return twice the area of each triangle (n,)."""
    corners = vertices[faces]
    return np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
