"""Reads image files as textures."""

from __future__ import annotations

import io
import struct
import warnings
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from .._util.budget import Budget
from .._util.srgb import from_srgb
from .._util.untrusted import read_charged
from ..geometry.pose import FloatArray
from .named_file import GREY_UNKNOWN
from .textures import Texture

if TYPE_CHECKING:
    from PIL.Image import Image

FORMATS = ("PNG", "JPEG", "TIFF", "BMP", "TGA", "WEBP")
"""The image formats that are read as textures, by Pillow's names."""

MOST_SIDE = 1 << 16
"""The most texels on a side: float32 coordinates cannot address more."""

_DECODED_BYTES, _TEXEL_BYTES, _LINEAR_BYTES = 4, 3, 12
"""Bytes of a texel: while Pillow decodes it, in memory, and as float32 in linear light."""

_STRIP = 1 << 20
"""How many texels are converted at a time."""


@dataclass(frozen=True, eq=False)
class EncodedTexture:
    """The texels of an image as its file has them. They are decoded to linear light when a shape is made of them.

    Attributes:
        texels: uint8 (H, W, 3), in sRGB; row 0 is the upper edge.
        alpha: uint8 (H, W), how opaque each is; None where the image is opaque everywhere.
        tint: (3,), factors of red, green and blue in linear light.
        transfer: what the file says that the texels are, ``srgb`` or ``linear``; empty where it does not say.
    """

    texels: npt.NDArray[np.uint8]
    alpha: npt.NDArray[np.uint8] | None
    tint: FloatArray
    transfer: str = ""

    @property
    def opaque(self) -> bool:
        """Whether the image is opaque everywhere."""
        return self.alpha is None

    def tinted(self, factor: FloatArray) -> EncodedTexture:
        """Return the same texels with another tint (3,)."""
        return replace(self, tint=factor)

    def charge(self, budget: Budget, where: str) -> None:
        """Charge a budget for what :meth:`linear` takes, for a shape that shows the texture.

        Raises:
            DecodeError: if the budget has not enough left.
        """
        height, width = self.texels.shape[:2]
        budget.take(_LINEAR_BYTES * height * width, f"{where}: a texture of {width} x {height} texels in linear light")

    @property
    def is_tinted(self) -> bool:
        """Whether its light is not that of its texels alone."""
        return bool((self.tint != 1.0).any())

    @property
    def light(self) -> FloatArray:
        """The linear value (256, 3) that each number of 8 bits stands for, in red, green and blue."""
        light = np.repeat(from_srgb(np.arange(256) / 255)[:, None], 3, axis=1)
        if not self.is_tinted:
            return light
        # Rounded to float32, as Mitsuba has them: all renderers see the same texels.
        return (light.astype(np.float32).astype(np.float64) * self.tint).astype(np.float32).astype(np.float64)

    def mean(self) -> FloatArray:
        """Return the mean reflectance (3,) in linear RGB."""
        height, width = self.texels.shape[:2]
        counts = np.zeros((3, 256))
        for rows in _strips(height, width):
            counts += [np.bincount(self.texels[rows, :, channel].ravel(), minlength=256) for channel in range(3)]
        return np.asarray((counts * self.light.T).sum(1) / (height * width))

    def linear(self) -> Texture:
        """Return the reflectance (H, W, 3) in linear RGB."""
        height, width = self.texels.shape[:2]
        reflectance, tables = np.empty(self.texels.shape, np.float32), self.light.astype(np.float32).T
        for rows in _strips(height, width):
            for channel, light in enumerate(tables):
                reflectance[rows, :, channel] = light[self.texels[rows, :, channel]]
        return reflectance


