"""Writes and reads recordings of a camera's stream as it came: a header of 1024 bytes, then the words.

The header is a line that names the format, a JSON object, and spaces; its last byte ends a line, so that ``head -n 2``
shows it. After it every byte is the camera's, little-endian words to the end of the file: a recording that was cut
short by anything is good as far as it goes.
"""

from __future__ import annotations

import dataclasses
import json
import threading
from collections.abc import Iterator
from datetime import datetime, timezone
from pathlib import Path
from types import TracebackType

from .._core import DecodeError, Decoder
from .._util.array_types import JsonObject
from .._util.untrusted import regular_file
from .description import DavisDescription

MAGIC = b"#!DAVIS-RAW 1\n"
HEADER_BYTES = 1024
CHUNK_BYTES = 1 << 20


class RawWriter:
    """Writes a recording into a file that does not exist yet. Threads may share it: calls wait for each other.

    The header is filled in again at the end: ``complete``, ``bytes`` and ``lost_bytes`` are right only then.

    Args:
        path: the file.
        camera: what the bytes come from.
        started: when, in UTC; now if not given.

    Raises:
        OSError: if it exists or cannot be written.
    """

    def __init__(self, path: str | Path, camera: DavisDescription, *, started: datetime | None = None) -> None:
        self.path = Path(path)
        self._meta: JsonObject = {
            "complete": False,
            "bytes": 0,
            "lost_bytes": 0,
            "started": (started or datetime.now(timezone.utc)).isoformat(),
            "camera": dataclasses.asdict(camera),
        }
        self._turn = threading.RLock()
        header = _header(self._meta)
        self._file = self.path.open("xb")
        self._file.write(header)

    def write(self, words: bytes) -> None:
        """Append a part of the stream."""
        with self._turn:
            self._file.write(words)
            self._meta["bytes"] += len(words)

    def finish(self, *, lost_bytes: int = 0) -> int:
        """Complete the header and close; returns how many bytes of the stream are in the file."""
        with self._turn:
            if not self._file.closed:
                self._meta |= {"complete": True, "lost_bytes": lost_bytes}
                with self._file:
                    self._file.flush()
                    self._file.seek(0)
                    self._file.write(_header(self._meta))
            return int(self._meta["bytes"])

    def __enter__(self) -> RawWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if kind is None:
            self.finish()
        else:
            self._file.close()


class RawRecording:
    """A recording that was written by :class:`RawWriter`.

    Attributes:
        path: the file.
        camera: what it is a recording of.
        started: when, in UTC.
        complete: whether it was finished; one that was not ends somewhere.
        lost_bytes: how much of the stream was lost while it was recorded.

    Raises:
        OSError: if the file cannot be read.
        DecodeError: if it is no such recording, with the byte.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = regular_file(path)
        with self.path.open("rb") as file:
            header = file.read(HEADER_BYTES)
        if not header.startswith(MAGIC):
            raise DecodeError(
                f"{self.path}, byte 0: expected {MAGIC.decode().strip()!r}, found {header[: len(MAGIC)]!r}"
            )
        if len(header) < HEADER_BYTES:
            raise DecodeError(
                f"{self.path}, byte {len(header)}: the header has {HEADER_BYTES} bytes, the file ends here"
            )
        try:
            meta = json.loads(header[len(MAGIC) :])
            self.camera = DavisDescription(**meta["camera"])
            _ = self.camera.device  # whatever makes it impossible to decode should show here
            self.started = datetime.fromisoformat(meta["started"])
            self.complete, self.lost_bytes = bool(meta["complete"]), int(meta["lost_bytes"])
        except (ValueError, TypeError, KeyError, OverflowError, RecursionError) as error:
            raise DecodeError(f"{self.path}, byte {len(MAGIC)}: malformed header: {error}") from None

    def decoder(self) -> Decoder:
        """Return a decoder for the camera that was recorded."""
        return Decoder(self.camera.device)

    def chunks(self, size: int = CHUNK_BYTES) -> Iterator[bytes]:
        """Yield the stream, ``size`` bytes at a time."""
        with self.path.open("rb") as file:
            file.seek(HEADER_BYTES)
            while chunk := file.read(size):
                yield chunk


def _header(meta: JsonObject) -> bytes:
    content = MAGIC + json.dumps(meta).encode()
    if len(content) >= HEADER_BYTES:
        raise ValueError(f"the header must fit into {HEADER_BYTES} bytes, got {len(content)}")
    return content.ljust(HEADER_BYTES - 1) + b"\n"
