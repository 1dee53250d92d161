"""The rays of a camera's pixels, as the Rust core takes them."""

from __future__ import annotations

import functools

import numpy as np

from ..._core import PixelRays
from ...geometry.camera import Camera
from .camera_rays import ray_table


@functools.lru_cache(maxsize=4)
def pixel_rays(camera: Camera, rays: int) -> PixelRays:
    """A table of ``rays`` lattice rays for each pixel.

    The last few tables are kept, because each takes as long as some frames, and many short simulations with one camera
    need the same ones.
    """
    table = ray_table(camera, rays).astype(np.float32)
    return PixelRays(camera.width, camera.height, rays, table.ravel())
