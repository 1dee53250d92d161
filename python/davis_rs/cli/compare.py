"""The command line: davis-rs compare."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from ..progress import progress
from .common import add_part, figure_file, sensor_size


def add_compare(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.description = (
        "Print the statistics of two streams side by side: rates, intervals, row bursts, shared stamps, hot pixels, "
        "quiet pixels, parity of columns and rows. docs/sensor.md says what each means."
    )
    parser.set_defaults(run=_compare)
    what = "a dataset folder, an event file of any format, a camera's bytes, or an AEDAT recording"
    parser.add_argument("real", metavar="REAL", help=what)
    parser.add_argument("simulated", metavar="SIMULATED", help="likewise")
    parser.add_argument(
        "--figure", type=figure_file, metavar="FILE", help="draw both on one page: .png, .pdf, .svg ..."
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all numbers of both")
    parser.add_argument(
        "--size", type=sensor_size, metavar="WxH", help="sensor size of both, where a file does not say"
    )
    parser.add_argument(
        "--quiet-region",
        type=int,
        nargs=4,
        metavar=("X0", "Y0", "X1", "Y1"),
        help="pixels X0 <= x < X1, Y0 <= y < Y1 that see no signal in either; the quietest tiles of each if not given",
    )
    add_part(parser)
    parser.add_argument("--quiet", action="store_true", help="no progress bar")


def _compare(options: argparse.Namespace) -> int:
    from ..stream_statistics import StreamComparison, StreamStatistics, measure_stream
    from ..stream_statistics.comparison_figure import draw_comparison

    region = None if options.quiet_region is None else tuple(options.quiet_region)

    def measured(path: str) -> StreamStatistics:
        with progress(f"reading {path}", 100.0, unit="%", show=not options.quiet) as bar:
            return measure_stream(
                path,
                size=options.size,
                quiet=region,
                start_s=options.start,
                stop_s=options.stop,
                progress=lambda share: bar.to(100.0 * share),
            )

    comparison = StreamComparison(measured(options.real), measured(options.simulated))
    print(comparison)
    if options.json is not None:
        found = {"real": comparison.real.describe(), "simulated": comparison.simulated.describe()}
        options.json.write_text(json.dumps(found, indent=1) + "\n")
    if options.figure is not None:
        print(draw_comparison(comparison, options.figure))
    return 0
