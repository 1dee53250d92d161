"""What a scene's file says of how surfaces look, and the renderers do not show."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from .mesh_part import MeshPart
from .repairs import SceneFileWarning

TRANSPARENCY = "transparency"
OWN_LIGHT = "light of their own"
METAL = "metal"
BUMPS = "normal maps"
BACKS = "backs that cannot be seen (they are seen from both sides)"
"""The look of surfaces that have one side; lost only where the camera sees the other."""
_NAMED = 4
"""So many names are given in a message."""


class LostLookWarning(SceneFileWarning):
    """Looks of a scene's file are lost that a part of the image shows."""


class LostLook(NamedTuple):
    """A look that is not shown.

    Attributes:
        what: the kind of look, such as ``normal maps``.
        of: the file's names of what has it: materials, lights, nodes.
        shapes: the ids of the scene's shapes that have it; () for a look of no shape, such as a light's range.
    """

    what: str
    of: tuple[str, ...]
    shapes: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.what} of {shown(self.of)}" if self.of else self.what


def lost_looks(parts: Mapping[str, MeshPart]) -> tuple[LostLook, ...]:
    """Collect the looks that are lost of shapes, by their ids."""
    found: dict[str, tuple[dict[str, None], list[str]]] = {}
    for shape, part in parts.items():
        for what in part.lost:
            materials, shapes = found.setdefault(what, ({}, []))
            materials[part.material] = None
            shapes.append(shape)
    return tuple(
        LostLook(what, tuple(name for name in materials if name), tuple(shapes))
        for what, (materials, shapes) in found.items()
    )


def shown(names: tuple[str, ...]) -> str:
    """Return names in a message: the first few."""
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more
