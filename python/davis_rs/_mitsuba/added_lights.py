"""Adds lights to the elements of a scene."""

from __future__ import annotations

from .elements import Element, Ids
from .types import SceneDictionary


def add_lights(root: Element, lights: SceneDictionary) -> None:
    """Add lights to a scene.

    Args:
        root: of the scene; it is changed.
        lights: dictionaries of emitters by name, whose properties are numbers (colours) and lists of three (vectors).
    """
    ids = Ids(root)
    for name, properties in lights.items():
        light = root.child("emitter", type=properties["type"])
        for key, value in properties.items():
            if isinstance(value, float):
                light.children.append(light.child("rgb", name=key, value=repr(value)))
            elif isinstance(value, list):
                light.children.append(light.child("vector", name=key, value=", ".join(map(repr, value))))
        ids.of(light, name)
        root.children.append(light)
