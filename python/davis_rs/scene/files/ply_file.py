"""Reads PLY meshes (Stanford's polygon format): ASCII and binary, with colours of vertices or faces, or textures."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..._util.budget import Budget
from ..._util.srgb import from_srgb
from ..._util.untrusted import read_charged
from ...geometry.pose import FloatArray
from ..lost_looks import MISSING, NO_MASK, TRANSPARENCY
from ..mesh_part import GREY, MeshPart, charge_triangles, check_finite, unit_normals
from ..named_file import named_file
from ..repairs import Repairs
from ..texture_file import TextureFiles
from .alpha_mask import blended, masked
from .colour_alpha import is_drawn_below
from .rounding import ROUNDING, within
from .triangulation import cut_polygons, cut_strip, has_area

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}
_UV = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))
_CODES = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "f4": "f", "f8": "d"}
_SPACES = (b" ", b"\n", b"\t", b"\r", b"\v", b"\f")
_WORD_BYTES, _ROW_BYTES, _NUMBER_BYTES = 50, 100, 40
"""About what a word, a list of numbers and each of its numbers take as objects of Python."""
_LONGEST = 1 << 16
"""The longest list of a face; strips of triangles may be longer."""

_INDICES = ("vertex_indices", "vertex_index")
_RGB = ("red", "green", "blue")
_STRIPS = "tristrips"

Indices = npt.NDArray[np.int64]
Columns = dict[str, npt.NDArray[np.float64]]
"""Numbers of rows by the property's name: (n,), or (n, k) of a list that has k numbers in each of these rows."""

_UNTEXTURED = -1
"""The number of its texture of a triangle that has none."""


@dataclass
class _Element:
    """Describes an element of the header: its properties are (name, type, type of a list's length or None)."""

    name: str
    count: int
    properties: list[tuple[str, str, str | None]] = field(default_factory=list)


class _Triangles(NamedTuple):
    """Holds triangles with what their faces say of them.

    Attributes:
        corners: (m, 3), numbers of vertices.
        uv: (m, 3, 2), texture coordinates at the corners; NaN where the face names none.
        texture: (m,), the number of its texture; 0 where the face names none.
        colours: (m, 3), linear RGB; NaN where the face has none.
        opaque: bool (m,), whether these colours are.
    """

    corners: Indices
    uv: FloatArray
    texture: Indices
    colours: FloatArray
    opaque: npt.NDArray[np.bool_]

    @classmethod
    def of(cls, corners: Indices) -> _Triangles:
        """Return triangles of whose faces nothing else is known."""
        count = len(corners)
        uv, colours = np.full((count, 3, 2), np.nan), np.full((count, 3), np.nan)
        return cls(corners, uv, np.zeros(count, np.int64), colours, np.ones(count, bool))

    def only(self, rows: Indices) -> _Triangles:
        """Return some of them."""
        return _Triangles(self.corners[rows], self.uv[rows], self.texture[rows], self.colours[rows], self.opaque[rows])


class _OfVertices(NamedTuple):
    """Holds what vertices have besides their positions; None for what they do not have.

    Attributes:
        uv: (v, 2), texture coordinates.
        normals: (v, 3).
        colours: (v, 3), linear RGB.
        opaque: bool (v,), whether these colours are.
    """

    uv: FloatArray | None
    normals: FloatArray | None
    colours: FloatArray | None
    opaque: npt.NDArray[np.bool_]


