"""Runs davis-rs frames."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from .._util.terminal_text import tell
from ..io.dataset.files import require_folder_room
from ..simulation.settings import FrameFolderSettings
from .settings_options import add_settings, given_settings
from .show import ShownEvents, add_output


def add_frames(frames: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    frames.description = (
        "Turn a video, a folder of images or a .npy stack into a dataset folder with the events that a sensor would "
        "have seen. Ctrl-C keeps what was written."
    )
    frames.set_defaults(run=_frames)
    frames.add_argument(
        "frames",
        metavar="FRAMES",
        help="a video, a folder of images (PNG, JPEG, TIFF, BMP, EXR), or a .npy file (n, H, W) or (n, H, W, 3)",
    )
    add_output(frames)
    stamps = frames.add_argument_group("stamps")
    stamps.add_argument(
        "--timestamps",
        metavar="FILE",
        help="text with a stamp a line, or .npy; if not given, the video's own, or the folder's images.txt, images.csv "
        "(ESIM), timestamps.txt or fps.txt (vid2e)",
    )
    stamps.add_argument("--fps", type=float, metavar="HZ", help="frames a second, in place of stamps")
    stamps.add_argument(
        "--time-unit",
        choices=("s", "ms", "us", "ns"),
        help="unit of --timestamps; if not given, s in text and floating point, us in integers of .npy",
    )
    add_settings(frames, FrameFolderSettings)


def _frames(options: argparse.Namespace) -> int:
    from ..simulation.from_frames.frames_folder import frames_to_folder
    from ..simulation.from_frames.open_frames import open_frames

    require_folder_room(Path(options.output), overwrite=options.overwrite)
    source = open_frames(options.frames, timestamps=options.timestamps, fps=options.fps, time_unit=options.time_unit)
    with ShownEvents(f"{options.frames}: events", wanted=options.show) as shown:
        report = frames_to_folder(
            source,
            options.output,
            overwrite=options.overwrite,
            meta={"command": ["davis-rs", *sys.argv[1:]]},
            quiet=options.quiet,
            on_packet=shown.packet,
            **given_settings(options, FrameFolderSettings),
        )
    tell(report)
    return 130 if report.interrupted else 0