class TextureFiles:
    """Reads the image files that a scene's file names, each once, however many materials show it.

    Args:
        budget: what the scene's file may take.
    """

    def __init__(self, budget: Budget) -> None:
        self._budget = budget
        self._known: dict[Path, EncodedTexture] = {}

    def read(self, path: Path, named_in: str) -> EncodedTexture:
        """Read a file of 8 bits per channel, in sRGB.

        Args:
            named_in: file and line that name it, for messages.

        Raises:
            OSError: if it cannot be read.
            ValueError: as :func:`texture_of_bytes`.
        """
        if path not in self._known:
            if not path.is_file():
                raise FileNotFoundError(
                    f"{named_in}: the texture {path} is not there; put it there, or take surfaces with missing "
                    f"textures as grey: {GREY_UNKNOWN}"
                )
            data = read_charged(path, self._budget)
            self._known[path] = texture_of_bytes(data, str(path), self._budget)
            self._budget.give_back(len(data))
        return self._known[path]


def texture_of_bytes(
    data: bytes | memoryview, name: str, budget: Budget, formats: tuple[str, ...] = FORMATS
) -> EncodedTexture:
    """Decode the bytes of an image file. The size in its header is charged before they are decoded.

    Args:
        name: of the image, for messages.
        formats: the formats that it may have, by Pillow's names.

    Raises:
        ValueError: if it is no such image, one of more than 8 bits a channel, or of more than :data:`MOST_SIDE` texels
            on a side; DecodeError if it needs more than the budget has left.
    """
    import PIL.Image
    from PIL import UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of Pillow's own limit, which the budget replaces, and of odd metadata
            with PIL.Image.open(io.BytesIO(data), formats=formats) as image:
                check_size(image.width, image.height, name)
                if image.mode.startswith(("I", "F")):
                    raise ValueError(f"{name}: a texture must have 8 bits a channel, got an image of mode {image.mode}")
                return _decoded(image, name, budget)
    except UnidentifiedImageError:
        kinds = ", ".join(formats)
        raise ValueError(f"{name}: not an image that can be read as a texture ({kinds})") from None
    except (PIL.Image.DecompressionBombError, SyntaxError, EOFError, OSError, struct.error, zlib.error) as error:
        raise ValueError(f"{name}: the texture cannot be read: {error}") from None


def check_size(width: int, height: int, name: str) -> None:
    """Refuse an image with more than :data:`MOST_SIDE` texels on a side.

    Raises:
        ValueError: naming the image and its size.
    """
    if max(width, height) > MOST_SIDE:
        raise ValueError(f"{name}: a texture may have {MOST_SIDE} texels on a side, got {width} x {height}")


def _decoded(image: Image, name: str, budget: Budget) -> EncodedTexture:
    """Convert the texels strip by strip, so that there is never a second copy of the whole image."""
    width, height = image.size
    size = f"{name}: a texture of {width} x {height} texels"
    budget.take(_TEXEL_BYTES * width * height, size)
    with budget.borrow(_DECODED_BYTES * width * height, f"{size}, while it is decoded,"):
        image.load()
        may_be_clear = image.mode not in ("RGB", "L") or "transparency" in image.info
        texels, alpha = np.empty((height, width, 3), np.uint8), None
        for rows in _strips(height, width):
            strip = image.crop((0, rows.start, width, rows.stop))
            if may_be_clear:
                strip = strip.convert("RGBA")
                opacity = np.asarray(strip.getchannel("A"))
                if alpha is None and opacity.min() < 255:
                    budget.take(width * height, f"{size}, with alpha,")
                    alpha = np.full((height, width), 255, np.uint8)
                if alpha is not None:
                    alpha[rows] = opacity
            texels[rows] = np.asarray(strip if strip.mode == "RGB" else strip.convert("RGB"))
    return EncodedTexture(texels, alpha, np.ones(3))


def _strips(height: int, width: int) -> Iterator[slice]:
    """Yield the rows of an image, about :data:`_STRIP` texels at a time."""
    step = max(1, _STRIP // width)
    for start in range(0, height, step):
        yield slice(start, min(start + step, height))