def read_ply(path: Path, budget: Budget, *, grey_unknown: bool = False) -> list[MeshPart]:
    """Read a PLY file: triangles, with normals, texture coordinates and colours. It is one part for each texture.

    Strips of triangles (the element ``tristrips``, as in Stanford's repository: lists of vertices, -1 between strips)
    are read, too. Edges, and faces without area, have no surface: they are left out. Colours of vertices or faces as
    integers are taken as sRGB, as floating-point numbers as linear; those of vertices come first. Textures are named by
    the header's lines ``comment TextureFile NAME``, as MeshLab writes them; they must lie in the mesh's folder, or
    below. Texture coordinates are those of a face's corners (its list ``texcoord``), or of vertices; where there are
    several textures, ``texnumber`` says which one a face has, and a negative number says that it has none.

    Args:
        budget: what the file may take, with its textures.
        grey_unknown: textures that are missing are grey, which their parts tell; else they are refused.

    Raises:
        OSError: if the file or its texture cannot be read.
        ValueError: naming the file and the rule that it breaks.

    Warns:
        SceneFileWarning: in one line, of what is left out or repaired.
    """
    data = read_charged(path, budget)
    order, textures, elements, start = _header(path, data)
    body = _BodyReader(path, memoryview(data)[start:], order, budget)
    rows = {element.name: body.rows(element) for element in elements}
    named = {element.name: element for element in elements}
    vertex, face = (named.get(name, _Element(name, 0)) for name in ("vertex", "face"))
    vertices = _vertices(path, rows.get("vertex", []))
    positions = _stacked(vertices, ("x", "y", "z"))
    if positions is None:
        raise ValueError(f"{path}: the PLY file has no vertices with x, y and z")
    check_finite(positions, "vertex", str(path))
    repairs = Repairs(path)
    repairs.add("edges have no surface and are left out", named["edge"].count if "edge" in named else 0, "edge 1")
    found = [*_faces(path, positions, rows.get("face", []), face, repairs)]
    found += map(_Triangles.of, _strips(path, positions, rows.get(_STRIPS, []), repairs))
    if not found:
        raise ValueError(
            f"{path}: it has {len(positions):,} points and no faces: a cloud of points has no surface that a camera "
            "could see; make a mesh of it first, for example by surface reconstruction in MeshLab"
        )
    repairs.refuse_nothing(sum(len(triangles.corners) for triangles in found))
    triangles = _Triangles(*(np.concatenate(arrays) for arrays in zip(*found, strict=True)))
    given = _of_vertices(path, vertices, vertex)
    parts = _parts(path, positions, triangles, given, textures, repairs, budget, grey_unknown)
    repairs.warn()
    return parts


def _header(path: Path, data: bytes) -> tuple[str, list[str], list[_Element], int]:
    """Parse the header: byte order, names of textures, elements, and where the body starts."""
    first, _, _ = data[:8].partition(b"\n")
    end = data.find(b"end_header")
    start = data.find(b"\n", end) + 1
    if first.strip() != b"ply" or end < 0 or start == 0:
        raise ValueError(f"{path}: not a PLY file: it must start with 'ply' and have a header that ends")
    order = None
    textures: list[str] = []
    elements: list[_Element] = []
    for number, line in enumerate(data[:end].decode("utf-8", errors="replace").splitlines()[1:], 2):
        try:
            match line.split():
                case ["format", name, "1.0"] if name in _ORDERS:
                    order = _ORDERS[name]
                case ["comment", "TextureFile", *_]:
                    textures.append(line.split("TextureFile", 1)[1].strip())
                case [] | ["comment" | "obj_info", *_]:
                    pass
                case ["element", name, count] if count.isdecimal():
                    elements.append(_Element(name, int(count)))
                case ["property", "list", length, kind, name] if elements and _TYPES[length][0] != "f":
                    elements[-1].properties.append((name, _TYPES[kind], _TYPES[length]))
                case ["property", kind, name] if elements:
                    elements[-1].properties.append((name, _TYPES[kind], None))
                case _:
                    raise KeyError
        except KeyError:
            raise ValueError(f"{path}:{number}: not a line of a PLY header: {line!r}") from None
    if order is None:
        raise ValueError(f"{path}: the PLY header names no format")
    return order, textures, elements, start


def _vertices(path: Path, rows: list[Columns]) -> Columns:
    if len(rows) > 1:
        raise ValueError(f"{path}: vertices with lists of different lengths are not read")
    return rows[0] if rows else {}


