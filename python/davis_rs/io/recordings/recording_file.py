"""Reads a camera's recording piece by piece, whatever its format is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...events.arrays import EVENT_DTYPE, EventArray
from ...events.decoded import IMU_DTYPE, TRIGGER_DTYPE, Decoded

RECORDED_KINDS = ("events", "imu", "frames", "triggers")
"""What a recording may hold."""


@dataclass
class Remarks:
    """Holds what reading a recording has found besides its contents.

    Attributes:
        notes: what was assumed, and what was left out.
        cut: what the end of the file cuts off, and where.
    """

    notes: list[str] = field(default_factory=list)
    cut: list[str] = field(default_factory=list)


class Piece(NamedTuple):
    """Holds a part of a recording.

    Attributes:
        decoded: what it holds. Events may lie outside of the sensor.
        fraction: of the file that is read with it, 0..1.
        position: where its events are, for :meth:`RecordingFile.events_at`; None where they follow from those before
            them.
    """

    decoded: Decoded
    fraction: float
    position: tuple[int, ...] | None = None


class RecordingFile(ABC):
    """Reads a recording, of which the header was read already.

    Attributes:
        path: the file.
        format: its format, in words.
        chip: the camera's, such as ``"DAVIS240C"``; empty if the file does not name one that is known.
        size: (width, height) of the sensor in pixels, None where neither the file nor its chip says.
        started: when the recording began, if the file says.
        accelerometer_range_g, gyroscope_range_deg_s: full scales that make counts into units; None where the file has
            units.
        unix_times: whether times are microseconds since 1970 (UTC), not those of the camera's clock.
        one_way: why events cannot be found without those before them; empty where they can.
    """

    format: str
    one_way = ""
    unix_times = False

    def __init__(self, path: Path, chip: str, size: tuple[int, int] | None, *, started: datetime | None = None) -> None:
        self.path, self.chip, self.size, self.started = path, chip, size, started
        self.accelerometer_range_g: int | None = None
        self.gyroscope_range_deg_s: int | None = None

    @abstractmethod
    def pieces(self, kinds: Collection[str] = RECORDED_KINDS, remarks: Remarks | None = None) -> Iterator[Piece]:
        """Yield the recording from its beginning, in bounded memory unless the format's module says otherwise.

        Args:
            kinds: what is read; the rest is passed over.
            remarks: gets what is found, all of it when the last piece was handed out.

        Raises:
            OSError, DecodeError: if it cannot be read, or is malformed.
        """

    def has(self, kind: str) -> bool:
        """Return whether there is any of a kind.

        Raises:
            OSError, DecodeError: if it cannot be read, or is malformed before the first.
        """
        return any(len(getattr(piece.decoded, kind)) for piece in self.pieces((kind,)))

    def counts(self, kinds: Collection[str]) -> dict[str, int | None]:
        """Return how many there are of each kind; None for some, where their number is not known in bounded memory.

        Raises:
            OSError, DecodeError: if it cannot be read, or is malformed.
        """
        counts = dict.fromkeys(kinds, 0)
        for piece in self.pieces(kinds):
            for kind in kinds:
                counts[kind] += len(getattr(piece.decoded, kind))
        return {**counts}

    def events_at(self, position: tuple[int, ...]) -> EventArray:
        """Return the events of a piece that had this place.

        Raises:
            OSError, DecodeError: if they cannot be read.
        """
        raise NotImplementedError


EMPTY = Decoded(np.zeros(0, EVENT_DTYPE), np.zeros(0, IMU_DTYPE), [], np.zeros(0, TRIGGER_DTYPE))
"""A piece without anything."""
