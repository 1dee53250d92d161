"""Runs davis-rs filter."""

from __future__ import annotations

import argparse

from .._util.argument_error import ArgumentError
from .._util.terminal_text import tell
from ..events.filters import BackgroundActivity, DropPixels, Filter, Flicker, Refractory
from ..io.dataset.files import SIGNAL
from ..io.files.conversion import convert, left_out_line
from ..io.formats.registry import written_formats
from .common import EVENTS_HELP, bar_of_fraction, sensor_size
from .files import conversion_bar


def add_filter(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.description = (
        "Leave out events that are noise or flicker, and write the others, with frames and all else that OUT can hold. "
        "Filters act in the order in which they are listed here, each on what the one before let pass."
    )
    parser.set_defaults(run=_filter)
    parser.add_argument("source", metavar="IN", help=EVENTS_HELP)
    parser.add_argument("target", metavar="OUT", help="what to write; without a suffix a dataset folder")
    parser.add_argument(
        "--hot-pixels", action="store_true", help="drop all events of pixels that fire on their own (found by info)"
    )
    parser.add_argument(
        "--flicker",
        type=_frequencies,
        metavar="LOW:HIGH",
        help="drop the events of pixels that flicker evenly between these frequencies in Hz, such as 90:130",
    )
    parser.add_argument(
        "--refractory", type=int, metavar="US", help="drop what a pixel makes within US microseconds after an event"
    )
    parser.add_argument(
        "--background-activity",
        type=int,
        metavar="US",
        help="drop events without another one in the 8 pixels around within US microseconds before",
    )
    parser.add_argument(
        "--neighbours", type=int, metavar="N", help="how many of the 8 pixels must have had one; 1 if not given"
    )
    parser.add_argument(
        "--format", choices=sorted(written_formats()), help="format of OUT; chosen by the suffix if not given"
    )
    parser.add_argument("--size", type=sensor_size, metavar="WxH", help="sensor size, where IN does not say")
    parser.add_argument("--overwrite", action="store_true", help="replace OUT if it exists")
    parser.add_argument("--quiet", action="store_true", help="no progress bar, only the last line")


def _frequencies(text: str) -> Flicker:
    """Parse LOW:HIGH in Hz."""
    low, colon, high = text.partition(":")
    try:
        if not colon:
            raise ValueError
        return Flicker(float(low), float(high))
    except ArgumentError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be LOW:HIGH in Hz, such as 90:130, got {text!r}") from None


def _filter(options: argparse.Namespace) -> int:
    filters: list[Filter] = []
    if options.neighbours is not None and options.background_activity is None:
        raise ArgumentError("{neighbours} is of {background_activity}: give it too")
    if options.flicker is not None:
        filters.append(options.flicker)
    if options.refractory is not None:
        filters.append(Refractory(options.refractory))
    if options.background_activity is not None:
        filters.append(BackgroundActivity(options.background_activity, options.neighbours or 1))
    if options.hot_pixels:
        filters.insert(0, _hot_pixels(options))
    if not filters:
        raise ValueError("nothing to filter by: give --hot-pixels, --flicker, --refractory or --background-activity")
    with conversion_bar(options) as told:
        report = convert(
            options.source,
            options.target,
            size=options.size,
            format=options.format,
            filters=filters,
            overwrite=options.overwrite,
            progress=told,
        )
    taken = report.events + report.filtered_out
    percent_out = 100 * report.filtered_out / max(taken, 1)
    tell(f"{report.path}: {report.events:,} of {taken:,} events pass, {percent_out:.1f} % are left out")
    if report.filter_score is not None:
        tell(f"by {SIGNAL}: {report.filter_score}")
    if report.left_out:
        tell(left_out_line(report.path, report.format, report.left_out))
    return 0


def _hot_pixels(options: argparse.Namespace) -> Filter:
    """Find the pixels that fire on their own, in a first pass over the stream."""
    from ..inspection.statistics import measure_stream

    with bar_of_fraction("looking for hot pixels", quiet=options.quiet) as told:
        hot = measure_stream(options.source, size=options.size, progress=told).hot_pixels
    if not options.quiet:
        tell(f"{len(hot)} hot pixels")
    return DropPixels(hot.x, hot.y)
