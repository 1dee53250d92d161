"""What several commands have alike: how they show their defaults, and the camera's path."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace

from ..scene.scene import Scene
from ..scenes import BUILTIN_SCENES, start_pose
from ..trajectory.trajectory import align, interval
from ..trajectory.trajectory_file import read_trajectory

SCENE_HELP = f"{', '.join(BUILTIN_SCENES)}, a sequence of davis-rs sequences, or a Mitsuba XML file"
"""What a scene may be."""


class Help(argparse.ArgumentDefaultsHelpFormatter):
    """Shows the defaults that are values; None says nothing."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        return action.help if action.default in (None, False) else super()._get_help_string(action)


def add_path(group: argparse._ArgumentGroup) -> None:
    """Add the options that :func:`on_path` reads."""
    group.add_argument(
        "--trajectory",
        metavar="FILE",
        help="groundtruth.txt, TUM, or ESIM's CSV in nanoseconds; the scene's own path if not given",
    )
    group.add_argument("--start", type=float, default=0.0, metavar="S", help="where on the trajectory t = 0 lies")
    group.add_argument("--duration", type=float, metavar="S", help="seconds of it; to the end if not given")
    group.add_argument(
        "--align",
        action=argparse.BooleanOptionalAction,
        help="move the trajectory so that it starts where the scene's camera does; "
        "if not given: where a file's trajectory meets a built-in scene",
    )
    group.add_argument(
        "--position-sigma", type=float, metavar="M", help="noise of the file's positions, smoothed away; 0 = none"
    )
    group.add_argument("--rotation-sigma", type=float, metavar="RAD", help="noise of the file's rotations, likewise")
    group.add_argument(
        "--max-gap", type=float, default=0.1, metavar="S", help="longest gap between samples that is bridged"
    )


def on_path(options: argparse.Namespace, scene: Scene, *, quiet: bool = False) -> Scene:
    """The scene with the part of a trajectory that the options ask for, from t = 0; says so where it was moved."""
    if options.trajectory is None:
        if options.align:
            raise ValueError("--align moves the trajectory of a file: give --trajectory")
        return scene.part(options.start, options.duration)
    sigmas = {"position_sigma_m": options.position_sigma, "rotation_sigma_rad": options.rotation_sigma}
    given = {name: value for name, value in sigmas.items() if value is not None}
    trajectory = read_trajectory(options.trajectory, max_gap_s=options.max_gap, **given)
    part = interval(trajectory, options.start, options.duration)
    # A built-in scene shares no world with anybody's trajectory, a user's own file may.
    if scene.trajectory is not None if options.align is None else options.align:
        if not quiet:
            print("trajectory moved so that it starts where the scene's camera does (--no-align)", file=sys.stderr)
        part = align(part, start_pose(scene))
    return replace(scene, trajectory=part)


def sensor_size(text: str) -> tuple[int, int]:
    """WIDTHxHEIGHT in pixels."""
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise argparse.ArgumentTypeError(f"expected WIDTHxHEIGHT such as 240x180, got {text!r}")
    return int(width), int(height)
