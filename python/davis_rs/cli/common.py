"""Holds what several commands have in common: scenes and the camera's path."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from .._util.argument_checks import as_size, parse_roi
from .._util.argument_error import ArgumentError
from .._util.extras import require
from .._util.progress import progress, say, stage
from .._util.terminal_text import tell
from ..geometry.pose import turn_deg
from ..geometry.trajectory.trajectory import Trajectory, align
from ..geometry.trajectory.trajectory_file import read_trajectory
from ..scene.default_motion import with_default_motion
from ..scene.default_paths import DEFAULT_DURATION_S
from ..scene.load import BUILTIN_SCENES, load_scene, moves_paths, start_pose
from ..scene.scene import Scene

SCENE_HELP = (
    f"{', '.join(BUILTIN_SCENES)}, a sequence of davis-rs sequences, a Mitsuba XML or glTF file, or an OBJ or PLY mesh"
)
"""What a scene may be."""

EVENTS_HELP = (
    "an event file of any format, a recording (AEDAT 2.0, 3.1, 4, or a camera's bytes), a dataset folder, or a rosbag2"
)
"""What has events."""


def add_scene(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that :func:`scene_of` reads."""
    parser.add_argument("scene", metavar="SCENE", help=SCENE_HELP)
    group = parser.add_argument_group("mesh or glTF file")
    group.add_argument(
        "--up",
        choices=("y", "z"),
        help="the axis of the file that points up (if not given: y for OBJ and glTF, z for PLY)",
    )
    group.add_argument("--scale", type=float, metavar="M", help="metres in the file's unit: 0.001 for millimetres")
    group.add_argument(
        "--animation",
        metavar="NAME",
        help="the animation of a glTF file that is played (if not given: all, or the first where two move the same)",
    )
    xml = parser.add_argument_group("Mitsuba file")
    xml.add_argument(
        "-D",
        dest="variables",
        action="append",
        type=_variable,
        default=[],
        metavar="NAME=VALUE",
        help="a value for a variable of the file, $NAME; may be given several times",
    )
    xml.add_argument(
        "--grey-unknown",
        action="store_true",
        help="take materials that are not known or missing as grey, instead of refusing the file; also of OBJ and PLY "
        "meshes, and missing textures of glTF files",
    )


def _variable(text: str) -> tuple[str, str]:
    """Return a variable's name and value."""
    name, sign, value = text.partition("=")
    if not name or not sign:
        raise argparse.ArgumentTypeError(f"must be NAME=VALUE, got {text!r}")
    return name, value


def scene_of(options: argparse.Namespace, quiet: bool = False) -> Scene:
    """Load the scene that the options name; says what is to be known of its file."""
    with stage(f"loading {options.scene}", show=not quiet):
        scene = load_scene(
            options.scene,
            up=options.up,
            scale=options.scale,
            animation=options.animation,
            variables=dict(options.variables),
            grey_unknown=options.grey_unknown,
        )
    if scene.note and not quiet:
        say(f"{scene.note} (--scale, --up)")
    return scene


def add_path(group: argparse._ArgumentGroup) -> None:
    """Add the options that :func:`on_path` reads."""
    add_trajectory(group)
    group.add_argument(
        "--start",
        dest="start_s",
        type=float,
        default=0.0,
        metavar="S",
        help="start at this time of the path, in seconds (default: 0)",
    )
    group.add_argument(
        "--duration",
        dest="duration_s",
        type=float,
        metavar="S",
        help="seconds of the path; if not given, to its end, or "
        f"{DEFAULT_DURATION_S:g} s of a path that the file does not have",
    )


def add_trajectory(group: argparse._ArgumentGroup) -> None:
    """Add the options that :func:`on_trajectory` reads."""
    group.add_argument(
        "--trajectory",
        metavar="FILE",
        help="groundtruth.txt, TUM, or ESIM's CSV in nanoseconds, whose first stamp becomes t = 0; the scene's own "
        "path if not given",
    )
    group.add_argument(
        "--align",
        action=argparse.BooleanOptionalAction,
        help="move the trajectory so that it starts where the scene's camera does; "
        "if not given: in a built-in scene or a sequence, but not in a scene of a file",
    )
    group.add_argument(
        "--position-sigma",
        dest="position_sigma_m",
        type=float,
        metavar="M",
        help="standard deviation of the noise of the file's positions, in metres: the path is smoothed by as much; "
        "0 for none; estimated from the data if not given",
    )
    group.add_argument(
        "--rotation-sigma",
        dest="rotation_sigma_rad",
        type=float,
        metavar="RAD",
        help="the same of its rotations, in radians; estimated from the data if not given",
    )
    group.add_argument(
        "--max-gap",
        dest="max_gap_s",
        type=float,
        default=0.1,
        metavar="S",
        help="longest gap between samples that is bridged (default: 0.1)",
    )


