"""Runs davis-rs compare."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from .._util.terminal_text import tell
from .._util.whole_file import write_whole
from .common import EVENTS_HELP, figure_file
from .measured import add_measured, measured


def add_compare(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.description = (
        "Print the statistics of two streams side by side: rates, intervals, row bursts, shared stamps, hot pixels, "
        "quiet pixels, parity of columns and rows. docs/sensor.md says what each means."
    )
    parser.set_defaults(run=_compare)
    parser.add_argument("real", metavar="REAL", help=EVENTS_HELP)
    parser.add_argument("simulated", metavar="SIMULATED", help="the simulated stream, in the same forms")
    parser.add_argument(
        "--figure", type=figure_file, metavar="FILE", help="draw both on one page: .png, .pdf, .svg ..."
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all numbers of both")
    add_measured(parser)


def _compare(options: argparse.Namespace) -> int:
    from ..inspection.statistics import StreamComparison
    from ..inspection.statistics.comparison_figure import draw_comparison

    real = measured(options.real, options)
    comparison = StreamComparison(real, measured(options.simulated, options, fallback_size=real.size))
    tell(comparison)
    if options.json is not None:
        described = {"real": comparison.real.describe(), "simulated": comparison.simulated.describe()}
        write_whole(options.json, json.dumps(described, indent=1) + "\n")
    if options.figure is not None:
        tell(draw_comparison(comparison, options.figure))
    return 0
