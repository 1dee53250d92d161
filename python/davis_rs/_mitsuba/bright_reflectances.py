"""Scales colours that reflect more light than comes, which Mitsuba 3 refuses, as Mitsuba 0.6 does."""

from __future__ import annotations

import re

from .elements import Element
from .files import SceneFile
from .former_plugin import FormerPlugin

_BRIGHTEST = 0.99
"""What the brightest channel of such a colour is then; it is that of Mitsuba 0.6."""
_NAME = re.compile(r"\w*(reflectance|transmittance)|base_color|color[01]")
"""Names of colours that are fractions of light, in materials and in their textures."""


def dim_reflectances(file: SceneFile, notes: list[str]) -> None:
    """Scale them, in all that is no light.

    Args:
        notes: gets a line, if there are any.
    """
    most = max(_dimmed(file.root, file), default=0.0)
    if most:
        notes.append(f"reflectances above 1 (up to {most:g}) are scaled to {_BRIGHTEST}, as in Mitsuba 0.6")


def _dimmed(around: Element, file: SceneFile) -> list[float]:
    """Scale the colours in an element, and return the highest channel of each."""
    plugin, found = FormerPlugin(around, file), list[float]()
    for child in list(around.children):
        if child.tag in ("rgb", "spectrum") and _NAME.fullmatch(child.name):
            colour = plugin.numbers(child.name, 0.0)
            if colour is not None and colour.max() > 1:
                plugin.put(**{child.name: colour * (_BRIGHTEST / colour.max())})
                found.append(float(colour.max()))
        elif child.tag != "emitter":
            found += _dimmed(child, file)
    return found
