"""The command line: davis-rs sequences, sequences-table, sequences-sheet, sequences-count."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..progress import each, progress
from ..sensors import IDEAL, RECORDED
from ..sequence_report import (
    MEASURED,
    MEASURED_RECORDED,
    EventCount,
    as_markdown,
    as_text,
    count_events,
    draw_sheet,
    read_counts,
    table,
    write_counts,
)
from ..sequences import SEQUENCES, Sequence, sequence_named
from ..terminal_text import tell


def add_sequences(listing: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    listing.description = (
        "List duration T, top speeds TS and RS and number of events NE of each sequence, the paper's and ours. Speeds "
        "are means over 100 ms. Events were counted before by sequences-count: those of ideal pixels, and those of the "
        "sensor of the recording."
    )
    listing.set_defaults(run=_list)
    _add_names(listing)
    _add_measured(listing)


def add_sequences_table(markdown: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    markdown.set_defaults(run=_table)
    _add_names(markdown)
    _add_measured(markdown)


def add_sequences_sheet(sheet: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    sheet.set_defaults(run=_sheet)
    _add_names(sheet)
    sheet.add_argument("-o", "--output", type=Path, required=True, metavar="PNG", help="the picture")


def add_sequences_count(count: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    count.description = (
        "Simulate sequences whole, count their events and add them to a CSV file. All of them take hours. Run the same "
        "command again to resume."
    )
    count.set_defaults(run=_count)
    _add_names(count)
    count.add_argument(
        "--sensor",
        choices=(IDEAL, RECORDED),
        default=IDEAL,
        help="ideal pixels, or the sensor of the recording (default: ideal); simulated sequences have none",
    )
    count.add_argument("-o", "--output", type=Path, required=True, metavar="CSV", help="the counts")


def _add_names(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("names", nargs="*", metavar="NAME", help="all if not given")


def _add_measured(parser: argparse.ArgumentParser) -> None:
    for option, default, of in (
        ("--measured", MEASURED, "ideal pixels"),
        ("--measured-recorded", MEASURED_RECORDED, "the sensor of the recording"),
    ):
        parser.add_argument(option, type=Path, metavar="CSV", default=default, help=f"counts of {of} to list")


def _counts(options: argparse.Namespace) -> tuple[dict[str, EventCount], dict[str, EventCount]]:
    return read_counts(options.measured), read_counts(options.measured_recorded)


def _chosen(options: argparse.Namespace) -> list[Sequence]:
    return [sequence_named(name) for name in options.names or SEQUENCES]


def _list(options: argparse.Namespace) -> int:
    chosen = _chosen(options)
    tell(as_text(table(each(chosen, "listing", len(chosen), unit="sequences"), *_counts(options))))
    for sequence in chosen if options.names else ():
        tell(f"{sequence.name}, next to the recording: {sequence.differs}")
    return 0


def _table(options: argparse.Namespace) -> int:
    chosen = each(_chosen(options), "listing", len(_chosen(options)), unit="sequences")
    tell(as_markdown(table(chosen, *_counts(options))))
    return 0


def _sheet(options: argparse.Namespace) -> int:
    chosen = each(_chosen(options), "simulating", len(_chosen(options)), unit="sequences")
    tell(draw_sheet(chosen, options.output))
    return 0


def _count(options: argparse.Namespace) -> int:
    path = options.output
    counts = read_counts(path) if path.exists() else {}
    places = {name: place for place, name in enumerate(SEQUENCES)}
    write_counts(path, counts.values())  # fails before the counting, if it must
    for count in counts.values():
        if count.sensor != options.sensor:
            raise ValueError(f"{path} has counts of --sensor {count.sensor}, these are of {options.sensor}")
    for sequence in _chosen(options):
        if sequence.name in counts or (options.sensor == RECORDED and sequence.biases is None):
            continue
        with progress(sequence.name, sequence.paper.duration_s, unit="s") as bar:
            counts[sequence.name] = count_events(sequence, sensor=options.sensor, progress=bar.advance)
        write_counts(path, sorted(counts.values(), key=lambda count: places.get(count.name, len(places))))
        tell(f"{sequence.name}: {counts[sequence.name].events:,} events")
    return 0
