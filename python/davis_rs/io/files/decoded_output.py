"""Writes decoded streams into files: one class for each format, chosen by the file's suffix."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

import numpy as np

from ..._util.whole_file import Workplace, require_no_file
from ...events.arrays import concatenate_events
from ...events.decoded import IMU_DTYPE, TRIGGER_DTYPE, Decoded, Frame
from ..formats.registry import FORMATS
from .backward import Policy, TimeOrder
from .write import open_writer

ARRAYS_SUFFIX = ".npz"
"""Of a file with all there is; other suffixes stand for files of events alone."""


class DecodedOutput(Protocol):
    """Holds a file that is being written."""

    def write(self, decoded: Decoded) -> None:
        """Append a piece of the stream."""

    def finish(self) -> list[str]:
        """Complete what is written; returns sentences on what became of the stream."""

    def abandon(self) -> None:
        """Leave nothing of it, if it gets its name when it is whole."""


class EventsOutput:
    """Writes a file of events alone, in time order, of any format that :func:`~davis_rs.open_writer` writes.

    Args:
        path: a file that does not exist yet. With ``backward="split"`` the next runs go to files next to it:
            events.txt, events-1.txt, events-2.txt ...
        size: (width, height) of the sensor.
        backward: what to do where times go back.
        whole: whether a file gets its name when it is whole; see :func:`~davis_rs.open_writer`.

    Raises:
        OSError: if a file exists or cannot be written.
        ValueError: for a suffix that stands for no format; with ``backward="refuse"``, when times go back.
    """

    def __init__(self, path: Path, size: tuple[int, int], *, backward: Policy = "refuse", whole: bool = False) -> None:
        self._path, self._size, self._whole = path, size, whole
        self._order = TimeOrder(backward)
        self._writer = open_writer(path, size, whole=whole)
        self._runs = 1
        self._events = 0
        self._left_out = {"IMU samples": 0, "frames": 0, "triggers": 0}

    def write(self, decoded: Decoded) -> None:
        """Append the events."""
        first, *later = self._order.push(decoded.events)
        self._writer.write(first)
        for run in later:
            self._events += self._writer.finish().events
            next_path = self._path.with_stem(f"{self._path.stem}-{self._runs}")
            self._writer = open_writer(next_path, self._size, whole=self._whole)
            self._runs += 1
            self._writer.write(run)
        self._left_out["IMU samples"] += len(decoded.imu)
        self._left_out["frames"] += len(decoded.frames)
        self._left_out["triggers"] += len(decoded.triggers)

    def finish(self) -> list[str]:
        """Close; tells of splits, drops, and of what the format does not hold."""
        self._events += self._writer.finish().events
        said = [f"{self._path}: {self._events} events"]
        if self._runs > 1:
            said.append(f"times went back: the stream is in {self._runs} files, the last is number {self._runs - 1}")
        if self._order.dropped:
            said.append(f"times went back: {self._order.dropped} events dropped")
        left_out = ", ".join(f"{count} {kind}" for kind, count in self._left_out.items() if count)
        if left_out:
            said.append(f"not kept, for the format has no place for them: {left_out}")
        return said

    def abandon(self) -> None:
        """Leave nothing of the file that is written, if it gets its name when it is whole; runs before it are whole."""
        if self._whole:
            self._writer.abandon()


class ArraysOutput:
    """NumPy's .npz, with all there is, in the order of the wire; held in memory until it is finished.

    Arrays: ``events`` (:data:`davis_rs.EVENT_DTYPE`), ``imu`` (:data:`davis_rs.IMU_DTYPE`), ``triggers``
    (:data:`davis_rs.TRIGGER_DTYPE`), ``frame_times`` int64 (n, 4): start, exposure start and end, end;
    ``frame_regions`` int64 (n, 4): x, y, width, height; and ``frame_0`` ... uint16 (height, width).

    Args:
        path: a file that does not exist yet.

    Raises:
        OSError: if it exists or cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._workplace = Workplace(path, require_room=lambda: require_no_file(path, overwrite=False))
        self._parts: list[Decoded] = []

    def write(self, decoded: Decoded) -> None:
        """Keep a piece."""
        self._parts.append(decoded)

    def finish(self) -> list[str]:
        """Write all."""
        frames = [frame for part in self._parts for frame in part.frames]
        arrays: dict[str, Any] = {
            "events": concatenate_events([part.events for part in self._parts]),
            "imu": np.concatenate([np.zeros(0, IMU_DTYPE), *(part.imu for part in self._parts)]),
            "triggers": np.concatenate([np.zeros(0, TRIGGER_DTYPE), *(part.triggers for part in self._parts)]),
            "frame_times": np.array([frame[:4] for frame in frames], np.int64).reshape(-1, 4),
            "frame_regions": np.array([_region(frame) for frame in frames], np.int64).reshape(-1, 4),
        }
        arrays |= {f"frame_{k}": frame.pixels for k, frame in enumerate(frames)}
        try:
            np.savez(self._workplace.working_path, **arrays)
            self._workplace.put()
        except BaseException as error:
            self._workplace.discard(error)
            raise
        counts = {"events": "events", "imu": "IMU samples", "triggers": "triggers"}
        said = ", ".join(f"{len(arrays[name])} {kind}" for name, kind in counts.items())
        return [f"{self._path}: {said}, {len(frames)} frames"]

    def abandon(self) -> None:
        """Leave nothing."""
        self._workplace.discard()


def is_decoded(path: str | Path) -> bool:
    """Return whether a file's suffix stands for decoded streams."""
    suffix = Path(path).suffix.lower()
    return suffix == ARRAYS_SUFFIX or any(suffix in format.suffixes for format in FORMATS.values())


def decoded_output(
    path: str | Path, size: tuple[int, int], *, backward: Policy = "refuse", whole: bool = False
) -> DecodedOutput:
    """Return the output for a file's suffix: .npz for all there is, those of event files for events.

    Args:
        size: (width, height) of the sensor.
        backward: what to do where times go back in a file of events.
        whole: whether a file of events gets its name when it is whole, as a .npz always does.

    Raises:
        ValueError: for another suffix.
        OSError: if the file exists or cannot be created.
    """
    path = Path(path)
    if path.suffix.lower() == ARRAYS_SUFFIX:
        return ArraysOutput(path)
    return EventsOutput(path, size, backward=backward, whole=whole)


def _region(frame: Frame) -> tuple[int, int, int, int]:
    height, width = frame.pixels.shape
    return frame.x, frame.y, width, height
