"""Makes parts of the built-in scenes: rectangles, the axes of a camera, and the pose from which it starts."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .._mitsuba.types import SceneDictionary
from ..geometry.pose import FloatArray, Pose
from .textures import patchwork

DIRECT = {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}
"""An integrator of direct light that samples the lights, never the surfaces."""

GLOSSY_DIRECT = {"type": "direct"}
"""The same for scenes with glossy surfaces, which show lights and skies."""


def rectangle(
    centre: list[float], axes: FloatArray, half: tuple[float, float], reflectance: SceneDictionary | float
) -> SceneDictionary:
    """Make a diffuse rectangle of two triangles, seen from both sides.

    Args:
        axes: columns are its own x, y and normal in the world.
        half: its half-sides along x and y, metres.
        reflectance: a texture, or grey.
    """
    to_world = np.eye(4)
    to_world[:3, :3] = axes * (half[0], half[1], 1.0)
    to_world[:3, 3] = centre
    if isinstance(reflectance, float):
        reflectance = {"type": "rgb", "value": reflectance}
    bsdf = {"type": "twosided", "nested": {"type": "diffuse", "reflectance": reflectance}}
    return {"type": "rectangle", "to_world": to_world, "bsdf": bsdf}


def textured_rectangle(
    centre: list[float],
    axes: FloatArray,
    half: tuple[float, float],
    *,
    seed: int,
    period: float,
    darkest: float,
    shapes: int,
) -> SceneDictionary:
    """Make a :func:`rectangle` whose texture repeats every ``period`` metres.

    Its reflectance is at least ``darkest``, and it shows ``shapes`` hard-edged shapes.
    """
    texture = {
        "type": "bitmap",
        "raw": True,
        "wrap_mode": "repeat",
        "data": patchwork(512, seed, low=darkest, high=0.98, grain=0.5, shapes=shapes, tint=(1.0, 0.97, 0.92)),
        "to_uv": np.diag([2 * half[0] / period, 2 * half[1] / period, 1.0]),
    }
    return rectangle(centre, axes, half, texture)


def look_at(position: FloatArray, target: FloatArray) -> FloatArray:
    """Return the axes (columns x right, y down, z forward) of a camera that looks at a target, with the world's
    z up."""
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, [0.0, 0, 1])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(forward, right), forward], 1)


def start_looking_at(position: npt.ArrayLike, target: npt.ArrayLike) -> Pose:
    """Return the pose of an upright camera at a point that looks at another."""
    from scipy.spatial.transform import Rotation

    start, end = np.asarray(position, np.float64), np.asarray(target, np.float64)
    return Pose(start, Rotation.from_matrix(look_at(start, end)).as_quat())
