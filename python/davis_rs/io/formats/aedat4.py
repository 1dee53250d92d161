"""Writes and reads AEDAT 4.0, the files of iniVation's DV and of its newer cameras."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Literal

from ..._core import EventFileReader
from ..._util.argument_error import ArgumentError
from ..recordings.aedat4 import Aedat4File
from .core_files import CoreReader, CoreWriter
from .destination import Limits, Target
from .interface import EventReader, EventWriter, Format
from .reading import ReadRules
from .recorded import RecordedParts, RecordedReader


class Aedat4Reader(RecordedParts, CoreReader):
    """Reads AEDAT 4.0; of a slice of time, its packets alone, if the file has a table of contents."""

    def __init__(self, recording: Aedat4File, *, format: str, limits: Limits, rules: ReadRules) -> None:
        super().__init__(recording.path, format=format, limits=limits, rules=rules)
        self.recording, self.notes = recording, {}

    def _open(self, start_us: int | None = None, stop_us: int | None = None) -> EventFileReader:
        limit = self.rules.max_packet_bytes
        return EventFileReader(self.path, self.format, start_us=start_us, stop_us=stop_us, max_packet_bytes=limit)


class Aedat4Format(Format):
    """Describes AEDAT 4. Options of the writer:

    - ``compression`` ("lz4"): of each packet by itself, "none", "lz4" or "zstd";
    - ``level`` (-4): of Zstandard, -7..22; 1 makes files 5 % smaller and takes a quarter more time;
    - ``start_us`` (0): the Unix time in microseconds of the events' 0, which is added to all times. They are read as
      they stand in the file.

    Each packet that is written is a packet of the file, or several of 8192 events at most. On finishing, a table of
    contents is added where the file is seekable; a file without one is whole as well.

    Source: iniVation, AEDAT 4.0 file format.
    """

    name = "aedat4"
    suffixes = (".aedat4",)
    options = ("compression", "level", "start_us")
    writer = CoreWriter
    limits = Limits(width=32_768, height=32_768)

    def sniff(self, head: bytes, path: Path) -> bool:
        return head.startswith(b"#!AER-DAT4.")

    def open_writer(
        self,
        target: Target,
        size: tuple[int, int],
        *,
        overwrite: bool,
        compression: Literal["none", "lz4", "zstd"] = "lz4",
        level: int = -4,
        start_us: int = 0,
        **options: Any,
    ) -> EventWriter:
        if not -7 <= level <= 22:
            raise ArgumentError("{level} must lie in -7..22: got {}", level)
        if not 0 <= start_us < 2**62:
            raise ArgumentError("{start_us} must be a Unix time in 0..2^62 us: got {}", start_us)
        options |= {"compression": compression, "level": level, "start_us": start_us}
        return super().open_writer(target, size, overwrite=overwrite, **options)

    def open_reader(self, path: str | os.PathLike[str], rules: ReadRules = ReadRules()) -> EventReader:  # noqa: B008
        recording = Aedat4File(Path(path), max_packet_bytes=rules.max_packet_bytes)
        if not recording.has_events:  # but frames, perhaps
            return RecordedReader(recording, format=self.name, rules=rules)
        return Aedat4Reader(recording, format=self.name, limits=self.limits, rules=rules)
