"""Measures the statistics of streams, for ``compare`` and ``calibrate sensor``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, TypedDict

from .common import bar_of_fraction, region, sensor_size

if TYPE_CHECKING:
    from ..calibrate.sensor import MeasuredRecording
    from ..inspection.statistics import StreamStatistics


def add_measured(parser: argparse.ArgumentParser) -> None:
    """Add what all streams of a command have in common."""
    parser.add_argument("--size", type=sensor_size, metavar="WxH", help="sensor size, where a file does not say")
    parser.add_argument(
        "--quiet-region",
        type=region,
        metavar="WxH+X+Y",
        help="a part of the sensor that sees no signal: its size, and its left and upper edge, in pixels; the quietest "
        "tiles of each stream if not given",
    )
    parser.add_argument(
        "--start",
        dest="start_s",
        type=float,
        default=0.0,
        metavar="S",
        help="only events from here on, after the first",
    )
    parser.add_argument(
        "--stop", dest="stop_s", type=float, metavar="S", help="only events before this time after the first"
    )
    parser.add_argument("--quiet", action="store_true", help="no progress bar")


def measured(path: str, options: argparse.Namespace, fallback_size: tuple[int, int] | None = None) -> StreamStatistics:
    """Measure the statistics of a stream, with a progress bar; ``fallback_size`` is its size where nothing says it."""
    from ..inspection.statistics import measure_stream

    with bar_of_fraction(f"reading {path}", quiet=options.quiet) as told:
        return measure_stream(path, progress=told, fallback_size=fallback_size, **_selection(options))


def measured_with_frames(path: str, options: argparse.Namespace, lux: float | None) -> MeasuredRecording:
    """Measure the same, and the recording's frames; ``lux`` is what its quiet pixels see, None if it is not known."""
    from ..calibrate.sensor import measure_recording

    with bar_of_fraction(f"reading {path}", quiet=options.quiet) as told:
        return measure_recording(path, progress=told, lux=lux, **_selection(options))


class _MeasuredSelection(TypedDict):
    """Says which pixels and which time of a recording are measured."""

    size: tuple[int, int] | None
    quiet: tuple[int, int, int, int] | None
    start_s: float
    stop_s: float | None


def _selection(options: argparse.Namespace) -> _MeasuredSelection:
    return {
        "size": options.size,
        "quiet": options.quiet_region,
        "start_s": options.start_s,
        "stop_s": options.stop_s,
    }
