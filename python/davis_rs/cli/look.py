"""The command line: davis-rs check, davis-rs view."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_check(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.set_defaults(run=_check)
    parser.add_argument("dataset", type=Path, metavar="DIR")


def add_view(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.set_defaults(run=_view)
    parser.add_argument("dataset", type=Path, metavar="DIR")
    parser.add_argument("-o", "--output", type=Path, metavar="PNG", help="the picture; DIR/view.png if not given")
    parser.add_argument("--time", type=float, metavar="S", help="the moment shown; the middle if not given")
    parser.add_argument("--window", type=float, metavar="S", help="length of the window of events; chosen if not given")
    parser.add_argument("--video", type=Path, metavar="FILE", help="make an .mp4 or .gif instead of a picture")
    parser.add_argument("--fps", type=float, default=25.0, help="pictures a second of the video (default: 25)")
    parser.add_argument(
        "--speed", type=float, default=0.1, help="seconds of the sequence in a second of the video (default: 0.1)"
    )


def _check(options: argparse.Namespace) -> int:
    from ..inspection.check import check_dataset

    report = check_dataset(options.dataset)
    print(report)
    return 0 if report.ok else 1


def _view(options: argparse.Namespace) -> int:
    from ..inspection.video import video_dataset
    from ..inspection.view import view_dataset

    if options.video is not None:
        print(video_dataset(options.dataset, options.video, fps=options.fps, speed=options.speed, show_progress=True))
        return 0
    output = options.output or Path(options.dataset) / "view.png"
    print(view_dataset(options.dataset, output, t_s=options.time, window_s=options.window))
    return 0
