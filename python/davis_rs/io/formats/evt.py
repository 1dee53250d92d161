"""Writes and reads EVT 2.0 and EVT 3.0, Prophesee's ``.raw`` files: words of 32 and of 16 bits."""

from __future__ import annotations

import os
import re
from pathlib import Path

from .core_files import CoreReader, CoreWriter
from .destination import Limits
from .interface import Format
from .reading import ReadRules


class EvtFormat(Format):
    """Without options. Sensors have at most 2048 x 2048 pixels.

    Args:
        version: 2 or 3.
        latest_us: the latest time that is written.

    Source: Prophesee, EVT 2.0 and EVT 3.0 formats, in Metavision's documentation.
    """

    suffixes = (".raw",)
    writer = CoreWriter

    def __init__(self, version: int, latest_us: int) -> None:
        self.name = f"evt{version}"
        self.limits = Limits(latest_us, 2048, 2048)
        self._header = re.compile(rb"^%% (evt %d\.|format EVT%d[;\n\r])" % (version, version), re.MULTILINE)

    def sniff(self, head: bytes, path: Path) -> bool:
        return head.startswith(b"%") and self._header.search(head) is not None

    def open_reader(self, path: str | os.PathLike[str], rules: ReadRules = ReadRules()) -> CoreReader:  # noqa: B008
        return CoreReader(path, format=self.name, limits=self.limits, rules=rules)


EVT3 = EvtFormat(3, 2**40 - 1)
EVT2 = EvtFormat(2, 2**34 - 1)
