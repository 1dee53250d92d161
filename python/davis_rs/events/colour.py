"""Defines colour filters before pixels: which pixel sees which colour, and full colour from what they saw."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .._util.argument_checks import check_type
from .._util.argument_error import ArgumentError

PATTERNS = ("RGGB", "GRBG", "GBRG", "BGGR")
"""Bayer patterns: the colours of the upper left 2 x 2 pixels, row by row. They repeat over the sensor.

A DAVIS of colour tells which it has. libcaer calls them RGBG, GRGB, GBGR and BGRG, going round the 2 x 2 pixels.

Source: inivation/libcaer, ``caer_frame_event_color_filter`` (events/frame.h) and the table of ``frame_utils.c``.
"""

COLOURS = ("red", "green", "blue")

Weights = tuple[float, float, float]


@dataclass(frozen=True)
class ColourFilter:
    """Describes the filters before a sensor's pixels.

    The light of a pixel is a weighted sum of the rendered red, green and blue, linear. The weights are those of its
    filter.

    Args:
        pattern: one of ``PATTERNS``.
        red, green, blue: of each filter, the weights of linear red, green and blue, >= 0 and not all 0. A sum of 1
            makes white 1. By default a filter passes its own colour alone.

    Raises:
        ValueError: for another pattern, or weights that are not three finite numbers >= 0.
    """

    pattern: str = "RGGB"
    red: Weights = (1.0, 0.0, 0.0)
    green: Weights = (0.0, 1.0, 0.0)
    blue: Weights = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        check_pattern(self.pattern)
        for name in COLOURS:
            weights = np.asarray(getattr(self, name), np.float64)
            if weights.shape != (3,) or not (np.isfinite(weights).all() and (weights >= 0).all() and weights.any()):
                raise ValueError(
                    f"{name} of a colour filter must be three weights >= 0, not all 0, got {getattr(self, name)!r}"
                )
            object.__setattr__(self, name, tuple(weights.tolist()))

    @property
    def weights(self) -> tuple[Weights, Weights, Weights]:
        """Return the weights of the red, the green and the blue filter."""
        return self.red, self.green, self.blue


def check_pattern(pattern: object) -> None:
    """Refuse what is no Bayer pattern.

    Raises:
        ArgumentError: with those that there are.
    """
    if pattern not in PATTERNS:
        raise ArgumentError("{colour_filter} must be one of {}, got {!r}", ", ".join(PATTERNS), pattern)


def filter_numbers(pattern: str, width: int, height: int) -> npt.NDArray[np.uint8]:
    """Return which filter each pixel has, (height, width): 0 red, 1 green, 2 blue."""
    check_pattern(pattern)
    two_by_two = np.array(["RGB".index(letter) for letter in pattern], np.uint8).reshape(2, 2)
    return np.tile(two_by_two, (-(-height // 2), -(-width // 2)))[:height, :width]


def demosaic(image: npt.ArrayLike, pattern: str = "RGGB") -> npt.NDArray[np.float32]:
    """Return full colour of a raw image of a colour sensor, float32 (H, W, 3), red, green and blue.

    A colour that a pixel does not see is the mean of its neighbours that do, weighted 2 for those beside, above and
    below and 1 for those at the corners (bilinear interpolation). What pixels saw stays as it is.

    Args:
        image: (H, W), H and W at least 2: luma of a packet, or a frame.
        pattern: one of ``PATTERNS``.

    Raises:
        ValueError: for another pattern, or an image of another shape.
    """
    from scipy.ndimage import convolve

    raw = np.asarray(image, np.float32)
    if raw.ndim != 2 or min(raw.shape) < 2:
        raise ValueError(f"a raw image must have shape (H, W), both at least 2, got {raw.shape}")
    height, width = raw.shape
    numbers = filter_numbers(pattern, width, height)
    kernel = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]], np.float32)
    colour = np.empty((height, width, 3), np.float32)
    for number in range(3):
        own = (numbers == number).astype(np.float32)
        total = convolve(raw * own, kernel, mode="constant")
        colour[..., number] = np.where(own > 0, raw, total / convolve(own, kernel, mode="constant"))
    return colour


def as_colour_filter(given: object) -> ColourFilter | None:
    """Return a filter as it may be given: one, a pattern's name, or ``none`` for none.

    Raises:
        TypeError, ValueError: for anything else.
    """
    if given is None or given == "none":
        return None
    if isinstance(given, str):
        return ColourFilter(given.upper())
    check_type("colour_filter", given, ColourFilter, "davis_rs.ColourFilter('RGGB') makes one")
    return given if isinstance(given, ColourFilter) else None