class _BodyReader:
    """Reads the numbers after the header, from front to back."""

    def __init__(self, path: Path, data: memoryview, order: str, budget: Budget) -> None:
        self.path, self.order, self.budget = path, order, budget
        self.data = data
        self.words = [] if order else self._split()
        self.at = 0

    def _split(self) -> list[bytes]:
        text = bytes(self.data)
        self.budget.take(len(text) + _WORD_BYTES * sum(map(text.count, _SPACES)), "its words")
        return text.split()

    def rows(self, element: _Element) -> list[Columns]:
        """Read all rows of an element, grouped by the lengths of their lists; "row" is a row's number."""
        if not element.properties or not element.count:
            return []
        start = self.at
        lengths = self._row(element)[0]
        self.at = start
        columns = self._alike(element, lengths)
        if columns is not None:
            return [columns]
        groups: dict[tuple[int, ...], list[list[float]]] = {}
        subject = f"rows of the element {element.name!r}"
        for row in range(element.count):
            self.budget.count(1, subject)
            lengths, values = self._row(element)
            self.budget.take(_ROW_BYTES + _NUMBER_BYTES * len(values), subject)
            groups.setdefault(tuple(lengths), []).append([row, *values])
        return [self._columns(element, lengths, np.array(values)) for lengths, values in groups.items()]

    def _row(self, element: _Element) -> tuple[list[int], list[float]]:
        """Read the next row: the lengths of its lists, and all its other numbers."""
        lengths: list[int] = []
        values: list[float] = []
        for _, kind, length in element.properties:
            count = 1
            if length is not None:
                (given,) = self._numbers(length, 1, element)
                most = len(self.data) if element.name == _STRIPS else _LONGEST
                if not 0 <= given <= most or given != int(given):
                    raise ValueError(f"{self.path}: a list of {given:g} numbers in the element {element.name!r}")
                count = int(given)
                lengths.append(count)
            values += self._numbers(kind, count, element)
        return lengths, values

    def _numbers(self, kind: str, count: int, element: _Element) -> list[float]:
        size = count * np.dtype(kind).itemsize if self.order else count
        if self.at + size > len(self.data if self.order else self.words):
            raise ValueError(f"{self.path}: the file ends within the element {element.name!r}")
        start, self.at = self.at, self.at + size
        if self.order:
            return list(struct.unpack_from(f"{self.order}{count}{_CODES[kind]}", self.data, start))
        return self._floats(self.words[start : self.at], element)

    def _floats(self, words: list[bytes], element: _Element) -> list[float]:
        try:
            return [float(word) for word in words]
        except ValueError as error:
            raise ValueError(f"{self.path}: in the element {element.name!r}: {error}") from None

    def _alike(self, element: _Element, lengths: list[int]) -> Columns | None:
        """Read the rows of an element at once if all lists have these lengths; else return None."""
        layout: list[tuple[str, str, tuple[int, ...]]] = []
        left = iter(lengths)
        for index, (_, kind, length) in enumerate(element.properties):
            if length is not None:
                layout.append((f"length {index}", self.order + length, ()))
            layout.append((f"{index}", self.order + kind, () if length is None else (next(left),)))
        width = sum(int(np.prod(shape)) for _, _, shape in layout)
        size = np.dtype(layout).itemsize if self.order else width
        end = self.at + element.count * size
        if end > len(self.data if self.order else self.words):
            return None  # reading row by row will say where it ends, if no row is shorter
        numbers = 8 * element.count * (1 + width)
        self.budget.take(numbers, f"the element {element.name!r}")
        with self.budget.borrow(numbers if self.order else _NUMBER_BYTES * element.count * width, "its numbers"):
            columns = self._table(element, lengths, layout, width, end)
        if columns is None:
            self.budget.give_back(numbers)
        return columns

    def _table(
        self,
        element: _Element,
        lengths: list[int],
        layout: list[tuple[str, str, tuple[int, ...]]],
        width: int,
        end: int,
    ) -> Columns | None:
        """Read the rows of an element until ``end`` as one table; return None if lists have other lengths."""
        if self.order:
            table = np.frombuffer(self.data, np.dtype(layout), element.count, self.at)
            columns = [table[name].reshape(element.count, -1).astype(np.float64) for name, _, _ in layout]
        else:
            words = np.array(self._floats(self.words[self.at : end], element)).reshape(element.count, width)
            columns = np.split(words, np.cumsum([int(np.prod(shape)) for _, _, shape in layout])[:-1], axis=1)
        given = [column for column, (name, _, _) in zip(columns, layout, strict=True) if name.startswith("length")]
        if any((column != wanted).any() for column, wanted in zip(given, lengths, strict=True)):
            return None
        self.at = end
        kept = [column for column, (name, _, _) in zip(columns, layout, strict=True) if not name.startswith("length")]
        rows = np.arange(element.count, dtype=np.float64)[:, None]
        return self._columns(element, lengths, np.concatenate([rows, *kept], 1))

    @staticmethod
    def _columns(element: _Element, lengths: Sequence[int], table: FloatArray) -> Columns:
        columns, at, left = {"row": table[:, 0]}, 1, iter(lengths)
        for name, _, length in element.properties:
            width = 1 if length is None else next(left)
            columns[name] = table[:, at] if length is None else table[:, at : at + width]
            at += width
        return columns


