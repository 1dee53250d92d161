"""Encodes and decodes values by sRGB's curve."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def from_srgb(encoded: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Decode values of sRGB's curve to linear ones (IEC 61966-2-1); negative ones lie on its straight piece."""
    value = np.asarray(encoded, np.float64)
    return np.where(value <= 0.04045, value / 12.92, ((np.maximum(value, 0) + 0.055) / 1.055) ** 2.4)


def to_srgb(linear: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Encode linear values by sRGB's curve (IEC 61966-2-1), as a display wants them, both in 0 to 1."""
    value = np.asarray(linear, np.float64)
    return np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)
