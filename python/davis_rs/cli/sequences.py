"""The command line: davis-rs sequences, sequences-table, sequences-sheet, sequences-count."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..progress import each, progress
from ..sequence_report import MEASURED, as_markdown, as_text, count_events, draw_sheet, read_counts, table, write_counts
from ..sequences import SEQUENCES, Sequence, sequence_named


def add_sequences(listing: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    listing.description = (
        "List duration T, top speeds TS and RS and number of events NE of each sequence, the paper's and ours. Speeds "
        "are means over 100 ms; events are those of ideal pixels, counted before by sequences-count."
    )
    listing.set_defaults(run=_list)
    _add_names(listing)
    listing.add_argument("--measured", type=Path, metavar="CSV", default=MEASURED, help="counts to list")


def add_sequences_table(markdown: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    markdown.set_defaults(run=_table)
    _add_names(markdown)
    markdown.add_argument("--measured", type=Path, metavar="CSV", default=MEASURED, help="counts to list")


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
    count.add_argument("-o", "--output", type=Path, required=True, metavar="CSV", help="the counts")


def _add_names(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("names", nargs="*", metavar="NAME", help="all if not given")


def _chosen(options: argparse.Namespace) -> list[Sequence]:
    return [sequence_named(name) for name in options.names or SEQUENCES]


def _list(options: argparse.Namespace) -> int:
    chosen = _chosen(options)
    print(as_text(table(each(chosen, "listing", len(chosen), unit="sequences"), read_counts(options.measured))))
    for sequence in chosen if options.names else ():
        print(f"{sequence.name}, next to the recording: {sequence.differs}")
    return 0


def _table(options: argparse.Namespace) -> int:
    chosen = each(_chosen(options), "listing", len(_chosen(options)), unit="sequences")
    print(as_markdown(table(chosen, read_counts(options.measured))))
    return 0


def _sheet(options: argparse.Namespace) -> int:
    chosen = each(_chosen(options), "simulating", len(_chosen(options)), unit="sequences")
    print(draw_sheet(chosen, options.output))
    return 0


def _count(options: argparse.Namespace) -> int:
    path = options.output
    counts = read_counts(path) if path.exists() else {}
    places = {name: place for place, name in enumerate(SEQUENCES)}
    write_counts(path, counts.values())  # fails before the counting, if it must
    for sequence in _chosen(options):
        if sequence.name in counts:
            continue
        with progress(sequence.name, sequence.paper.duration_s, unit="s") as bar:
            counts[sequence.name] = count_events(sequence, progress=bar.advance)
        write_counts(path, sorted(counts.values(), key=lambda count: places.get(count.name, len(places))))
        print(f"{sequence.name}: {counts[sequence.name].events:,} events")
    return 0
