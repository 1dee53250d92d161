"""Finds out before a run how much of what its camera sees is dark: there are no events there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._util.progress import doing
from .._util.quantities import percent
from ..geometry.trajectory.trajectory import Trajectory
from ..render.base import Renderer
from .followed_pixels import luma_of_pixels, spread_pixels

TOLD = 0.8
"""Less of the image in the dark is not told: skies of night are black."""

_PIXELS, _INSTANTS = 300, 3


@dataclass(frozen=True)
class Darkness:
    """Says how much of the image is dark.

    Attributes:
        share: the fraction of the image, a mean over the path.
        luma: what is darker than this is dark.
    """

    share: float
    luma: float

    def __str__(self) -> str:
        return (
            f"{percent(self.share)} of the image is dark (luma below {self.luma:g}), and has no events: the scene's "
            "lights do not reach what the camera sees there (a file without lights gets a sun and a sky)"
        )


def estimate_darkness(renderer: Renderer, trajectory: Trajectory, *, log_eps: float) -> Darkness | None:
    """Estimate how much of the image is darker than ``log_eps``, on some pixels at the path's start, middle and end;
    None for less than :data:`TOLD`."""
    doing("looking for light")
    t_us = np.unique(np.linspace(0.0, trajectory.duration_s * 1e6, _INSTANTS).round().astype(np.int64))
    size = renderer.camera.width * renderer.camera.height
    luma = luma_of_pixels(renderer, trajectory, t_us, spread_pixels(size, min(_PIXELS, size)))
    share = float(np.mean(luma < log_eps))
    return Darkness(share, log_eps) if share >= TOLD else None
