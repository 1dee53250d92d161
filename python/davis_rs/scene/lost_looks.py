"""Notes how a scene's file says that surfaces look where no renderer shows it: transparency, metal, bumps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from .mesh_part import MeshPart
from .repairs import SceneFileWarning

TRANSPARENCY = "transparency"
SOFT = "soft transparency (it is cut where it is half opaque)"
NO_MASK = "alpha of colours' textures (what it would hide is drawn, so it is not taken as a mask)"
OWN_LIGHT = "light of their own"
MEAN_EMISSION = "light of their own that differs from place to place (its mean is taken)"
METAL = "metal"
HIGHLIGHTS = "highlights"
MIRRORS = "mirrors and glass (illum 3 to 9)"
BUMPS = "normal maps"
SHEEN = "sheen (a Mitsuba XML file has a weaker one, as the sheen of principled)"
UNKNOWN = "materials that are not known, and grey here"
UNPLACED = "textures of surfaces without texture coordinates (their mean colour is shown)"
MISSING = "textures that are missing (the surfaces are grey)"
MISSING_NUMBERS = "textures of normals, metal, roughness or own light that are missing (they are left out)"
BRUSHED = "anisotropy (only that of numbers is shown, along a texture coordinate, without colours of vertices)"
BACKS = "backs that cannot be seen (they are seen from both sides)"
"""The look of one-sided surfaces; lost only where the camera sees the other side, which the native renderer culls."""
_NAMED = 4
"""How many names a message gives."""


class LostLookWarning(SceneFileWarning):
    """Warns that a part of the image shows shapes whose look in the scene's file is lost."""


class LostLook(NamedTuple):
    """Names a kind of look that no renderer shows, and what has it.

    Attributes:
        what: the kind of look, such as ``normal maps``.
        of: the names in the file of the materials, lights or nodes that have it.
        shapes: the ids of the scene's shapes that have it; () for a look of no shape, such as a light's range.
    """

    what: str
    of: tuple[str, ...]
    shapes: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.what} of {shown(self.of)}" if self.of else self.what


def lost_looks(parts: Mapping[str, MeshPart]) -> tuple[LostLook, ...]:
    """Collect the lost looks of parts, which are given by the ids of their shapes."""
    by_kind: dict[str, tuple[dict[str, None], list[str]]] = {}
    for shape, part in parts.items():
        for look in (*part.lost, BACKS) if part.one_sided else part.lost:
            materials, shapes = by_kind.setdefault(look, ({}, []))
            materials[part.material] = None
            shapes.append(shape)
    return tuple(
        LostLook(look, tuple(name for name in materials if name), tuple(shapes))
        for look, (materials, shapes) in by_kind.items()
    )


def shown(names: tuple[str, ...]) -> str:
    """Join names for a message: the first few, and how many more there are."""
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more
