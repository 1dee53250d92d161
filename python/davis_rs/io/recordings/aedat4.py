"""Reads AEDAT 4, DV's format, as the Rust core reads it.

Source: docs.inivation.com, AEDAT 4.0; the schemas of dv-processing.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path

from ..._core import Aedat4Recording, DecodeError
from ..._util.untrusted import MAX_PACKET_BYTES
from ...events.decoded import Decoded
from .recording import known_chip, size_of
from .recording_file import RECORDED_KINDS, Piece, RecordingFile, Remarks

MAGIC = b"#!AER-DAT4.0\r\n"


class Aedat4File(RecordingFile):
    """Reads a file of AEDAT 4.

    Attributes:
        has_events: whether it has a stream of events.
    """

    format = "AEDAT 4"
    unix_times = True
    one_way = "a packet does not say where the next one of its stream is"

    def __init__(
        self, path: Path, *, chip: str | None = None, max_packet_bytes: int = MAX_PACKET_BYTES, **_: object
    ) -> None:
        self._limit = max_packet_bytes
        core = Aedat4Recording(path, [], max_packet_bytes)
        self.has_events = core.has_events
        known = known_chip(chip, core.source)
        super().__init__(path, known, core.size or (size_of(known) if known else None))

    def pieces(self, kinds: Collection[str] = RECORDED_KINDS, remarks: Remarks | None = None) -> Iterator[Piece]:
        if set(kinds) == {"events"} and not self.has_events:
            raise DecodeError(f"{self.path}: the file has no stream of events (EVTS)")
        remarks = Remarks() if remarks is None else remarks
        core, others = Aedat4Recording(self.path, list(kinds), self._limit), 0
        total = max(self.path.stat().st_size, 1)
        while (arrays := core.read()) is not None:
            others += arrays["other_packets"]
            decoded = Decoded(arrays["events"], arrays["imu"], arrays["frames"], arrays["triggers"])
            yield Piece(decoded, min(core.bytes / total, 1.0))
        if others and set(kinds) == set(RECORDED_KINDS):
            remarks.notes.append(f"{others} packets of other streams left out; read is the first of each kind")
        if core.cut is not None:
            remarks.cut.append(core.cut)
