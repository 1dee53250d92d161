"""Writes the bytes of a format that Python encodes, without a buffer: a killed process loses nothing it has written."""

from __future__ import annotations

import os
from abc import abstractmethod
from typing import BinaryIO

from .destination import Destination, naming
from .interface import EventWriter


class ByteWriter(EventWriter):
    """Opens the file, or takes the stream that is given, and lets go of it; formats write by ``_put``."""

    def __init__(self, destination: Destination) -> None:
        super().__init__(destination)
        self._owned = not destination.is_stream
        self._written = 0
        with naming(self.path):
            self._file = self._open(destination)
            self._begin()

    def _open(self, destination: Destination) -> BinaryIO:
        target = destination.target
        if isinstance(target, str | os.PathLike):
            # Not to be read: else the end of a pipe's reader would pass unseen.
            return destination.claim().open("ab", buffering=0)
        return target

    @abstractmethod
    def _begin(self) -> None:
        """Write what stands before the first event."""

    def _size(self) -> int:
        """Return how many bytes the file has."""
        return self._written

    def _flush(self) -> None:
        if not self._owned:
            self._file.flush()

    def _close(self) -> int:
        with naming(self.path):
            self._flush()
            size = self._size()
            if self._owned:
                self._file.close()
            return size

    def _abandon(self) -> None:
        if self._owned:
            self._file.close()

    def _put(self, data: bytes | memoryview) -> None:
        """Write all of ``data``; the system may take it in parts."""
        rest = memoryview(data)
        while len(rest):
            taken = self._file.write(rest)
            if taken is None:
                raise BlockingIOError(f"{self.path} would block")
            self._written += taken
            rest = rest[taken:]
