"""Writes events as AEDAT 2.0, for jAER; the reader is that of recordings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ...events.arrays import EventArray
from ..recordings import aedat2
from .byte_writer import ByteWriter
from .destination import Limits, naming
from .interface import EventWriter
from .recorded import RecordedFormat


class Aedat2Writer(ByteWriter):
    """Writes a record of eight bytes an event, after a header that names the camera of this size."""

    def _begin(self) -> None:
        self._put(aedat2.header_of(*self.size))

    def _encode(self, packet: EventArray) -> None:
        with naming(self.path):
            self._put(aedat2.records_of(packet, *self.size).tobytes())


@dataclass(frozen=True)
class _CameraSizeLimits(Limits):
    """Allows the sizes of those cameras alone that a file can name."""

    def check_size(self, name: str, size: tuple[int, int]) -> tuple[int, int]:
        size = super().check_size(name, size)
        aedat2.jaer_class(*size)
        return size


class Aedat2Format(RecordedFormat):
    """Describes AEDAT 2.0; its writer has no options, and writes events alone.

    Sensors have 128 x 128, 240 x 180, 346 x 260 or 640 x 480 pixels, because a file names a camera, not a size; times
    are below 2^31 us, 35.8 minutes.

    Source: docs.inivation.com, AEDAT 2.0.
    """

    writable = True
    writer: ClassVar[type[EventWriter]] = Aedat2Writer
    limits = _CameraSizeLimits(2**31 - 1)


AEDAT2 = Aedat2Format("aedat2", aedat2.Aedat2File, aedat2.MAGIC, (".aedat", ".aedat2"))
