"""Reads the events of anything that can be read, piece by piece."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from ...events.arrays import EventArray
from ...io.dataset.folder_format import FolderReader
from ...io.files.read import open_reader
from ...io.files.sensor_size import find_sensor_size, sensor_size
from ...io.formats.recorded import RecordedParts

_PIECE = 1 << 18


@dataclass(frozen=True)
class EventStream:
    """Events in the order in which they were stored.

    Attributes:
        name: of the file or folder.
        kind: its format, or the camera.
        size: (width, height) of the sensor in pixels.
        pieces: makes an iterator over the events, :data:`davis_rs.EVENT_DTYPE`; what it is given is told the share that
            is read, 0..1.
    """

    name: str
    kind: str
    size: tuple[int, int]
    pieces: Callable[[Callable[[float], object]], Iterator[EventArray]]


def open_event_stream(
    path: str | os.PathLike[str],
    *,
    size: tuple[int, int] | None = None,
    fallback_size: tuple[int, int] | None = None,
) -> EventStream:
    """Open whatever :func:`davis_rs.open_reader` opens: a dataset folder, an event file of any format, or a camera's
    recording. Its events are streamed.

    Args:
        size: (width, height) of the sensor in pixels, where the file does not say.
        fallback_size: the same, where nothing else says it.

    Raises:
        OSError, DecodeError: if it cannot be read.
        ValueError: if nothing says how large the sensor is, or ``size`` contradicts the file.
    """
    file = Path(path)
    with open_reader(file) as reader:
        known = find_sensor_size(reader, size) or fallback_size or sensor_size(reader, size)
        kind = reader.format
        if isinstance(reader, FolderReader):
            kind = "dataset folder"
        elif isinstance(reader, RecordedParts):
            kind = f"{reader.recording.format}, {reader.recording.chip}".rstrip(", ")
    name = (file.resolve() if file.is_dir() else file).name  # also of "."
    return EventStream(name, kind, known, lambda told: _of_file(file, told))


def _of_file(path: Path, told: Callable[[float], object]) -> Iterator[EventArray]:
    with open_reader(path, backward="keep", outside="keep") as reader:
        for events in reader.iter(_PIECE):
            yield events
            told(reader.progress)


def cut(events: EventArray, told: Callable[[float], object]) -> Iterator[EventArray]:
    """Yield an array in pieces."""
    for start in range(0, len(events), _PIECE):
        yield events[start : start + _PIECE]
        told(min((start + _PIECE) / len(events), 1.0))
