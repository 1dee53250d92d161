"""Image files as textures."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from .textures import Texture, from_srgb


def read_texture(path: Path, named_in: str) -> Texture:
    """An image file as reflectance (H, W, 3) in linear RGB; 8 bits a channel, in sRGB.

    Args:
        named_in: file and line that name it, for messages.

    Raises:
        OSError: if it cannot be read.
        ValueError: if it is no image, or one of more than 8 bits a channel.

    Warns:
        UserWarning: if it is partly transparent: all of it is opaque here.
    """
    from PIL import Image, UnidentifiedImageError

    if not path.is_file():
        raise FileNotFoundError(
            f"{named_in}: the texture {path} is not there; put it there, or remove that line to simulate without it"
        )
    try:
        with Image.open(path) as image:
            if image.mode.startswith(("I", "F")):
                raise ValueError(f"{path}: a texture must have 8 bits a channel, got an image of mode {image.mode}")
            rgba = np.asarray(image.convert("RGBA"))
    except UnidentifiedImageError:
        raise ValueError(f"{path}: not an image that can be read as a texture (PNG, JPEG, TIFF, BMP, TGA)") from None
    except (Image.DecompressionBombError, SyntaxError, EOFError) as error:
        raise ValueError(f"{path}: the texture cannot be read: {error}") from None
    if rgba[..., 3].min() < 255:
        warnings.warn(f"{path}: the texture is transparent in places; here it is opaque everywhere", stacklevel=2)
    return from_srgb(np.arange(256) / 255).astype(np.float32)[rgba[..., :3]]
