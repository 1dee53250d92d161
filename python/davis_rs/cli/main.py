"""The command line: davis-rs check and view, and the commands of other modules."""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path

from .._core import __version__
from .accuracy import add_accuracy
from .calibrate import add_calibrate
from .common import Help, sensor_size
from .files import add_files
from .generate import add_generate
from .plan import add_plan
from .sequences import add_sequences
from .simulate import add_simulate
from .usb import add_usb


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit status: 0, 1 for a failure or a check that does not hold, 130 after Ctrl-C."""
    options = _parser().parse_args(arguments)
    warnings.showwarning = lambda message, *_: print(f"davis-rs: warning: {message}", file=sys.stderr)
    try:
        run: Callable[[argparse.Namespace], int] = options.run
        return run(options)
    except (ValueError, OSError, ImportError) as error:
        print(f"davis-rs: error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130


def _check(options: argparse.Namespace) -> int:
    from ..inspection.check import check_dataset

    report = check_dataset(options.dataset)
    print(report)
    return 0 if report.ok else 1


def _view(options: argparse.Namespace) -> int:
    from ..inspection.figure import check_figure_path, view
    from ..inspection.video import make_video

    if options.video is not None:
        if options.output is not None:
            raise ValueError("-o names a picture and --video a video: give one of them")
        settings = {"fps": options.fps, "speed": options.speed, "size": options.size}
        print(make_video(options.source, options.video, **settings, progress=True))
        return 0
    beside = options.source / "view.png" if options.source.is_dir() else options.source.with_suffix(".png")
    output = check_figure_path(options.output or beside)
    view(options.source, t_s=options.time, window_s=options.window, size=options.size).savefig(output)
    print(output)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="davis-rs",
        description="Simulate a DAVIS event camera, and read a real one.",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"davis-rs {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    add_simulate(commands)
    add_sequences(commands)
    add_plan(commands)
    add_generate(commands)
    add_accuracy(commands)
    add_usb(commands)
    add_files(commands)
    add_calibrate(commands)

    check = commands.add_parser("check", help="check a dataset: do its events explain its images?")
    check.add_argument("dataset", type=Path, metavar="DIR")
    check.set_defaults(run=_check)

    view = commands.add_parser("view", help="draw a dataset, an event file or a recording", formatter_class=Help)
    view.add_argument("source", type=Path, metavar="PATH", help="a dataset folder, event file or recording")
    view.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FILE",
        help="the picture: .png, .pdf, .svg ...; in or next to PATH if not given",
    )
    view.add_argument("--size", type=sensor_size, metavar="WxH", help="sensor size in pixels, where PATH does not say")
    view.add_argument("--time", type=float, metavar="S", help="the moment shown; the middle if not given")
    view.add_argument("--window", type=float, metavar="S", help="length of the window of events; chosen if not given")
    view.add_argument("--video", type=Path, metavar="FILE", help="make an .mp4 or .gif instead of a picture")
    view.add_argument("--fps", type=float, default=25.0, help="pictures a second of the video")
    view.add_argument("--speed", type=float, default=0.1, help="seconds of the sequence in a second of the video")
    view.set_defaults(run=_view)
    return parser
