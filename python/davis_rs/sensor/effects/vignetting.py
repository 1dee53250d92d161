"""Defines the effect of vignetting: a lens gives less light to the corners of its image than to the middle."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...events.luma import LumaFrames
from ...geometry.camera import Camera
from ...render.rays.camera_rays import pixel_centres
from .effect import Effect, Where, check_range


@dataclass(frozen=True)
class Vignetting(Effect):
    """Luma times cos(theta)^exponent, theta the angle between a pixel's undistorted ray and the optical axis.

    Args:
        exponent: 4 is the natural fall-off of a lens without mechanical vignetting: two powers for the distance to the
            image plane, one each for the light's slant on the aperture and on the sensor. More stands for a lens that
            also clips oblique light, 0 for none.

    Raises:
        ValueError: for an exponent that is negative or not finite.

    Source: Gardner, "Validity of the cosine-fourth-power law of illumination", J. Res. NBS 39 (1947), RP1824, with the
    angle in object space, as here.
    """

    exponent: float = 4.0

    name: ClassVar[str] = "vignetting"
    acts_on: ClassVar[Where] = "luma"

    def __post_init__(self) -> None:
        check_range("vignetting exponent", self.exponent, 0.0, math.inf)

    @property
    def neutral(self) -> bool:
        return self.exponent == 0

    def gain(self, camera: Camera) -> LumaFrames:
        """Return the factor of each pixel (H, W), float32: that of its centre; 1 on the axis."""
        squared_tangent = (camera.rays(pixel_centres(camera)) ** 2).sum(-1)
        gain = (1 + squared_tangent) ** (-self.exponent / 2)
        return gain.astype(np.float32).reshape(camera.height, camera.width)
