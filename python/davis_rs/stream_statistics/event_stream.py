"""The events of anything that can be read, piece by piece."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from ..argument_error import ArgumentError
from ..dataset.reader import Dataset
from ..event_files.read import open_reader
from ..events import EventArray
from ..recordings import aedat2, aedat3, read_recording
from ..untrusted import regular_file
from ..usb.raw_file import RawRecording, is_raw

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


def open_event_stream(path: str | os.PathLike[str], *, size: tuple[int, int] | None = None) -> EventStream:
    """Open a dataset folder, an event file of any format, a camera's bytes, or a recording (AEDAT 2, 3.1, 4).

    AEDAT 2 and 3.1 are held in memory while they are read; all else is streamed.

    Args:
        size: (width, height) of the sensor in pixels, where the file does not say.

    Raises:
        OSError, DecodeError: if it cannot be read.
        ValueError: if neither the file nor ``size`` says how large the sensor is.
    """
    file = Path(path)
    if file.is_dir():
        known = size or Dataset(file).size
        return EventStream(
            file.resolve().name, "dataset folder", _known(file, known), lambda told: _of_file(file, told)
        )
    with regular_file(file).open("rb") as opened:
        head = opened.read(16)
    if head.startswith((aedat2.MAGIC, aedat3.MAGIC)):
        recording = read_recording(file)
        kind = f"{recording.format}, {recording.chip}".rstrip(", ")
        return EventStream(
            file.name, kind, size or (recording.width, recording.height), lambda told: cut(recording.events, told)
        )
    if is_raw(file):
        raw = RawRecording(file)
        device = raw.camera.device
        return EventStream(
            file.name, raw.camera.chip, size or (device.width, device.height), lambda told: _of_camera(raw, told)
        )
    with open_reader(file) as reader:
        kind, known = reader.format, size or reader.size
    return EventStream(file.name, kind, _known(file, known), lambda told: _of_file(file, told))


def _known(path: Path, size: tuple[int, int] | None) -> tuple[int, int]:
    if size is None:
        raise ArgumentError("{} does not say the sensor's size: give {size}", path)
    return size


def _of_file(path: Path, told: Callable[[float], object]) -> Iterator[EventArray]:
    with open_reader(path, backward="keep", outside="keep") as reader:
        for events in reader.iter(_PIECE):
            yield events
            told(reader.progress)


def _of_camera(raw: RawRecording, told: Callable[[float], object]) -> Iterator[EventArray]:
    decoder, total, done = raw.decoder(), raw.path.stat().st_size, 0
    for chunk in raw.chunks():
        yield decoder.push(chunk).events
        done += len(chunk)
        told(min(done / total, 1.0))


def cut(events: EventArray, told: Callable[[float], object]) -> Iterator[EventArray]:
    """An array in pieces."""
    for start in range(0, len(events), _PIECE):
        yield events[start : start + _PIECE]
        told(min((start + _PIECE) / len(events), 1.0))
