"""Reads how many events the sequences have, as they were counted before."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

MEASURED = Path(__file__).with_name("measured.csv")
"""The counts of ideal pixels that ``davis-rs sequences`` shows; ``python benches/sequence_tables.py count`` makes them.

They are kept here because counting them takes hours.
"""


@dataclass(frozen=True)
class EventCount:
    """The number of events of a sequence.

    Attributes:
        name: of the sequence.
        duration_s: simulated.
        events, on_events: how many there were, and how many of them ON.
        max_displacement_px, samples: how finely time and pixels were sampled.
        contrast_threshold, luma: C_on, and the mean luma of a view: of what these are the events.
        sensor: ``ideal`` or ``recorded``.
    """

    name: str
    duration_s: float
    events: int
    on_events: int
    max_displacement_px: float
    samples: int
    contrast_threshold: float
    luma: float
    sensor: str = "ideal"


def read_counts(path: str | Path = MEASURED) -> dict[str, EventCount]:
    """Read counts by the sequences' names, from a CSV file.

    Raises:
        OSError: if it cannot be read.
        ValueError: naming the file and the line that holds something else.
    """
    counts: dict[str, EventCount] = {}
    with Path(path).open(newline="") as file:
        reader = csv.DictReader(file)
        for row in reader:
            try:
                counts[row["name"]] = EventCount(
                    row["name"],
                    float(row["duration_s"]),
                    int(row["events"]),
                    int(row["on_events"]),
                    float(row["max_displacement_px"]),
                    int(row["samples"]),
                    float(row["contrast_threshold"]),
                    float(row["luma"]),
                    str(row["sensor"]),
                )
            except (KeyError, TypeError, ValueError) as error:
                raise ValueError(f"{path}, line {reader.line_num}: not a count of events: {error!r}") from None
    return counts
