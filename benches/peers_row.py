"""A row of the bench that compares with other programs, and our own rows."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

EventArray = npt.NDArray[np.void]
SIZE = (240, 180)
PACKET = 100_000


class Row(NamedTuple):
    """A program that writes a file of events, and perhaps one that reads it as it likes best.

    What ``prepare`` makes of the events, untimed, is what ``write`` gets.
    """

    format: str
    program: str
    suffix: str
    write: Callable[[Path, Any], object]
    read: Callable[[Path], object] | None
    prepare: Callable[[EventArray], Any] = lambda events: events


def ours(format: str, suffix: str, **options: Any) -> Row:
    """Our writer, in packets, and our reader."""

    def write(path: Path, events: EventArray) -> None:
        from davis_rs import open_writer

        with open_writer(path, SIZE, format, **options) as writer:
            for packet in packets(events):
                writer.write(packet)

    def read(path: Path) -> object:
        from davis_rs import read_events

        return read_events(path)

    told = ", ".join(f"{name} {value}" for name, value in options.items())
    return Row(f"{format}{f' ({told})' if told else ''}", "davis_rs", suffix, write, read)


def packets(events: EventArray) -> Iterable[EventArray]:
    return (events[start : start + PACKET] for start in range(0, len(events), PACKET))
