"""Runs davis-rs sequences."""

from __future__ import annotations

import argparse
from pathlib import Path

from .._util.progress import each
from .._util.terminal_text import tell
from ..scene.sequences import SEQUENCES, Sequence, sequence_named
from ..scene.sequences.event_counts import MEASURED, MEASURED_RECORDED, EventCount, read_counts
from ..scene.sequences.listing import as_text, table


def add_sequences(listing: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    listing.description = (
        "List duration T, top speeds TS and RS and number of events NE of each sequence, the paper's and ours. Speeds "
        "are means over 100 ms. Events were counted before: those of ideal pixels, and those of the "
        "sensor of the recording."
    )
    listing.set_defaults(run=_list)
    _add_names(listing)
    _add_measured(listing)


def _add_names(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("names", nargs="*", metavar="NAME", help="all if not given")


def _add_measured(parser: argparse.ArgumentParser) -> None:
    for option, default, meaning in (
        ("--measured", MEASURED, "ideal pixels"),
        ("--measured-recorded", MEASURED_RECORDED, "the sensor of the recording"),
    ):
        parser.add_argument(option, type=Path, metavar="CSV", default=default, help=f"counts of {meaning} to list")


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
