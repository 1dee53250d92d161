"""The command line: davis-rs check and view, and the commands of other modules."""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NoReturn

from .._core import __version__
from .accuracy import add_accuracy
from .calibrate import add_calibrate
from .files import add_files
from .generate import add_generate
from .plan import add_plan
from .sequences import add_sequences
from .simulate import add_simulate
from .usb import add_usb


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are one line: the usage of a command with many options would bury them."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {message} ({self.prog} --help lists the options)\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit status: 0, 1 for a failure or a check that does not hold, 130 after Ctrl-C.

    Raises:
        SystemExit: with status 2 for options that are not there or values that they do not take.
    """
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
    from ..inspection.video import video_dataset
    from ..inspection.view import view_dataset

    if options.video is not None:
        print(video_dataset(options.dataset, options.video, fps=options.fps, speed=options.speed, progress=True))
        return 0
    output = options.output or Path(options.dataset) / "view.png"
    print(view_dataset(options.dataset, output, t_s=options.time, window_s=options.window))
    return 0


def _parser() -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = _Parser(
        prog="davis-rs",
        description="Simulate a DAVIS event camera, and read a real one.",
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

    view = commands.add_parser("view", help="draw a dataset as a picture or a video")
    view.add_argument("dataset", type=Path, metavar="DIR")
    view.add_argument("-o", "--output", type=Path, metavar="PNG", help="the picture; DIR/view.png if not given")
    view.add_argument("--time", type=float, metavar="S", help="the moment shown; the middle if not given")
    view.add_argument("--window", type=float, metavar="S", help="length of the window of events; chosen if not given")
    view.add_argument("--video", type=Path, metavar="FILE", help="make an .mp4 or .gif instead of a picture")
    view.add_argument("--fps", type=float, default=25.0, help="pictures a second of the video (default: 25)")
    view.add_argument(
        "--speed", type=float, default=0.1, help="seconds of the sequence in a second of the video (default: 0.1)"
    )
    view.set_defaults(run=_view)
    return parser
