"""The command line: davis-rs sequence, davis-rs sequences."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..progress import each, progress
from ..sequence_report import MEASURED, as_markdown, as_text, count_events, draw_sheet, read_counts, table, write_counts
from ..sequences import SEQUENCES, Sequence, sequence_named
from .common import Help
from .simulate import add_settings, simulate_into

_FRAME_RATE_HZ = 24.0
"""Of the dataset's recordings."""


def add_sequence(sequence: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    sequence.description = (
        "Simulate a twin of one of the public dataset's sequences into a dataset folder, with IMU. "
        "davis-rs sequences lists them."
    )
    sequence.formatter_class = Help
    sequence.add_argument("name", metavar="NAME", help="such as poster_6dof or slider_depth")
    path = sequence.add_argument_group("camera path")
    path.add_argument("--start", type=float, default=0.0, metavar="S", help="where in the sequence t = 0 lies")
    path.add_argument("--duration", type=float, metavar="S", help="seconds of it; to the end if not given")
    add_settings(sequence)
    sequence.set_defaults(run=_sequence, imu="mpu6150", frame_rate=_FRAME_RATE_HZ, depth_rate=_FRAME_RATE_HZ)


def add_sequences(sequences: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    sequences.description = (
        "List duration T, top speeds TS and RS and number of events NE of each sequence, the paper's and "
        "ours. Speeds are means over 100 ms; events are those of ideal pixels, counted before (--count)."
    )
    sequences.add_argument("names", nargs="*", metavar="NAME", help="all if not given")
    instead = sequences.add_mutually_exclusive_group()
    instead.add_argument("--markdown", action="store_true", help="as a table of Markdown")
    instead.add_argument("--sheet", type=Path, metavar="PNG", help="draw frame and events of each, instead")
    instead.add_argument(
        "--count",
        type=Path,
        metavar="CSV",
        help="simulate them whole, count their events and add them to this file, instead; takes hours, and goes on "
        "where it was stopped",
    )
    sequences.add_argument("--measured", type=Path, metavar="CSV", default=MEASURED, help="counts to list")
    sequences.set_defaults(run=_sequences)


def _sequence(options: argparse.Namespace) -> int:
    sequence = sequence_named(options.name)
    part = sequence.scene().part(options.start, options.duration)
    return simulate_into(options, part, sequence={"biases": sequence.biases, "differs": sequence.differs})


def _sequences(options: argparse.Namespace) -> int:
    sequences = [sequence_named(name) for name in options.names or SEQUENCES]
    if options.count is not None:
        _count(sequences, options.count)
        return 0
    shown = each(sequences, "simulating" if options.sheet is not None else "listing", len(sequences), unit="sequences")
    if options.sheet is not None:
        print(draw_sheet(shown, options.sheet))
        return 0
    rows = table(shown, read_counts(options.measured))
    if options.markdown:
        print(as_markdown(rows))
        return 0
    print(as_text(rows))
    for sequence in sequences if options.names else ():
        print(f"{sequence.name}, beside the recording: {sequence.differs}")
    return 0


def _count(sequences: list[Sequence], path: Path) -> None:
    counts = read_counts(path) if path.exists() else {}
    places = {name: place for place, name in enumerate(SEQUENCES)}
    write_counts(path, counts.values())  # fails before the counting, if it must
    for sequence in sequences:
        if sequence.name in counts:
            continue
        with progress(sequence.name, sequence.paper.duration_s, unit="s") as bar:
            counts[sequence.name] = count_events(sequence, progress=bar.advance)
        write_counts(path, sorted(counts.values(), key=lambda count: places.get(count.name, len(places))))
        print(f"{sequence.name}: {counts[sequence.name].events:,} events")
