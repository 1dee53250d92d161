"""The command line: davis-rs simulate, check, view, and the commands of other modules."""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path

from ._core import __version__
from .camera import PRESETS
from .cli_accuracy import add_accuracy
from .cli_calibrate import add_calibrate
from .cli_common import add_path, path_of
from .cli_files import add_files
from .cli_generate import add_generate
from .cli_inertial import add_inertial, refuse_lone_imu_options
from .cli_plan import add_plan
from .cli_usb import add_usb
from .sensor_parameters import SENSORS


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


def _simulate(options: argparse.Namespace) -> int:
    from .record import record
    from .run_settings import RunSettings
    from .scenes import load_scene

    refuse_lone_imu_options(options)
    given = vars(options)
    settings = RunSettings(**{one.name: given[one.name] for one in fields(RunSettings) if one.name in given})
    imu, motion_capture = settings.make_imu(), settings.make_motion_capture()
    scene = load_scene(options.scene)
    part = path_of(options, scene, quiet=options.quiet)
    if not options.overwrite and Path(options.output).exists() and any(Path(options.output).iterdir()):
        # Said again, and binding, when the folder is made; here it saves the time until then.
        raise FileExistsError(f"{options.output} exists and is not empty: choose another folder or give --overwrite")
    simulator = settings.make_simulator(scene, seed=options.seed, threads=options.threads)
    if not options.quiet:
        print(f"rendering with {simulator.renderer.name}: {simulator.renderer.reason}", file=sys.stderr)
    recording = record(
        simulator,
        part,
        options.output,
        motion_capture=motion_capture,
        imu=imu,
        exposure=options.exposure,
        overwrite=options.overwrite,
        meta={"command": ["davis-rs", *sys.argv[1:]]},
        quiet=options.quiet,
    )
    print(recording)
    return 130 if recording.interrupted else 0


def _check(options: argparse.Namespace) -> int:
    from .check import check_dataset

    report = check_dataset(options.dataset)
    print(report)
    return 0 if report.ok else 1


def _view(options: argparse.Namespace) -> int:
    from .video import video_dataset
    from .view import view_dataset

    if options.video is not None:
        print(video_dataset(options.dataset, options.video, fps=options.fps, speed=options.speed, progress=True))
        return 0
    output = options.output or Path(options.dataset) / "view.png"
    print(view_dataset(options.dataset, output, t_s=options.time, window_s=options.window))
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="davis-rs",
        description="Simulate a DAVIS event camera, and read a real one.",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"davis-rs {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    _add_simulate(commands)
    add_plan(commands)
    add_generate(commands)
    add_accuracy(commands)
    add_usb(commands)
    add_files(commands)
    add_calibrate(commands)

    check = commands.add_parser("check", help="check a dataset: do its events explain its images?")
    check.add_argument("dataset", type=Path, metavar="DIR")
    check.set_defaults(run=_check)

    view = commands.add_parser("view", help="draw a dataset as a picture or a video", formatter_class=_Help)
    view.add_argument("dataset", type=Path, metavar="DIR")
    view.add_argument("-o", "--output", type=Path, metavar="PNG", help="the picture; DIR/view.png if not given")
    view.add_argument("--time", type=float, metavar="S", help="the moment shown; the middle if not given")
    view.add_argument("--window", type=float, metavar="S", help="length of the window of events; chosen if not given")
    view.add_argument("--video", type=Path, metavar="FILE", help="make an .mp4 or .gif instead of a picture")
    view.add_argument("--fps", type=float, default=25.0, help="pictures a second of the video")
    view.add_argument("--speed", type=float, default=0.1, help="seconds of the sequence in a second of the video")
    view.set_defaults(run=_view)
    return parser


class _Help(argparse.ArgumentDefaultsHelpFormatter):
    """Shows the defaults that are values; None says nothing."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        return action.help if action.default in (None, False) else super()._get_help_string(action)


def _add_simulate(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    simulate = commands.add_parser("simulate", help="simulate a sequence into a dataset folder", formatter_class=_Help)
    simulate.set_defaults(run=_simulate)
    simulate.add_argument(
        "scene", metavar="SCENE", help="three_planes, three_walls, fence, calibration or a Mitsuba XML file"
    )
    simulate.add_argument("-o", "--output", required=True, metavar="DIR", help="the folder to write")

    add_path(simulate.add_argument_group("camera path"))

    camera = simulate.add_argument_group("camera and pixel")
    camera.add_argument(
        "--camera", metavar="CAMERA", help=f"{', '.join(PRESETS)} or a calib.txt; the scene's if not given"
    )
    camera.add_argument(
        "--contrast-threshold", type=float, metavar="C", help="of ON events, natural log; the scene's if not given"
    )
    camera.add_argument("--contrast-threshold-off", type=float, metavar="C", help="of OFF events; as ON if not given")
    camera.add_argument("--log-eps", type=float, default=1e-3, metavar="Y", help="dark level in units of luma")
    camera.add_argument("--frame-rate", type=float, default=40.0, metavar="HZ", help="intensity frames; 0 = none")
    camera.add_argument("--depth-rate", type=float, default=40.0, metavar="HZ", help="depth maps; 0 = none")
    camera.add_argument(
        "--exposure", type=float, help="grey = 255 x exposure x luma; chosen from the first frame if not given"
    )

    effects = simulate.add_argument_group("effects (docs/effects.md)")
    effects.add_argument("--sensor", choices=tuple(SENSORS), help="thresholds and effects of a sensor")
    which = effects.add_mutually_exclusive_group()
    which.add_argument(
        "--effect",
        action="append",
        metavar="NAME[=VALUE[,PARAMETER=VALUE...]]",
        help="an imperfection of the sensor, over those of --sensor; may be given several times",
    )
    which.add_argument(
        "--effects",
        choices=("auto",),
        help="those of --sensor (davis240c if not given) whose neglect would show in this scene",
    )

    add_inertial(simulate)

    accuracy = simulate.add_argument_group("accuracy and cost")
    accuracy.add_argument(
        "--accuracy",
        choices=("fast", "balanced", "exact"),
        help="a point on the curve of docs/accuracy.md; what follows overrides it; the paper's rule if not given",
    )
    rate = accuracy.add_mutually_exclusive_group()
    rate.add_argument("--render-rate", type=float, metavar="HZ", help="render at a fixed rate")
    rate.add_argument(
        "--max-displacement", type=float, metavar="PX", help="render whenever a pixel moved so far; 1/3 in the paper"
    )
    rate.add_argument(
        "--tolerance", type=float, metavar="SHARE", help="keep the error of log luma below this share of C"
    )
    accuracy.add_argument(
        "--refine", action=argparse.BooleanOptionalAction, help="polish event times to the microsecond; slow"
    )
    accuracy.add_argument("--samples", type=int, metavar="N", help="rays a pixel; 8 if not given, 2 without LLVM")
    accuracy.add_argument("--renderer", choices=("auto", "table", "integrator"), default="auto")
    accuracy.add_argument(
        "--blur", action=argparse.BooleanOptionalAction, help="3 x 3 blur of luma; as the scene if not given"
    )
    accuracy.add_argument("--seed", type=int, default=0, metavar="N", help="of Mitsuba's integrators")
    accuracy.add_argument("--threads", type=int, metavar="N", help="of the crossing engine; as many as pay by default")

    simulate.add_argument("--overwrite", action="store_true", help="replace the dataset in DIR")
    simulate.add_argument("--quiet", action="store_true", help="no progress bar, only the last line")


if __name__ == "__main__":
    sys.exit(main())
