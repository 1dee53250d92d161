"""Lists and reads the images and meshes in a user's folder."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..._util.budget import Budget
from ..._util.extras import require
from ..._util.untrusted import regular_file
from ..repairs import SceneFileWarning
from ..texture_file import FORMATS, TextureFiles, check_size
from ..textures import Texture
from .mesh_scene import READERS as MESH_READERS

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".tga")
"""Suffixes of images; other files of the folder are ignored."""

SMALLEST_SIDE = 16
"""The fewest pixels on a side of a texture; fewer would be a few blurred patches."""


def image_files(folder: str | Path) -> tuple[Path, ...]:
    """List the images in a folder and its subfolders, by their suffix, in the order of their names.

    Raises:
        OSError: if there is no such folder, or it cannot be read.
        ValueError: if it has no images.
    """
    return _files(Path(folder), IMAGE_SUFFIXES, "images")


def mesh_files(folder: str | Path) -> tuple[Path, ...]:
    """List the meshes (OBJ, PLY) in a folder and its subfolders, as :func:`image_files` lists images."""
    return _files(Path(folder), tuple(MESH_READERS), "meshes")


def check_image(path: Path, longest_side: int) -> None:
    """Refuse a file that, by its header, is not an image that can be a texture of at most ``longest_side`` texels.

    Raises:
        OSError: if it cannot be read.
        ImportError: if it has to be scaled down, which OpenCV does, and that is not there.
        ValueError: naming the file.
    """
    from PIL import Image, UnidentifiedImageError

    regular_file(path)
    try:
        with Image.open(path, formats=FORMATS) as image:
            width, height = image.size
    except UnidentifiedImageError:
        raise ValueError(f"{path}: not an image that can be read as a texture") from None
    except (Image.DecompressionBombError, Image.DecompressionBombWarning, SyntaxError) as error:
        raise ValueError(f"{path}: the texture cannot be read: {error}") from None
    if min(width, height) < SMALLEST_SIDE:
        raise ValueError(
            f"{path}: an image must have at least {SMALLEST_SIDE} pixels each way, this has {width} x {height}"
        )
    check_size(width, height, str(path))
    if max(width, height) > longest_side:
        require("video", "cv2")


def read_image_texture(path: Path, longest_side: int) -> Texture:
    """Read an image as reflectance (H, W, 3) in linear RGB, with at most ``longest_side`` texels on a side.

    A larger image is scaled down by averages over areas, in linear light.

    Raises:
        OSError, ValueError: as :func:`~davis_rs.scene.texture_file.TextureFiles.read` and :func:`check_image`.

    Warns:
        SceneFileWarning: if it is partly transparent: all of it is opaque here.
    """
    check_image(path, longest_side)
    budget = Budget(path)
    encoded = TextureFiles(budget).read(path, str(path.parent))
    if not encoded.opaque:
        message = f"{path}: the texture is transparent in places; here it is opaque everywhere"
        warnings.warn(message, SceneFileWarning, stacklevel=2)
    encoded.charge(budget, str(path))
    texture = encoded.linear()
    height, width = texture.shape[:2]
    if max(height, width) <= longest_side:
        return texture
    import cv2

    factor = longest_side / max(height, width)
    size = max(1, round(width * factor)), max(1, round(height * factor))
    return np.clip(cv2.resize(texture, size, interpolation=cv2.INTER_AREA), 0.0, 1.0).astype(np.float32)


def _files(folder: Path, suffixes: Sequence[str], kind: str) -> tuple[Path, ...]:
    if not folder.is_dir():
        raise NotADirectoryError(f"{folder} is no folder: it must be one with {kind}")
    paths = (path for path in folder.rglob("*") if path.suffix.lower() in suffixes and path.is_file())
    files = sorted((path for path in paths if not path.name.startswith(".")), key=lambda path: path.as_posix())
    if not files:
        raise ValueError(f"{folder}: there are no {kind} in it ({', '.join(suffixes)})")
    return tuple(files)
