"""Reads scene files, and checks them before Mitsuba does.

Mitsuba ends the process at XML that is nested too deeply, at a blend without materials, and at a PLY mesh whose faces
name missing vertices; it decodes images of any size, and loads a plug-in from any path.
"""

from __future__ import annotations

import functools
import os
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from .._core import DecodeError
from .._util.budget import Budget
from .._util.untrusted import decoding, read_charged, regular_file
from .elements import DEEPEST, Element, elements_by_id, read_elements, with_values
from .types import SceneDictionary

_MOST_INCLUDED = 15
_TEXEL_BYTES = 16
"""Bytes per texel of an image: as Mitsuba holds it, and as a renderer does."""

_DTYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_FACES = ("vertex_index", "vertex_indices")


@dataclass(frozen=True)
class XmlFile:
    """A Mitsuba XML file with values for its variables.

    Attributes:
        path: of the file.
        variables: a value for each ``$name``, as text. They come before the file's own defaults.
        grey_unknown: materials that Mitsuba does not have are grey; else the file is refused.
        lights: emitters to add, by name, see :func:`~davis_rs._mitsuba.added_lights.add_lights`.
    """

    path: Path
    variables: Mapping[str, str]
    grey_unknown: bool = False
    lights: SceneDictionary = field(default_factory=dict)


@dataclass(frozen=True)
class SceneFile:
    """A Mitsuba XML file that was read and checked.

    Attributes:
        root: its elements; those of files that it includes stand in their places.
        roots: the first element of each file, as it was in the file.
        values: of its variables, those that were given and the defaults.
        including: names of files that were included, as the files have them, with variables.
    """

    root: Element
    roots: list[Element]
    values: dict[str, str]
    including: list[str]

    def with_values(self, text: str) -> str:
        """Return a text with values in the place of its variables."""
        return with_values(text, self.values)

    def named_by(self, element: Element) -> Path | None:
        """Return the file that the value of an element names; None where it is not there."""
        name = self.with_values(element.attributes.get("value", ""))
        return _found(name, (element.file.parent, self.roots[0].file.parent))

    def resolved(self, element: Element) -> Element:
        """Return what a ``ref`` names; any other element, and a ``ref`` to nothing or to itself, as it is."""
        found, passed = element, set[int]()
        while found.tag == "ref" and id(found) not in passed:
            passed.add(id(found))
            found = self._by_id.get(found.attributes.get("id", ""), found)
        return found

    @functools.cached_property
    def _by_id(self) -> dict[str, Element]:
        return elements_by_id(self.root)


def read_scene_file(file: XmlFile, budget: Budget | None = None) -> SceneFile:
    """Read an XML file and those that it includes, and check the PLY meshes and images that they name.

    Args:
        budget: what all files together may take; a new one if not given.

    Raises:
        OSError: if the file cannot be read.
        DecodeError: for XML that is malformed or nested too deeply, for a mesh that is malformed, for plug-ins that are
            paths, and where elements or images would fill memory.
    """
    return _Reader(file, budget or Budget(file.path)).read()


