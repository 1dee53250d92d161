"""The command line: davis-rs sequences, sequences-table, sequences-sheet, sequences-count."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path

from ..sequence_report import MEASURED, as_markdown, as_text, count_events, draw_sheet, read_counts, table, write_counts
from ..sequences import SEQUENCES, Sequence
from .common import sequence_named

_NAMES_HELP = "all if not given"


def add_sequences(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the commands to the command line's."""
    listing = commands.add_parser(
        "sequences",
        help="list the public dataset's sequences: the paper's table next to our own",
        description="List duration T, top speeds TS and RS and number of events NE of each sequence, the paper's and "
        "ours. Speeds are means over 100 ms; events are those of ideal pixels, counted before by sequences-count.",
    )
    listing.set_defaults(run=_list)
    markdown = commands.add_parser("sequences-table", help="the same list as a table of Markdown")
    markdown.set_defaults(run=_table)
    for command in (listing, markdown):
        command.add_argument("names", nargs="*", metavar="NAME", help=_NAMES_HELP)
        command.add_argument("--measured", type=Path, metavar="CSV", default=MEASURED, help="counts to list")

    sheet = commands.add_parser("sequences-sheet", help="draw a frame and events of each sequence")
    sheet.set_defaults(run=_sheet)
    sheet.add_argument("names", nargs="*", metavar="NAME", help=_NAMES_HELP)
    sheet.add_argument("-o", "--output", type=Path, required=True, metavar="PNG", help="the picture")

    count = commands.add_parser(
        "sequences-count",
        help="simulate sequences whole and count their events",
        description="Simulate sequences whole, count their events and add them to a CSV file. All of them take hours. "
        "Run the same command again to resume.",
    )
    count.set_defaults(run=_count)
    count.add_argument("names", nargs="*", metavar="NAME", help=_NAMES_HELP)
    count.add_argument("-o", "--output", type=Path, required=True, metavar="CSV", help="the counts")


def _chosen(options: argparse.Namespace) -> list[Sequence]:
    return [sequence_named(name) for name in options.names or SEQUENCES]


def _list(options: argparse.Namespace) -> int:
    chosen = _chosen(options)
    print(as_text(table(_shown(chosen), read_counts(options.measured))))
    for sequence in chosen if options.names else ():
        print(f"{sequence.name}, next to the recording: {sequence.differs}")
    return 0


def _table(options: argparse.Namespace) -> int:
    print(as_markdown(table(_shown(_chosen(options)), read_counts(options.measured))))
    return 0


def _sheet(options: argparse.Namespace) -> int:
    print(draw_sheet(_shown(_chosen(options)), options.output))
    return 0


def _shown(sequences: list[Sequence]) -> Iterable[Sequence]:
    from tqdm import tqdm

    shown: Iterable[Sequence] = tqdm(sequences, leave=False, disable=not sys.stderr.isatty())
    return shown


def _count(options: argparse.Namespace) -> int:
    from tqdm import tqdm

    path = options.output
    counts = read_counts(path) if path.exists() else {}
    places = {name: place for place, name in enumerate(SEQUENCES)}
    write_counts(path, counts.values())  # fails before the counting, if it must
    for sequence in _chosen(options):
        if sequence.name in counts:
            continue
        with tqdm(total=sequence.paper.duration_s, unit="s", desc=sequence.name) as bar:
            counts[sequence.name] = count_events(sequence, progress=bar.update)
        write_counts(path, sorted(counts.values(), key=lambda count: places.get(count.name, len(places))))
        print(f"{sequence.name}: {counts[sequence.name].events:,} events")
    return 0
