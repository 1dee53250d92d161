"""Describes where events are written, and makes the files there.

An existing file is only replaced on request. A format that is unreadable in part is first written under another name.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from ..._util.argument_checks import as_size
from ..._util.argument_error import OverwriteError
from ..._util.whole_file import is_sink, require_no_file

Target = str | os.PathLike[str] | BinaryIO
"""Where events are written: a path, or an open binary stream (a pipe, a buffer), which the writer leaves open."""


@dataclass(frozen=True)
class Limits:
    """Holds what a format can hold: whole microseconds 0 .. ``latest_us``, and sensors of ``width`` x ``height``."""

    latest_us: int = 2**63 - 1
    width: int = 65_535
    height: int = 65_535

    def check_size(self, name: str, size: tuple[int, int]) -> tuple[int, int]:
        """Check ``size``, and return it as (width, height) integers.

        Raises:
            ValueError: for no size, or if the format called ``name`` cannot hold a sensor of that size.
        """
        width, height = as_size(size)
        if not (1 <= width <= self.width and 1 <= height <= self.height):
            raise ValueError(
                f"{name} holds sensors of 1 x 1 to {self.width} x {self.height} pixels: got {width} x {height}"
            )
        return width, height


@dataclass(frozen=True)
class Destination:
    """Holds what every writer is told: where it writes, in which format, and of which sensor.

    It checks nothing by itself, because each format has its own order of checks, and nothing may be made before they
    hold.

    Attributes:
        target: the path, or the stream, that is written to.
        format: the format's name.
        size: (width, height) of the sensor in pixels, as the caller gives it.
        limits: what the format can hold.
        overwrite: whether a file that is there may be replaced.
    """

    target: Target
    format: str
    size: tuple[int, int]
    limits: Limits
    overwrite: bool

    @property
    def is_stream(self) -> bool:
        """Return whether it is a stream, which the writer must leave open."""
        return not isinstance(self.target, str | os.PathLike)

    @property
    def name(self) -> str:
        """Return the path, or what a stream is called, for messages and reports."""
        if isinstance(self.target, str | os.PathLike):
            return os.fspath(self.target)
        return str(getattr(self.target, "name", self.target))

    def checked_size(self) -> tuple[int, int]:
        """Check the size, and return it as (width, height) integers.

        Raises:
            ValueError: for no size, or one that the format cannot hold.
        """
        return self.limits.check_size(self.format, self.size)

    def path(self, needs: str = "this format needs a file: it") -> Path:
        """Return the path of a format that cannot be written into a stream.

        Args:
            needs: the beginning of the message, such as ``a bag needs a file: it``.

        Raises:
            ValueError: for a stream.
        """
        if isinstance(self.target, str | os.PathLike):
            return Path(self.target)
        raise ValueError(f"{needs} cannot be written into a stream")

    def claim(self) -> Path:
        """Make an empty file at the path.

        Raises:
            FileExistsError: if a file is there and ``overwrite`` is not set.
            OSError: if it cannot be made.
        """
        return claim(self.path(), overwrite=self.overwrite)

    def claim_part(self) -> PartFile:
        """Make the file next to the path that will take its name when it is whole."""
        return PartFile(self.path(), overwrite=self.overwrite)


def claim(path: str | os.PathLike[str], *, overwrite: bool) -> Path:
    """Make an empty file at ``path``.

    A pipe or a device has nothing to overwrite and is taken as it is.

    Raises:
        FileExistsError: if a file is there and ``overwrite`` is not set.
        OSError: if it cannot be made.
    """
    target = Path(path)
    if is_sink(target):
        return target
    try:
        target.open("wb" if overwrite else "xb").close()
    except FileExistsError:
        raise OverwriteError(target, "the file exists; {overwrite:True} replaces it") from None
    return target


def part_of(path: Path) -> Path:
    """Return where a file is written until it is whole: ``NAME.part`` next to it."""
    return path.with_name(path.name + ".part")


class PartFile:
    """Holds a file that is written next to its path, as ``NAME.part``, and takes its name when it is whole.

    Raises:
        FileExistsError: if the path exists and ``overwrite`` is not set, now or at the end.
        OSError: if ``NAME.part`` cannot be made.
    """

    def __init__(self, path: str | os.PathLike[str], *, overwrite: bool) -> None:
        self.path = Path(path)
        self.part = part_of(self.path)
        self._overwrite = overwrite
        require_no_file(self.path, overwrite=overwrite)
        claim(self.part, overwrite=True)

    def commit(self) -> None:
        """Give the file its name."""
        require_no_file(self.path, overwrite=self._overwrite)
        os.replace(self.part, self.path)


@contextmanager
def naming(path: str | os.PathLike[str]) -> Iterator[None]:
    """Give an OSError the path that it is about, where it comes without one (as those of writes do)."""
    try:
        yield
    except OSError as error:
        if error.filename is None and error.errno is not None:
            raise OSError(error.errno, os.strerror(error.errno), os.fspath(path)) from error
        raise
