"""Reads the intensity frames of anything that has them, one by one, with the instants that they stand for."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..._util.array_types import AnyArray
from ...events.decoded import Frame
from ...inspection.statistics.stream_statistics import Measured
from ...io.dataset.folder_format import FolderReader
from ...io.dataset.reader import Dataset
from ...io.files.read import open_reader
from ...io.formats.parts import FRAMES
from ...io.formats.recorded import RecordedParts
from ...io.recordings.recording_file import RecordingFile
from .signal_samples import StampedFrame

_STEPS = 64  # the 16 bits of a camera's frame over the 10 of its converter
_GREY = 255.0
_BLACK_SHARE = 0.02


@dataclass(frozen=True)
class FrameSource:
    """Frames, and what is known of them.

    Attributes:
        frames: makes an iterator over them, in the order of time.
        unit: of their values, in words.
        black: the value of a frame without light, where it is known.
        of_camera: whether a camera made them, so that values are counts of its converter.
    """

    frames: Callable[[], Iterator[StampedFrame]]
    unit: str
    black: Measured | None = None
    of_camera: bool = False


def open_frames(path: str | os.PathLike[str], size: tuple[int, int]) -> FrameSource | None:
    """Return the frames of whatever :func:`davis_rs.open_reader` opens; None where it has no place for any.

    Frames of AEDAT 2.0 are held in memory, all others are read one by one. A frame of a camera stands for the middle of
    its exposure. A dataset folder of this package stamps frames at the end of the exposure that its ``meta.json``
    tells; other folders and files do not tell an exposure: the stamp is taken, and what it is off comes out as a lag.

    Args:
        size: (width, height) of the sensor in pixels.

    Raises:
        OSError, DecodeError: if they cannot be read.
    """
    file = Path(path)
    with open_reader(file) as reader:
        if isinstance(reader, FolderReader):
            return _of_folder(reader.dataset, size)
        if isinstance(reader, RecordedParts):
            recording = reader.recording
            return FrameSource(lambda: of_camera(_frames(recording), size), "DN", of_camera=True)
        if not hasattr(reader, FRAMES.read):
            return None
    return FrameSource(lambda: _of_file(file, size), "grey values")


def _of_folder(dataset: Dataset, size: tuple[int, int]) -> FrameSource | None:
    if not dataset.frames:
        return None
    aps = (dataset.meta.get("effects") or {}).get("aps")
    told = aps.get("exposure_us") if isinstance(aps, dict) else None
    exposure_us = float(told) if isinstance(told, int | float) else 0.0
    gain, log_eps = dataset.image_gain, (dataset.meta.get("parameters") or {}).get("log_eps")
    black = None
    if gain is not None and log_eps is not None:
        dark = float(log_eps) * _GREY * gain
        black = Measured(-dark, _BLACK_SHARE * dark)

    def frames() -> Iterator[StampedFrame]:
        for index, image in enumerate(dataset.frames):
            yield StampedFrame(image.t_us - exposure_us / 2, exposure_us, _whole(dataset.read_image(index), 0, 0, size))

    return FrameSource(frames, "grey values", black)


def _frames(recording: RecordingFile) -> Iterator[Frame]:
    for piece in recording.pieces(("frames",)):
        yield from piece.decoded.frames


def of_camera(frames: Iterator[Frame], size: tuple[int, int]) -> Iterator[StampedFrame]:
    """Yield the frames at their place on the sensor, stamped with the middle of their exposure."""
    for frame in frames:
        middle_us = (frame.t_exposure_start + frame.t_exposure_end) / 2
        exposure_us = float(frame.t_exposure_end - frame.t_exposure_start)
        yield StampedFrame(middle_us, exposure_us, _whole(frame.pixels / _STEPS, frame.x, frame.y, size))


def _of_file(file: Path, size: tuple[int, int]) -> Iterator[StampedFrame]:
    with open_reader(file) as reader:
        for t_us, pixels in getattr(reader, FRAMES.read)():
            yield StampedFrame(float(t_us), 0.0, _whole(pixels, 0, 0, size))


def _whole(pixels: AnyArray, x: int, y: int, size: tuple[int, int]) -> npt.NDArray[np.float32]:
    """Return values where they lie on the sensor, NaN around them."""
    width, height = size
    values = np.full((height, width), np.nan, np.float32)
    visible = pixels[: max(height - y, 0), : max(width - x, 0)]
    values[y : y + visible.shape[0], x : x + visible.shape[1]] = visible
    return values
