"""Reads Wavefront OBJ meshes with their materials."""

from __future__ import annotations

from array import array
from itertools import takewhile
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..._core import DecodeError
from ..._util.budget import Budget
from ..._util.srgb import from_srgb
from ..._util.untrusted import read_charged
from ...geometry.pose import FloatArray
from ..image_textures import ChargedImages, ImageTexture
from ..lost_looks import MEAN_EMISSION, NO_MASK, OWN_LIGHT, TRANSPARENCY, UNKNOWN, UNPLACED
from ..mesh_part import GREY, Blend, MeshPart, charge_triangles, check_finite, unit_normals
from ..named_file import GREY_UNKNOWN, named_file
from ..repairs import Repairs
from ..texture_file import EncodedTexture, TextureFiles
from .alpha_mask import blended, masked
from .colour_alpha import is_drawn_below
from .mtl_file import Materials, text_lines
from .rounding import ROUNDING, within
from .triangulation import cut_polygons

_WIDTH = {"v": 3, "vt": 2, "vn": 3}
_NUMBERS = {*_WIDTH, "f"}
"""Lines of numbers."""
_OPTIONAL = {"vt": "texture coordinates", "vn": "normals"}
"""What a mesh can do without."""
_UNREAD = {"curv", "curv2", "surf", "call"}
_FACE_BYTES = 9 * 8 * 2
"""Bytes of a triangle's indices, while the faces are joined."""
_COLOURS = "colours of vertices (those of the material are shown)"
_WITHOUT_SURFACE = {"p": "points", "l": "lines"}


def read_obj(path: Path, budget: Budget, *, grey_unknown: bool = False) -> list[MeshPart]:
    """Read the parts of an OBJ file, one for each material that faces use, in the order of first use.

    Polygons are cut into triangles; ``v x y z r g b`` gives a colour (sRGB) to the vertices of faces without a
    material; next to one it is told as lost, because programs disagree on what it means there. Points, lines and faces
    without area have no surface: they are left out. Groups have no meaning here.

    Material files and textures must lie in the mesh's folder, or below.

    Args:
        budget: what the file may take, with all that it names.
        grey_unknown: materials and textures that are missing are grey, which their parts tell; else they are refused.

    Raises:
        OSError: if the file, its material file or a texture cannot be read.
        ValueError: naming the line and the rule that it breaks.

    Warns:
        SceneFileWarning: in one line, of what is left out or repaired.
    """
    file = _ObjFile(path, budget, grey_unknown)
    parts = file.parts()
    file.repairs.refuse_nothing(len(parts))
    file.repairs.warn()
    return parts


