"""Runs davis-rs accuracy."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from .._util.argument_error import ArgumentError
from .._util.extras import require
from .._util.progress import each, progress, say, stage
from .._util.terminal_text import tell
from .._util.whole_file import write_whole
from ..accuracy.accuracy_sweep import Measurement, Sweep, sweep
from ..accuracy.frame_rate_report import draw_frame_rates, frame_rates_markdown, write_frame_rates_csv
from ..accuracy.frame_rates import DURATION_S, FrameRateSweep, VideoErrors, video_settings
from ..accuracy.light_accuracy import HEADS, LIGHT_SAMPLES, LightComparison
from ..accuracy.report import draw, facts_of, markdown, write_csv
from ..accuracy.settings import Setting, default_settings
from ..geometry.camera import Camera
from ..scene.scene import Scene
from ..simulation.settings import ViewSettings, complete, view_scene
from .common import add_scene, add_trajectory, on_trajectory, scene_of
from .ctrl_c import LINE
from .settings_options import add_settings, given_settings

_SETTINGS = ("camera", "size", "bake_error")
"""The settings that are not varied."""


_ROUNDS = 3
"""Timed runs of each setting."""


def add_accuracy(accuracy: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    accuracy.description = (
        "Measure settings of the simulator on a scene: errors against references, and time. "
        "Writes accuracy.csv, accuracy.md and accuracy.png. Ctrl-C keeps what was measured. With --frames: what the "
        "frame rate of a video costs that is made into events (docs/events_from_video.md)."
    )
    accuracy.set_defaults(run=_accuracy)
    add_scene(accuracy)
    accuracy.add_argument("-o", "--output", required=True, type=Path, metavar="DIR", help="the folder to write")
    path = accuracy.add_argument_group("camera path")
    add_trajectory(path)
    path.add_argument(
        "--start",
        dest="start_s",
        type=float,
        metavar="S",
        help="where on the trajectory to judge; if not given, half way of it",
    )
    path.add_argument(
        "--duration",
        dest="duration_s",
        type=float,
        metavar="S",
        help="how much to judge; if not given, 6 pixels of the fastest motion",
    )
    accuracy.add_argument(
        "--frames",
        action="store_true",
        help="render video of 30 to 960 frames a second, make events of it by each interpolation, and judge them; "
        "--duration is 0.2 s if not given. Writes frame_rates.csv, frame_rates.md and frame_rates.png",
    )
    accuracy.add_argument(
        "--light",
        type=int,
        metavar="RUNS",
        help="compare baked light with the mean of this many runs of Mitsuba's path tracer with 1,024 samples each; it "
        "must be even (docs/light.md). Writes light.md; the runs are kept next to it, and more of them may follow",
    )
    accuracy.add_argument("--rounds", type=int, metavar="N", help=f"timed runs of each setting (default: {_ROUNDS})")
    accuracy.add_argument("--only", metavar="TEXT", help="only settings whose name or family has this in it")
    accuracy.add_argument("--quiet", action="store_true", help="no progress bar")
    add_settings(accuracy, ViewSettings, only=_SETTINGS)


def _accuracy(options: argparse.Namespace) -> int:
    if options.light is not None:
        return _light(options)
    if "bake_error" in given_settings(options, ViewSettings):
        raise ValueError("--bake-error is for --light: what is compared without it renders alike")
    require("view", "matplotlib")  # it draws at the end
    if options.frames:
        return _frame_rates(options)
    rounds = _ROUNDS if options.rounds is None else options.rounds
    if rounds < 1:
        raise ArgumentError("{rounds} must be at least 1, got {}", rounds)
    settings = default_settings()
    if options.only is not None:
        settings = [setting for setting in settings if options.only in f"{setting.name} {setting.family}"]
        if not settings:
            raise ValueError(f"no setting has {options.only!r} in its name or family")
    scene, camera = _judged_scene(options)
    with stage("making the renderers", show=not options.quiet):
        prepared = Sweep(
            scene,
            start_s=options.start_s,
            duration_s=options.duration_s,
            camera=camera,
            folder=options.output,
        )
    command = f"davis-rs {shlex.join(sys.argv[1:])}"
    return run_sweep(prepared, settings, rounds=rounds, command=command, quiet=options.quiet)


def _judged_scene(options: argparse.Namespace) -> tuple[Scene, Camera]:
    """Return the scene on its path, and the camera that sees it."""
    scene = on_trajectory(options, scene_of(options, options.quiet), quiet=options.quiet)
    viewed = view_scene(scene, complete(ViewSettings, given_settings(options, ViewSettings), taker="davis-rs accuracy"))
    return scene, viewed.camera


def _light(options: argparse.Namespace) -> int:
    if options.frames or options.only is not None or options.rounds is not None or options.start_s is not None:
        raise ValueError("--light compares light alone: without --frames, --only, --rounds and --start")
    scene, camera = _judged_scene(options)
    given = given_settings(options, ViewSettings)
    folder: Path = options.output
    with stage("making the renderers", show=not options.quiet):
        comparison = LightComparison(
            scene,
            camera,
            runs=options.light,
            folder=folder,
            **({} if options.duration_s is None else {"duration_s": options.duration_s}),
            **({"bake_error": given["bake_error"]} if "bake_error" in given else {}),
        )
    table = [f"| {' | '.join(HEADS)} |", "|---|" + "---:|" * (len(HEADS) - 1)]
    for errors in each(comparison.measure(), "light", 2 + len(LIGHT_SAMPLES), show=not options.quiet):
        table.append(str(errors))
        tell(errors, flush=True)
    facts = (
        f"{scene.name}, {camera.width} x {camera.height}, {comparison.duration_s:g} s, C = {scene.contrast_threshold:g}"
        f": `davis-rs {shlex.join(sys.argv[1:])}`"
    )
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / "light.md", "\n".join([facts, "", *table, ""]))
    tell(folder / "light.md")
    return 0


def _frame_rates(options: argparse.Namespace) -> int:
    if options.only is not None:
        raise ValueError("--only chooses settings of the simulator, which --frames does not compare")
    if options.rounds is not None:
        raise ValueError("--rounds are timed runs, and --frames times nothing")
    scene, camera = _judged_scene(options)
    duration_s = DURATION_S if options.duration_s is None else options.duration_s
    with stage("making the renderers", show=not options.quiet):
        prepared = FrameRateSweep(scene, start_s=options.start_s, duration_s=duration_s, camera=camera)
    folder: Path = options.output
    folder.mkdir(parents=True, exist_ok=True)
    settings = video_settings()
    measured: list[VideoErrors] = []
    interrupted = False
    try:
        for errors in each(prepared.measure(settings), "videos", len(settings), show=not options.quiet):
            measured.append(errors)
            write_frame_rates_csv(measured, folder / "frame_rates.csv")
    except KeyboardInterrupt:
        say(LINE)
        interrupted = True
    if measured:
        facts = {
            "command": f"`davis-rs {shlex.join(sys.argv[1:])}`",
            "scene": f"{scene.name}, {camera.width} x {camera.height}, C = {scene.contrast_threshold:g}",
            "judged": f"{prepared.duration_s:.3g} s from {prepared.start_s:.3g} s on, in which the fastest pixel moves "
            f"{prepared.path_px:.1f} px; events match within {prepared.window_us / 1000:.3g} ms",
        }
        write_whole(folder / "frame_rates.md", frame_rates_markdown(measured, facts))
        draw_frame_rates(measured, folder / "frame_rates.png", f"{scene.name}: events from video")
        tell(folder / "frame_rates.md")
    return 130 if interrupted else 0


def run_sweep(prepared: Sweep, settings: Sequence[Setting], *, rounds: int, command: str, quiet: bool) -> int:
    """Measure, and write the files into the sweep's folder, the CSV as rows come; returns the exit status.

    Ctrl-C ends the measuring; the page and the figure are then of what was measured until there.

    Raises:
        OSError: if a file cannot be written.
        ImportError: without matplotlib.
    """
    folder = prepared.folder
    folder.mkdir(parents=True, exist_ok=True)
    measured: list[Measurement] = []
    interrupted = False
    try:
        with progress(f"reference, {prepared.fine_rays:,} rays", 1, unit="frames", show=not quiet) as bar:
            for done, bar.total in prepared.prepare():
                bar.to(done)
            bar.total = max(bar.done, 1)  # it may be good before the densest frames
        for measured in each(
            sweep(prepared, settings, rounds), "settings", len(settings) * rounds, unit="runs", show=not quiet
        ):
            write_csv(measured, folder / "accuracy.csv")
    except KeyboardInterrupt:
        say(LINE)
        interrupted = True
    if measured:
        facts = facts_of(prepared, measured, command=command, interrupted=interrupted)
        write_whole(folder / "accuracy.md", markdown(measured, facts))
        draw(measured, folder / "accuracy.png", f"{prepared.scene.name}: accuracy against time ({facts['machine']})")
        tell(folder / "accuracy.md")
    return 130 if interrupted else 0
