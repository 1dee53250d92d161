"""The command line: davis-rs simulate, and the settings of any simulation."""

from __future__ import annotations

import argparse
import sys
from dataclasses import fields
from pathlib import Path
from typing import Any

from ..camera import PRESETS
from ..record import record
from ..run_settings import RunSettings
from ..scene.scene import Scene
from ..scenes import load_scene
from ..sensor_parameters import SENSORS
from .common import SCENE_HELP, Help, add_path, on_path
from .inertial import add_inertial


def add_simulate(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line's."""
    simulate = commands.add_parser("simulate", help="simulate a scene into a dataset folder", formatter_class=Help)
    simulate.set_defaults(run=_simulate)
    simulate.add_argument("scene", metavar="SCENE", help=SCENE_HELP)
    add_path(simulate.add_argument_group("camera path"))
    add_settings(simulate)


def _simulate(options: argparse.Namespace) -> int:
    return simulate_into(options, on_path(options, load_scene(options.scene), quiet=options.quiet))


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Add the options that :func:`simulate_into` reads."""
    parser.add_argument("-o", "--output", required=True, metavar="DIR", help="the folder to write")

    camera = parser.add_argument_group("camera and pixel")
    camera.add_argument(
        "--camera", metavar="CAMERA", help=f"{', '.join(PRESETS)} or a calib.txt; the scene's if not given"
    )
    camera.add_argument(
        "--contrast-threshold", type=float, metavar="C", help="of ON events, natural log; the scene's if not given"
    )
    camera.add_argument("--contrast-threshold-off", type=float, metavar="C", help="of OFF events; as ON if not given")
    camera.add_argument(
        "--log-eps", type=float, default=RunSettings.log_eps, metavar="Y", help="dark level in units of luma"
    )
    camera.add_argument("--lux-per-luma", type=float, metavar="LUX", help="brightness; the scene's if not given")
    camera.add_argument(
        "--frame-rate", type=float, default=RunSettings.frame_rate, metavar="HZ", help="intensity frames; 0 = none"
    )
    camera.add_argument(
        "--depth-rate", type=float, default=RunSettings.depth_rate, metavar="HZ", help="depth maps; 0 = none"
    )
    camera.add_argument(
        "--exposure", type=float, help="grey = 255 x exposure x luma; chosen from the first frame if not given"
    )

    effects = parser.add_argument_group("effects (docs/effects.md)")
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

    add_inertial(parser)

    accuracy = parser.add_argument_group("accuracy and cost")
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
    accuracy.add_argument(
        "--samples", type=int, metavar="N", help="rays a pixel; 8 if not given (integrators without LLVM: 2)"
    )
    accuracy.add_argument("--renderer", choices=("auto", "native", "table", "integrator"), default=RunSettings.renderer)
    accuracy.add_argument(
        "--blur", action=argparse.BooleanOptionalAction, help="3 x 3 blur of luma; as the scene if not given"
    )
    accuracy.add_argument("--seed", type=int, default=0, metavar="N", help="of Mitsuba's integrators")
    accuracy.add_argument("--threads", type=int, metavar="N", help="of the crossing engine; as many as pay by default")

    parser.add_argument("--overwrite", action="store_true", help="replace the dataset in DIR")
    parser.add_argument("--quiet", action="store_true", help="no progress bar, only the last line")


def simulate_into(options: argparse.Namespace, scene: Scene, **meta: Any) -> int:
    """Simulate a scene's trajectory into the folder ``options.output``, under the options of :func:`add_settings`.

    ``meta`` is more for meta.json.
    """
    given = vars(options)
    settings = RunSettings(**{one.name: given[one.name] for one in fields(RunSettings) if one.name in given})
    imu, motion_capture = settings.make_imu(), settings.make_motion_capture()
    if not options.overwrite and Path(options.output).exists() and any(Path(options.output).iterdir()):
        # Said again, and binding, when the folder is made; here it saves the time until then.
        raise FileExistsError(f"{options.output} exists and is not empty: choose another folder or give --overwrite")
    simulator = settings.make_simulator(scene, seed=options.seed, threads=options.threads)
    if not options.quiet:
        print(f"rendering with {simulator.renderer.name}: {simulator.renderer.reason}", file=sys.stderr)
    recording = record(
        simulator,
        scene.path,
        options.output,
        motion_capture=motion_capture,
        imu=imu,
        exposure=options.exposure,
        overwrite=options.overwrite,
        meta={"command": ["davis-rs", *sys.argv[1:]], **meta},
        quiet=options.quiet,
    )
    print(recording)
    return 130 if recording.interrupted else 0
