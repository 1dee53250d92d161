"""Writes PLY meshes anew that Mitsuba 3 refuses or shows black, for as long as it loads them.

It refuses faces with another list than that of their vertices, as MeshLab writes texture coordinates of corners, and
faces with more than three corners. Where normals of vertices have no direction, its integrators show no light.
"""

from __future__ import annotations

import tempfile
from collections import defaultdict
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from .._util.budget import Budget
from .._util.untrusted import decoding, read_charged
from .files import SceneFile
from .former_plugin import FormerPlugin
from .lost_normals import FLAT, is_flat, make_flat
from .ply_arrays import UV_OF_CORNERS, Body, FloatArray, Table, Triangles
from .ply_mesh import FACES, header

_MEMORY = 8
"""So many times its bytes a mesh takes while it is written anew, about, without its faces."""
_NORMAL = ("nx", "ny", "nz")
_UV = (("u", "v"), ("s", "t"), ("texture_u", "texture_v"))


class _Anew(NamedTuple):
    """Describes a mesh that is written anew.

    Attributes:
        data: the new file.
        told: how its looks change, one text for each kind of change.
        flat: whether its faces must be shown flat.
    """

    data: bytes
    told: list[str]
    flat: bool


@contextmanager
def meshes_rewritten(file: SceneFile, notes: list[str]) -> Iterator[list[str]]:
    """Let a scene name meshes that are written anew, until the block ends; yield the names that the file has for them.

    Args:
        notes: gets a line for each kind of change of looks.

    Raises:
        OSError, DecodeError: for a mesh that cannot be read.
    """
    places = dict[tuple[Path, bool], tuple[Path, list[str], bool] | None]()
    told = defaultdict[str, dict[str, None]](dict)
    former: list[str] = []
    with ExitStack() as folders:
        for element in file.root.walk():
            shape = FormerPlugin(element, file)
            name = shape.get("filename") if element.tag == "shape" and shape.kind == "ply" else None
            path = None if name is None else file.named_by(name)
            if name is None or path is None:
                continue
            key = path, is_flat(shape)
            if key not in places:
                anew = _anew(*key)
                places[key] = None
                if anew is not None:
                    folder = Path(folders.enter_context(tempfile.TemporaryDirectory(prefix="davis_rs_")))
                    (folder / path.name).write_bytes(anew.data)
                    places[key] = folder / path.name, anew.told, anew.flat
            if (found := places[key]) is None:
                continue
            former.append(name.attributes["value"])
            name.attributes["value"] = str(found[0])
            if found[2]:
                make_flat(shape)
            for change in found[1]:
                told[change][path.name] = None
        notes += [f"its meshes {', '.join(names)[:80]} {change}" for change, names in told.items()]
        yield former


def _anew(path: Path, flat: bool) -> _Anew | None:
    """Write a mesh anew; return None for one that Mitsuba shows, or that is not made of vertices and faces.

    Args:
        flat: whether its faces are flat already.
    """
    budget = Budget(path)
    data = read_charged(path, budget)
    with decoding(path, "PLY"):
        form, elements, begin = header(data)
        if [element.name for element in elements[:2]] != ["vertex", "face"] or elements[0].lists:
            return None
        vertex, face = elements[:2]
        if not any(name in FACES for name in face.lists):
            return None
        body = Body(form, memoryview(data)[begin:], vertex, face)
        vertices = body.vertices()
        refused = len(face.lists) > 1 or (len(elements) == 2 and not body.are_triangles())
        if not refused and not _without_direction(vertices).any():
            return None
        budget.take(_MEMORY * len(data), f"the mesh {path}, which is written anew,")
        vertices, triangles = vertices.copy(), body.triangles(budget)
        told = [
            f"have the list {name!r} of faces, which is left out"
            for name in face.lists
            if name not in (*FACES, UV_OF_CORNERS)
        ]
        if triangles.cut:
            told.append("have faces with more than three corners, which are cut into triangles from their first corner")
        used = np.unique(triangles.corners)
        lost = np.zeros(len(vertices), bool)
        lost[used] = _without_direction(vertices)[used]
        if not (refused or lost.any()):
            return None
        drop = bool(lost.any()) and (flat or bool(lost[used].all()))
        if drop and not flat:
            told.append(FLAT)
        elif lost.any() and not drop:
            told.append("have normals without a direction, which become the mean of their triangles'")
            _put_normals(vertices, triangles, lost)
        return _Anew(_written(vertices, triangles, _NORMAL if drop else ()), told, drop)