class _Reader:
    """Reads a file, puts those that it includes in their places, and checks what they name."""

    def __init__(self, file: XmlFile, budget: Budget) -> None:
        self._file, self._budget = file, budget
        self._values = dict(file.variables)
        self._roots: list[Element] = []
        self._including: list[str] = []

    def read(self) -> SceneFile:
        """Read all."""
        root = self._root(self._file.path, 0)
        self._settle(root, 1, 0)
        return SceneFile(root, self._roots, self._values, self._including)

    def _root(self, path: Path, included: int) -> Element:
        if included > _MOST_INCLUDED:
            raise DecodeError(f"{path}: scene files may include each other {_MOST_INCLUDED} deep")
        root = read_elements(path, self._budget)
        self._roots.append(root)
        return root

    def _settle(self, element: Element, depth: int, included: int) -> None:
        """Check the files that elements name, and put the contents of others in the place of ``include``."""
        if depth > DEEPEST:
            raise DecodeError(f"{element.place}: elements may be nested {DEEPEST} deep")
        children: list[Element] = []
        for child in element.children:
            attributes = child.attributes
            if child.tag == "default":
                self._values.setdefault(attributes.get("name", ""), attributes.get("value", ""))
            elif child.tag in ("string", "path") and attributes.get("name") == "filename":
                self._check(child)
            other = self._found(child, attributes.get("filename", "")) if child.tag == "include" else None
            if other is None:
                self._settle(child, depth + 1, included)
                self._check_plugin(child)
                children.append(child)
                continue
            self._including.append(attributes["filename"])
            root = self._root(other, included + 1)
            self._settle(root, depth, included + 1)
            if root.tag == "scene":
                children += root.children
                continue
            if "name" in attributes:
                root.attributes["name"] = attributes["name"]
            children.append(root)
        element.children = children

    def _check_plugin(self, element: Element) -> None:
        """Refuse what would load a library from elsewhere, or end the process."""
        kind = with_values(element.attributes.get("type", ""), self._values)
        if "/" in kind or "\\" in kind:
            raise DecodeError(f"{element.place}: must name a plug-in of Mitsuba, got the path {kind[:60]!r}")
        if kind == "blendbsdf" and sum(child.tag in ("bsdf", "ref") for child in element.children) < 2:
            raise DecodeError(f"{element.place}: a blendbsdf must have two materials")

    def _check(self, element: Element) -> None:
        named = self._found(element, element.attributes.get("value", ""))
        if named is not None and named.suffix.lower() == ".ply":
            check_ply(named, self._budget)
        elif named is not None:
            _charge_image(named, self._budget)

    def _found(self, element: Element, name: str) -> Path | None:
        """Return the file that an element names; None where it is not there: Mitsuba says so, or has it elsewhere."""
        return _found(with_values(name, self._values), (element.file.parent, self._file.path.parent))


def _found(name: str, folders: tuple[Path, ...]) -> Path | None:
    for folder in folders:
        for spelled in (name, name.replace("\\", "/")):  # as files from Windows have it, see `former_notation`
            if spelled and os.path.isfile(folder / spelled):  # False for what can be no name
                return folder / spelled
    return None


def _charge_image(path: Path, budget: Budget) -> None:
    """Charge a budget for an image by its header; files that Pillow and OpenEXR do not know are left to Mitsuba."""
    from PIL import Image, UnidentifiedImageError

    width = height = 0
    if path.suffix.lower() == ".exr":
        import OpenEXR

        with decoding(path), OpenEXR.File(os.fspath(regular_file(path)), header_only=True) as file:
            low, high = (np.asarray(corner, np.int64) for corner in file.header()["dataWindow"])
        width, height = (high - low + 1).tolist()
    else:
        with warnings.catch_warnings(), decoding(path):
            warnings.simplefilter("ignore")  # of Pillow's own limit, which the budget replaces
            try:
                with Image.open(regular_file(path)) as image:
                    width, height = image.size
            except UnidentifiedImageError:
                return
    budget.take(_TEXEL_BYTES * width * height, f"the image {path} of {width} x {height} texels")


def check_scene_dictionary(node: Mapping[str, object]) -> None:
    """Check the PLY meshes that a scene dictionary names.

    Raises:
        DecodeError: for a mesh that is malformed.
    """
    name = node.get("filename")
    if node.get("type") == "ply" and isinstance(name, str | Path) and Path(name).is_file():
        check_ply(Path(name), Budget(name))
    for value in node.values():
        if isinstance(value, Mapping):
            check_scene_dictionary(value)


def check_ply(path: Path, budget: Budget) -> None:
    """Refuse a PLY mesh whose faces name missing vertices.

    Raises:
        OSError: if it cannot be read.
        DecodeError: if it is malformed.
    """
    data = read_charged(path, budget)
    with decoding(path, "PLY"):
        form, elements, begin = _header(data)
        count = {name: number for name, number, _ in elements}.get("vertex", 0)
        if form == "ascii":
            indices = _ascii_indices(data[begin:].split(), elements)
        else:
            indices = _binary_indices(memoryview(data)[begin:], elements, "<" if "little" in form else ">")
        for block in indices:
            if len(block) and not (int(block.min()) >= 0 and int(block.max()) < count):
                wrong = block[(block < 0) | (block >= count)][0]
                raise ValueError(f"a face names vertex {wrong} of {count}")


