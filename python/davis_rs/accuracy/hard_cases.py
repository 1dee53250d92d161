"""Compares the presets of accuracy on hard cases with brute force on the same rays: a table."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..events.arrays import concatenate_events
from ..events.matching import EventComparison, compare_events
from ..geometry.trajectory.views import Views
from ..render.base import Renderer
from ..sampling.observe import LumaRecorder
from ..sampling.presets import ACCURACY
from ..scene.scene import Scene
from ..simulation.simulator import Simulator
from .brute_force import DenseProbe, dense_probe
from .hard_case_scenes import HardCase

STEP_US = 40
"""Brute force renders this often."""

EARLY_US = 100
"""Events this long before anything changes in the image are counted."""

_WINDOW_US = (1_000, 10_000)


@dataclass(frozen=True)
class HardCaseResult:
    """Says what one preset makes of one case.

    Attributes:
        keyframes: how many were rendered.
        compared: with brute force.
        early: events that come more than :data:`EARLY_US` before brute force sees anything change in the image.
        wall_s: of the simulation, compiling included.
    """

    case: HardCase
    preset: str
    keyframes: int
    compared: EventComparison
    early: int
    wall_s: float


def measure_hard_cases(cases: Sequence[HardCase]) -> Iterator[HardCaseResult]:
    """Measure case by case and preset by preset; the rays or lines of brute force are those of the preset."""
    for case in cases:
        references: dict[tuple[int, str], DenseProbe] = {}
        for preset in ACCURACY:
            yield _measure(case, preset, references)


def _measure(case: HardCase, preset: str, references: dict[tuple[int, str], DenseProbe]) -> HardCaseResult:
    simulator = _simulator(case, case.part, preset)
    recorder = LumaRecorder(simulator.sampling, np.empty(0, np.int64), simulator.log_eps)
    simulator.sampling = recorder
    began = time.perf_counter()
    events = concatenate_events([packet.events for packet in simulator.run()])
    wall_s = time.perf_counter() - began
    renderer = simulator.renderer
    of_pixel = renderer.rays_per_pixel, renderer.pixel
    if of_pixel not in references:
        true = renderer if case.true_scene is None else _simulator(case, case.true_part, preset).renderer
        references[of_pixel] = dense_probe(
            true,
            case.true_part.path,
            step_us=STEP_US,
            contrast_threshold=case.contrast_threshold,
            log_eps=simulator.log_eps,
        )
    probe = references[of_pixel]
    size = (renderer.camera.width, renderer.camera.height)
    compared = compare_events(events, probe.events, size=size, window_us=_window_us(renderer, case))
    early = int((events["t"] < int(probe.unchanged_until_us.min()) - EARLY_US).sum())
    return HardCaseResult(case, preset, recorder.keyframe_count, compared, early, wall_s)


def _simulator(case: HardCase, scene: Scene, preset: str) -> Simulator:
    return Simulator(
        scene, accuracy=preset, contrast_threshold=case.contrast_threshold, frame_rate_hz=0, depth_rate_hz=0
    )


def _window_us(renderer: Renderer, case: HardCase) -> int:
    """Return the time in which the fastest pixel moves by one, at the end of the path, within limits."""
    path = case.part.path
    speeds = np.linalg.norm(renderer.flow(Views.along(path, [path.duration_s])), axis=-1)
    fastest = max(float(np.nanmax(speeds)), 1e-9)
    return int(np.clip(1e6 / fastest, *_WINDOW_US))


def hard_cases_page(results: Sequence[HardCaseResult], facts: Mapping[str, str]) -> str:
    """Write the page that shows them."""
    lines = ["# Hard cases", "", *(f"- {name}: {text}" for name, text in facts.items()), ""]
    lines += [
        "Small scenes in which sampling in time or space is easily wrong, simulated with each preset of",
        f"[accuracy](accuracy.md), against brute force: the same rays or lines every {STEP_US} us, log luma straight",
        "in between. Missing and spurious events are in per cent of brute force's, errors of time in microseconds",
        "(median / 99th percentile), of events that are matched within the time of one pixel of motion (1 to 10 ms).",
        f"*Early*: events more than {EARLY_US} us before brute force sees anything change in the image.",
        "",
        "| case | preset | keyframes | events | brute force | missing + spurious | error: median / p99 | early |",
        "|---|---|---:|---:|---:|---:|---:|---:|",
    ]
    for result in results:
        comparison = result.compared
        cells = [
            result.case.name,
            result.preset,
            f"{result.keyframes:,}",
            f"{comparison.compared:,}",
            f"{comparison.reference:,}",
            f"{comparison.missing_percent:.2f} + {comparison.spurious_percent:.2f}",
            f"{comparison.median_us:.0f} / {comparison.p99_us:.0f}",
            f"{result.early:,}",
        ]
        lines.append("| " + " | ".join(cells) + " |")
    cases = {result.case.name: result.case.what for result in results}
    lines += ["", "## The cases", "", *(f"- **{name}**: {what}." for name, what in cases.items()), "", *_LIMITS]
    return "\n".join(lines) + "\n"


_LIMITS = [
    "## What is left",
    "",
    "- **Wires.** Where a pixel is the mean of rays, a thin thing or its shadow may cross one between two samples and",
    "  leave no trace in them. The preset `exact` takes the integral over the pixel by lines, which see it wherever it",
    "  is. Luma that turns round between two samples may still reach a level for less time than lies between them.",
    "- **Brute force** stamps what jumps up to its own step late, and sees no dip shorter than that.",
]
