"""From one event file to another, in constant memory."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..dataset.reader import Dataset
from ..formats.interface import Roi, Target, WriteReport
from ..formats.reading import Breach
from ..untrusted import MAX_PACKET_BYTES
from .read import open_reader
from .write import open_writer


def convert(
    source: str | os.PathLike[str],
    target: Target,
    *,
    size: tuple[int, int] | None = None,
    format: str | None = None,
    start_us: int | None = None,
    stop_us: int | None = None,
    roi: Roi | None = None,
    backward: Breach = "refuse",
    outside: Breach = "refuse",
    max_packet_bytes: int = MAX_PACKET_BYTES,
    overwrite: bool = False,
    progress: Callable[[float], object] | None = None,
    **options: Any,
) -> WriteReport:
    """Convert events from any format to any format; times, coordinates and the order of events stay as they are.

    Args:
        source: a file of any format, recognised by its content, or a dataset folder.
        target: a path, or an open binary stream.
        size: (width, height) of the sensor, where the source does not say.
        format: of the target; by its suffix if not given.
        start_us, stop_us: only events with start_us <= t < stop_us.
        roi: only events with x0 <= x < x1 and y0 <= y < y1, as (x0, y0, x1, y1).
        backward, outside, max_packet_bytes: see :func:`davis_rs.open_reader`; how many events were dropped is a
            ``UserWarning``.
        overwrite: whether an existing target may be replaced.
        progress: is told the share of the source that is done, 0..1.
        options: those of the target's format.

    Raises:
        ValueError: if the size is not known, both are one file, or the target cannot hold an event; what came before
            it is written.
        OSError, DecodeError: if the source cannot be read, or the target not be written.
    """
    if isinstance(target, str | os.PathLike) and os.path.exists(target) and os.path.samefile(source, target):
        raise ValueError(f"{os.fspath(source)} cannot be converted onto itself")
    with open_reader(source, backward=backward, outside=outside, max_packet_bytes=max_packet_bytes) as reader:
        sensor = size or reader.size or _size_of_folder(source)
        if sensor is None:
            raise ValueError(f"{reader.path} ({reader.format}) does not say the sensor's size: give it")
        with open_writer(target, sensor, format, overwrite=overwrite, **options) as writer:
            for events in reader.iter(start_us=start_us, stop_us=stop_us, roi=roi):
                writer.write(events)
                if progress is not None:
                    progress(reader.progress)
        dropped = reader.check
        if dropped.dropped_backward or dropped.dropped_outside:
            warnings.warn(
                f"{reader.path}: left out are {dropped.dropped_backward} events earlier than one before them, "
                f"{dropped.dropped_outside} outside of the sensor",
                stacklevel=2,
            )
        return writer.finish()


def _size_of_folder(source: str | os.PathLike[str]) -> tuple[int, int] | None:
    """The size that a dataset folder states, if it does."""
    if not os.path.isdir(source):
        return None
    return Dataset(Path(source)).size


def left_out(source: str | os.PathLike[str]) -> str:
    """What a dataset folder holds that a file of events cannot: its parts and their counts, empty if there are none.

    Raises:
        OSError, DecodeError: if a part cannot be read.
    """
    dataset = Dataset(Path(source))
    counts = {
        "frames": len(dataset.frames),
        "depth maps": len(dataset.depth_maps),
        "poses": len(dataset.groundtruth.t_us),
        "IMU samples": len(dataset.imu),
    }
    return ", ".join(f"{count:,} {what}" for what, count in counts.items() if count)
