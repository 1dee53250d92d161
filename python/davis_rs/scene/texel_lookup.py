"""Looks up texels as renderers do: bilinearly, and beyond the edges as a wrap mode says."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

WRAP_MODES = ("repeat", "clamp", "mirror")


class TexelArray(Protocol):
    """Gives texels by rows and columns: an array (H, W, channels), or what decodes them."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Return rows, columns and channels."""

    def __getitem__(self, where: tuple[IntArray, IntArray], /) -> npt.NDArray[np.generic]:
        """Return the texels (..., channels) at rows and columns."""


def bilinear(texels: TexelArray, uv: FloatArray, wrap: int) -> FloatArray:
    """Look up (n, channels) bilinearly from texels (H, W, channels) at uv (2, n), v downwards; texel centres lie at
    (i + 0.5) / size."""
    height, width = texels.shape[:2]
    x, y = uv[0] * width - 0.5, uv[1] * height - 0.5
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (x - x0)[:, None], (y - y0)[:, None]
    columns = [wrap_index(x0 + i, width, wrap) for i in (0, 1)]
    rows = [wrap_index(y0 + i, height, wrap) for i in (0, 1)]
    top, bottom = (texels[row, columns[0]] * (1 - fx) + texels[row, columns[1]] * fx for row in rows)
    return np.asarray(top * (1 - fy) + bottom * fy)


def wrap_index(index: IntArray, n: int, wrap: int) -> IntArray:
    """Return the texel that an index outside of 0..n-1 stands for."""
    if WRAP_MODES[wrap] == "clamp":
        return np.clip(index, 0, n - 1)
    if WRAP_MODES[wrap] == "repeat":
        return index % n
    folded = index % (2 * n)
    return np.minimum(folded, 2 * n - 1 - folded)
