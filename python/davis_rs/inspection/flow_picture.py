"""Draws optical flow in colours: the direction as hue, the speed as saturation."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

_ARCS = (
    ((255, 0, 0), (255, 255, 0), 15),
    ((255, 255, 0), (0, 255, 0), 6),
    ((0, 255, 0), (0, 255, 255), 4),
    ((0, 255, 255), (0, 0, 255), 11),
    ((0, 0, 255), (255, 0, 255), 13),
    ((255, 0, 255), (255, 0, 0), 6),
)
"""(From this colour, to this colour, in this many steps). The steps are as many as the eye can tell apart."""

_MISSING = 209
"""Grey where there is no flow."""


def flow_picture(flow: npt.NDArray[np.float32], most: float) -> npt.NDArray[np.uint8]:
    """Return flow (H, W, 2) as the usual colour wheel has it, uint8 (H, W, 3): white is no motion, full colour
    ``most``.

    Vectors to the right are red, downwards yellow-green, to the left light blue, upwards violet. Grey where there is
    none.

    Source: Baker, Scharstein, Lewis, Roth, Black, Szeliski, "A Database and Evaluation Methodology for Optical Flow",
    IJCV 2011.
    """
    wheel = np.concatenate([np.linspace(first, last, steps, endpoint=False) for first, last, steps in _ARCS]) / 255
    known = np.asarray(np.isfinite(flow).all(-1))
    u, v = np.moveaxis(np.where(known[..., None], flow, 0).astype(np.float64), -1, 0)
    speed = np.minimum(np.hypot(u, v) / max(most, 1e-12), 1.0)[..., None]
    position = np.arctan2(v, u) / (2 * np.pi) % 1.0 * len(wheel)
    first = np.floor(position).astype(np.int64) % len(wheel)
    fraction = (position - np.floor(position))[..., None]
    colour = (1 - fraction) * wheel[first] + fraction * wheel[(first + 1) % len(wheel)]
    picture = np.rint(255 * (1 - speed * (1 - colour))).astype(np.uint8)
    picture[~known] = _MISSING
    return picture


def flow_wheel(side: int) -> npt.NDArray[np.uint8]:
    """Return the wheel itself, uint8 (side, side, 4): transparent outside of it."""
    axis = np.linspace(-1, 1, side)
    u, v = np.meshgrid(axis, axis)
    picture = flow_picture(np.stack([u, v], -1).astype(np.float32), 1.0)
    inside = np.where(np.hypot(u, v) <= 1, 255, 0).astype(np.uint8)
    return np.concatenate([picture, inside[..., None]], -1)
