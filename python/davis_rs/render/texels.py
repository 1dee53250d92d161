"""Defines the texels of bitmaps as Mitsuba holds them, and looks them up as it does."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from .._mitsuba.types import Mitsuba, MitsubaParameters, MitsubaValue
from .._mitsuba.variants import FAST
from .._util.srgb import from_srgb
from ..scene.texel_lookup import WRAP_MODES, bilinear, wrap_index

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_Number = TypeVar("_Number", bound=np.generic)

TEXELS_AT_ONCE = 1 << 18
"""How many texels are decoded and weighted at a time."""

CoreImage = tuple[tuple[int, int, int], npt.NDArray[np.generic], npt.NDArray[np.float32] | None]
CoreColours = tuple[npt.NDArray[np.uint32], list[CoreImage]]
"""The colours of textures, see :class:`davis_rs._core.SceneRenderer`."""

LUMINANCE = np.array([[0.212671], [0.715160], [0.072169]])
"""Weights (3, 1) of linear red, green and blue where Mitsuba takes a coloured texture for a number."""


class Texels:
    """The texels of a bitmap as Mitsuba holds them; linear RGB in float64 where they are asked for.

    They are decoded block by block, because all of them in float64 would be the largest copy of a texture.

    Args:
        data: (H, W) or (H, W, channels), of which the first three count.
        light: (256,) the linear value that each integer of ``data`` stands for, or (256, 3) in red, green and blue;
            None where ``data`` is linear itself.
    """

    def __init__(self, data: npt.NDArray[np.generic], light: FloatArray | None = None) -> None:
        self._data = data.reshape(data.shape[0], data.shape[1], -1)[..., :3]
        alike = light is not None and light.ndim == 2 and bool((light == light[:, :1]).all())
        self._light = light[:, 0] if light is not None and alike else light
        self.shape = (*data.shape[:2], 3)

    def __getitem__(self, where: tuple[IntArray, IntArray]) -> FloatArray:
        """Return the texels (..., 3) at rows and columns."""
        return self._rgb(self._data[where])

    def repeated(self, rows: int, columns: int) -> Texels:
        """Return the same picture with each texel given ``rows`` times down and ``columns`` times across."""
        return Texels(self._data.repeat(rows, axis=0).repeat(columns, axis=1), self._light)

    @property
    def coded(self) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.float32]] | None:
        """The texels (H, W, 3) as integers of 8 bits, and the linear red, green and blue (256, 3) that each stands for;
        None where they are linear themselves."""
        if self._light is None:
            return None
        values = np.broadcast_to(self._light.reshape(256, -1), (256, 3))
        return np.broadcast_to(self._data.astype(np.uint8, copy=False), self.shape), values.astype(np.float32)

    def pieces(self) -> Iterator[tuple[int, FloatArray]]:
        """Return all texels row by row, in pieces (n, 3), each with the number of its first texel."""
        flat = self._data.reshape(-1, self._data.shape[2])
        return (
            (start, self._rgb(flat[start : start + TEXELS_AT_ONCE])) for start in range(0, len(flat), TEXELS_AT_ONCE)
        )

    @property
    def range(self) -> float:
        """How far apart the smallest and the largest value lie."""
        return float(np.ptp(self._rgb(np.array([[self._data.min()], [self._data.max()]]))))

    @functools.cached_property
    def digest(self) -> bytes:
        """What tells texels from others of another size or other values."""
        light = b"" if self._light is None else self._light.tobytes()
        said = f"{self._data.shape} {self._data.dtype} ".encode()
        return hashlib.blake2b(
            np.ascontiguousarray(self._data).data, key=hashlib.sha256(said + light).digest()
        ).digest()

    @property
    def is_grey(self) -> bool:
        """Whether none has a hue."""
        return all(bool((piece == piece[:, :1]).all()) for _, piece in self.pieces())

    def _rgb(self, values: npt.NDArray[np.generic]) -> FloatArray:
        if self._light is None:
            linear = values.astype(np.float64)
        else:
            numbers = values.astype(np.uint8, copy=False)
            linear = self._light[numbers] if self._light.ndim == 1 else self._light[numbers, np.arange(3)]
        return np.broadcast_to(linear, (*linear.shape[:-1], 3))


def laid_out(
    images: Iterable[tuple[npt.NDArray[np.generic], int]], dtype: type[_Number]
) -> tuple[list[list[int]], npt.NDArray[_Number]]:
    """Put images one after the other, each in a border of one texel, as the core takes them.

    Args:
        images: (H, W, ...), each with its index into :data:`WRAP_MODES`.

    Returns:
        Of each the number of its first texel, width, height and wrap mode; and all texels, flat.
    """
    layouts, framed, first = list[list[int]](), [np.zeros(0, dtype)], 0
    for image, wrap in images:
        height, width = image.shape[:2]
        layouts.append([first, width, height, wrap])
        framed.append(bordered(image, wrap, dtype).ravel())
        first += (height + 2) * (width + 2)
    return layouts, np.concatenate(framed)


def bordered(image: npt.NDArray[np.generic], wrap: int, dtype: type[_Number] | None = None) -> npt.NDArray[_Number]:
    """Return a texture (H, W, ...) in a border of one texel (H + 2, W + 2, ...), filled by its wrap mode.

    Args:
        dtype: of the result; None for the texture's own.
    """
    height, width = image.shape[:2]
    framed = np.empty((height + 2, width + 2, *image.shape[2:]), dtype or image.dtype)
    framed[1:-1, 1:-1] = image
    fill_border(framed, wrap)
    return framed


def fill_border(framed: npt.NDArray[np.generic], wrap: int) -> None:
    """Fill the border of one texel around a texture (H + 2, W + 2, ...) by its wrap mode."""
    before, after = (-2, 1) if WRAP_MODES[wrap] == "repeat" else (1, -2)
    framed[0, 1:-1], framed[-1, 1:-1] = framed[before, 1:-1], framed[after, 1:-1]
    framed[:, 0], framed[:, -1] = framed[:, before], framed[:, after]


def uv_map_of(parameters: MitsubaParameters, prefix: str = "") -> FloatArray:
    """Return the transform (3, 3) of a texture's coordinates, which Mitsuba has among these parameters."""
    return np.array(parameters[f"{prefix}to_uv"].matrix, np.float64).reshape(3, 3)


