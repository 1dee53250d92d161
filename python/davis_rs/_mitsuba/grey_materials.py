"""Puts grey in the place of materials that this Mitsuba does not have, if the user wants that."""

from __future__ import annotations

from collections import defaultdict
from typing import NamedTuple

from .elements import Element, Ids
from .files import SceneFile
from .plugins import is_usable
from .types import Mitsuba

GREY = 0.5
"""The reflectance."""

_NAMELESS = 0
"""Stands for an id where an element has none: no ``id()``, and no id of a file."""


class GreyMaterial(NamedTuple):
    """A material that is not known.

    Attributes:
        name: its id in the file, or its line.
        shapes: the ids of those that have it.
    """

    name: str
    shapes: tuple[str, ...]


def make_grey(file: SceneFile, mi: Mitsuba, notes: list[str]) -> list[GreyMaterial]:
    """Put grey in the place of all materials that are not known, and return them."""
    grey: list[tuple[str, Element]] = []
    for element in [element for element in file.root.walk() if element.tag == "bsdf"]:
        kind = element.attributes.get("type", "")
        if is_usable(kind, mi.ObjectType.BSDF, mi):
            continue
        name = repr(element.attributes["id"][:60]) if "id" in element.attributes else f"in line {element.line}"
        notes.append(f"its material {name} ({kind[:40]!r}, which is not known) is taken as grey")
        element.attributes["type"] = "diffuse"
        element.children = [element.child("rgb", name="reflectance", value=str(GREY))]
        grey.append((name, element))
    users, ids = _users(file.root), Ids(file.root)
    return [GreyMaterial(name, _shapes_with(element, users, ids)) for name, element in grey]


def _users(root: Element) -> dict[int | str, list[Element]]:
    """Return the materials and shapes that have each element in them, by its ``id()``, or name it, by its id."""
    users = defaultdict[int | str, list[Element]](list)
    for element in root.walk():
        if element.tag in ("bsdf", "shape"):
            for part in element.children:
                users[part.attributes.get("id", "") if part.tag == "ref" else id(part)].append(element)
    return users


def _shapes_with(material: Element, users: dict[int | str, list[Element]], ids: Ids) -> tuple[str, ...]:
    """Return the ids of the shapes that have a material, within others or by reference, in the order of the file."""
    found, waiting = {id(material): material}, [material]
    while waiting:  # materials in materials in materials
        element = waiting.pop()
        for key in (id(element), element.attributes.get("id", _NAMELESS)):
            for user in users.get(key, []):
                if id(user) not in found:
                    found[id(user)] = user
                    waiting.append(user)
    shapes = [element for element in found.values() if element.tag == "shape"]
    return tuple(ids.of(shape, "shape") for shape in sorted(shapes, key=lambda shape: (str(shape.file), shape.line)))
