"""Leaves out shapes at which nothing happens to light.

A surface of Mitsuba's ``null`` material lets all light pass. Where it bounds no medium and emits nothing, only shadow
rays of some integrators see it.
"""

from __future__ import annotations

from .elements import Element
from .files import SceneFile

_SEEN = ("medium", "emitter", "sensor")
"""What makes a surface count, whatever its material is."""


def drop_null_surfaces(file: SceneFile, notes: list[str]) -> None:
    """Leave out the scene's shapes of ``null`` that bound no medium and emit nothing.

    Args:
        notes: gets a line that says how many.
    """
    children = file.root.children
    file.root.children = [child for child in children if not _is_nothing(child, file)]
    dropped = len(children) - len(file.root.children)
    if dropped:
        notes.append(f"{dropped} of its shapes let all light pass ('null'), and are left out")


def _is_nothing(shape: Element, file: SceneFile) -> bool:
    if shape.tag != "shape":
        return False
    parts = [file.resolved(part) for part in shape.children]
    materials = [part.attributes.get("type") for part in parts if part.tag == "bsdf"]
    return materials == ["null"] and not any(part.tag in _SEEN or part.tag == "ref" for part in parts)
