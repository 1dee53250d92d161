"""Reads PLY meshes into arrays that keep the types of their numbers."""

from __future__ import annotations

from collections import defaultdict
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .._util.budget import Budget
from .ply_mesh import DTYPES, FACES, Element, equal_rows

UV_OF_CORNERS = "texcoord"
"""The list of faces with two texture coordinates for each corner."""

_FACE_BYTES = 400
"""What a face takes, about, where not all have lists of the same lengths."""
_TRIANGLE_CORNER_BYTES, _CORNER_BYTES = 90, 170
"""What a corner takes, about: of a triangle, and of a polygon that is cut."""

Table = npt.NDArray[np.void]
FloatArray = npt.NDArray[np.float64]


class Triangles(NamedTuple):
    """Holds triangles.

    Attributes:
        corners: (m, 3), numbers of vertices.
        uv: (m, 3, 2), texture coordinates of corners; NaN where a face has none.
        of_faces: (m,), the numbers that their faces have, by name.
        cut: how many faces had more than three corners.
    """

    corners: npt.NDArray[np.int64]
    uv: FloatArray
    of_faces: Table
    cut: int


class Body:
    """Reads what comes after the header of a mesh: vertices, then faces.

    Args:
        form: of the file, as the header names it.
        data: all after the header.
        vertex, face: the first two elements.

    Raises:
        ValueError, KeyError: for what is malformed.
    """

    def __init__(self, form: str, data: memoryview, vertex: Element, face: Element) -> None:
        self._order = "" if form == "ascii" else "<" if "little" in form else ">"
        self._words = [] if self._order else bytes(data).split()
        self._data, self._length = data, len(data) if self._order else len(self._words)
        self._vertex, self._face = vertex, face
        self._begin = vertex.number * sum(self._size(entry[0]) for entry in vertex.properties)

    def _size(self, kind: str) -> int:
        """Return what a number takes: bytes, or a word."""
        return np.dtype(DTYPES[kind]).itemsize if self._order else 1

    def vertices(self) -> Table:
        """Return what vertices have, by name."""
        dtype = np.dtype([(name, (self._order or "<") + DTYPES[kind]) for kind, name in self._vertex.properties])
        if self._begin > self._length:
            raise ValueError("it ends before its elements do")
        if self._order:
            return np.frombuffer(self._data, dtype, self._vertex.number)
        return self._table(dtype, [(0, self._begin)], self._vertex.number)

    def are_triangles(self) -> bool:
        """Return whether all that comes after the vertices has the length of triangles."""
        size = 0
        for entry in self._face.properties:
            size += self._size(entry[1]) + 3 * self._size(entry[2]) if entry[0] == "list" else self._size(entry[0])
        return self._begin + self._face.number * size == self._length

    def triangles(self, budget: Budget) -> Triangles:
        """Return faces, cut into triangles from their first corner. The budget is charged for them."""
        properties = self._face.properties
        scalars = [(k, entry[-1], DTYPES[entry[0]]) for k, entry in enumerate(properties) if entry[0] != "list"]
        lists = {entry[-1]: f"values{k}" for k, entry in enumerate(properties) if entry[0] == "list"}
        corners_of = next(lists[name] for name in FACES if name in lists)
        kind = np.dtype([(name, f"<{dtype}") for _, name, dtype in scalars])
        found = [(np.zeros((0, 3), np.int64), np.zeros((0, 3, 2)), np.zeros(0, kind))]
        cut = 0
        for rows in self._faces(budget):
            sides = rows[corners_of].shape[1]
            each = _TRIANGLE_CORNER_BYTES if sides == 3 else _CORNER_BYTES
            budget.take(each * sides * len(rows), "its list of corners")
            polygons = rows[corners_of].astype(np.int64)
            fan = np.array([(0, k, k + 1) for k in range(1, sides - 1)], np.int64).reshape(-1, 3)
            cut += len(rows) if sides > 3 else 0
            uv = np.full((len(rows), sides, 2), np.nan)
            if UV_OF_CORNERS in lists and rows[lists[UV_OF_CORNERS]].shape[1] == 2 * sides:
                uv = rows[lists[UV_OF_CORNERS]].astype(np.float64).reshape(-1, sides, 2)
            of_faces = np.zeros(len(rows), kind)
            for k, name, _ in scalars:
                of_faces[name] = rows[f"value{k}"]
            found.append((polygons[:, fan].reshape(-1, 3), uv[:, fan].reshape(-1, 3, 2), np.repeat(of_faces, len(fan))))
        corners, uv, of_faces = (np.concatenate(arrays) for arrays in zip(*found, strict=True))
        return Triangles(corners, uv, of_faces, cut)

    def _faces(self, budget: Budget) -> list[Table]:
        """Return the rows of faces, in groups whose lists have the same lengths: see :func:`equal_rows`."""
        properties, number = self._face.properties, self._face.number
        if self._order:
            rows = equal_rows(self._data[self._begin :], number, properties, self._order)
            if rows is not None:
                return [rows]
        budget.take(_FACE_BYTES * number, "its list of faces")
        at, groups = self._begin, defaultdict[tuple[int, ...], list[tuple[int, int]]](list)
        for _ in range(number):
            start, lengths = at, list[int]()
            for entry in properties:
                if entry[0] != "list":
                    at += self._size(entry[0])
                    continue
                lengths.append(self._count(at, entry[1]))
                at += self._size(entry[1]) + lengths[-1] * self._size(entry[2])
            groups[tuple(lengths)].append((start, at))
        return [self._group(lengths, places) for lengths, places in groups.items()]

    def _count(self, at: int, kind: str) -> int:
        count = int(np.frombuffer(self._data, self._order + DTYPES[kind], 1, at)[0] if self._order else self._words[at])
        if not 0 <= count <= self._length - at:
            raise ValueError(f"a list of {count} values")
        return count

    def _group(self, lengths: tuple[int, ...], places: list[tuple[int, int]]) -> Table:
        """Return rows that lie at some places, and whose lists have these lengths."""
        fields: list[tuple[str, str, tuple[int, ...]]] = []
        left = iter(lengths)
        for k, entry in enumerate(self._face.properties):
            if entry[0] == "list":
                fields.append((f"count{k}", (self._order or "<") + DTYPES[entry[1]], ()))
                fields.append((f"values{k}", (self._order or "<") + DTYPES[entry[2]], (next(left),)))
            else:
                fields.append((f"value{k}", (self._order or "<") + DTYPES[entry[0]], ()))
        if self._order:
            return np.frombuffer(b"".join(self._data[start:end] for start, end in places), np.dtype(fields))
        return self._table(np.dtype(fields), places, len(places))

    def _table(self, dtype: np.dtype[np.void], places: list[tuple[int, int]], number: int) -> Table:
        """Return the words at some places as rows of numbers."""
        numbers = np.array([float(word) for start, end in places for word in self._words[start:end]])
        left = numbers.reshape(number, -1)
        table = np.zeros(number, dtype)
        for name in dtype.names or ():
            width = int(np.prod(dtype[name].shape))
            table[name] = left[:, :width].reshape(number, *dtype[name].shape)
            left = left[:, width:]
        return table
