"""Makes procedural textures: deterministic, periodic, with fine and coarse structure and hard edges.

They are made of sums and products of frozen random numbers (NumPy's ``RandomState`` keeps its streams for ever) and
rounded to eight bits, so that they are the same on every machine.
"""

from __future__ import annotations

import functools

import numpy as np
import numpy.typing as npt

from .._mitsuba.types import MitsubaValue, SceneDictionary
from .._util.srgb import from_srgb, to_srgb

__all__ = ["Texture", "bitmap", "encoded_bitmap", "from_srgb", "patchwork", "to_srgb", "value_noise"]

FloatArray = npt.NDArray[np.float64]

Texture = npt.NDArray[np.float32]
"""Reflectance, (height, width, 3), linear RGB; row 0 is the upper edge."""

_FILTERS = {False: "bilinear", True: "nearest"}
"""Mitsuba's names, by whether texels have hard edges."""


def bitmap(
    data: Texture | MitsubaValue,
    *,
    repeats: tuple[float, float] | None = None,
    wrap: str = "repeat",
    nearest: bool = False,
) -> SceneDictionary:
    """Describe a texture for Mitsuba, at the surface's own coordinates or repeated over its width and height.

    Args:
        data: a :data:`Texture`, or Mitsuba's tensor of one.
        wrap: what lies beyond its edges: repeat, clamp or mirror.
        nearest: texels have hard edges; others are bilinear.
    """
    texture = {"type": "bitmap", "raw": True, "wrap_mode": wrap, "filter_type": _FILTERS[nearest], "data": data}
    return texture if repeats is None else {**texture, "to_uv": np.diag([*repeats, 1.0])}


def encoded_bitmap(
    data: MitsubaValue, *, raw: bool = False, wrap: str = "repeat", nearest: bool = False
) -> SceneDictionary:
    """Describe a texture for Mitsuba that keeps the 8 bits of its file, a quarter of what linear light takes.

    Args:
        data: a ``mi.Bitmap`` of them.
        raw: they are numbers from 0 to 1; else sRGB.
        wrap, nearest: as in :func:`bitmap`.
    """
    texture = {"type": "bitmap", "raw": raw, "format": "auto", "wrap_mode": wrap, "filter_type": _FILTERS[nearest]}
    return {**texture, "bitmap": data}


def patchwork(
    size: int, seed: int, *, low: float, high: float, grain: float, shapes: int, tint: tuple[float, float, float]
) -> npt.NDArray[np.float32]:
    """Draw an RGB reflectance (size, size, 3), float32, 0 to 1: noise under sharp rectangles, discs and stripes.

    Args:
        size: texels a side; a power of two.
        low, high: range of reflectance.
        grain: fraction of noise in a shape's brightness, 0..1.
        shapes: number of shapes.
        tint: factors of red, green and blue.
    """
    return (_patchwork(size, seed, low, high, grain, shapes, tint) / 255).astype(np.float32)


@functools.lru_cache(maxsize=16)
def _patchwork(
    size: int, seed: int, low: float, high: float, grain: float, shapes: int, tint: tuple[float, float, float]
) -> npt.NDArray[np.uint8]:
    """Draw :func:`patchwork` in eight bits. The last few are kept: each takes half a second, and 0.8 MB at 512
    texels."""
    random = np.random.RandomState(seed)
    noise = value_noise(size, random)
    grained, level = (grain * noise).ravel(), noise.ravel().copy()
    for _ in range(shapes):
        rows, columns, inside = _shape(size, random)
        brightness = random.random_sample()
        texels = (rows[:, None] * size + columns)[inside]
        level[texels] = (1 - grain) * brightness + grained[texels]
    # Even steps in log reflectance: equal contrast in the dark and in the bright.
    reflectance = low * (high / low) ** level.reshape(size, size)
    rgb = np.clip(reflectance[..., None] * np.array(tint), 0, 1)
    return np.round(rgb * 255).astype(np.uint8)


def value_noise(size: int, random: np.random.RandomState) -> FloatArray:
    """Draw periodic noise in [0, 1]: octaves of random lattices, each half as strong and twice as fine."""
    total = np.zeros((size, size))
    cells, strength = 8, 1.0
    while cells <= size // 4:
        lattice = random.random_sample((cells, cells))
        x = (np.arange(size) + 0.5) * cells / size
        i, f = x.astype(int), x % 1
        f = f * f * (3 - 2 * f)
        j = (i + 1) % cells
        rows = lattice[i] * (1 - f)[:, None] + lattice[j] * f[:, None]
        total += strength * (rows[:, i] * (1 - f) + rows[:, j] * f)
        cells, strength = 2 * cells, strength / 2
    return (total - total.min()) / (total.max() - total.min())


def _shape(
    size: int, random: np.random.RandomState
) -> tuple[npt.NDArray[np.int_], npt.NDArray[np.int_], npt.NDArray[np.bool_]]:
    """Draw a hard-edged shape at a random position.

    Returns:
        Rows and columns of a window, wrapped around the borders, and a mask in it.
    """
    centre_x, centre_y, scale, angle, kind = random.random_sample(5) * (size, size, 1, 1, 3)
    radius = size * 0.02 * (6.0**scale)  # many small ones, some large
    reach = int(radius * 1.5) + 1
    window = np.arange(-reach, reach + 1)
    dy, dx = window[:, None] - centre_y % 1, window[None] - centre_x % 1
    rows, columns = (window + int(centre_y)) % size, (window + int(centre_x)) % size
    if kind < 1:
        return rows, columns, dx * dx + dy * dy < radius * radius
    # A rational rotation (no sine or cosine, whose last bit depends on the C library).
    t = 2 * angle - 1
    cos, sin = (1 - t * t) / (1 + t * t), 2 * t / (1 + t * t)
    u, v = cos * dx + sin * dy, cos * dy - sin * dx
    box = (abs(u) < radius) & (abs(v) < radius * 0.6)
    return rows, columns, box if kind < 2 else box & (np.floor(u / (radius * 0.2)) % 2 == 0)
