"""The command line: davis-rs plan."""

from __future__ import annotations

import argparse
from dataclasses import replace

from ..camera import load_camera
from ..effects import Effects, parse_effect
from ..plan import plan_effects
from ..scenes import load_scene
from ..sensor_parameters import SENSORS, sensor_parameters
from .common import SCENE_HELP, add_path, on_path


def add_plan(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line's."""
    plan = commands.add_parser(
        "plan",
        help="say which effects of a sensor a sequence calls for",
        description="Look at a sequence, and say of each effect of a sensor what leaving it out would do to the "
        "events (or frames), and what having it costs.",
    )
    plan.set_defaults(run=_plan)
    plan.add_argument("scene", metavar="SCENE", help=SCENE_HELP)
    plan.add_argument("--sensor", choices=tuple(SENSORS), help="davis240c if neither this nor --effect is given")
    plan.add_argument(
        "--effect",
        action="append",
        default=[],
        metavar="NAME[=VALUE[,PARAMETER=VALUE...]]",
        help="a candidate, over those of --sensor; may be given several times",
    )
    plan.add_argument(
        "--share",
        type=float,
        default=0.01,
        help="of events that must be missing, spurious or shifted without an effect that is called for (default: 0.01)",
    )
    plan.add_argument(
        "--shift-us", type=float, default=100.0, metavar="US", help="what counts as shifted (default: 100)"
    )
    add_path(plan.add_argument_group("camera path"))
    plan.add_argument("--camera", metavar="CAMERA", help="a preset or a calib.txt; the scene's if not given")
    plan.add_argument("--contrast-threshold", type=float, metavar="C", help="the sensor's or the scene's if not given")
    plan.add_argument("--contrast-threshold-off", type=float, metavar="C", help="as ON if not given")
    plan.add_argument("--log-eps", type=float, default=1e-3, metavar="Y", help="dark level in luma (default: 0.001)")
    plan.add_argument("--lux-per-luma", type=float, metavar="LUX", help="brightness; the scene's if not given")
    plan.add_argument(
        "--samples", type=int, metavar="N", help="rays a pixel; 8 if not given (integrators without LLVM: 2)"
    )
    plan.add_argument("--renderer", choices=("auto", "native", "table", "integrator"), default="auto")
    plan.add_argument("--blur", action=argparse.BooleanOptionalAction, help="3 x 3 blur; as the scene if not given")
    plan.add_argument("--seed", type=int, default=0, metavar="N")


def _plan(options: argparse.Namespace) -> int:
    scene = on_path(options, load_scene(options.scene))
    if options.lux_per_luma is not None:
        scene = replace(scene, lux_per_luma=options.lux_per_luma)
    given = [parse_effect(text) for text in options.effect]
    sensor = sensor_parameters(options.sensor or ("ideal" if given else "davis240c"))
    threshold, threshold_off = options.contrast_threshold, options.contrast_threshold_off
    plan = plan_effects(
        scene,
        scene.path,
        Effects.of([*sensor.effects(scene.lux_per_luma), *given]),
        camera=None if options.camera is None else load_camera(options.camera),
        contrast_threshold=sensor.contrast_threshold if threshold is None else threshold,
        contrast_threshold_off=sensor.contrast_threshold_off if threshold_off is None else threshold_off,
        log_eps=options.log_eps,
        samples=options.samples,
        seed=options.seed,
        renderer=options.renderer,
        blur=options.blur,
        share=options.share,
        shift_us=options.shift_us,
    )
    print(plan)
    return 0
