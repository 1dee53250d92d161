"""Makes bilinear texels of textures that have hard edges or that belong to a mesh's vertices.

The renderers without noise look texels up bilinearly. So a hard edge becomes a ramp of one texel, centred on the edge,
and texels are made so fine that the ramp is a small fraction of a pixel wherever the camera's path is closest.
"""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..._mitsuba.types import Mitsuba, MitsubaParameters, MitsubaShape, MitsubaTexture

FloatArray = npt.NDArray[np.float64]

RAMP_PX = 0.02
"""How wide the ramp in place of a hard edge should be, pixels.

A ray errs where it meets a ramp, by half of the edge's contrast at most, and the errors of both halves cancel. The mean
over a pixel errs by at most 1/8 of the contrast times the ramp's width: by 1e-3 for a step from black to 0.4.
"""

_MOST_TEXELS = 1 << 22
"""Of a texture that is made finer. It takes 16 MB for each colour of the light."""

_UNKNOWN = 256
"""Texels along a side of a period where no path is known."""


class Ramp(NamedTuple):
    """How a texture with hard edges is divided.

    Attributes:
        columns, rows: texels along each side, powers of two.
        width_px: the ramp's width at the closest point of the path, in pixels; NaN where no path is known.
    """

    columns: int
    rows: int
    width_px: float


def divide(pixels: tuple[float, float] | None, least: int, texels: int = 1) -> Ramp:
    """Divide parts of a texture so that ramps are at most :data:`RAMP_PX` wide, or as narrow as the limit allows.

    Args:
        pixels: how many pixels a part covers at most along u and v; None if that is not known.
        least: into how many texels at least.
        texels: how many parts the texture has.
    """
    if pixels is None:
        side = max(least, min(_UNKNOWN, 1 << int(np.log2(max(1.0, np.sqrt(_MOST_TEXELS / texels))))))
        return Ramp(side, side, np.nan)
    along = np.clip(np.array(pixels) / RAMP_PX, least, _MOST_TEXELS)
    sides = 2 ** np.ceil(np.log2(along)).astype(np.int64)
    widths = np.array(pixels) / sides
    while sides.prod() * texels > _MOST_TEXELS and (sides > least).any():
        finer = int(np.where(sides > least, widths, np.inf).argmin())
        sides[finer] //= 2
        widths[finer] *= 2
    return Ramp(int(sides[0]), int(sides[1]), float(widths.max()))


def checkerboard(
    parameters: MitsubaParameters, prefix: str, pixels: tuple[float, float] | None
) -> tuple[npt.NDArray[np.float32], Ramp] | None:
    """Return one period of a checkerboard (rows, columns, 3), which repeats; None if its colours vary.

    Args:
        parameters: those of the material.
        prefix: under which they have the texture.
        pixels: how many pixels a period covers at most along u and v.
    """
    keys = [f"{prefix}.color{number}.value" for number in (0, 1)]
    if any(key not in parameters for key in keys):
        return None
    first, second = (np.broadcast_to(np.array(parameters[key], np.float32).reshape(-1), (3,)) for key in keys)
    ramp = divide(pixels, 2)
    right = np.arange(ramp.columns) >= ramp.columns // 2
    below = np.arange(ramp.rows) >= ramp.rows // 2
    return np.where((right == below[:, None])[..., None], first, second), ramp


def vertex_colours(
    texture: MitsubaTexture, shape: MitsubaShape, faces: npt.NDArray[np.uint32], mi: Mitsuba
) -> FloatArray | None:
    """Return the colours (m, 3, 3) that a ``mesh_attribute`` has at the corners of a mesh's triangles.

    None if the mesh has no such attribute of one or three numbers.
    """
    named = re.search(r'name = "(\w+)"', str(texture))
    parameters = mi.traverse(shape)
    if named is None or named[1] not in parameters:
        return None
    values = np.array(parameters[named[1]], np.float64)
    of_faces = named[1].startswith("face_")
    count = len(faces) if of_faces else int(shape.vertex_count())
    if values.size not in (count, 3 * count):
        return None
    colours = np.broadcast_to(values.reshape(count, -1), (count, 3)) * float(mi.traverse(texture)["scale"])
    return np.repeat(colours[:, None], 3, axis=1) if of_faces else colours[faces]
