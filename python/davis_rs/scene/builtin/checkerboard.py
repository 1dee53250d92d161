"""Describes the checkerboard of a calibration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True)
class Checkerboard:
    """A board of black and white tiles, of which the one at the top left is black.

    Its own axes are those of a camera that looks straight at it: x to the right along a row, y down along a column, z
    into the board. Their origin is the top left *inner* corner, where the first four tiles meet.

    Args:
        rows, columns: of tiles, at least 3; one of them even and the other odd, so that the board does not look the
            same upside down.
        tile_m: a tile's side in metres, > 0.

    Raises:
        ValueError: for other numbers.
    """

    rows: int
    columns: int
    tile_m: float

    def __post_init__(self) -> None:
        if min(self.rows, self.columns) < 3 or (self.rows + self.columns) % 2 == 0:
            raise ValueError(
                "a checkerboard needs at least 3 x 3 tiles, an even number one way and an odd number the other, "
                f"got {self.rows} x {self.columns}"
            )
        if not 0 < self.tile_m < np.inf:
            raise ValueError(f"a checkerboard's tiles must be finite and larger than 0 m, got {self.tile_m} m")

    @property
    def corners(self) -> npt.NDArray[np.float64]:
        """Its inner corners, row by row from the top left: ((rows - 1) * (columns - 1), 3) in metres, board axes."""
        y, x = np.mgrid[: self.rows - 1, : self.columns - 1] * self.tile_m
        return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], 1)

    @property
    def centre(self) -> npt.NDArray[np.float64]:
        """The middle of the board, (3,) in metres, board axes."""
        return np.array([self.columns - 2, self.rows - 2, 0.0]) * self.tile_m / 2

    @property
    def black_tiles(self) -> npt.NDArray[np.float64]:
        """Centres of the black tiles, (n, 3) in metres, board axes."""
        row, column = np.nonzero(np.add.outer(np.arange(self.rows), np.arange(self.columns)) % 2 == 0)
        return np.stack([column - 0.5, row - 0.5, np.zeros(len(row))], 1) * self.tile_m


DATASET_BOARD = Checkerboard(rows=6, columns=7, tile_m=0.07)
"""The public dataset's: 6 x 7 tiles of 70 mm, so 5 x 6 inner corners (Mueggler et al., IJRR 2017)."""
