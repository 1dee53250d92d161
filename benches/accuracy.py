"""What a simulated second costs, and errs: python benches/accuracy.py [SCENE ...] [-o DIR]

On each scene the presets, and points around them, are judged against 1,024 rays a pixel (davis_rs.accuracy says how),
and timed. So is a second reference, 64 lines a pixel: what the two differ by is what neither knows. The usual way,
`paper`, `fast` and `balanced` take turns in several rounds. The usual way is Mitsuba's integrator with 16 rays and
lines 1/3 px apart. Closed rooms are black for Mitsuba, because no integrator has their light from all sides: there it
is the table kernel, with the same rays and lines.

``workshop``, ``wires`` and ``foliage`` are scenes that no preset was chosen by. Needs LLVM and matplotlib. With -o, the
tables and the figure are written into DIR, as presets.md and presets.png.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pixel_estimators import BUILT

import davis_rs
from davis_rs import ACCURACY, MaxDisplacement, Scene, Tolerance
from davis_rs.accuracy.accuracy_sweep import Measurement, Sweep
from davis_rs.accuracy.report import COLOURS, kept_text, make_logarithmic, processor
from davis_rs.accuracy.settings import Setting
from davis_rs.render.native.estimators import LINES

RAYS, PATH_PX, TIMED_PARTS, ROUNDS = 1024, 2.0, 12, 3
CLOSED_ROOMS = {"poster_6dof", "boxes_6dof", "office_zigzag"}
SCENES = [
    *(
        "three_planes",
        "three_walls",
        "fence",
        "poster_6dof",
        "boxes_6dof",
        "office_zigzag",
        "outdoors_walking",
        "urban",
    ),
    *BUILT,
]
REFERENCE = "second reference"
OFTEN = ("paper", "fast", "balanced")
"""What is timed in several rounds, with the usual way."""


class Result(NamedTuple):
    """What was measured on a scene."""

    scene: str
    judged: Sweep
    measured: list[Measurement]

    @property
    def usual(self) -> Measurement:
        return self.measured[0]


def settings_of(scene: str) -> list[Setting]:
    """The usual way first."""
    usual = "table" if scene in CLOSED_ROOMS else "integrator"
    name = "table kernel" if scene in CLOSED_ROOMS else "Mitsuba's integrator"
    presets = [
        Setting(preset, "presets", chosen.sampling, chosen.rays_per_pixel, refine=chosen.refine, preset=preset)
        for preset, chosen in ACCURACY.items()
    ]
    around = [
        Setting(f"{family}, {rays} rays", family, sampling, rays)
        for family, sampling, lattices in (
            ("lines, 1/3 px", MaxDisplacement(1 / 3), (16, 32, 64)),  # with 8 rays it is paper
            ("adaptive cubics, 1/2 px", ACCURACY["balanced"].sampling, (16, 32, 64)),
        )
        for rays in lattices
    ]
    lines = [
        Setting(f"balanced, {count} lines", "balanced by lines", ACCURACY["balanced"].sampling, rays, pixel="lines")
        for rays, count in LINES.items()
    ]
    finest = Tolerance(0.05, pixels=1 / 12, longest=1 / 12, halvings=3, edges=False)
    other = Setting("64 lines, adaptive cubics, 1/12 px", REFERENCE, finest, 256, pixel="lines")
    usual_way = Setting(f"{name}, 16 rays, lines 1/3 px", "usual", MaxDisplacement(1 / 3), 16, usual)
    return [usual_way, *presets, *around, *lines, other]


def measure(name: str, folder: Path) -> Result:
    scene: Scene = BUILT[name]() if name in BUILT else davis_rs.load_scene(name)
    judged = Sweep(scene, folder=folder / name, fine_rays=RAYS, path_px=PATH_PX, timed_parts=TIMED_PARTS)
    for _ in judged.prepare():
        pass
    settings = settings_of(name)
    measured = [judged.measure(setting, same_rays=setting.preset == "exact") for setting in settings]
    often = [one for one in measured if one.setting.name in OFTEN or (one.setting.family == "usual" and not one.slow)]
    for _ in range(ROUNDS - 1):
        for one in often:
            one.wall_s.append(judged.time(one.setting))
    return Result(name, judged, measured)


def row(result: Result, one: Measurement) -> str:
    errors = one.in_all
    least = min(one.wall_s)
    cells = [
        result.scene,
        one.setting.name,
        f"{least:.3g}",
        f"{min(result.usual.wall_s) / least:.1f}",
        f"{errors.median_us:.1f}",
        f"{errors.p99_us:.0f}",
        f"{errors.missing_percent:.2f} + {errors.spurious_percent:.2f}",
    ]
    return "| " + " | ".join(cells) + " |"


HEADER = [
    "| scene | setting | wall s per s | less than usual | median (us) | p99 (us) | missing + spurious (%) |",
    "|---|---|---:|---:|---:|---:|---:|",
]


def page(results: list[Result], command: str, minutes: float) -> str:
    lines = [
        "# What a simulated second costs",
        "",
        f"- command: `{command}` ({minutes:.0f} minutes)",
        f"- machine: {processor()}, {os.cpu_count()} logical CPUs; davis_rs {davis_rs.__version__}",
        f"- judged: while the fastest pixel moves {PATH_PX:g} px, half way of each path, against {RAYS} rays a pixel;",
        f"  timed: {TIMED_PARTS} times as much, start-up and files apart; the usual way, paper, fast and balanced: the"
        f" least of {ROUNDS} rounds in which they take turns",
        "- the usual way: Mitsuba's integrator, 16 rays a pixel, lines between renders 1/3 px apart; in closed rooms,",
        "  which only our own renderers light, the table kernel with the same rays and lines",
        *(
            ["- `workshop`, `wires` and `foliage` (scenes of the benches) were never used to choose a preset"]
            if any(result.scene in BUILT for result in results)
            else []
        ),
        "",
        "Errors of time are in microseconds, missing and spurious events in per cent of the reference's.",
        "",
        *HEADER,
        *(row(r, one) for r in results for one in r.measured if one.setting.family in ("usual", "presets")),
        "",
        "`exact` against the crossings of its own lines, which are searched between samples 1/48 px apart: errors in",
        "time alone (benches/exact.py has brute force):",
        "",
        "| scene | median (us) | p99 (us) | missing + spurious (%) |",
        "|---|---:|---:|---:|",
    ]
    for result in results:
        for one in result.measured:
            if one.in_time is not None:
                e = one.in_time
                counts = f"{e.missing_percent:.3f} + {e.spurious_percent:.3f}"
                lines.append(f"| {result.scene} | {e.median_us:.1f} | {e.p99_us:.1f} | {counts} |")
    lines += [
        "",
        "What adaptive sampling promises is that log luma errs less between renders, in 95 % of all pixels. Measured",
        "against the same rays or lines:",
        "",
        "| scene | setting | promised: pixels that keep it |",
        "|---|---|---:|",
    ]
    presets = [(r.scene, one) for r in results for one in r.measured if one.setting.preset]
    lines += [
        f"| {scene} | {one.setting.name} | {kept_text(one)} |" for scene, one in presets if one.kept_percent is not None
    ]
    lines += ["", "What the two references differ by:", "", *HEADER]
    lines += [row(r, one) for r in results for one in r.measured if one.setting.family == REFERENCE]
    lines += ["", "Points around the presets:", "", *HEADER]
    told = ("usual", "presets", REFERENCE)
    lines += [row(r, one) for r in results for one in r.measured if one.setting.family not in told]
    return "\n".join(lines) + "\n"


def draw(results: list[Result], path: Path) -> None:
    """One panel a scene: missing and spurious events against wall time."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    columns = min(3, len(results))
    rows = -(-len(results) // columns)
    figure = Figure(figsize=(4.4 * columns, 3.5 * rows + 0.6), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    axes = np.atleast_1d(figure.subplots(rows, columns)).ravel()
    families = list(dict.fromkeys(one.setting.family for one in results[0].measured))
    families.remove(REFERENCE)
    for axis, result in zip(axes, results, strict=False):
        for k, family in enumerate(families):
            own = [one for one in result.measured if one.setting.family == family]
            x = [min(one.wall_s) for one in own]
            y = [one.in_all.missing_percent + one.in_all.spurious_percent for one in own]
            single = family in ("usual", "presets")
            axis.plot(
                x,
                y,
                color=COLOURS[k],
                marker="D" if single else "o",
                markersize=7 if single else 4,
                linewidth=0 if single else 1,
                label="the usual way" if family == "usual" else family,
                zorder=3 if single else 2,
            )
            for one, at_x, at_y in zip(own, x, y, strict=True):
                if one.setting.preset:
                    axis.annotate(
                        one.setting.preset,
                        (at_x, at_y),
                        xytext=(6, 6 if one.setting.preset != "fast" else -12),
                        textcoords="offset points",
                        fontsize=8,
                    )
        axis.margins(0.12)  # room for the names
        make_logarithmic(axis)
        axis.set_title(result.scene, fontsize=10)
    for axis in axes[len(results) :]:
        axis.set_visible(False)
    figure.supxlabel("wall time per simulated second (s)", fontsize=10)
    figure.supylabel("missing + spurious events (%)", fontsize=10)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=4, frameon=False, fontsize=9)
    figure.savefig(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=SCENES, metavar="SCENE", help="which of them; all if not given")
    parser.add_argument("-o", "--output", type=Path, metavar="DIR", help="the folder to write")
    options = parser.parse_args()
    begin, results = time.perf_counter(), []
    with tempfile.TemporaryDirectory() as folder:
        for name in options.scenes:
            started = time.perf_counter()
            results.append(measure(name, Path(folder)))
            print(f"{name}: {time.perf_counter() - started:.0f} s", *HEADER, sep="\n")
            for one in results[-1].measured:
                print(row(results[-1], one), flush=True)
    if options.output is not None:
        options.output.mkdir(parents=True, exist_ok=True)
        minutes = (time.perf_counter() - begin) / 60
        command = "python benches/accuracy.py " + " ".join(sys.argv[1:])
        (options.output / "presets.md").write_text(page(results, command, minutes), "utf-8")
        draw(results, options.output / "presets.png")


if __name__ == "__main__":
    main()