def _faces(
    path: Path, positions: FloatArray, faces: list[Columns], element: _Element, repairs: Repairs
) -> Iterator[_Triangles]:
    """Yield the triangles of polygons."""
    for rows in faces:
        polygons = _indices(path, rows, "face", len(positions), least=0)
        numbers, sides = rows["row"].astype(np.int64) + 1, polygons.shape[1]
        if sides < 3:
            raise ValueError(f"{path}: face {numbers[0]} needs a list of at least 3 vertices")
        cut = cut_polygons(polygons, positions, "face", numbers, repairs)
        triangles, face = _Triangles.of(polygons.ravel()[cut]), cut[:, 0] // sides
        uv = rows.get("texcoord", np.empty((0, 0)))
        if uv.size:
            if uv.shape[1:] != (2 * sides,):
                raise ValueError(f"{path}: face {numbers[0]} needs 2 texture coordinates for each corner")
            check_finite(uv, "texture coordinates of face", str(path))
            triangles = triangles._replace(uv=uv.reshape(-1, 2)[cut])
        if "texnumber" in rows:
            texture = rows["texnumber"]
            if texture.ndim != 1 or not (np.abs(texture) < _LONGEST).all():
                raise ValueError(f"{path}: texnumber of face {numbers[0]} is not the number of a texture")
            triangles = triangles._replace(texture=texture.astype(np.int64)[face])
        colours, opaque = _colours(path, rows, element, "faces")
        if colours is not None:
            triangles = triangles._replace(colours=colours[face], opaque=opaque[face])
        yield triangles


def _of_vertices(path: Path, columns: Columns, element: _Element) -> _OfVertices:
    uv = next((found for names in _UV if (found := _stacked(columns, names)) is not None), None)
    if uv is not None:
        check_finite(uv, "texture coordinates of vertex", str(path))
    return _OfVertices(uv, _stacked(columns, ("nx", "ny", "nz")), *_colours(path, columns, element, "vertices"))


def _strips(path: Path, positions: FloatArray, strips: list[Columns], repairs: Repairs) -> Iterator[Indices]:
    """Yield the triangles of strips."""
    for rows in strips:
        for strip, row in zip(_indices(path, rows, "strip", len(positions), least=-1), rows["row"], strict=True):
            triangles = cut_strip(strip)
            whole = has_area(positions[triangles])
            note = "triangles without area are left out"
            repairs.add(note, int((~whole).sum()), f"in strip {int(row) + 1}")
            yield triangles[whole]


def _indices(path: Path, rows: Columns, name: str, count: int, *, least: int) -> Indices:
    """Return the vertices (m, n) of rows, and check that each is from ``least`` to ``count`` - 1."""
    given = next((rows[key] for key in _INDICES if key in rows), np.empty((len(rows["row"]), 0)))
    if given.ndim != 2:
        given = np.empty((len(rows["row"]), 0))
    outside = ~((given >= least) & (given < count))
    if outside.any():
        worst, column = np.argwhere(outside)[0]
        named = (
            f"the vertices [{', '.join(f'{index:g}' for index in given[worst])}]"
            if given.shape[1] < 10
            else f"vertex {given[worst, column]:g}"
        )
        raise ValueError(
            f"{path}: {name} {int(rows['row'][worst]) + 1} names {named}, but the file has {count}, counted from 0"
        )
    return given.astype(np.int64)


