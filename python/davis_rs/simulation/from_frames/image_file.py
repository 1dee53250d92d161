"""Reads one image file as an array: by Pillow, 16-bit colour by OpenCV, OpenEXR by its own library."""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..._core import DecodeError
from ..._util.budget import Budget
from ..._util.untrusted import decoding, read_charged
from .frame_source import FrameArray, charge_frame

if TYPE_CHECKING:
    from PIL.Image import Image

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".exr")
"""Of the files of a folder that are taken for its frames."""

_FORMATS = ("PNG", "JPEG", "TIFF", "BMP")
"""Pillow's names of the kinds of files that are read, whatever the file's name says; OpenEXR's goes by its name."""

_GREY, _COLOUR, _WITH_ALPHA = {"1", "L"}, {"RGB", "P"}, {"LA", "RGBA", "PA", "La", "RGBa"}


def read_frame_image(path: Path) -> FrameArray:
    """Read an image (H, W) or (H, W, 3): uint8 or uint16 as encoded, or float32.

    An image that its EXIF data turns is turned. An alpha channel is left out where it is opaque throughout.

    Raises:
        OSError: if the file cannot be read.
        DecodeError: for a file that is malformed, cut short, too large, has transparent pixels or colours other than
            grey and red, green, blue.
        ImportError: for an image that needs OpenCV, without it.
    """
    budget = Budget(path)
    data = read_charged(path, budget)
    if path.suffix.lower() == ".exr":
        return _read_exr(path, data, budget)
    return _read_with_pillow(path, data, budget)


def _opened(data: bytes) -> Image:
    """Open an image by its header, without Pillow's warning of many pixels: they are charged to the budget."""
    import PIL.Image

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PIL.Image.DecompressionBombWarning)
        return PIL.Image.open(io.BytesIO(data), formats=_FORMATS)


def _read_with_pillow(path: Path, data: bytes, budget: Budget) -> FrameArray:
    from PIL import ImageOps, UnidentifiedImageError

    deep = False
    try:
        with decoding(path), _opened(data) as opened:
            charge_frame(budget, opened.width, opened.height)
            deep = _has_deep_colour(opened, data)
            if not deep:
                image = ImageOps.exif_transpose(opened)
                image.load()
    except DecodeError as error:
        if not isinstance(error.__cause__, UnidentifiedImageError):
            raise
        if data[:4] not in _TIFF:
            kinds = f"{', '.join(_FORMATS)}, or OpenEXR by its name"
            raise DecodeError(f"{path}: not an image of a kind that is read: {kinds}") from None
        deep = True  # a layout that Pillow does not have, such as TIFF with 16-bit colour
        charge_frame(budget, *_tiff_size(path, data))
    if deep:
        return _read_with_opencv(path, data)
    mode = image.mode
    if mode.startswith("I"):  # Pillow's names for 16 bits of grey
        values = np.asarray(image)
        if values.min() < 0 or values.max() > 65535:
            raise DecodeError(f"{path}: an image of integers must have 8 or 16 bits a value, found {mode}")
        return values.astype(np.uint16)
    if mode == "F":
        return np.asarray(image, np.float32)
    if mode in _WITH_ALPHA or (mode in ("P", "L", "RGB") and "transparency" in image.info):
        whole = image.convert("RGBA")
        if np.asarray(whole)[..., 3].min() != 255:
            raise DecodeError(f"{path}: pixels must be opaque, found an alpha channel that is not")
        return np.asarray(whole)[..., :3]
    if mode in _GREY:
        return np.asarray(image.convert("L"))
    if mode in _COLOUR:
        return np.asarray(image.convert("RGB"))
    raise DecodeError(f"{path}: an image must be grey or red, green and blue, found mode {mode}")


def _has_deep_colour(image: Image, data: bytes) -> bool:
    """Tell whether it is a PNG or a TIFF with 16-bit colour, of which Pillow would keep 8 bits without a word."""
    if image.format == "PNG":
        return data[24:25] == b"\x10" and data[25:26] in (b"\x02", b"\x04", b"\x06")
    if image.format == "TIFF":
        bits = image.tag_v2.get(_BITS_PER_SAMPLE, (1,))  # type: ignore[attr-defined]  # of its own class
        return len(bits) > 1 and max(bits) > 8
    return False


