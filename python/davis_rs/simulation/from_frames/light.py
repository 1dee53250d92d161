"""Turns the values of a frame into linear luma."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ..._util.argument_error import ArgumentError
from ..._util.srgb import from_srgb
from ...events.colour import ColourFilter, Weights
from ...events.luma import LUMA_WEIGHTS
from .frame_source import Encoding, FrameArray

FloatArray = npt.NDArray[np.float64]
LumaFrame = npt.NDArray[np.float32]

TRANSFERS = ("srgb", "rec709", "linear", "gamma=G")
"""The transfer functions that can be named; G is the exponent from values to light."""


def parse_transfer(name: str) -> Callable[[FloatArray], FloatArray]:
    """Converts encoded values (0 black, 1 white) to linear light.

    - ``srgb``: the piecewise curve of IEC 61966-2-1, with its straight piece near black;
    - ``rec709``: the inverse of the camera's curve in ITU-R BT.709-6 (item 1.2), which BT.601 and BT.2020 share;
    - ``linear``: none;
    - ``gamma=G``: value^G, G in 0.1..10.

    Raises:
        ValueError: for another name, or an exponent out of range.
    """
    if name == "linear":
        return lambda value: value
    if name == "srgb":
        return from_srgb
    if name == "rec709":
        return lambda value: np.where(
            value < 0.081, value / 4.5, ((np.maximum(value, 0) + 0.099) / 1.099) ** (1 / 0.45)
        )
    match = re.fullmatch(r"gamma=([0-9]*\.?[0-9]+)", name)
    gamma = float(match[1]) if match else math.nan
    if not 0.1 <= gamma <= 10:
        wanted = "gamma=G with G in 0.1..10" if name.startswith("gamma") else f"one of {', '.join(TRANSFERS)}"
        raise ArgumentError("{transfer} must be {}, got {!r}", wanted, name)
    return lambda value: np.maximum(value, 0) ** gamma


class Light:
    """Turns frames into linear luma, Y = 0.299 R + 0.587 G + 0.114 B (BT.601) on linear light, 1 at white.

    Integers go through a table of all their values, so a frame costs three look-ups a pixel.

    Args:
        encoding: that of the source.
        transfer, white_level: what the user says in its place; None leaves it to the source.

    Attributes:
        transfer: the name of the transfer function.
        black, white: the source's values for luma 0 and 1.
        levels: luma of each step from black to white, float64 (n,); None for floating point.

    Raises:
        ValueError: for an unknown transfer function.
    """

    def __init__(self, encoding: Encoding, transfer: str | None = None, white_level: float | None = None) -> None:
        self.transfer = transfer or encoding.transfer
        self.black = encoding.black
        self.white = encoding.white if white_level is None else white_level
        if not self.white > self.black:
            raise ArgumentError(
                "{white_level} must be above the value of black, {:g}, got {:g}", self.black, self.white
            )
        self._black, self._white = encoding.in_frame(self.black), encoding.in_frame(self.white)
        self._decode = parse_transfer(self.transfer)
        self._tables: dict[tuple[np.dtype[np.generic], float], LumaFrame] = {}
        self.levels: FloatArray | None = None
        if encoding.levels is not None:
            steps = np.linspace(self.black, encoding.white, encoding.levels + 1)
            self.levels = self._decode((steps - self.black) / (self.white - self.black))

    def luma(self, image: FrameArray, where: str) -> LumaFrame:
        """Return linear luma (H, W), float32, of a frame (H, W) or (H, W, 3).

        Raises:
            ValueError: for a value that is NaN, infinite or negative, naming the frame and the pixel.
        """
        return self._planes(image, (LUMA_WEIGHTS,), where)[0]

    def through(self, filters: ColourFilter, image: FrameArray, where: str) -> list[LumaFrame]:
        """Return linear light (H, W), float32, of a frame (H, W, 3) behind the red, the green and the blue filter.

        Raises:
            ValueError: as :meth:`luma`.
        """
        return self._planes(image, filters.weights, where)

    def _planes(self, image: FrameArray, sums: Sequence[Weights], where: str) -> list[LumaFrame]:
        """Return sums of weighted linear colours, (H, W) each; of a frame (H, W) its linear light."""
        if image.dtype in (np.uint8, np.uint16):
            return [self._of_integers(image, weights) for weights in sums]
        if not np.issubdtype(image.dtype, np.floating):
            raise ValueError(f"{where}: frames must be uint8, uint16 or floating point, got {image.dtype}")
        bad = ~np.isfinite(image) | (image < 0)
        if bad.any():
            y, x = (int(i) for i in np.argwhere(bad)[0][:2])
            raise ValueError(f"{where}: light must be finite and >= 0, got {image[y, x]} at pixel ({x}, {y})")
        light = self._decode((image.astype(np.float64) - self._black) / (self._white - self._black))
        planes = [light if light.ndim == 2 else light @ np.array(weights) for weights in sums]
        return [np.ascontiguousarray(plane, np.float32) for plane in planes]

    def _of_integers(self, image: FrameArray, weights: Weights) -> LumaFrame:
        if image.ndim == 2:
            return self._table(image.dtype, 1.0)[image]
        luma, *more = (
            self._table(image.dtype, weight)[image[..., colour]] for colour, weight in enumerate(weights) if weight
        )
        for one in more:
            luma += one
        return luma

    def _table(self, dtype: np.dtype[Any], weight: float) -> LumaFrame:
        """Return the weighted light of every value of a type of integers."""
        if (dtype, weight) not in self._tables:
            values = np.arange(np.iinfo(dtype).max + 1, dtype=np.float64)
            light = self._decode(np.maximum(values - self._black, 0) / (self._white - self._black))
            self._tables[dtype, weight] = (weight * light).astype(np.float32)
        return self._tables[dtype, weight]
