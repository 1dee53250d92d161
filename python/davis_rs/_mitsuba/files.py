"""Reads scene files, and checks them before Mitsuba does.

Mitsuba ends the process at XML that is nested too deeply, at a blend without materials, and at a PLY mesh whose faces
name missing vertices; it decodes images of any size, and loads a plug-in from any path.
"""

from __future__ import annotations

import functools
import os
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .._core import DecodeError
from .._util.budget import Budget
from .._util.untrusted import decoding, regular_file
from .elements import DEEPEST, Element, elements_by_id, read_elements, with_values
from .ply_mesh import check_ply
from .types import SceneDictionary

_MOST_INCLUDED = 15
_TEXEL_BYTES = 16
"""Bytes per texel of an image: as Mitsuba holds it, and as a renderer does."""


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
