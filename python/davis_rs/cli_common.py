"""What several commands have alike: how they show their defaults, and the camera's path."""

from __future__ import annotations

import argparse
import sys

from .scene import Scene
from .scenes import start_pose
from .simulate import trajectory_part
from .trajectory import Trajectory, align
from .trajectory_file import read_trajectory


class Help(argparse.ArgumentDefaultsHelpFormatter):
    """Shows the defaults that are values; None says nothing."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        return action.help if action.default in (None, False) else super()._get_help_string(action)


def add_path(group: argparse._ArgumentGroup) -> None:
    """Add the options that :func:`path_of` reads."""
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


def path_of(options: argparse.Namespace, scene: Scene, *, quiet: bool = False) -> Trajectory:
    """The part of a trajectory that the options ask for, from t = 0; says so where it was moved."""
    trajectory: Trajectory | None = None
    if options.trajectory is not None:
        sigmas = {"position_sigma_m": options.position_sigma, "rotation_sigma_rad": options.rotation_sigma}
        given = {name: value for name, value in sigmas.items() if value is not None}
        trajectory = read_trajectory(options.trajectory, max_gap_s=options.max_gap, **given)
    # A built-in scene shares no world with anybody's trajectory, a user's own file may.
    built_in_scene_foreign_path = scene.trajectory is not None and trajectory is not None
    part = trajectory_part(scene, trajectory, options.start, options.duration)
    if not (built_in_scene_foreign_path if options.align is None else options.align):
        return part
    if not quiet:
        print("trajectory moved so that it starts where the scene's camera does (--no-align)", file=sys.stderr)
    return align(part, start_pose(scene))
