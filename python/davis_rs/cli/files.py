"""Runs davis-rs convert, davis-rs info."""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from decimal import Decimal, InvalidOperation
from functools import partial
from pathlib import Path
from typing import Any

from .._core import DecodeError
from .._util.argument_error import ArgumentError
from .._util.terminal_text import tell
from .._util.untrusted import MAX_PACKET_BYTES
from ..inspection.rig_summary import rig_contents
from ..inspection.summary import DATASET_FOLDER, dataset_contents, dataset_row, draw_rates, summarize_events
from ..io.dataset.files import is_plan_folder
from ..io.dataset.reader import Dataset
from ..io.dataset.rig_folder import RigDataset, is_rig_folder
from ..io.files.conversion import LeftOutWarning, convert, left_out_line
from ..io.files.rig_layouts import convert_rig
from ..io.formats.parts import ALL_PARTS, PARTS
from ..io.formats.registry import written_formats
from ..io.formats.ros2 import MESSAGES, STORAGES
from .common import EVENTS_HELP, bar_of_fraction, figure_file, of_camera, region, sensor_size


def add_convert(conversion: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    conversion.description = (
        "Convert from any container to any other, in constant memory: events, and the calibration, frames, depth, "
        "flow, IMU samples and poses that both hold. Values stay as they are; a message names what OUT cannot hold. "
        "OUT gets its name when it is whole: an error or Ctrl-C leaves nothing. The folder of a rig becomes DSEC's "
        "folder, MVSEC's HDF5 (.hdf5), or a bag with MVSEC's topics (.bag)."
    )
    conversion.set_defaults(run=partial(_convert, conversion))
    conversion.add_argument("source", metavar="IN", help=EVENTS_HELP)
    conversion.add_argument(
        "target", metavar="OUT", help="what to write; without a suffix a dataset folder, or - for standard output"
    )
    conversion.add_argument(
        "--format", choices=sorted(written_formats()), help="format of OUT; chosen by the suffix if not given"
    )
    conversion.add_argument(
        "--start", dest="start_us", type=_microseconds, metavar="S", help="only what is from this time of IN on"
    )
    conversion.add_argument(
        "--stop", dest="stop_us", type=_microseconds, metavar="S", help="only what is before this time of IN"
    )
    conversion.add_argument(
        "--roi",
        type=region,
        metavar="WxH+X+Y",
        help="only events of a part of the sensor: its size, and its left and upper edge, in pixels",
    )
    conversion.add_argument("--size", type=sensor_size, metavar="WxH", help="sensor size, where IN does not say")
    conversion.add_argument(
        "--parts",
        metavar="NAMES",
        help=f"only these next to the events, by commas: {', '.join(ALL_PARTS)}; none for events alone",
    )
    conversion.add_argument(
        "--from-zero",
        action=argparse.BooleanOptionalAction,
        default=None,
        help="subtract the time of the first event, frame or sample from all times; if not given, where OUT is a "
        "dataset folder and IN begins after an hour, as with Unix times",
    )
    conversion.add_argument("--storage", choices=STORAGES, help="storage of a rosbag2; sqlite3 if not given")
    conversion.add_argument(
        "--messages", choices=MESSAGES, help="message type of events in a rosbag2; dvs_msgs if not given"
    )
    conversion.add_argument(
        "--option", type=_option, action="append", default=[], metavar="NAME=VALUE", help="an option of OUT's format"
    )
    for rule, fault in (("backward", "are earlier than one before them"), ("outside", "lie outside of IN's own size")):
        conversion.add_argument(
            f"--{rule}", choices=("refuse", "drop"), default="refuse", help=f"what is done with events that {fault}"
        )
    add_max_packet_bytes(conversion)
    conversion.add_argument("--overwrite", action="store_true", help="replace OUT if it exists")
    conversion.add_argument("--quiet", action="store_true", help="no progress bar, only the last line")


def add_info(info: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    info.description = (
        "Sensor size, duration, events, ON share, rates and gaps; of a dataset folder also the columns of "
        "the paper's tables: T (duration), TS and RS (top speeds), NE (number of events). Of a folder of davis-rs "
        "generate, how many sequences are complete, and how long they are."
    )
    info.set_defaults(run=_info)
    info.add_argument("path", metavar="PATH", help=EVENTS_HELP)
    info.add_argument(
        "--picture", type=figure_file, metavar="FILE", help="draw the rate of each pixel: .png, .pdf, .svg ..."
    )
    info.add_argument("--size", type=sensor_size, metavar="WxH", help="sensor size in pixels, where PATH does not say")
    add_max_packet_bytes(info)
    info.add_argument("--quiet", action="store_true", help="no progress bar")


def add_max_packet_bytes(parser: argparse.ArgumentParser) -> None:
    """Add the limit of what is unpacked."""
    parser.add_argument(
        "--max-packet-bytes",
        type=int,
        default=MAX_PACKET_BYTES,
        metavar="BYTES",
        help="what a packet or chunk of a compressed file may unpack to; 64 MiB if not given",
    )


@contextmanager
def conversion_bar(options: argparse.Namespace) -> Iterator[Callable[[float], object]]:
    """Show the bar of a conversion; what the target cannot hold is left to the command's last line."""
    with bar_of_fraction(f"to {options.target}", quiet=options.quiet) as told, warnings.catch_warnings():
        warnings.simplefilter("ignore", LeftOutWarning)
        yield told


def _convert(parser: argparse.ArgumentParser, options: argparse.Namespace) -> int:
    if is_rig_folder(options.source):
        return _convert_rig(parser, options)
    to_stream = options.target == "-"
    if to_stream and options.format is None:
        raise ValueError("standard output has no suffix that would tell the format: give --format")
    arguments: dict[str, Any] = {
        "size": options.size,
        "format": options.format,
        "start_us": options.start_us,
        "stop_us": options.stop_us,
        "roi": options.roi,
        "backward": options.backward,
        "outside": options.outside,
        "max_packet_bytes": options.max_packet_bytes,
        "overwrite": options.overwrite,
        "parts": _parts(options.parts),
        "from_zero": options.from_zero,
        **{name: getattr(options, name) for name in ("storage", "messages") if getattr(options, name) is not None},
        **dict(options.option),
    }
    try:
        with conversion_bar(options) as told:
            target = sys.stdout.buffer if to_stream else options.target
            report = convert(options.source, target, progress=told, **arguments)
            if to_stream:
                sys.stdout.buffer.flush()
    except TypeError as error:  # an option that the format does not have
        raise ValueError(str(error)) from error
    others = "".join(f", {report.parts[part.name]:,} {part.counted}" for part in PARTS if part.name in report.parts)
    tell(
        f"{report.path}: {report.format}, {report.events:,} events{others}, {report.bytes:,} bytes",
        file=sys.stderr if to_stream else sys.stdout,
    )
    if report.left_out:
        tell(f"davis-rs: {left_out_line(report.path, report.format, report.left_out)}", file=sys.stderr)
    return 0


_OF_RIGS = ("help", "debug", "source", "target", "format", "overwrite", "quiet")
"""The arguments of a conversion that hold for rigs, too."""


def _convert_rig(parser: argparse.ArgumentParser, options: argparse.Namespace) -> int:
    """Convert the folder of a rig."""
    for name, option in options.written.items():
        if name not in _OF_RIGS and getattr(options, name) != parser.get_default(name):
            raise ValueError(f"{option} is not for rigs: convert a camera of it, {options.source}/cam0")
    with conversion_bar(options) as told:
        report = convert_rig(
            options.source, options.target, layout=options.format, overwrite=options.overwrite, progress=told
        )
    left, right = report.events
    maps = f", {report.disparities:,} disparity maps" if report.disparities else ""
    tell(f"{report.path}: {report.layout}, {left:,} + {right:,} events{maps}")
    if report.left_out:
        tell(f"davis-rs: {left_out_line(report.path, report.layout, report.left_out)}", file=sys.stderr)
    return 0


def _info(options: argparse.Namespace) -> int:
    if is_plan_folder(options.path):
        from ..inspection.plan_folder import plan_folder_contents

        if options.picture is not None:
            raise ArgumentError("{picture} is that of one sequence, and {} has many", options.path)
        tell(plan_folder_contents(options.path))
        return 0
    if not is_rig_folder(options.path):
        _print_info(options, options.path, options.picture)
        return 0
    rig = RigDataset(options.path)
    tell(rig_contents(rig))
    for camera, dataset in rig.cameras.items():
        picture = None if options.picture is None else of_camera(options.picture, camera)
        tell("")
        _print_info(options, str(dataset.path), picture)
    return 0


def _print_info(options: argparse.Namespace, path: str, picture: Path | None) -> None:
    """Sum up a file or a folder."""
    try:
        with bar_of_fraction("reading", quiet=options.quiet) as told:
            summary = summarize_events(
                path, size=options.size, max_packet_bytes=options.max_packet_bytes, progress=told
            )
    except (OSError, DecodeError):
        _print_rest(path)
        raise
    tell(summary)
    if summary.format == DATASET_FOLDER:
        tell(dataset_contents(Dataset(path)))
        tell(dataset_row(path, summary))
    if picture is not None:
        tell(draw_rates(summary, picture))


def _print_rest(path: str) -> None:
    """Say what a dataset folder holds that was never finished, and whose events cannot be read."""
    with suppress(OSError, DecodeError):
        dataset = Dataset(path)
        if dataset.meta.get("complete") is False:
            tell(f"{path}: {DATASET_FOLDER}")
            tell(dataset_contents(dataset))


def _microseconds(text: str) -> int:
    """Parse decimal seconds as microseconds, exactly."""
    try:
        t_us = Decimal(text) * 1_000_000
        if t_us != t_us.to_integral_value():
            raise argparse.ArgumentTypeError(f"{text} s is no whole number of microseconds")
    except InvalidOperation:
        raise argparse.ArgumentTypeError(f"expected seconds, got {text!r}") from None
    return int(t_us)


def _parts(text: str | None) -> tuple[str, ...] | None:
    """Parse names with commas between them; "none" stands for no name."""
    if text is None:
        return None
    return () if text == "none" else tuple(name.strip() for name in text.split(","))


def _option(text: str) -> tuple[str, bool | int | str]:
    name, equals, value = text.partition("=")
    if not (name.isidentifier() and equals):
        raise argparse.ArgumentTypeError(f"expected NAME=VALUE such as compression=lz4, got {text!r}")
    if value in ("true", "false"):
        return name, value == "true"
    return name, int(value) if value.isdecimal() else value
