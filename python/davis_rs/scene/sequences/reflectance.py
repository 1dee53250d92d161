"""Finishes textures: rounds them to eight bits, and tells Mitsuba of them.

Rounded to eight bits, as the textures of :mod:`davis_rs.scene.textures`, so that they are the same on every machine.
"""

from __future__ import annotations

import numpy as np

from ...geometry.pose import FloatArray
from ..textures import Texture

Tint = tuple[float, float, float]

GREY: Tint = (1.0, 1.0, 1.0)


def finished(reflectance: FloatArray, tint: Tint = GREY) -> Texture:
    """Make RGB (H, W, 3) from grey (H, W), rounded to eight bits."""
    rgb = np.clip(reflectance[..., None] * np.array(tint), 0.0, 1.0)
    return (np.round(rgb * 255) / 255).astype(np.float32)


def between(low: float, high: float, level: FloatArray) -> FloatArray:
    """Map levels, clipped to [0, 1], to reflectances that are even in the logarithm: equal contrast in dark and
    bright."""
    return np.asarray(low * (high / low) ** np.clip(level, 0, 1))
