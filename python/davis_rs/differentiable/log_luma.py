"""Computes log luma of single pixels at single instants, in float64, with its derivatives."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from ..geometry.trajectory.trajectory import Trajectory
from ..geometry.trajectory.views import Views
from ..render.native.renderer import NativeRenderer
from .blurred_pixels import BlurredPixels

if TYPE_CHECKING:
    from scipy.sparse import csr_array

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_AT_ONCE = 1 << 15
"""How many pixels are evaluated in one call, because more would cost memory."""


class LogLuma(NamedTuple):
    """Holds L = ln(Y + log_eps) of n pixels, each at its own instant.

    Attributes:
        value: (n,) L.
        rate: (n,) dL/dt, per second: of the camera, of all that moves, and of the lights.
        pose: (n, 6) dL by an increment of the camera's pose: position in world axes, per metre, then a rotation vector
            in camera axes, per radian.
        lights: (n, l) dL by the logarithm of each light's strength.
        log_eps: (n,) dL by the dark level.
    """

    value: FloatArray
    rate: FloatArray
    pose: FloatArray
    lights: FloatArray
    log_eps: FloatArray

    def take(self, index: IntArray) -> LogLuma:
        """Return the values at these indices."""
        return LogLuma(*(column[index] for column in self))

    def put(self, index: IntArray, other: LogLuma) -> None:
        """Replace the values at these indices."""
        for column, values in zip(self, other, strict=True):
            column[index] = values


class LogLumaField:
    """Computes log luma along a camera path, as a native renderer's own rays see it, without the rounding of float32.

    Which surface a ray meets, and whether a light is hidden from it, is taken as fixed in the derivatives.

    Args:
        renderer: without effects of the lens.
        trajectory: the camera's path.
        log_eps: dark level, in luma.

    Attributes:
        path: of the camera.
        pixels: of the renderer, and its blur.
        light_names: of the scene, in its order, each once.
        of_light_name: (l, names) 1 where a light of the table has the name.
    """

    def __init__(self, renderer: NativeRenderer, trajectory: Trajectory, log_eps: float) -> None:
        self.renderer, self.log_eps = renderer, log_eps
        self.path, self.duration_s = trajectory, trajectory.duration_s
        self.pixels = BlurredPixels(renderer)
        names = [light.name for light in renderer.table.lights]
        self.light_names = tuple(dict.fromkeys(names))
        self.of_light_name = np.array([[name == known for known in self.light_names] for name in names], np.float64)

    def views(self, t_us: FloatArray) -> Views:
        """Return the camera at instants (n,), microseconds; those that rounding puts just before 0 are at 0."""
        return Views.along(self.path, np.clip(t_us * 1e-6, 0.0, self.path.duration_s))

    def at(self, t_us: FloatArray, pixel: IntArray) -> LogLuma:
        """Return log luma of pixels (n,), y W + x, each at its own instant (n,), microseconds from the path's start."""
        # Sorted by pixel, so that the texels that they need are still in the cache.
        order = np.argsort(pixel, kind="stable")
        chunks = [order[first : first + _AT_ONCE] for first in range(0, max(len(order), 1), _AT_ONCE)]
        results = [self._at(self.views(t_us[chunk]), pixel[chunk]) for chunk in chunks]
        back = np.empty_like(order)
        back[order] = np.arange(len(order))
        return LogLuma(*(np.concatenate(columns)[back] for columns in zip(*results, strict=True)))

    def at_start(self, pixel: IntArray) -> LogLuma:
        """Return log luma of pixels (n,) at the path's first instant."""
        return self._of_view(self.views(np.zeros(1)), np.zeros(len(pixel), np.uint32), pixel)

    def by_texel(self, t_us: FloatArray, pixel: IntArray) -> csr_array:
        """Return sparse (n, texels): dL by the reflectance of the table's texels, each pixel at its own instant."""
        from scipy.sparse import csr_array, vstack

        texels = int(np.prod(self.renderer.table.textures.sizes[:, 1:3].astype(np.int64), axis=1).sum())
        blocks = [csr_array((0, texels))]
        for first in range(0, len(pixel), _AT_ONCE):
            chunk = slice(first, first + _AT_ONCE)
            around = self.pixels.neighbours(pixel[chunk]).astype(np.uint32)
            views, view = self.views(t_us[chunk]), np.arange(len(around), dtype=np.uint32)
            luma = self.renderer.gradients(views, view, around, self.pixels.weights)[:, 0]
            counts, seen, values = self.renderer.texel_gradients(views, view, around, self.pixels.weights)
            rows = np.append(0, np.cumsum(counts, dtype=np.int64))
            values = values * np.repeat(1 / (luma + self.log_eps), counts)
            block = csr_array((values, seen, rows), shape=(len(around), texels))
            block.sum_duplicates()
            blocks.append(block)
        return vstack(blocks, format="csr")

    def _at(self, views: Views, pixel: IntArray) -> LogLuma:
        return self._of_view(views, np.arange(len(pixel), dtype=np.uint32), pixel)

    def _of_view(self, views: Views, view: npt.NDArray[np.uint32], pixel: IntArray) -> LogLuma:
        around = self.pixels.neighbours(pixel).astype(np.uint32)
        table = self.renderer.gradients(views, view, around, self.pixels.weights)
        dark = 1 / (table[:, 0] + self.log_eps)
        slopes = table[:, 1:] * dark[:, None]
        return LogLuma(np.log(table[:, 0] + self.log_eps), slopes[:, 0], slopes[:, 1:7], slopes[:, 7:], dark)
