"""The rays of a camera's pixels, as the Rust core takes them."""

from __future__ import annotations

import functools

import numpy as np
import numpy.typing as npt

from .._core import PixelRays
from ..camera import Camera
from ..lattice import rank1_lattice
from .camera_rays import pixel_centres

_PART_BYTES = 32 << 20
"""What the rays of a part of the image may take while they are made, in float64."""

_TILE = 8
"""Parts have whole tiles of the core's, which have so many rows."""


@functools.lru_cache(maxsize=4)
def pixel_rays(camera: Camera, rays: int) -> PixelRays:
    """A table of ``rays`` lattice rays for each pixel.

    The last few tables are kept, because each takes as long as some frames, and many short simulations with one camera
    need the same ones. Without distortion a table has columns and rows alone; else it is made in parts.
    """
    lattice = rank1_lattice(rays)
    if not any(camera.distortion):
        x, y = (_along(camera, axis, lattice) for axis in (0, 1))
        return PixelRays.grid(camera.width, camera.height, rays, x, y)
    rows = max(_TILE, _PART_BYTES // (16 * rays * camera.width) // _TILE * _TILE)

    def part(first: int) -> npt.NDArray[np.float32]:
        centres = pixel_centres(camera, first, min(first + rows, camera.height))
        return camera.rays(centres[None] + lattice[:, None]).astype(np.float32).ravel()

    return PixelRays.from_parts(camera.width, camera.height, rays, rows, part)


def table_bytes(camera: Camera, rays: int) -> int:
    """What a table takes."""
    if not any(camera.distortion):
        return 4 * rays * (camera.width + camera.height)
    return 8 * rays * camera.width * camera.height


def _along(camera: Camera, axis: int, lattice: npt.NDArray[np.float64]) -> npt.NDArray[np.float32]:
    """Coordinates of the pixels along an axis of the image, by ray."""
    pixels = np.zeros(((camera.width, camera.height)[axis], 2))
    pixels[:, axis] = np.arange(len(pixels))
    return camera.rays(pixels[None] + lattice[:, None])[..., axis].astype(np.float32).ravel()
