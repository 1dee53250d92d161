"""Image files as textures."""

from __future__ import annotations

import io
import struct
import warnings
import zlib
from pathlib import Path

import numpy as np

from ..._util.untrusted import read_limited
from ..textures import Texture, from_srgb

MOST_TEXELS = 1 << 26
"""Of a texture, 8192 x 8192: a file of some kilobytes may unpack to any number."""


def read_texture(path: Path, named_in: str) -> tuple[Texture, bool]:
    """An image file as reflectance (H, W, 3) in linear RGB, 8 bits a channel, in sRGB; and whether it is opaque
    everywhere.

    Args:
        named_in: file and line that name it, for messages.

    Raises:
        OSError: if it cannot be read.
        ValueError: if it is no image, or one of more than 8 bits a channel.
    """
    if not path.is_file():
        raise FileNotFoundError(
            f"{named_in}: the texture {path} is not there; put it there, or remove that line to simulate without it"
        )
    return texture_of_bytes(read_limited(path), str(path))


def texture_of_bytes(data: bytes, name: str, *, formats: tuple[str, ...] | None = None) -> tuple[Texture, bool]:
    """An image file's bytes as :func:`read_texture`, and whether it is opaque everywhere.

    Args:
        name: how messages call it.
        formats: which of Pillow's it may have; all if not given.

    Raises:
        ValueError: if it is no such image, one of more than 8 bits a channel, or of more than :data:`MOST_TEXELS`.
    """
    from PIL import Image, UnidentifiedImageError

    kinds = ", ".join(formats or ("PNG", "JPEG", "TIFF", "BMP", "TGA"))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of Pillow's own limit, which is higher than ours, and of odd metadata
            with Image.open(io.BytesIO(data), formats=formats) as image:
                if image.mode.startswith(("I", "F")):
                    raise ValueError(f"{name}: a texture must have 8 bits a channel, got an image of mode {image.mode}")
                if image.width * image.height > MOST_TEXELS:
                    size = f"{image.width} x {image.height}"
                    raise ValueError(f"{name}: a texture may have {MOST_TEXELS} texels, got {size}")
                rgba = np.asarray(image.convert("RGBA"))
    except UnidentifiedImageError:
        raise ValueError(f"{name}: not an image that can be read as a texture ({kinds})") from None
    except (Image.DecompressionBombError, SyntaxError, EOFError, OSError, struct.error, zlib.error) as error:
        raise ValueError(f"{name}: the texture cannot be read: {error}") from None
    texture = from_srgb(np.arange(256) / 255).astype(np.float32)[rgba[..., :3]]
    return texture, bool(rgba[..., 3].min() == 255)
