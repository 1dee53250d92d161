"""The command line: davis-rs check, davis-rs view."""

from __future__ import annotations

import argparse
from pathlib import Path

from .common import sensor_size


def add_check(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.set_defaults(run=_check)
    parser.add_argument("dataset", type=Path, metavar="DIR")


def add_view(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.set_defaults(run=_view)
    parser.add_argument("source", type=Path, metavar="PATH", help="a dataset folder, event file or recording")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FILE",
        help="the picture: .png, .pdf, .svg ...; in or next to PATH if not given",
    )
    parser.add_argument(
        "--size", type=sensor_size, metavar="WxH", help="sensor size in pixels, where PATH does not say"
    )
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
    from ..inspection.figure import check_figure_path, view
    from ..inspection.video import make_video

    if options.video is not None:
        if options.output is not None:
            raise ValueError("-o names a picture and --video a video: give one of them")
        settings = {"fps": options.fps, "speed": options.speed, "size": options.size}
        print(make_video(options.source, options.video, **settings, show_progress=True))
        return 0
    in_or_next_to = options.source / "view.png" if options.source.is_dir() else options.source.with_suffix(".png")
    output = check_figure_path(options.output or in_or_next_to)
    view(options.source, t_s=options.time, window_s=options.window, size=options.size).savefig(output)
    print(output)
    return 0
