"""Reads the lights of a glTF file (KHR_lights_punctual), and finds out which unit their numbers have.

The extension says lux and candela. Blender's exporter writes these, in its mode Standard. Many programs write numbers
without a unit instead (three.js, Spline, Unity, Babylon.js; Blender in its mode Unitless), in which a sun of about 3
makes white surfaces white. Taken as lux, such a sun is weaker than a street lamp, and the image is black. So where
lights, as lux and candela, hardly light anything, they are all made stronger by one factor, as a camera would be
exposed for longer.

Source: Khronos Group, KHR_lights_punctual.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..._mitsuba.types import SceneDictionary
from ...events.luma import LUMA_WEIGHTS
from ...geometry.pose import FloatArray
from .gltf_file import GltfFile, plain
from .gltf_nodes import NodeTree
from .gltf_poses import Node
from .rounding import ROUNDING
from .subject import Surfaces

LUMENS_PER_WATT = 683.0
"""Lux or candela for one unit of Mitsuba's linear light, because glTF gives lights in these. Blender's exporter uses
the same luminous efficacy, so the resulting numbers are those in Blender: watts divided by 4 pi for point lights."""

_OFF_LUX, _DIM_LUX = 1e-5, 40.0
"""Lights that make less than this on what they light best are taken as numbers without a unit. Files of the programs
above make 0.0005 to 34, lamps in a room at night 50 to 200, and the sun 100,000. Those that make less than the first
are off, and stay so."""
_BEST_LIT = 0.99
"""What lights light best: all but this fraction of the surfaces. A lamp's own shade says little."""
_EVERY = 20
"""Of the points on surfaces, one in so many is looked at."""
_HARD_EDGE = 0.999
"""Largest fraction of a spot's cone in which its light may be even: Mitsuba needs a soft edge."""

Lose = Callable[[str, str], None]
"""Notes that a look of something, by its name, is not shown."""


class PunctualLight(NamedTuple):
    """A light of a file, in the world.

    Attributes:
        name: of its node.
        kind: point, directional or spot.
        strength: (3,), RGB, in lux (directional) or candela, as the file has it.
        position: (3,), metres.
        direction: (3,), in which it shines, of unit length; of a point light, anything.
        outer_rad, inner_rad: half the angles of a spot's cone: where its light ends, and where it begins to fall off.
    """

    name: str
    kind: str
    strength: FloatArray
    position: FloatArray
    direction: FloatArray
    outer_rad: float = np.pi
    inner_rad: float = 0.0

    def lux(self, points: FloatArray) -> FloatArray:
        """Return how many lux it makes at points (n, 3), on surfaces that face it, without shadows."""
        strength = float(np.array(LUMA_WEIGHTS) @ self.strength)
        if self.kind == "directional":
            return np.full(len(points), strength)
        towards = points - self.position
        distance2 = np.maximum(np.einsum("nk,nk->n", towards, towards), 1e-12)
        inside = towards @ self.direction >= np.cos(self.outer_rad) * np.sqrt(distance2)
        return np.where(inside | (self.kind == "point"), strength / distance2, 0.0)

    def described(self, unit: float) -> SceneDictionary:
        """Describe it for Mitsuba, with this many lux or candela as one unit."""
        strength = {"type": "rgb", "value": (self.strength / unit).tolist()}
        if self.kind == "point":
            return {"type": "point", "position": self.position.tolist(), "intensity": strength}
        if self.kind == "directional":
            return {"type": "directional", "direction": self.direction.tolist(), "irradiance": strength}
        to_world = np.eye(4)
        aside = np.cross(self.direction, np.eye(3)[np.abs(self.direction).argmin()])
        aside /= np.linalg.norm(aside)
        to_world[:3, :3] = np.stack([aside, np.cross(self.direction, aside), self.direction], 1)
        to_world[:3, 3] = self.position
        return {
            "type": "spot",
            "to_world": to_world,
            "intensity": strength,
            "cutoff_angle": float(np.degrees(self.outer_rad)),
            "beam_width": float(np.degrees(min(self.inner_rad, _HARD_EDGE * self.outer_rad))),
        }


