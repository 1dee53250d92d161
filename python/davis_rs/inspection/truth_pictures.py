"""Turns maps of the ground truth into pictures: depth, shapes and surface normals."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

_GREY = 0.82
"""Where there is nothing, or a shape without a number."""

HIDDEN = (0.84, 0.15, 0.16)
"""Where the second camera of a pair does not see what the first one does."""

_VIRIDIS = np.array(
    [
        (68, 1, 84),
        (72, 24, 106),
        (71, 45, 123),
        (66, 64, 134),
        (59, 82, 139),
        (51, 99, 141),
        (44, 114, 142),
        (38, 130, 142),
        (33, 145, 140),
        (31, 160, 136),
        (40, 174, 128),
        (63, 188, 115),
        (94, 201, 98),
        (132, 212, 75),
        (173, 220, 48),
        (216, 226, 25),
        (253, 231, 37),
    ]
)
"""Seventeen colours of Matplotlib's map of that name, at even distances: a page must not need Matplotlib."""

_SHAPES = np.array(
    [
        (31, 119, 180),
        (174, 199, 232),
        (255, 127, 14),
        (255, 187, 120),
        (44, 160, 44),
        (152, 223, 138),
        (214, 39, 40),
        (255, 152, 150),
        (148, 103, 189),
        (197, 176, 213),
        (140, 86, 75),
        (196, 156, 148),
        (227, 119, 194),
        (247, 182, 210),
        (127, 127, 127),
        (199, 199, 199),
        (188, 189, 34),
        (219, 219, 141),
        (23, 190, 207),
        (158, 218, 229),
    ]
)
"""Matplotlib's ``tab20``."""

_SHADES = 15
"""Shades of each of them along red, green and blue, so that even 65,535 shapes have different colours."""


def depth_picture(depth: npt.NDArray[np.float32], least: float, most: float) -> npt.NDArray[np.float64]:
    """Return depth (H, W) as colours (H, W, 3), 0 to 1: yellow at ``least``, violet at ``most``, grey for none."""
    known = np.isfinite(depth)
    away = np.clip((np.where(known, depth, most) - least) / max(most - least, 1e-12), 0, 1)
    stops = np.linspace(0, 1, len(_VIRIDIS))
    picture = np.stack([np.interp(1 - away, stops, channel / 255) for channel in _VIRIDIS.T], -1)
    return np.where(known[..., None], picture, _GREY)


def shape_colours(count: int) -> npt.NDArray[np.float64]:
    """Return the colours (1 + count, 3) of a mask's numbers, 0 to 1: grey for 0.

    They are multiples of 1 / 255. After 20 they are nearly the same again, but no two are equal.
    """
    again, which = np.divmod(np.arange(count), len(_SHAPES))
    shades = np.stack([again, again // _SHADES, again // _SHADES**2], -1) % _SHADES
    colours = _SHAPES[which]
    return np.concatenate([[[_GREY] * 3], np.where(colours < 128, colours + shades, colours - shades) / 255])


def normals_picture(normals: npt.NDArray[np.float32]) -> npt.NDArray[np.float64]:
    """Return normals (H, W, 3) in camera axes as colours, 0 to 1: red to the right, green up, blue to the camera."""
    # Towards the camera is -z: so x, -y, -z in 0..1 give the usual light blue for what faces it.
    picture = np.where(np.isfinite(normals), (1 + normals * (1, -1, -1)) / 2, _GREY)
    return np.clip(picture, 0, 1)
