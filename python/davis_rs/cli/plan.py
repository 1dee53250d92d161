"""Runs davis-rs plan."""

from __future__ import annotations

import argparse

from .._util.progress import stage
from .._util.terminal_text import tell
from ..simulation.settings import PlanSettings, ViewSettings, complete, renderer_of, view_scene
from .common import add_path, add_scene, on_path, scene_of
from .settings_options import add_settings, given_settings


def add_plan(plan: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    plan.description = (
        "Look at a sequence, and say of each effect of a sensor what leaving it out would do to the "
        "events (or frames); and of those called for, how much of the difference they make at which cost."
    )
    plan.set_defaults(run=_plan)
    add_scene(plan)
    plan.add_argument(
        "--effect",
        "--effects",
        dest="effects",
        action="append",
        metavar="NAME[=VALUE[,PARAMETER=VALUE...]]",
        help="a candidate, over those of --sensor; may be given several times; where neither is given, the effects of "
        "the davis240c are the candidates",
    )
    plan.add_argument(
        "--explain", action="store_true", help="print for each effect what was measured and what it costs"
    )
    plan.add_argument("--quiet", action="store_true", help="no progress bars, only the results")
    add_path(plan.add_argument_group("camera path"))
    add_settings(plan, PlanSettings)


def _plan(options: argparse.Namespace) -> int:
    from ..accuracy.light_accuracy import light_cost
    from ..simulation.monte_carlo_noise import estimate_noise
    from ..simulation.planning import plan_effects

    scene = on_path(options, scene_of(options, options.quiet), options.quiet)
    with stage("planning effects", show=not options.quiet):
        plan = plan_effects(scene, options.effects, **given_settings(options, PlanSettings))
    tell(plan.explain() if options.explain else plan)
    with stage("measuring noise", show=not options.quiet):
        noise = estimate_noise(scene, **given_settings(options, ViewSettings))
    if noise is not None:
        tell(noise)
    settings = complete(ViewSettings, given_settings(options, ViewSettings), taker="davis-rs plan")
    viewed = view_scene(scene, settings)
    with stage("measuring what light costs", show=not options.quiet):
        light = light_cost(renderer_of(viewed, settings), viewed.scene)
    if light is not None:
        tell(light)
    return 0
