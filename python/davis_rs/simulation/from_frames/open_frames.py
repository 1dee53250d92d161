"""Opens frames: a video, a folder of images, or a .npy file, whichever a path leads to."""

from __future__ import annotations

import os
from pathlib import Path

import numpy.typing as npt

from ..._util.argument_checks import check_type
from ..._util.argument_error import ArgumentError
from ..._util.close_names import names_checked
from .array_frames import NpyFrames
from .frame_source import FrameSource, Stamps
from .image_file import IMAGE_SUFFIXES
from .image_folder import ImageFolder
from .stamps import as_stamps, check_unit, rate_stamps, read_stamps
from .video import Video


@names_checked
def open_frames(
    path: str | Path,
    *,
    timestamps: str | Path | npt.ArrayLike | None = None,
    fps: float | None = None,
    time_unit: str | None = None,
) -> FrameSource:
    """Open frames for :func:`~davis_rs.events_from_frames` or :func:`~davis_rs.frames_to_folder`.

    Args:
        path: a video, a folder of images (PNG, JPEG, TIFF, BMP, OpenEXR), or a ``.npy`` file of the shape (n, H, W) or
            (n, H, W, 3).
        timestamps: when each frame was taken: a text file with one stamp a line, a ``.npy`` file, or numbers (n,). By
            default a video has its container's, and a folder those of its ``images.txt``, ``images.csv`` (ESIM),
            ``timestamps.txt`` or ``fps.txt`` (vid2e).
        fps: frames a second, in place of stamps; the first is at 0.
        time_unit: of the timestamps: s, ms, us or ns; by default seconds in text and floating point, microseconds in
            integers.

    Raises:
        ImportError: for a video, without PyAV.
        OSError: if something cannot be read.
        DecodeError: for malformed files.
        ValueError: for stamps that are missing, given twice, or of another number than the frames.
    """
    made_by = "davis_rs.events_from_frames takes arrays"
    check_type("path", path, (str, os.PathLike), made_by)
    if timestamps is not None and fps is not None:
        raise ArgumentError("only one of {timestamps} and {fps} may be given")
    if time_unit is not None and timestamps is None:
        raise ArgumentError("{time_unit} is that of {timestamps}: give them too")
    check_unit(time_unit)
    stamps: Stamps | None = None
    if fps is not None:
        stamps = rate_stamps(fps)
    elif isinstance(timestamps, str | Path):
        stamps = read_stamps(timestamps, time_unit).tolist()
    elif timestamps is not None:
        stamps = as_stamps(timestamps, time_unit, "timestamps").tolist()
    path = Path(path)
    if path.is_dir():
        return ImageFolder(path, stamps)
    if path.suffix.lower() == ".npy":
        if stamps is None:
            raise ArgumentError("{} does not say when its frames were taken: give {timestamps} or {fps}", path)
        return NpyFrames(path, stamps)
    if path.suffix.lower() in IMAGE_SUFFIXES:
        raise ValueError(f"{path} is a single image: give the folder of all of them")
    return Video(path, stamps)
