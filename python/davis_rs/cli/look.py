"""Runs davis-rs check, davis-rs view."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .._util.argument_error import ArgumentError
from .._util.progress import stage
from .._util.terminal_text import tell
from .._util.whole_file import whole_file
from ..io.dataset.files import is_plan_folder
from ..io.dataset.rig_folder import RigDataset, is_rig_folder
from .common import EVENTS_HELP, of_camera, sensor_size


def add_check(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.set_defaults(run=_check)
    parser.add_argument("dataset", type=Path, metavar="DIR", help="a dataset folder, or the folder of a rig")


def add_view(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.set_defaults(run=_view)
    parser.add_argument("source", type=Path, metavar="PATH", help=EVENTS_HELP)
    outputs = parser.add_argument_group("what is made (give one; a picture if none is given)")
    outputs.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FILE",
        help="the picture: .png, .pdf, .svg ...; in or next to PATH if not given",
    )
    outputs.add_argument("--video", type=Path, metavar="FILE", help="an .mp4 or .gif")
    outputs.add_argument(
        "--html", type=Path, metavar="FILE", help="an interactive page, one .html file for any browser"
    )
    outputs.add_argument(
        "--rerun",
        nargs="?",
        const="",
        metavar="FILE",
        help="a recording for Rerun's viewer, an .rrd file; without FILE the viewer is started",
    )
    parser.add_argument(
        "--size", type=sensor_size, metavar="WxH", help="sensor size in pixels, where PATH does not say"
    )
    parser.add_argument(
        "--time",
        dest="t_s",
        type=float,
        metavar="S",
        help="picture, page: the moment shown (first); the middle if not given",
    )
    parser.add_argument(
        "--window",
        dest="window_s",
        type=float,
        metavar="S",
        help="picture, page: length of the window of events; chosen if not given. Video: how far back the events of a "
        "picture reach; to the picture before if not given",
    )
    parser.add_argument(
        "--panels",
        metavar="NAMES",
        help="video: what is shown side by side: frame, events (over the frame), accumulated (ON minus OFF events as "
        "grey), with commas between (default: frame,events)",
    )
    parser.add_argument(
        "--events-per-picture", type=int, metavar="N", help="video: make a picture at every N events, of just these"
    )
    parser.add_argument(
        "--full-scale", type=int, metavar="N", help="video: events that make a pixel of accumulated white (default: 3)"
    )
    parser.add_argument("--fps", type=float, help="video: pictures a second (default: 25)")
    parser.add_argument(
        "--speed",
        type=float,
        help="video, page: seconds of the sequence in a second of playing (default: 0.1 in a video; "
        "in a page such that it takes about 20 s)",
    )
    parser.add_argument(
        "--max-events",
        type=int,
        metavar="N",
        help="page, Rerun: events kept, drawn evenly from all (default: 5,000,000 in a page, 2,000,000 in Rerun's "
        "cloud)",
    )
    parser.add_argument(
        "--whole",
        action="store_true",
        default=None,
        help="page: where there are more, keep all events of one span of time, around --time or where they are densest",
    )
    parser.add_argument(
        "--max-frames",
        type=int,
        metavar="N",
        help="page, Rerun: frames kept (default: as many as fit 4 MB of a page; all in Rerun)",
    )


_SETTINGS = {
    "output": ("t_s", "window_s"),
    "video": ("fps", "speed", "panels", "window_s", "events_per_picture", "full_scale"),
    "html": ("t_s", "window_s", "speed", "max_events", "max_frames", "whole"),
    "rerun": ("max_events", "max_frames"),
}
"""By what is made, the options that it takes."""

_OPTION_NAMES = {"output": "-o"}


def _check(options: argparse.Namespace) -> int:
    from ..inspection.check import check_dataset
    from ..inspection.rig_summary import check_rig

    with stage(f"checking {options.dataset}"):
        report = check_rig(options.dataset) if is_rig_folder(options.dataset) else check_dataset(options.dataset)
    tell(report)
    return 0 if report.ok else 1


def _view(options: argparse.Namespace) -> int:
    made = [kind for kind in _SETTINGS if getattr(options, kind) is not None] or ["output"]
    if len(made) > 1:
        listed = " and ".join(_OPTION_NAMES.get(kind, f"--{kind}") for kind in made)
        raise ValueError(f"{listed} make different things: give one of them")
    kind = made[0]
    given = {name: getattr(options, name) for names in _SETTINGS.values() for name in names}
    given = {name: value for name, value in given.items() if value is not None}
    for name in sorted(given.keys() - set(_SETTINGS[kind])):
        output_name = "the picture" if kind == "output" else f"--{kind}"
        raise ArgumentError("{option} means nothing for {}: leave it out", output_name, option=name)
    if is_plan_folder(options.source):
        from ..inspection.plan_folder import instead_of_plan_folder

        raise instead_of_plan_folder(options.source)
    if not is_rig_folder(options.source):
        tell(_MAKERS[kind](options, given | {"size": options.size}))
        return 0
    target = getattr(options, kind)
    if kind == "output" and target is None:
        target = options.source / "view.png"
    for camera, dataset in RigDataset(options.source).cameras.items():
        made_file = of_camera(Path(target), camera) if target else target
        of_one_camera = argparse.Namespace(**{**vars(options), "source": dataset.path, kind: made_file})
        tell(_MAKERS[kind](of_one_camera, given | {"size": options.size}))
    return 0


def _view_picture(options: argparse.Namespace, settings: dict[str, Any]) -> Path:
    from ..inspection.figure import check_figure_path, view

    in_or_next_to = options.source / "view.png" if options.source.is_dir() else options.source.with_suffix(".png")
    output = check_figure_path(options.output or in_or_next_to)
    with stage(f"drawing {options.source}"), whole_file(output) as working:
        figure = view(options.source, **settings)
        figure.savefig(working)
    return output


def _view_video(options: argparse.Namespace, settings: dict[str, Any]) -> Path:
    from ..inspection.video import make_video

    return make_video(options.source, options.video, **settings, show_progress=True)


def _view_html(options: argparse.Namespace, settings: dict[str, Any]) -> object:
    from ..inspection.html_page import view_html

    return view_html(options.source, options.html, **settings, show_progress=True)


def _view_rerun(options: argparse.Namespace, settings: dict[str, Any]) -> object:
    from ..inspection.rerun_recording import view_rerun

    return view_rerun(options.source, options.rerun or None, **settings, show_progress=True)


_MAKERS: dict[str, Callable[[argparse.Namespace, dict[str, Any]], object]] = {
    "output": _view_picture,
    "video": _view_video,
    "html": _view_html,
    "rerun": _view_rerun,
}
