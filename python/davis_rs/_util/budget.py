"""Limits what the reading of one source of untrusted bytes may take, of memory, of parts and of time."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

from .._core import DecodeError

VARIABLE = "DAVIS_RS_READ_BUDGET"
"""The environment variable that sets other limits, such as ``bytes=8GiB items=1e8 seconds=600``."""


class Limits(NamedTuple):
    """Holds what a source may take, unless :data:`VARIABLE` says otherwise.

    Attributes:
        bytes: that are held in memory at one time.
        items: parts that the source makes a reader handle one by one: accessors, nodes, materials, rows of a table.
        seconds: for parts of the work whose length the source alone decides, such as a query of a database.
    """

    bytes: int = 2 << 30
    items: int = 10_000_000
    seconds: float = 120.0


class Budget:
    """Accounts for what one source takes: everything that it makes a reader open or hold is charged to it.

    One account for all of it, because a file with many parts can fill memory although none of them is large. A reader
    makes one, hands it to what it opens, and charges **before** it allocates.

    Args:
        source: the file, for messages.
        limits: those of :data:`VARIABLE` and the defaults of :class:`Limits`, if left out.

    Attributes:
        source: the same.
        limits: in use.
        bytes: in use now.
        items: seen so far.
    """

    def __init__(self, source: str | os.PathLike[str], limits: Limits | None = None) -> None:
        self.source = source
        self.limits = limits_in_use() if limits is None else limits
        self.bytes = 0
        self.items = 0
        self._spent = 0.0
        self.start_clock()

    def take(self, size: int, subject: str) -> None:
        """Charge bytes that stay in memory.

        Raises:
            DecodeError: if there are not so many left; ``subject`` says in the message what needs them.
        """
        if self.bytes + size > self.limits.bytes:
            beyond = f"{subject} needs {readable_bytes(size)}"
            if self.bytes:
                beyond += f", {readable_bytes(self.bytes)} are in use"
            raise self._error(f"{beyond}; {readable_bytes(self.limits.bytes)} may be held in memory", "bytes")
        self.bytes += size

    def give_back(self, size: int) -> None:
        """Return bytes that are no longer held."""
        self.bytes -= size

    @contextmanager
    def borrow(self, size: int, subject: str) -> Iterator[None]:
        """Charge bytes for as long as the block runs.

        Raises:
            DecodeError: as :meth:`take`.
        """
        self.take(size, subject)
        try:
            yield
        finally:
            self.give_back(size)

    def count(self, items: int, kind: str) -> None:
        """Charge parts that are handled one by one.

        Raises:
            DecodeError: if there are more than may be; ``kind`` names them in the plural.
        """
        self.items += items
        if self.items > self.limits.items:
            raise self._error(f"more than {self.limits.items} parts, the last of them {kind}", "items")

    def start_clock(self) -> None:
        """Count the seconds from now on, for a reader whose user may take any time between two parts of the work."""
        self._end = time.monotonic() + self.limits.seconds

    def check_time(self, subject: str) -> None:
        """Refuse to go on when there is no time left.

        Raises:
            DecodeError: once it is over; ``subject`` says in the message what took so long.
        """
        if self.out_of_time():
            raise self._error(f"{subject} has taken more than {self.limits.seconds:g} s", "seconds")

    def spend(self, seconds: float, subject: str) -> None:
        """Charge time of work that is done again and again, wherever the clock stands.

        Raises:
            DecodeError: once there are no more seconds; ``subject`` says in the message what takes so long.
        """
        self._spent += seconds
        if self._spent > self.limits.seconds:
            raise self._error(f"{subject} has taken more than {self.limits.seconds:g} s", "seconds")

    def out_of_time(self) -> bool:
        """Tell whether there is no time left: for libraries' callbacks, which must not raise."""
        return time.monotonic() > self._end

    def _error(self, message: str, limit: str) -> DecodeError:
        return DecodeError(f"{os.fspath(self.source)}: {message} ({VARIABLE}={limit}=... allows more)")


_UNITS = {"": 1, "kib": 1 << 10, "mib": 1 << 20, "gib": 1 << 30, "tib": 1 << 40}
_ENTRY = re.compile(r"(bytes|items|seconds)=([0-9.]+(?:e[0-9]+)?)(|KiB|MiB|GiB|TiB)", re.IGNORECASE)


def limits_in_use() -> Limits:
    """Return the limits of :data:`VARIABLE`; what it does not name has its default.

    Raises:
        ValueError: if the variable cannot be understood.
    """
    limits = Limits()
    for entry in os.environ.get(VARIABLE, "").split():
        parsed = _ENTRY.fullmatch(entry)
        try:
            name, number, unit = parsed.groups() if parsed else ("", "", "")
            value = float(number) * _UNITS[unit.lower()]
        except ValueError:
            parsed = None
        if parsed is None or not 0 < value < 2**62 or (unit and name.lower() != "bytes"):
            raise ValueError(f"{VARIABLE} is like 'bytes=8GiB items=1e8 seconds=600': got {entry!r}")
        match name.lower():
            case "bytes":
                limits = limits._replace(bytes=int(value))
            case "items":
                limits = limits._replace(items=int(value))
            case _:
                limits = limits._replace(seconds=value)
    return limits


def readable_bytes(size: int) -> str:
    """Write a number of bytes in the unit that suits it."""
    for unit, unit_bytes in (("GiB", 1 << 30), ("MiB", 1 << 20), ("KiB", 1 << 10)):
        if size >= unit_bytes:
            return f"{size / unit_bytes:.3g} {unit}"
    return f"{size} bytes"
