"""How many events the sequences have: simulated whole, and counted instead of written."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

from .._util.whole_file import whole_file
from ..geometry.trajectory.views import Views
from ..render.choice import make_renderer
from ..sampling.rules import MaxDisplacement
from ..scene.sequences import Sequence
from ..sensor.presets import IDEAL
from ..simulation.simulator import Simulator

MEASURED = Path(__file__).with_name("measured.csv")
"""The counts that ``davis-rs sequences`` shows: what :func:`count_events` found with the defaults."""

MEASURED_RECORDED = Path(__file__).with_name("measured_recorded.csv")
"""The same with ``sensor="recorded"``."""

COARSE_PX, COARSE_SAMPLES = 2.0, 5
"""A render for so much motion, and rays a pixel: a third of a pixel and 8 rays find 3 to 10 % more events, for eight
times the work (docs/sequences.md)."""

_LOOK = 0.7


@dataclass(frozen=True)
class EventCount:
    """The events of a sequence.

    Attributes:
        name: of the sequence.
        duration_s: simulated.
        events, on_events: how many there were, and how many of them ON.
        max_displacement_px, samples: how finely time and pixels were sampled.
        contrast_threshold, luma: C_on, and :func:`mean_luma`: of what these are the events.
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
    sensor: str = IDEAL


def mean_luma(sequence: Sequence) -> float:
    """The mean luma of a view of the sequence, at 70 % of its time: another scene or path has another."""
    scene = sequence.scene()
    renderer = make_renderer(scene, scene.own_camera, samples=1)
    view = Views.along(scene.path, np.array([_LOOK * scene.path.duration_s]))
    return float(renderer.luma(view).mean(dtype=np.float64))


def count_events(
    sequence: Sequence,
    *,
    sensor: str = IDEAL,
    duration_s: float | None = None,
    max_displacement_px: float = COARSE_PX,
    samples: int = COARSE_SAMPLES,
    progress: Callable[[float], object] | None = None,
) -> EventCount:
    """Simulate a sequence and count its events.

    Args:
        sensor: ``ideal`` for ideal pixels with the scene's threshold, ``recorded`` for the sensor of the recording.
        duration_s: from its start; all of it by default.
        max_displacement_px, samples: a render for so much motion, and rays a pixel; see :data:`COARSE_PX`.
        progress: called with the simulated seconds since the call before.

    Raises:
        ValueError: for a recorded sensor where nothing was recorded.
    """
    scene = sequence.scene().crop(0.0, duration_s)
    simulator = Simulator(
        scene,
        frame_rate_hz=0,
        depth_rate_hz=0,
        sampling=MaxDisplacement(max_displacement_px),
        samples=samples,
        sensor=sensor,
    )
    events = on_events = 0
    for packet in simulator.run():
        events += len(packet.events)
        on_events += int(packet.events["p"].sum())
        if progress is not None:
            progress((packet.end_us - packet.start_us) * 1e-6)
    return EventCount(
        sequence.name,
        round(scene.path.duration_s, 6),
        events,
        on_events,
        max_displacement_px,
        samples,
        simulator.contrast_threshold,
        round(mean_luma(sequence), 7),
        sensor,
    )


def read_counts(path: str | Path = MEASURED) -> dict[str, EventCount]:
    """Counts by the sequences' names, from a CSV file of :func:`write_counts`.

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


def write_counts(path: str | Path, counts: Iterable[EventCount]) -> None:
    """Replace a CSV file by one of these counts; a reader sees the old file or the new one, whole."""
    with whole_file(path) as place, place.open("w", newline="") as file:
        writer = csv.DictWriter(file, [field.name for field in fields(EventCount)], lineterminator="\n")
        writer.writeheader()
        writer.writerows(asdict(count) for count in counts)