class _ObjFile:
    """Reads the numbers of a file, and its faces by material and number of corners."""

    def __init__(self, path: Path, budget: Budget, grey_unknown: bool) -> None:
        self.path, self.budget, self.grey_unknown = path, budget, grey_unknown
        self.numbers = {"v": array("d"), "vt": array("d"), "vn": array("d")}
        self.colours = array("d")
        self.faces: dict[tuple[str, int], array[int]] = {}
        """Each face as its line, then position, texture coordinate and normal of each corner, from 1; 0 for none."""
        self.libraries: dict[Path, Materials] = {}
        """Material files, each read once, in the order in which they were last named: later ones win."""
        self.textures = TextureFiles(budget)
        self.charged = ChargedImages(budget)
        self.repairs = Repairs(path)
        self._read()
        self.materials = {name: library for library in self.libraries.values() for name in library.colours}

    def _read(self) -> None:
        material, begun = "", list[str]()
        data = read_charged(self.path, self.budget)
        if b"\0" in data:
            raise ValueError(f"{self.path}: must be a text in UTF-8 or ASCII, but it has bytes that are 0")
        for number, line in enumerate(text_lines(data, self.budget), 1):
            words = [*begun, *line.split()]
            key = words[0] if words else "#"
            if key in _NUMBERS and words[-1] == "\\":  # it goes on
                begun = words[:-1]
                continue
            begun = []
            if key in _NUMBERS and "#" in line:  # a comment; in names, # is a letter
                words = list(takewhile(lambda word: word[0] != "#", words))
            try:
                if key in _WIDTH:
                    self._number(key, words[1:])
                elif key == "f":
                    self._face(material, number, words[1:])
                elif key == "usemtl":
                    material = line.strip()[6:].strip()
                elif key == "mtllib":
                    self._read_materials(line.strip()[6:].strip(), number)
                elif key in _WITHOUT_SURFACE:
                    note = f"{_WITHOUT_SURFACE[key]} ({key}) have no surface and are left out"
                    self.repairs.add(note, 1, f"line {number}")
                elif key in _UNREAD:
                    raise ValueError(f"{key} (curves and surfaces) is not read: export a mesh of polygons")
            except DecodeError:
                raise
            except ValueError as error:
                raise ValueError(f"{self.path}:{number}: {error}") from None

    def _number(self, key: str, words: list[str]) -> None:
        width = _WIDTH[key]
        if len(words) < (1 if key == "vt" else width):
            raise ValueError(f"{key} needs {width} numbers, got {len(words)}")
        try:
            values = [float(word) for word in words]
        except ValueError:
            raise ValueError(f"{key} needs numbers, got {' '.join(words)!r}") from None
        self.budget.take(8 * len(values), "its vertices")
        self.numbers[key].extend([*values, 0.0][:width])
        if key == "v" and len(values) >= 6:
            self.colours.extend(values[3:6])

    def _face(self, material: str, line: int, words: list[str]) -> None:
        if len(words) < 3:
            raise ValueError(f"a face needs at least 3 corners, got {len(words)}")
        counts = [len(self.numbers[key]) // width for key, width in _WIDTH.items()]
        row = [line]
        for word in words:
            fields = word.split("/")
            if len(fields) > 3:
                raise ValueError(f"a corner is v, v/vt, v//vn or v/vt/vn, got {word!r}")
            for slot in range(3):
                field = fields[slot] if slot < len(fields) else ""
                index = int(field) if field else 0
                if index < 0:
                    index += counts[slot] + 1
                if (index < 1 and field) or (slot == 0 and not field) or index >= 1 << 32:
                    raise ValueError(f"a corner's index counts from 1, or from -1 backwards, got {word!r}")
                row.append(index)
        self.budget.take(8 * len(row), "its faces")
        self.faces.setdefault((material, len(words)), array("q")).extend(row)

    def _read_materials(self, name: str, line: int) -> None:
        path = named_file(name.replace("\\", "/"), self.path, self.path.parent, f"{self.path}:{line}: mtllib")
        if not path.is_file() and not self.grey_unknown:
            raise ValueError(
                f"the material file {name!r} is not next to the mesh; put it there, or take what is missing as grey: "
                f"{GREY_UNKNOWN}"
            )
        if path.is_file():
            known = self.libraries.pop(path, None)
            self.libraries[path] = known or Materials(path, self.path.parent, self.budget, self.grey_unknown)

    def parts(self) -> list[MeshPart]:
        """Build the parts, one for each material; two where only some triangles have a place on its texture."""
        values = {key: np.array(self.numbers[key]).reshape(-1, width) for key, width in _WIDTH.items()}
        for key, name in (("v", "vertex"), ("vt", "texture coordinate")):
            check_finite(values[key], name, str(self.path))
        colours = self._vertex_colours(len(values["v"]))
        by_material: dict[str, list[npt.NDArray[np.int64]]] = {}
        for (material, corners), rows in self.faces.items():
            self.budget.take(_FACE_BYTES * (corners - 2) * (len(rows) // (1 + 3 * corners)), "its triangles")
            faces = np.array(rows).reshape(-1, 1 + 3 * corners)
            by_material.setdefault(material, []).append(self._triangles(faces, values))
        joined = {material: np.concatenate(triangles) for material, triangles in by_material.items()}
        return [
            self._part(material, alike, values, colours)
            for material, triangles in joined.items()
            for alike in self._placed_or_not(material, triangles)
            if len(alike)
        ]

    def _placed_or_not(self, material: str, triangles: npt.NDArray[np.int64]) -> list[npt.NDArray[np.int64]]:
        """Return the triangles of a material that have a place on its texture, and those that have none."""
        if material not in self.materials or self.materials[material].texture(material) is None:
            return [triangles]
        placed = (triangles[:, :, 1] >= 0).all(1)
        return [triangles[placed], triangles[~placed]]

    def _vertex_colours(self, count: int) -> FloatArray | None:
        """Return linear RGB (count, 3) of the vertices, or None where not all have one."""
        if len(self.colours) != 3 * count or not count:
            if self.colours:
                note = f"colours of vertices are left out because not all of the {count} have one"
                self.repairs.add(note, len(self.colours) // 3, "see the lines v")
            return None
        given = np.array(self.colours).reshape(-1, 3)
        check_finite(given, "colour of vertex", str(self.path))
        colours = within(given, 0, 1)
        if colours is None:
            wrong = int(((given < 0) | (given > 1)).any(1).argmax())
            shown = ", ".join(f"{value:g}" for value in given[wrong])
            raise ValueError(f"{self.path}: colours of vertices must lie in 0 to 1, vertex {wrong + 1} has ({shown})")
        return from_srgb(colours)

    def _triangles(self, faces: npt.NDArray[np.int64], values: dict[str, FloatArray]) -> npt.NDArray[np.int64]:
        """Return indices of position, texture coordinate and normal of each corner, (m, 3, 3), from 0; -1 for none."""
        lines, corners = faces[:, 0], faces[:, 1:].reshape(len(faces), -1, 3) - 1
        for slot, key in enumerate(_WIDTH):
            if key in _OPTIONAL and not len(values[key]):
                named = (corners[..., slot] >= 0).any(1)
                note = f"faces name {_OPTIONAL[key]} ({key}), of which the file has none"
                self.repairs.add(note, int(np.count_nonzero(named)), f"line {lines[named.argmax()]}")
                corners[..., slot] = -1
            outside = (corners[..., slot] >= len(values[key])).any(1)
            if outside.any():
                worst = int(outside.argmax())
                raise ValueError(
                    f"{self.path}:{lines[worst]}: a face names {key} {corners[worst, :, slot].max() + 1}, but the "
                    f"file has {len(values[key])}"
                )
        return corners.reshape(-1, 3)[cut_polygons(corners[..., 0], values["v"], "line", lines, self.repairs)]

    def _part(
        self, material: str, triangles: npt.NDArray[np.int64], values: dict[str, FloatArray], colours: FloatArray | None
    ) -> MeshPart:
        charge_triangles(self.budget, len(triangles), 3 + 2 + 3 + 3, f"{self.path}: {material or 'the mesh'}")
        position, texture, normal = np.moveaxis(triangles, 2, 0)
        uv = values["vt"][texture] if (texture >= 0).all() else None
        points = values["v"][position]
        normals = None
        if (normal >= 0).all():
            normals = unit_normals(values["vn"][normal], points, material or "the mesh", self.repairs)
        if material not in self.materials:
            if self.libraries and material and not self.grey_unknown:
                raise ValueError(
                    f"{self.path}: no material file of this mesh has the material {material!r} that faces use; add it, "
                    f"or take what is missing as grey: {GREY_UNKNOWN}"
                )
            own = None if colours is None else colours[position]
            lost = (UNKNOWN,) if material and own is None else ()
            return MeshPart(points, uv, normals, np.full(3, GREY), own, material, lost=lost)
        materials = self.materials[material]
        reflectance, image = materials.reflectance(material, self.textures), materials.texture(material)
        of_opacity, alpha, unread = materials.opacity(material, self.textures)
        of_emission, emission, dark = materials.emission(material, self.textures)
        named = [file for file in (image, of_opacity, of_emission) if file is not None]
        files = tuple(dict.fromkeys([materials.path, *named]))
        opacity, blend, told = materials.opaque(material), None, tuple[str, ...]()
        if opacity == 0:  # nobody draws what is not there, and some exporters write Tr 1 of what is opaque
            opacity, told = 1.0, (TRANSPARENCY,)
        if unread or (alpha is not None and uv is None and alpha.min() < 255):
            alpha, told = None, (TRANSPARENCY,)
        if of_opacity is None and isinstance(reflectance, EncodedTexture) and is_drawn_below(reflectance):
            alpha, told = None, (*told, NO_MASK)
        mask, soft = blended(alpha, factor=opacity)
        if soft and opacity == 1 and (of_opacity is None or (mask is not None and not mask.is_haze)):
            told = (*told, *soft)  # the alpha of a base colour's texture may mean something else
        elif soft:
            mask, blend = None, Blend(opacity, alpha)
        if dark:
            told = (*told, OWN_LIGHT)
        if isinstance(emission, EncodedTexture):
            if uv is None:
                emission, told = emission.mean(), (*told, MEAN_EMISSION)
            else:
                emission.charge(self.budget, f"the material {material!r}")
        if colours is not None and (colours[position] < 1 - ROUNDING).any():
            told = (*told, _COLOURS)
        if isinstance(reflectance, EncodedTexture) and uv is None:
            reflectance, told = reflectance.mean(), (*told, UNPLACED)
        elif isinstance(reflectance, EncodedTexture):
            # As parts look it up that say nothing else.
            self.charged.charge(ImageTexture(reflectance, "repeat", nearest=False), f"the material {material!r}")
        looks = tuple(dict.fromkeys([*materials.lost(material), *told]))
        part = MeshPart(
            points, uv, normals, reflectance, None, material, files, lost=looks, emission=emission, blend=blend
        )
        return masked(part, mask, self.budget)