def _tiff_size(path: Path, data: bytes) -> tuple[int, int]:
    """Read width and height from the first directory of a TIFF file."""
    from PIL.TiffImagePlugin import ImageFileDirectory_v2

    with decoding(path):
        directory = ImageFileDirectory_v2(data[:16] if data[:4] in _BIG_TIFF else data[:8])
        file = io.BytesIO(data)
        file.seek(directory.next)  # type: ignore[attr-defined]  # set by its header
        directory.load(file)
        return int(directory[_WIDTH]), int(directory[_HEIGHT])


_BIG_TIFF = (b"II+\0", b"MM\0+")
_TIFF = (b"II*\0", b"MM\0*", *_BIG_TIFF)
_WIDTH, _HEIGHT, _BITS_PER_SAMPLE = 256, 257, 258


def _read_with_opencv(path: Path, data: bytes) -> FrameArray:
    try:
        import cv2
    except ImportError as error:
        raise ImportError(f"{path}: images with 16-bit colour need OpenCV: pip install 'davis_rs[video]'") from error
    with decoding(path):
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise DecodeError(f"{path}: not an image that Pillow or OpenCV can read, or cut short")
    if image.dtype not in (np.uint8, np.uint16, np.float32):
        raise DecodeError(f"{path}: values must be 8 or 16 bits or float32, found {image.dtype}")
    if image.ndim == 2:
        return np.asarray(image)
    if image.shape[2] == 4:
        opaque = np.iinfo(image.dtype).max if image.dtype != np.float32 else 1.0
        if (image[..., 3] != opaque).any():
            raise DecodeError(f"{path}: pixels must be opaque, found an alpha channel that is not")
    return np.ascontiguousarray(image[..., 2::-1])  # OpenCV has blue first


def _read_exr(path: Path, data: bytes, budget: Budget) -> FrameArray:
    import OpenEXR

    with decoding(path):
        # Its size before its pixels, for which it would take the memory.
        with OpenEXR.File(io.BytesIO(data), header_only=True) as file:
            low, high = (np.asarray(corner, np.int64) for corner in file.header()["dataWindow"])
            count = len(file.header()["channels"])
        wide, high_px = (high - low + 1).tolist()
        if wide < 1 or high_px < 1:
            raise DecodeError(f"{path}: an image must have pixels, found {wide} x {high_px}")
        charge_frame(budget, wide, high_px)
        budget.take(4 * wide * high_px * count, f"its {count} channels of {wide} x {high_px} pixels")
        with OpenEXR.File(io.BytesIO(data), separate_channels=True) as file:
            channels = {name: channel.pixels for name, channel in file.channels().items()}
    alpha = channels.get("A")
    if alpha is not None and not (np.asarray(alpha) == 1).all():
        raise DecodeError(f"{path}: pixels must be opaque, found an alpha channel that is not")
    names = next((names for names in (("R", "G", "B"), ("Y",)) if all(name in channels for name in names)), None)
    if names is None or (names == ("Y",) and {"RY", "BY"} & channels.keys()):
        raise DecodeError(f"{path}: expected channels R, G and B, or Y alone, found {', '.join(sorted(channels))}")
    planes = [np.asarray(channels[name]) for name in names]
    if any(not np.issubdtype(plane.dtype, np.floating) for plane in planes):
        raise DecodeError(f"{path}: channels must be half or float, found {planes[0].dtype}")
    if any(plane.shape != planes[0].shape for plane in planes):
        raise DecodeError(f"{path}: channels must all have the image's size, found sub-sampled ones")
    image = np.stack(planes, -1).astype(np.float32) if len(planes) > 1 else planes[0].astype(np.float32)
    bad = ~np.isfinite(image) | (image < 0)
    if bad.any():
        y, x = (int(i) for i in np.argwhere(bad)[0][:2])
        raise DecodeError(f"{path}: light must be finite and >= 0, found {image[y, x]} at pixel ({x}, {y})")
    return image
