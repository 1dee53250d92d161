"""Writes the skies of older versions of Mitsuba as those of Mitsuba 3.

Older versions have y up and -z to the north where Mitsuba 3 has z up and x to the north, a ``sky`` and a ``sun`` of
their own, and a factor on the sun's radius in place of its aperture.
"""

from __future__ import annotations

from .files import SceneFile
from .former_notation import FORMER
from .former_plugin import FormerPlugin

_AXES = "0 -1 0 0  0 0 1 0  -1 0 0 0  0 0 0 1"
"""From the axes of Mitsuba 3's sky to those of older versions."""

_APERTURE = 0.5358
"""Of the sun, in degrees, as older versions have it."""

_LEAST = 0.05
"""The least factor on the sun's radius. Older versions take 0 as a sun without any."""

_NOT_LIGHT = ("resolution", "sampling_weight")
"""Properties that say how light is computed."""


def translate_lights(file: SceneFile, notes: list[str]) -> None:
    """Write the skies of a scene as those of Mitsuba 3, if the file is of an older version.

    Args:
        notes: gets a line for each kind of sky.
    """
    if file.root.attributes.get("version") != FORMER:
        return
    for element in file.root.walk():
        if element.tag == "emitter" and element.attributes.get("type") in ("sunsky", "sky", "sun"):
            _sky(FormerPlugin(element, file), notes)


def _sky(light: FormerPlugin, notes: list[str]) -> None:
    kind, radius = light.kind, light.number("sun_radius_scale", 1.0)
    if radius is None:
        return
    scale = {} if kind == "sunsky" else {"scale": f"{kind}_scale"}
    light.becomes("sunsky", (*_NOT_LIGHT, "sun_radius_scale"), **scale)
    if kind != "sunsky":
        light.put(**{"sun_scale" if kind == "sky" else "sky_scale": 0.0})
    light.put(sun_aperture=_APERTURE * max(radius, _LEAST))
    transform = light.get("to_world")
    if transform is None:
        transform = light.element.child("transform", name="to_world")
        light.element.children.append(transform)
    transform.children.insert(0, transform.child("matrix", value=_AXES))
    notes.append(f"its light {kind!r} is taken as the 'sunsky' of Mitsuba 3, whose sky and sun are by newer models")
