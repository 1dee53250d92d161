"""Decodes a camera's bytes, the stream of the USB, as ``davis-rs record`` writes them."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path

from ...usb.raw_file import HEADER_BYTES, MAGIC, RawRecording
from .recording_file import EMPTY, RECORDED_KINDS, Piece, RecordingFile, Remarks

__all__ = ["MAGIC", "CameraBytesFile"]


class CameraBytesFile(RecordingFile):
    """Reads a recording of :class:`davis_rs.RawWriter`."""

    format = "camera bytes"
    one_way = "times in a camera's stream follow from those before them"

    def __init__(self, path: Path, *, chip: str | None = None, **_: object) -> None:
        self.raw = RawRecording(path)
        device = self.raw.camera.device
        if chip is not None and chip != device.chip:
            raise ValueError(f"{path} is of a {device.chip}: leave out chip={chip!r}")
        super().__init__(path, device.chip, (device.width, device.height), started=self.raw.started)

    def pieces(self, kinds: Collection[str] = RECORDED_KINDS, remarks: Remarks | None = None) -> Iterator[Piece]:
        remarks = Remarks() if remarks is None else remarks
        decoder, done = self.raw.decoder(), HEADER_BYTES
        total = self.path.stat().st_size
        for chunk in self.raw.chunks():
            done += len(chunk)
            all_kinds = decoder.push(chunk)
            yield Piece(EMPTY._replace(**{kind: getattr(all_kinds, kind) for kind in kinds}), done / total)
        odd = ", ".join(f"{count} {kind}" for kind, count in decoder.stats.items() if count)
        if odd:
            remarks.notes.append(f"oddities of the stream: {odd}")
        if self.raw.lost_bytes:
            remarks.notes.append(f"{self.raw.lost_bytes} bytes had been lost while it was recorded")
        if not self.raw.complete:
            remarks.cut.append("the recording was not finished; what is there is read")