def lookup_positions(uv_map: FloatArray) -> tuple[npt.NDArray[np.float32], FloatArray]:
    """Return texture coordinates (2, n) at which a lookup shows how it is made, and the same after a transform."""
    uv = np.random.RandomState(0).uniform(-2, 3, (2, 256)).astype(np.float32)
    return uv, uv_map[:2, :2] @ uv.astype(np.float64) + uv_map[:2, 2:]


def looked_up(evaluate: Callable[[MitsubaValue], MitsubaValue], uv: npt.NDArray[np.float32], mi: Mitsuba) -> FloatArray:
    """Return what Mitsuba looks up at texture coordinates, (n, k).

    Args:
        evaluate: returns k numbers for a surface interaction, which is seen along the normal.
        uv: (2, n), before the texture's own transform.
        mi: Mitsuba, under the variant that loaded the texture.
    """

    def at(uv: npt.NDArray[np.float32] | list[float]) -> FloatArray:
        interaction = mi.SurfaceInteraction3f()
        interaction.uv, interaction.wi = mi.Point2f(uv), mi.Vector3f(0, 0, 1)
        return np.array(evaluate(interaction), np.float64)

    values = at(uv).T if mi.variant() == FAST else np.array([at(pair) for pair in uv.T.tolist()])
    return values.reshape(uv.shape[1], -1)


def decoded(data: npt.NDArray[np.generic]) -> Iterator[Texels]:
    """Yield the possible meanings of a bitmap's data; 8-bit images, in sRGB unless raw, stay encoded until
    looked up."""
    if data.dtype != np.uint8:
        yield Texels(data)
        return
    encoded = np.arange(256) / 255
    yield Texels(data, from_srgb(encoded))
    yield Texels(data, encoded)


def bilinear_meaning(
    data: npt.NDArray[np.generic], uv: FloatArray, looked_up: FloatArray, weights: FloatArray | None = None
) -> tuple[Texels, int] | None:
    """Find the encoding and the wrap mode by which bilinear lookups of a bitmap agree with Mitsuba's own.

    Mitsuba does not tell them, so each is tried.

    Args:
        uv: (2, n), after the texture's own transform.
        looked_up: (n, k), what Mitsuba looks up there.
        weights: (3, k), of red, green and blue in that; None where it is these three.

    Returns:
        None where no lookup agrees.
    """
    off = rounding_texels(data, uv)[:, None]
    for texels in decoded(data):
        for wrap in range(len(WRAP_MODES)):
            values = bilinear(texels, uv, wrap)
            values = values if weights is None else values @ weights
            if (np.abs(values - looked_up) < 1e-3 + texels.range * off).all():
                return texels, wrap
    return None


def nearest_meaning(
    data: npt.NDArray[np.generic], uv: FloatArray, looked_up: FloatArray, weights: FloatArray | None = None
) -> tuple[Texels, int] | None:
    """Find the encoding and the wrap mode by which the texels at places are what Mitsuba looks up there.

    Args and Returns:
        as of :func:`bilinear_meaning`.
    """
    height, width = data.shape[:2]
    position, texels_off = uv * [[width], [height]], rounding_texels(data, uv)
    # Next to an edge between texels the rounding of float32 decides.
    away = (np.abs(position - np.round(position)) > 1e-3 + texels_off).all(0)
    column, row = np.floor(position[:, away]).astype(np.int64)
    for texels in decoded(data) if away.any() else ():
        for wrap in range(len(WRAP_MODES)):
            values = texels[wrap_index(row, height, wrap), wrap_index(column, width, wrap)]
            values = values if weights is None else values @ weights
            if (np.abs(values - looked_up[away]) < 1e-3 + 1e-3 * texels.range).all():
                return texels, wrap
    return None


def rounding_texels(data: npt.NDArray[np.generic], uv: FloatArray) -> FloatArray:
    """Return by how many texels Mitsuba may look beside: its coordinates are float32, and far out on a fine texture
    they are wrong by a good part of a texel."""
    return np.asarray(np.abs(uv).max(0) * max(data.shape[:2]) * 2.0**-22)
