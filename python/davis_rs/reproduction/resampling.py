"""Draws tiles of pixels, and blocks of time, again and again: the bootstrap behind every error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

TILE = 8
"""Pixels on a side. Events of one edge fall into few tiles, so tiles are nearly independent and single pixels are
not."""

DRAWS, BLOCKS = 400, 64
_SEED = 7


@dataclass(frozen=True, eq=False)
class Resampling:
    """Holds how often each tile, and each block of time, is in each draw. The first draw has each of them once.

    All streams of a comparison use the same draws. So what the scene does to both of them cancels in a difference.

    Attributes:
        tiles: float64 (1 + draws, tiles).
        blocks: float64 (1 + draws, blocks).
        tile_of: int64 (H, W): which tile a pixel belongs to; -1 where nothing is compared.
    """

    tiles: FloatArray
    blocks: FloatArray
    tile_of: npt.NDArray[np.int64]

    @classmethod
    def of(cls, compared: npt.NDArray[np.bool_]) -> Resampling:
        """Make the draws for a sensor.

        Args:
            compared: bool (H, W): the pixels that are compared.
        """
        height, width = compared.shape
        y, x = np.ogrid[:height, :width]
        tile = (y // TILE) * (-(-width // TILE)) + x // TILE
        known, numbers = np.unique(tile[compared], return_inverse=True)
        tile_of = np.full(compared.shape, -1, np.int64)
        tile_of[compared] = numbers
        rng = np.random.default_rng(_SEED)
        return cls(_draws(rng, len(known)), _draws(rng, BLOCKS), tile_of)

    @property
    def tile_count(self) -> int:
        """Return how many tiles there are."""
        return self.tiles.shape[1]

    def by_tile(self, pixels: npt.NDArray[np.int64], values: FloatArray | None = None) -> FloatArray:
        """Return the sum of values, or the count, over pixels (n,), numbered y W + x, of each tile."""
        return np.asarray(np.bincount(self.tile_of.ravel()[pixels], values, self.tile_count), np.float64)

    def image_by_tile(self, image: FloatArray) -> FloatArray:
        """Return the sum over the pixels of each tile of an image (..., H, W) as (..., tiles)."""
        inside = np.flatnonzero(self.tile_of.ravel() >= 0)
        flat = image.reshape(-1, self.tile_of.size)
        return np.stack([self.by_tile(inside, one[inside]) for one in flat]).reshape(*image.shape[:-2], self.tile_count)


def _draws(rng: np.random.Generator, count: int) -> FloatArray:
    drawn = rng.multinomial(count, np.full(count, 1 / count), DRAWS)
    return np.concatenate([np.ones((1, count)), drawn])