_Elements = list[tuple[str, int, list[list[str]]]]


def _header(data: bytes) -> tuple[str, _Elements, int]:
    """Parse the header: format; name, number and properties of the elements; and where they begin."""
    end = data.find(b"end_header")
    if not data.startswith(b"ply") or end < 0:
        raise ValueError("it must begin with 'ply', and its header must end")
    begin = data.index(b"\n", end) + 1
    form, elements = "", _Elements()
    for line in data[:end].decode("ascii").splitlines():
        words = line.split()
        if words[:1] == ["format"]:
            form = words[1]
        elif words[:1] == ["element"]:
            number = int(words[2])
            if not 0 <= number <= len(data):  # each takes a byte at least
                raise ValueError(f"there are not {number} of {words[1]}")
            elements.append((words[1], number, []))
        elif words[:1] == ["property"]:
            elements[-1][2].append(words[1:])
    return form, elements, begin


def _ascii_indices(words: list[bytes], elements: _Elements) -> Iterator[npt.NDArray[np.int64]]:
    at = 0
    for _, number, properties in elements:
        for _ in range(number):
            for entry in properties:
                length = 1
                if entry[0] == "list":
                    length, at = int(words[at]), at + 1
                if at + length > len(words) or length < 0:
                    raise ValueError("it ends before its elements do")
                if entry[0] == "list" and entry[-1] in _FACES:
                    yield np.array(words[at : at + length], np.int64)
                at += length


def _binary_indices(data: memoryview, elements: _Elements, order: str) -> Iterator[npt.NDArray[np.int64]]:
    at = 0
    for _, number, properties in elements:
        if all(entry[0] != "list" for entry in properties):
            at += number * sum(np.dtype(_DTYPES[entry[0]]).itemsize for entry in properties)
            continue
        rows = _equal_rows(data[at:], number, properties, order)
        if rows is not None:
            at += rows.nbytes
            for k, entry in enumerate(properties):
                if entry[0] == "list" and entry[-1] in _FACES:
                    yield rows[f"values{k}"].ravel().astype(np.int64)
            continue
        for _ in range(number):
            for entry in properties:
                length, kind = 1, entry[0]
                if entry[0] == "list":
                    count = np.dtype(order + _DTYPES[entry[1]])
                    length, kind, at = int(np.frombuffer(data, count, 1, at)[0]), entry[2], at + count.itemsize
                dtype = np.dtype(order + _DTYPES[kind])
                if length < 0:
                    raise ValueError(f"a list of {length} values")
                values = np.frombuffer(data, dtype, length, at) if length else np.zeros(0, dtype)
                if entry[0] == "list" and entry[-1] in _FACES:
                    yield values.astype(np.int64)
                at += values.nbytes


def _equal_rows(data: memoryview, number: int, properties: list[list[str]], order: str) -> npt.NDArray[np.void] | None:
    """Read the rows as one array if each list is as long as in the first row, as triangles are; else return None."""
    fields: list[tuple[str, str | np.dtype[np.generic]] | tuple[str, str, tuple[int]]] = []
    at = 0
    for k, entry in enumerate(properties):
        if entry[0] != "list":
            fields.append((f"value{k}", order + _DTYPES[entry[0]]))
        elif number:
            count = np.dtype(order + _DTYPES[entry[1]])
            length = int(np.frombuffer(data, count, 1, at)[0])
            if not 0 <= length < 1 << 16:
                return None
            fields += [(f"count{k}", count), (f"values{k}", order + _DTYPES[entry[2]], (length,))]
        else:
            fields.append((f"values{k}", order + _DTYPES[entry[2]], (0,)))
        at = np.dtype(fields).itemsize
    dtype = np.dtype(fields)
    if number * dtype.itemsize > len(data):
        return None
    rows = np.frombuffer(data, dtype, number)
    equal = all((rows[name] == rows[name][:1]).all() for name, *_ in fields if name.startswith("count"))
    return rows if equal else None
