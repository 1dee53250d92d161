"""Shows OBJ meshes that have normals without a direction with flat faces: Mitsuba 3 refuses such normals."""

from __future__ import annotations

import mmap
import re
from pathlib import Path

from .files import SceneFile
from .former_plugin import FormerPlugin

_WITHOUT_DIRECTION = re.compile(
    rb"^vn[ \t]+(?:[-+]?(?:0+(?:\.0*)?|\.0+)(?:e[-+]?\d+)?(?:[ \t]+|(?=\r?$))){3}\r?$"  # three numbers that are 0
    rb"|^vn[ \t][^\n]*(?:nan|inf)",
    re.MULTILINE | re.IGNORECASE,
)
FLAT = "have normals without a direction, so their faces are flat"


def flatten_lost_normals(file: SceneFile, notes: list[str]) -> None:
    """Give such meshes ``face_normals``.

    Args:
        notes: gets a line, if there are any.
    """
    flat: list[str] = []
    for element in file.root.walk():
        shape = FormerPlugin(element, file)
        name = shape.get("filename") if element.tag == "shape" and shape.kind == "obj" else None
        mesh = None if name is None else file.named_by(name)
        if mesh is None or not _has_lost_normals(mesh):
            continue
        if not is_flat(shape):
            make_flat(shape)
            flat.append(mesh.name)
    if flat:
        names = ", ".join(dict.fromkeys(flat))
        notes.append(f"its meshes {names[:80]} {FLAT}")


def is_flat(shape: FormerPlugin) -> bool:
    """Return whether the faces of a mesh are flat already."""
    given = shape.get("face_normals")
    return given is not None and given.attributes.get("value") == "true"


def make_flat(shape: FormerPlugin) -> None:
    """Show the faces of a mesh flat."""
    element = shape.element
    element.children = [child for child in element.children if child.name != "face_normals"]
    element.children.append(element.child("boolean", name="face_normals", value="true"))


def _has_lost_normals(mesh: Path) -> bool:
    with mesh.open("rb") as opened:
        if not mesh.stat().st_size:
            return False
        with mmap.mmap(opened.fileno(), 0, access=mmap.ACCESS_READ) as data:
            return _WITHOUT_DIRECTION.search(data) is not None
