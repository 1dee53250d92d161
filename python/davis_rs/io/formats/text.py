"""Writes and reads the public Event-Camera Dataset's events.txt: a line ``timestamp x y polarity`` an event."""

from __future__ import annotations

import os
import re
from pathlib import Path

from ..._core import EventFileReader
from ...events.arrays import EventArray
from .core_files import CoreReader, CoreWriter
from .destination import Limits
from .interface import Format
from .reading import ANY_SIZE, ReadRules

_SEARCHED = 1 << 16
"""The search for the start of a slice stops at a range of this many bytes."""


class TextReader(CoreReader):
    """Reads events.txt; of a slice of time, its part of the file alone."""

    def _open(self, start_us: int | None = None, stop_us: int | None = None) -> EventFileReader:
        from_byte = 0 if start_us is None else self._find(start_us)
        return EventFileReader(self.path, self.format, from_byte=from_byte, in_order=self.rules.in_order)

    def _past(self, packet: EventArray, stop_us: int | None) -> bool:
        return stop_us is not None and len(packet) > 0 and bool(packet["t"][-1] >= stop_us)

    def _find(self, start_us: int) -> int:
        """Return the beginning of a line, 0 or one before which all times are below ``start_us``, by bisection."""
        with self.path.open("rb") as file:
            low, high = 0, file.seek(0, os.SEEK_END)
            while high - low > _SEARCHED:
                middle = (low + high) // 2
                file.seek(middle)
                line_start = middle + len(file.readline(_SEARCHED))
                t_us = _stamp(file.readline(_SEARCHED))
                if t_us is None:  # the decoder will say what is wrong with it
                    return low
                if t_us < start_us:
                    low = line_start
                else:
                    high = middle
            return low


class TextFormat(Format):
    """Describes text files of a line ``t x y p`` for each event.

    Option of the writer: ``size_line`` (False), a first line ``width height``, as rpg_e2vid asks for and others reject.

    Source: Mueggler et al., IJRR 2017, section 4.
    """

    name = "text"
    suffixes = (".txt",)
    options = ("size_line",)
    writer = CoreWriter
    states_size = False
    limits = Limits()

    def sniff(self, head: bytes, path: Path) -> bool:
        # Whatever begins with a number: what is wrong with the rest is then told with its line.
        return re.match(rb"[-+]?\d", head) is not None

    def open_reader(self, path: str | os.PathLike[str], rules: ReadRules = ReadRules()) -> TextReader:  # noqa: B008
        return TextReader(path, format=self.name, limits=Limits(width=ANY_SIZE[0], height=ANY_SIZE[1]), rules=rules)


def _stamp(line: bytes) -> int | None:
    """Return the time of a line in microseconds, rounded down, if it begins with one."""
    match = re.match(rb"([0-9]{1,13})\.([0-9]{1,9}) ", line)
    return None if match is None else int(match[1] + match[2].ljust(6, b"0")[:6])