def _without_direction(vertices: Table) -> npt.NDArray[np.bool_]:
    """Return which vertices (v,) have a normal that is 0 or not finite."""
    if not set(_NORMAL) <= set(vertices.dtype.names or ()):
        return np.zeros(len(vertices), bool)
    size = sum(np.abs(vertices[name].astype(np.float64)) for name in _NORMAL)
    return (size == 0) | ~np.isfinite(size)


def _put_normals(vertices: Table, triangles: Triangles, lost: npt.NDArray[np.bool_]) -> None:
    """Put the mean of their triangles' normals, by area, in the place of normals that are lost."""
    points, normals = (
        np.stack([vertices[name].astype(np.float64) for name in names], 1) for names in (("x", "y", "z"), _NORMAL)
    )
    first, second, third = (points[triangles.corners[:, k]] for k in range(3))
    across = np.cross(second - first, third - first)
    known = np.where(lost[:, None], 0.0, normals)[triangles.corners].sum(1)
    if (across * known).sum() < 0:  # the other normals say that the triangles' fronts are their backs
        across = -across
    means = np.zeros_like(points)
    for corner in range(3):
        np.add.at(means, triangles.corners[:, corner], across)
    length = np.linalg.norm(means, axis=1, keepdims=True)
    means = np.where(length > 0, means / np.where(length > 0, length, 1.0), (0.0, 0.0, 1.0))
    for axis, name in enumerate(_NORMAL):
        vertices[name][lost] = means[lost, axis]


def _written(vertices: Table, triangles: Triangles, left_out: tuple[str, ...]) -> bytes:
    """Write a mesh.

    Args:
        left_out: names of properties of vertices.
    """
    corners, uv = triangles.corners, None
    if np.isfinite(triangles.uv).all((1, 2)).any():
        left_out = (*left_out, *(name for names in _UV for name in names))
        vertices, corners, uv = _split(vertices, triangles)
    columns: list[tuple[str, npt.NDArray[Any]]] = [
        (name, vertices[name]) for name in vertices.dtype.names or () if name not in left_out
    ]
    if uv is not None:
        columns += [("u", uv[:, 0].astype(np.float32)), ("v", uv[:, 1].astype(np.float32))]
    names = triangles.of_faces.dtype.names or ()
    faces: list[tuple[str, npt.NDArray[Any]]] = [
        ("count", np.full(len(corners), 3, np.uint8)),
        ("corners", corners.astype(np.int32)),
    ]
    faces += [(name, triangles.of_faces[name]) for name in names]
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    lines += [f"property {column.dtype.name} {name}" for name, column in columns]
    lines += [f"element face {len(corners)}", "property list uint8 int32 vertex_indices"]
    lines += [f"property {triangles.of_faces[name].dtype.name} {name}" for name in names]
    return ("\n".join(lines) + "\nend_header\n").encode() + _packed(columns) + _packed(faces)


def _split(vertices: Table, triangles: Triangles) -> tuple[Table, npt.NDArray[np.int64], FloatArray]:
    """Return vertices, each with one place in the texture, the corners that name them, and these places."""
    own = np.zeros((len(vertices), 2))
    for names in reversed(_UV):
        if set(names) <= set(vertices.dtype.names or ()):
            own = np.stack([vertices[name].astype(np.float64) for name in names], 1)
    uv = np.where(np.isfinite(triangles.uv), triangles.uv, own[triangles.corners]).reshape(-1, 2)
    named = triangles.corners.ravel()
    _, place = np.unique(uv.astype("<f4").view("<u8").ravel(), return_inverse=True)
    _, first, corners = np.unique(named * (len(place) + 1) + place, return_index=True, return_inverse=True)
    return vertices[named[first]], corners.reshape(-1, 3), uv[first]


def _packed(columns: list[tuple[str, npt.NDArray[Any]]]) -> bytes:
    """Return rows of these columns, little-endian."""
    fields = [(name, column.dtype.newbyteorder("<"), column.shape[1:]) for name, column in columns]
    table = np.zeros(len(columns[0][1]), fields)
    for name, column in columns:
        table[name] = column
    return table.tobytes()
