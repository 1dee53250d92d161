"""Runs davis-rs sequences."""

from __future__ import annotations

import argparse
from pathlib import Path

from .._util.progress import each
from .._util.terminal_text import tell
from ..scene.sequences import SEQUENCES, sequence_named
from ..scene.sequences.event_counts import MEASURED, read_counts
from ..scene.sequences.listing import as_text, table


def add_sequences(listing: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    listing.description = (
        "List duration T, top speeds TS and RS and number of events NE of each sequence, the paper's and ours. Speeds "
        "are means over 100 ms. Events were counted before, those of ideal pixels."
    )
    listing.set_defaults(run=_list)
    listing.add_argument("names", nargs="*", metavar="NAME", help="all if not given")
    listing.add_argument(
        "--measured", type=Path, metavar="CSV", default=MEASURED, help="counts of ideal pixels to list"
    )


def _list(options: argparse.Namespace) -> int:
    chosen = [sequence_named(name) for name in options.names or SEQUENCES]
    tell(as_text(table(each(chosen, "listing", len(chosen), unit="sequences"), read_counts(options.measured))))
    for sequence in chosen if options.names else ():
        tell(f"{sequence.name}, next to the recording: {sequence.differs}")
    return 0