def lights_of(file: GltfFile, tree: NodeTree, to_world: FloatArray, lose: Lose) -> list[PunctualLight]:
    """Return the lights of a file's scene, where they are at first.

    Args:
        to_world: (4, 4), from the file's axes and unit to the world's.
        lose: is told what of them is not shown.
    """
    declared = _extension(file, file.document.extensions).get("lights", [])
    if not isinstance(declared, list):
        raise file.error("KHR_lights_punctual.lights", "must be a list")
    lights = []
    for node in tree.nodes.values():
        given = _extension(file, node.item.extensions)
        if "light" not in given:
            continue
        where = f"nodes[{node.index}]: KHR_lights_punctual"
        which = file.whole(given["light"], where, f"of the {len(declared)} lights", len(declared) - 1)
        if not isinstance(declared[which], dict):
            raise file.error(f"KHR_lights_punctual.lights[{which}]", "must be an object")
        if tree.moves(node.index):
            lose("the motion of the light (it stays where it is at first)", node.name)
        matrix = to_world @ tree.matrices(node.index, np.zeros(1))[0][0]
        lights.append(_light(file, declared[which], node, matrix, f"KHR_lights_punctual.lights[{which}]", lose))
    return lights


def unit_of(lights: list[PunctualLight], corners: FloatArray) -> float:
    """Return how many of the lights' numbers are one unit of linear light.

    They are those of lux and candela. If these would hardly light the triangles (m, 3, 3) of the world, they are so
    many that a white surface has luma 1 where it is lit best.
    """
    points = Surfaces.of(corners).points[::_EVERY]
    lux = np.zeros(len(points))
    for light in lights:
        lux += light.lux(points)
    best = float(np.quantile(lux, _BEST_LIT))
    return best / np.pi if _OFF_LUX < best < _DIM_LUX else LUMENS_PER_WATT


def _light(
    file: GltfFile, given: dict[str, object], node: Node, matrix: FloatArray, where: str, lose: Lose
) -> PunctualLight:
    """Return a light of a node, which the matrix (4, 4) places in the world."""
    intensity = file.numbers(given.get("intensity", 1.0), f"{where}.intensity", 1, low=0)[0]
    colour = file.numbers(given.get("color", [1, 1, 1]), f"{where}.color", 3, low=0)
    axis = -matrix[:3, 2]
    length = np.linalg.norm(axis)
    kind = given.get("type")
    if "range" in given:
        lose("the range of the light (it shines without end)", node.name)
    light = PunctualLight(node.name, str(kind), colour * intensity, matrix[:3, 3], axis)
    if kind == "point":
        return light
    if not length > 0:
        raise file.error(f"nodes[{node.index}]", "is scaled to nothing, so its light has no direction")
    light = light._replace(direction=axis / length)
    if kind == "directional":
        return light
    if kind != "spot":
        raise file.error(f"{where}.type", f"must be point, directional or spot, got {plain(kind)}")
    cone = given.get("spot", {})
    if not isinstance(cone, dict):
        raise file.error(f"{where}.spot", "must be an object")
    outer = file.numbers(cone.get("outerConeAngle", np.pi / 4), f"{where}.spot", 1, low=1e-4, high=np.pi / 2)[0]
    inner = file.numbers(cone.get("innerConeAngle", 0.0), f"{where}.spot", 1, low=0, high=np.pi / 2)[0]
    if inner > outer * (1 + ROUNDING):
        raise file.error(f"{where}.spot", f"innerConeAngle {inner:g} must be at most outerConeAngle {outer:g}")
    lose("how the spot light's edge falls off (linear in the angle here)", node.name)
    return light._replace(outer_rad=float(outer), inner_rad=float(inner))


def _extension(file: GltfFile, extensions: object) -> dict[str, object]:
    given = (extensions if isinstance(extensions, dict) else {}).get("KHR_lights_punctual", {})
    if not isinstance(given, dict):
        raise file.error("KHR_lights_punctual", "must be an object")
    return given
