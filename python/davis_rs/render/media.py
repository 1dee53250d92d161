"""Reads what light goes through within shapes: media that absorb it, which are rendered without noise, and others.

A homogeneous medium that scatters nothing leaves the fraction exp(-absorption x length) of light (Beer's law): coloured
glass, water or wine.
"""

from __future__ import annotations

import numpy as np

from .._mitsuba.types import MitsubaMedium, MitsubaScene, MitsubaShape
from .diffuse_materials import nested_objects
from .finish import Rgb
from .number_textures import rgb_of


def absorption_within(shape: MitsubaShape) -> Rgb | None:
    """Return how much light is absorbed within a shape, RGB, per unit of length; None where its media do more.

    A shape without media absorbs nothing.
    """
    if not shape.is_medium_transition():
        return 0.0, 0.0, 0.0
    return None if shape.exterior_medium() is not None else _absorption(shape.interior_medium())


def has_media(scene: MitsubaScene) -> bool:
    """Return whether light goes through media, such as fog, milk or wine."""
    return _camera_is_in_medium(scene) or any(shape.is_medium_transition() for shape in scene.shapes())


def has_more_than_absorption(scene: MitsubaScene) -> bool:
    """Return whether light goes through media that do more than to absorb it within shapes."""
    return _camera_is_in_medium(scene) or any(absorption_within(shape) is None for shape in scene.shapes())


def _camera_is_in_medium(scene: MitsubaScene) -> bool:
    import mitsuba as mi

    around = (nested for sensor in scene.sensors() for nested in nested_objects(sensor))
    return any(isinstance(nested, mi.Medium) for nested in around)


def _absorption(medium: MitsubaMedium) -> Rgb | None:
    import mitsuba as mi

    parameters = mi.traverse(medium)
    known = {"albedo.value.value", "sigma_t.value.value", "scale"} <= set(parameters.keys())
    if medium.class_name() != "HomogeneousMedium" or not known or np.any(np.array(parameters["albedo.value.value"])):
        return None
    extinction = np.array(parameters["sigma_t.value.value"], np.float64) * float(parameters["scale"])
    return rgb_of(extinction)
