"""Holds the light of a frame behind the colour filters of a sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from .light import LumaFrame


@dataclass(frozen=True, eq=False)
class ColourLight:
    """Holds what passes each of three filters, over the whole frame.

    A pixel has one of the filters. But what the image shows moves from pixels of one filter to those of another, so
    light between two frames follows from all three.

    Attributes:
        light: linear light that passes the red, the green and the blue filter, (H, W) each, float32.
        numbers: uint8 (H, W), which of them each pixel has.
    """

    light: tuple[LumaFrame, ...]
    numbers: npt.NDArray[np.uint8]

    @cached_property
    def grey(self) -> LumaFrame:
        """Return the mean of the three (H, W)."""
        return np.asarray(np.mean(self.light, axis=0), np.float32)

    def seen(self, planes: Sequence[LumaFrame]) -> LumaFrame:
        """Return what the pixels see (H, W) of light (H, W) that passes each of the filters."""
        return np.asarray(np.choose(self.numbers, planes), np.float32)
