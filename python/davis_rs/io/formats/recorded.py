"""Reads recordings of cameras as event files: AEDAT 3.1 and a camera's own bytes; AEDAT 2.0 is in ``aedat2``."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..._core import DecodeError
from ...events.arrays import EventArray
from ..recordings import aedat3, camera_bytes
from ..recordings.recording_file import RecordingFile, Remarks
from .blocks import BlockPosition, Blocks, blocks_of, refuse
from .interface import EventReader, Format, warn_truncated
from .parts import ImuSample, on_sensor
from .reading import ANY_SIZE, ReadRules


class RecordedParts:
    """Yields what a camera's recording has next to its events, for a reader.

    Attributes:
        recording: the file.
        notes: what was assumed of frames and samples that were read, and what was left out; each once.
    """

    recording: RecordingFile
    notes: dict[str, None]
    size: tuple[int, int] | None
    sensor: tuple[int, int] | None

    def images(self) -> Iterator[tuple[int, npt.NDArray[np.uint8]]]:
        """Yield intensity frames as (t_us, uint8 (height, width)) of the sensor's size, stamped with the middle of
        their exposure; 0 where a frame does not cover the sensor. A camera's 10 bits lose the last two, which ``notes``
        say.
        """
        remarks = Remarks()
        for piece in self.recording.pieces(("frames",), remarks):
            for frame in piece.decoded.frames:
                if (frame.pixels & 0xFF).any():
                    self.notes["frames of more than 8 bits: the upper 8 are taken"] = None
                grey = (frame.pixels >> 8).astype(np.uint8)
                image = on_sensor(grey, frame.x, frame.y, self.size or self.sensor)
                if image is not grey:
                    self.notes["frames of a part of the sensor: they are 0 elsewhere"] = None
                yield (frame.t_exposure_start + frame.t_exposure_end) // 2, image
        self._found(remarks)

    def imu(self) -> Iterator[ImuSample]:
        """Yield IMU samples."""
        remarks = Remarks()
        for piece in self.recording.pieces(("imu",), remarks):
            for sample in piece.decoded.imu:
                yield ImuSample(int(sample["t"]), sample["accel"].copy(), sample["gyro"].copy())
        self._found(remarks)

    def _found(self, remarks: Remarks) -> None:
        """Keep what was found in a pass over the file."""
        self.notes.update(dict.fromkeys(remarks.notes))


class RecordedReader(RecordedParts, EventReader):
    """Reads a recording of a camera."""

    def __init__(self, recording: RecordingFile, *, format: str, rules: ReadRules) -> None:
        super().__init__(recording.path, format=format, size=recording.size, rules=rules, extent=ANY_SIZE)
        self.recording, self.notes = recording, {}
        self._done = 0.0
        self._cuts: set[str] = set()
        """What the end of the file cuts off, as far as it was told."""

    @property
    def progress(self) -> float:
        return self._done

    def _packets(self, chunk: int, start_us: int | None, stop_us: int | None) -> Iterator[EventArray]:
        remarks = Remarks()
        for piece in self.recording.pieces(("events",), remarks):
            events, self._done = piece.decoded.events, piece.fraction
            for start in range(0, len(events), chunk):
                yield events[start : start + chunk]
            if stop_us is not None and len(events) and events["t"][0] >= stop_us:
                return
        self._cuts.clear()
        self._found(remarks)

    def _found(self, remarks: Remarks) -> None:
        super()._found(remarks)
        for cut in set(remarks.cut) - self._cuts:
            self._cuts.add(cut)
            warn_truncated(self.path, cut)

    def blocks(self) -> Blocks:
        if self.recording.one_way:
            refuse(self.path, self.recording.one_way)
        remarks = Remarks()
        rows: list[tuple[int, int, tuple[int, ...]]] = []
        number, last_us = 0, 0
        for piece in self.recording.pieces(("events",), remarks):
            events = piece.decoded.events
            if len(events) and piece.position is not None:
                first_us = int(events["t"][0])
                if first_us < last_us:
                    raise DecodeError(
                        f"{self.path}: times may not go back: event {number} is at {first_us} us, after {last_us} us"
                    )
                rows.append((len(events), first_us, piece.position))
                number, last_us = number + len(events), int(events["t"][-1])
        self._found(remarks)
        positions = np.array([position for *_, position in rows], np.int64).reshape(len(rows), -1)
        return blocks_of([count for count, *_ in rows], [first_us for _, first_us, _ in rows], positions, last_us)

    def read_block(self, position: BlockPosition, events: int) -> EventArray:
        return self.recording.events_at(tuple(position.tolist()))


class RecordedFormat(Format):
    """Describes a format of cameras' software, which is only read unless a subclass has a writer.

    Args:
        name: as ``format=`` and messages name it.
        file: opens a recording of it.
        magic: what files begin with.
    """

    writable = False

    def __init__(
        self, name: str, file: Callable[..., RecordingFile], magic: bytes, suffixes: tuple[str, ...] = ()
    ) -> None:
        self.name, self.suffixes = name, suffixes
        self._file, self._magic = file, magic

    def sniff(self, head: bytes, path: Path) -> bool:
        return head.startswith(self._magic)

    def open_reader(self, path: str | os.PathLike[str], rules: ReadRules = ReadRules()) -> RecordedReader:  # noqa: B008
        recording = self._file(Path(path), max_packet_bytes=rules.max_packet_bytes)
        return RecordedReader(recording, format=self.name, rules=rules)


AEDAT3 = RecordedFormat("aedat3", aedat3.Aedat3File, aedat3.MAGIC, (".aedat",))
CAMERA_BYTES = RecordedFormat("camera", camera_bytes.CameraBytesFile, camera_bytes.MAGIC)
