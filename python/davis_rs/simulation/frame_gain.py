"""Chooses the gain of the 8-bit frames of a run by what its camera sees along the whole path."""

from __future__ import annotations

import numpy as np

from ..geometry.trajectory.trajectory import Trajectory
from ..geometry.trajectory.views import Views
from ..io.dataset.writer import image_gain_for
from .simulator import Simulator

_VIEWS, _PIXELS = 16, 256
"""So many pixels are looked up in each of so many views."""
_GOLDEN = (np.sqrt(5) - 1) / 2
"""Multiples of it, without their whole part, are spread evenly."""


def path_image_gain(simulator: Simulator, path: Trajectory) -> float | None:
    """Return the image gain at which few pixels of the frames are white, wherever the camera looks on its path.

    By the first frame alone, which may look at a dark corner, others would be burnt out. On slow worlds this takes less
    than a frame does.

    Returns:
        None where effects make the frames, which then decide.
    """
    if simulator.custom_effects or simulator.effects.aps is not None:
        return None
    count = _VIEWS * _PIXELS
    view = np.repeat(np.arange(_VIEWS), _PIXELS)
    spread = (np.arange(count) * _GOLDEN) % 1
    pixel = (spread * simulator.camera.width * simulator.camera.height).astype(np.int64)
    views = Views.along(path, (np.arange(_VIEWS) + 0.5) / _VIEWS * path.duration_s)
    return image_gain_for(simulator.renderer.samples(views, view, pixel))
