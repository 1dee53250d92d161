"""What the tests of event files share: the formats with their options, events to write, and writing them."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from davis_rs import EVENT_DTYPE, EventReader, EventWriter, open_writer
from davis_rs.events.arrays import EventArray
from davis_rs.io.formats import FORMATS

SIZE = (240, 180)


class FormatVariant(NamedTuple):
    """A format of the core or of NumPy, with options of its writer."""

    name: str
    file: str
    options: dict[str, Any]

    def writer(self, folder: Path, size: tuple[int, int] = SIZE, **options: Any) -> EventWriter:
        return open_writer(folder / self.file, size, self.name, **(self.options | options))

    def reader(self, folder: Path) -> EventReader:
        return FORMATS[self.name].open_reader(folder / self.file)

    @property
    def latest_us(self) -> int:
        return FORMATS[self.name].limits.latest_us


FORMAT_VARIANTS = {
    "text": FormatVariant("text", "e.txt", {}),
    "text with size": FormatVariant("text", "e.txt", {"size_line": True}),
    "npy": FormatVariant("npy", "e.npy", {}),
    "npz": FormatVariant("npz", "e.npz", {}),
    "evt2": FormatVariant("evt2", "e.raw", {}),
    "evt3": FormatVariant("evt3", "e.raw", {}),
    "aedat2": FormatVariant("aedat2", "e.aedat", {}),
    "aedat4": FormatVariant("aedat4", "e.aedat4", {"compression": "none"}),
    "aedat4 lz4": FormatVariant("aedat4", "e.aedat4", {"compression": "lz4"}),
    "aedat4 zstd": FormatVariant("aedat4", "e.aedat4", {"compression": "zstd"}),
}


def events_of(*events: tuple[int, int, int, int]) -> EventArray:
    return np.array(list(events), EVENT_DTYPE)


def many(count: int, *, start_us: int = 0, seed: int = 1) -> EventArray:
    """Events on the sensor, a third of them at the time of the one before."""
    rng = np.random.default_rng(seed)
    events = np.zeros(count, EVENT_DTYPE)
    events["t"] = start_us + np.cumsum(rng.integers(0, 3, count))
    for field, limit in (("x", SIZE[0]), ("y", SIZE[1]), ("p", 2)):
        events[field] = rng.integers(0, limit, count)
    return events


def write_events(
    kind: FormatVariant, folder: Path, events: EventArray, *, packet: int = 1 << 30, **options: Any
) -> Path:
    with kind.writer(folder, **options) as writer:
        for start in range(0, len(events), packet):
            writer.write(events[start : start + packet])
    return folder / kind.file


def assert_same(events: EventArray, expected: EventArray) -> None:
    assert events.dtype == EVENT_DTYPE
    np.testing.assert_array_equal(events, expected)
