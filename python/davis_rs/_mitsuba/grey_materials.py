"""Puts grey in the place of materials that this Mitsuba does not have, if the user wants that."""

from __future__ import annotations

from typing import NamedTuple

from .elements import Element
from .files import SceneFile
from .plugins import is_usable
from .types import Mitsuba

GREY = 0.5
"""The reflectance."""


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
    return [GreyMaterial(name, _shapes_with(element, file.root)) for name, element in grey]


def _shapes_with(material: Element, root: Element) -> tuple[str, ...]:
    """Return the ids of the shapes that have a material, within others or by reference."""
    everything = list(root.walk())
    having, ids = {id(material)}, {material.attributes.get("id")} - {None}
    count = 0
    while len(having) > count:  # materials in materials in materials
        count = len(having)
        for element in everything:
            if element.tag not in ("bsdf", "shape"):
                continue
            if any(
                id(part) in having or (part.tag == "ref" and part.attributes.get("id") in ids)
                for part in element.children
            ):
                having.add(id(element))
                ids |= {element.attributes.get("id")} - {None}
    taken = root.ids()
    return tuple(each.named("shape", taken) for each in everything if each.tag == "shape" and id(each) in having)