def on_path(options: argparse.Namespace, scene: Scene, quiet: bool = False) -> Scene:
    """Return the scene over the part of a camera path that the options ask for, from t = 0."""
    moved, duration_s = on_trajectory(options, scene, at_s=options.start_s, quiet=quiet), options.duration_s
    default_s = moved.default_duration_s
    if duration_s is None and default_s is not None and (rest_s := moved.path.duration_s - options.start_s) > default_s:
        duration_s = default_s
        if not quiet:
            tell(f"{default_s:g} s of its path are taken (--duration {rest_s:g}: to its end)", file=sys.stderr)
    return moved.crop(options.start_s, duration_s)


def on_trajectory(options: argparse.Namespace, scene: Scene, *, at_s: float = 0.0, quiet: bool = False) -> Scene:
    """Return the scene with the trajectory that the options ask for; says so where it was moved.

    Args:
        at_s: the instant of the trajectory that is moved to the scene's start.
    """
    if options.trajectory is None:
        if options.align:
            raise ValueError("--align moves the trajectory of a file: give --trajectory")
        if scene.trajectory is not None:
            return scene
        if scene.start is None:
            raise ValueError(f"scene {scene.name!r} has no trajectory of its own: give --trajectory FILE")
        moving = with_default_motion(scene)
        if not quiet:
            told = "it goes once around a small circle across its view (another path: --trajectory FILE)"
            eye = scene.own_camera
            of_size = f"a camera of {eye.width} x {eye.height} pixels (--size)"
            tell(f"scene {scene.name!r} has {of_size}, but no path: {told}", file=sys.stderr)
        return moving
    sigmas = {"position_sigma_m": options.position_sigma_m, "rotation_sigma_rad": options.rotation_sigma_rad}
    trajectory: Trajectory = (sampled := read_trajectory(options.trajectory, max_gap_s=options.max_gap_s, **sigmas))
    if not quiet:
        tell(f"{options.trajectory}: {sampled.smoothing()} (--position-sigma, --rotation-sigma)", file=sys.stderr)
    if moves_paths(scene) if options.align is None else options.align:
        start, was = start_pose(scene), trajectory.pose(at_s)
        trajectory = align(trajectory, start, at_s)
        if not quiet:
            metres = np.linalg.norm(start.position - was.position)
            tell(
                f"{options.trajectory}: moved by {metres:.3g} m and turned by {turn_deg(start, was):.1f} degrees, "
                "so that it starts where the scene's camera does (--no-align)",
                file=sys.stderr,
            )
    return scene.with_trajectory(trajectory)


def unnamed(error: ArgumentError) -> str:
    """Say what an error says of an argument, for one of argparse's errors, which names it in front."""
    return error.told(lambda _: "").lstrip()


def figure_file(text: str) -> Path:
    """Parse a file that a picture can be written to, told by its suffix; what draws it must be there."""
    from ..inspection.figure import check_figure_path

    require("view", "matplotlib")
    try:
        return check_figure_path(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def sensor_size(text: str) -> tuple[int, int]:
    """Parse WIDTHxHEIGHT in pixels."""
    try:
        return as_size(text)
    except ArgumentError as error:
        raise argparse.ArgumentTypeError(unnamed(error)) from None


def region(text: str) -> tuple[int, int, int, int]:
    """Parse WIDTHxHEIGHT+LEFT+TOP in pixels; return (x0, y0, x1, y1), half-open."""
    try:
        return parse_roi(text)
    except ArgumentError as error:
        raise argparse.ArgumentTypeError(unnamed(error)) from None


def of_camera(path: Path, camera: int) -> Path:
    """Return the file in which a camera of a rig gets what is made of each: ``out_cam1.png`` for ``out.png``."""
    return path.with_name(f"{path.stem}_cam{camera}{path.suffix}")


@contextmanager
def bar_of_fraction(task: str, *, quiet: bool) -> Iterator[Callable[[float], object]]:
    """Show a progress bar that is told the fraction that is done."""
    with progress(task, 100.0, unit="%", show=not quiet) as bar:
        yield lambda fraction: bar.to(100.0 * fraction)