def _parts(
    path: Path,
    positions: FloatArray,
    triangles: _Triangles,
    of_vertices: _OfVertices,
    names: list[str],
    repairs: Repairs,
    budget: Budget,
    grey_unknown: bool,
) -> list[MeshPart]:
    """Return one part for each texture that triangles have, and one for those without.

    Args:
        names: of textures.
        grey_unknown: what shows textures that are missing is grey.
    """
    # What a triangle's face says of it is less than 5 numbers at each corner.
    charge_triangles(budget, len(triangles.corners), 3 + 2 + 3 + 3 + 5, str(path))
    uv, normals = triangles.uv, None
    if of_vertices.uv is not None:
        uv = np.where(np.isfinite(uv), uv, of_vertices.uv[triangles.corners])
    texture = np.maximum(triangles.texture, _UNTEXTURED) if names else np.full(len(uv), _UNTEXTURED)
    if len(beyond := np.flatnonzero(texture >= max(len(names), 1))):
        raise ValueError(f"{path}: a face has the texture {texture[beyond[0]]} of {len(names)}, counted from 0")
    if len(lacking := np.flatnonzero((texture >= 0) & np.isnan(uv).any((1, 2)))):
        raise ValueError(
            f"{path}: the texture {names[texture[lacking[0]]]!r} needs texture coordinates of vertices (s, t) or of "
            "faces (texcoord), which the file does not have; export them, or delete the line 'comment TextureFile'"
        )
    if of_vertices.normals is not None:
        points = positions[triangles.corners]
        normals = unit_normals(of_vertices.normals[triangles.corners], points, "the mesh", repairs)
    files = TextureFiles(budget)
    parts = list[MeshPart]()
    for number in np.unique(texture).tolist():
        rows = np.flatnonzero(texture == number)
        part = MeshPart(
            positions[triangles.corners[rows]],
            uv[rows] if np.isfinite(uv[rows]).all() else None,
            None if normals is None else normals[rows],
            np.full(3, GREY),
            None,
            names[number] if number >= 0 else "",
        )
        if number >= 0:
            parts.append(_textured(path, part, files, budget, grey_unknown))
        else:
            parts.append(_coloured(part, of_vertices, triangles.only(rows)))
    return parts


def _textured(path: Path, part: MeshPart, files: TextureFiles, budget: Budget, grey_unknown: bool) -> MeshPart:
    """Return a part with the texture that its name says, cut along its mask; grey where that is missing."""
    file = named_file(part.material, path, path.parent, f"{path}: TextureFile")
    if grey_unknown and not file.is_file():
        return part._replace(lost=(MISSING,))
    reflectance = files.read(file, str(path))
    reflectance.charge(budget, str(path))
    mask, looks = (None, (NO_MASK,)) if is_drawn_below(reflectance) else blended(reflectance.alpha)
    return masked(part._replace(reflectance=reflectance, files=(file,), lost=looks), mask, budget)


def _coloured(part: MeshPart, of_vertices: _OfVertices, triangles: _Triangles) -> MeshPart:
    """Return a part with the colours of vertices, or else of its triangles, if there are any."""
    if of_vertices.colours is not None:
        colours, opaque = of_vertices.colours[triangles.corners], of_vertices.opaque[triangles.corners]
    elif np.isnan(triangles.colours).all():
        return part
    else:
        known = np.where(np.isnan(triangles.colours), GREY, triangles.colours)
        colours, opaque = np.repeat(known[:, None], 3, axis=1), triangles.opaque
    return part._replace(colours=colours, lost=() if opaque.all() else (TRANSPARENCY,))


def _colours(
    path: Path, columns: Columns, element: _Element, name: str
) -> tuple[FloatArray | None, npt.NDArray[np.bool_]]:
    """Return linear RGB (n, 3) of vertices or faces, None where they have no colours; and which (n) are opaque.

    Args:
        name: of them in messages.
    """
    given = _stacked(columns, _RGB)
    if given is None:
        return None, np.ones(len(columns["row"]), bool)
    kind = next(kind for key, kind, _ in element.properties if key == "red")
    full = 1.0 if kind[0] == "f" else float(np.iinfo(kind).max)
    colours = within(given / full, 0.0, 1.0)
    if colours is None:
        raise ValueError(f"{path}: colours of {name} must lie in 0 to {full:g}")
    alpha = columns.get("alpha", np.full(len(given), full))
    return colours if full == 1 else from_srgb(colours), alpha >= (1 - ROUNDING) * full


def _stacked(columns: Columns, names: Sequence[str]) -> FloatArray | None:
    """Stack these columns side by side; return None if one is missing."""
    if not all(name in columns and columns[name].ndim == 1 for name in names):
        return None
    return np.stack([columns[name] for name in names], 1)
