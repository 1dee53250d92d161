"""Writes and reads EVT 2.0 and EVT 3.0, and reads EVT 2.1, Prophesee's ``.raw`` files: words of 32, 16 and 64 bits."""

from __future__ import annotations

import os
import re
from pathlib import Path

from .core_files import CoreReader, CoreWriter
from .destination import Limits
from .interface import Format
from .reading import ReadRules


class EvtFormat(Format):
    """Describes a version of EVT; its writer has no options. Sensors have at most 2048 x 2048 pixels.

    Args:
        version: as headers write it, such as ``3.0``.
        latest_us: the latest time that is written.
        writable: whether it is written too.

    Source: Prophesee, EVT 2.0, EVT 2.1 and EVT 3.0 formats, in Metavision's documentation.
    """

    suffixes = (".raw",)
    writer = CoreWriter

    def __init__(self, version: str, latest_us: int, *, writable: bool = True) -> None:
        number = version.replace(".", "").removesuffix("0")
        self.name, self.writable = f"evt{number}", writable
        self.limits = Limits(latest_us, 2048, 2048)
        header = rb"^%% (evt %s(?!\d)|format EVT%s[;\n\r])" % (re.escape(version).encode(), number.encode())
        self._header = re.compile(header, re.MULTILINE)

    def sniff(self, head: bytes, path: Path) -> bool:
        return head.startswith(b"%") and self._header.search(head) is not None

    def open_reader(self, path: str | os.PathLike[str], rules: ReadRules = ReadRules()) -> CoreReader:  # noqa: B008
        return CoreReader(path, format=self.name, limits=self.limits, rules=rules)


EVT3 = EvtFormat("3.0", 2**40 - 1)
EVT2 = EvtFormat("2.0", 2**34 - 1)
EVT21 = EvtFormat("2.1", 2**34 - 1, writable=False)
