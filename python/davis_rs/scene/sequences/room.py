"""Makes a plain closed room, so that a camera sees a surface everywhere, with lights and boxes."""

from __future__ import annotations

import numpy as np

from ..._mitsuba.types import SceneDictionary
from ...geometry.pose import FloatArray
from ..parts import rectangle
from ..textures import Texture, bitmap

LUX_PER_LUMA = 1000.0
"""Lux per unit of luma in rooms: white paper under 500 lux has luma 0.5."""

_X, _Y, _Z = np.eye(3)

FACING, SIDEWAYS, UPWARDS = np.stack([_X, _Z, -_Y], 1), np.stack([_Y, _Z, _X], 1), np.eye(3)
"""Axes of a rectangle that faces a camera looking along y, along x, and down."""


def empty_room(
    x: tuple[float, float],
    y: tuple[float, float],
    height: float,
    *,
    walls: float = 0.7,
    floor: SceneDictionary | float = 0.3,
    ceiling: float = 0.8,
) -> SceneDictionary:
    """Make four walls, a floor at z = 0 and a ceiling, from ``x[0]`` to ``x[1]`` and so on, with these reflectances.

    The walls differ a little, as the light on them does in a real room, so that corners are seen.
    """
    (x0, x1), (y0, y1) = x, y
    middle = np.array([(x0 + x1) / 2, (y0 + y1) / 2, height / 2])
    # Sides overlap at the corners: no ray slips through.
    half = np.array([(x1 - x0) / 2, (y1 - y0) / 2, height / 2]) + 0.01
    sides: list[tuple[str, int, float, FloatArray, tuple[float, float], SceneDictionary | float]] = [
        ("left_wall", 0, x0, SIDEWAYS, (half[1], half[2]), 0.9 * walls),
        ("right_wall", 0, x1, SIDEWAYS, (half[1], half[2]), 0.8 * walls),
        ("front_wall", 1, y1, FACING, (half[0], half[2]), walls),
        ("back_wall", 1, y0, FACING, (half[0], half[2]), 0.85 * walls),
        ("floor", 2, 0.0, UPWARDS, (half[0], half[1]), floor),
        ("ceiling", 2, height, UPWARDS, (half[0], half[1]), ceiling),
    ]
    shapes = {}
    for name, axis, position, axes, halves, reflectance in sides:
        centre = middle.copy()
        centre[axis] = position
        shapes[name] = rectangle(centre.tolist(), axes, halves, reflectance)
    return shapes


def covered_box(centre: FloatArray, size: FloatArray, turn: float, cover: Texture | float) -> SceneDictionary:
    """Make an upright box of this size (3,), metres, turned about the vertical (radians): each side shows its
    cover."""
    cos, sin = np.cos(turn), np.sin(turn)
    to_world = np.eye(4)
    to_world[:3, :3] = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]) * size / 2
    to_world[:3, 3] = centre
    reflectance = {"type": "rgb", "value": cover} if isinstance(cover, float) else bitmap(cover)
    # Closed: its inside is never seen.
    return {"type": "cube", "to_world": to_world, "bsdf": {"type": "diffuse", "reflectance": reflectance}}


def point_light(position: tuple[float, float, float], lux: float, distance_m: float) -> SceneDictionary:
    """Make a point light that gives ``lux`` on a surface that faces it from ``distance_m``."""
    intensity = np.pi * distance_m**2 * lux / LUX_PER_LUMA
    return {"type": "point", "position": list(position), "intensity": float(intensity)}


def general_light(lux: float) -> SceneDictionary:
    """Make light from all directions that gives ``lux`` on any surface, like what a room's walls and windows scatter.

    It stands for light that was reflected often, so nothing shades it: only the table kernel and the native
    renderer, which take constant light as unoccluded, show it within closed walls. A scene with it is ``ambient``.
    """
    return {"type": "constant", "radiance": lux / LUX_PER_LUMA}
