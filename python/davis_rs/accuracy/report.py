"""Reports what a sweep of settings found: a table for machines, a table for people, and a figure."""

from __future__ import annotations

import csv
import math
import os
import platform
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._core import __version__
from .._util.extras import from_extra
from .._util.whole_file import whole_file
from .accuracy_sweep import SLOW_S, Errors, Measurement, Sweep
from .reference_events import EXACT_PX
from .settings import PRESETS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Value = Callable[[Errors], float]

_ERRORS: dict[str, tuple[str, Value]] = {
    "median": ("median event-time error (us)", lambda errors: errors.median_us),
    "p99": ("99th percentile of event-time error (us)", lambda errors: errors.p99_us),
    "counts": ("missing + spurious events (%)", lambda errors: errors.missing_percent + errors.spurious_percent),
}
"""What fronts are drawn of: axis labels, and values."""


def write_csv(measured: Sequence[Measurement], path: Path) -> None:
    """Write all numbers, one row a setting; replaces the file in one go, so that there is always a whole one."""
    rows = [_row(measurement) for measurement in measured]
    with whole_file(path) as working, working.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]) if rows else [])
        writer.writeheader()
        writer.writerows(rows)


def _row(measurement: Measurement) -> dict[str, object]:
    setting = measurement.setting
    row: dict[str, object] = {
        "setting": setting.name,
        "family": setting.family,
        "preset": setting.preset,
        "sampling": repr(setting.sampling),
        "rays_per_pixel": setting.rays_per_pixel,
        "pixel": measurement.pixel,
        "renderer": setting.renderer,
        "refined": measurement.refined,
        "wall_s_per_s": f"{measurement.median_wall_s:.6g}",
        "wall_s_per_s_least": f"{min(measurement.wall_s):.6g}",
        "wall_s_per_s_most": f"{max(measurement.wall_s):.6g}",
        "rounds": len(measurement.wall_s),
        "keyframes_per_s": f"{measurement.keyframes_per_s:.6g}",
        "rays_per_s": f"{measurement.rays_per_s:.6g}",
        "events": measurement.events,
        "promised_log_error_c": "" if setting.promised is None else f"{setting.promised:g}",
        "kept_percent": "" if measurement.kept_percent is None else f"{measurement.kept_percent:.6g}",
    }
    for name, errors in (("fine", measurement.in_all), ("same_rays", measurement.in_time)):
        for field in Errors._fields:
            row[f"{name}_{field}"] = "" if errors is None else f"{getattr(errors, field):.6g}"
    return row


def facts_of(sweep: Sweep, measured: Sequence[Measurement], *, command: str, interrupted: bool) -> dict[str, str]:
    """Say how the numbers came about, for people."""
    scene, camera, fine = sweep.scene, sweep.camera, sweep.fine
    rounds = sorted({len(m.wall_s) for m in measured if not m.slow})
    facts = {
        "scene": f"{scene.name}, {camera.width} x {camera.height} pixels, C = {scene.contrast_threshold:g}",
        "judged": f"{sweep.duration_s:.4g} s from {sweep.start_s:.4g} s of the trajectory, in which the fastest pixel "
        f"moves {sweep.path_px:.3g} px; {len(fine.events):,} events in the fine reference",
        "timed": f"{sweep.timed_s:.4g} s of simulation without frames and depth maps; loading and compiling left out; "
        f"medians of {' or '.join(map(str, rounds))} rounds, each of all settings in turn, so that a slow moment of "
        f"the machine meets all of them alike; what takes more than {SLOW_S:g} s for the judged part: there, once",
        "fine reference": f"{sweep.fine_rays:,} rays a pixel, cubics between frames {fine.pixels:.3g} px apart; "
        f"halving to that moved events by {fine.shift_us[0]:.2g} us (median) and {fine.shift_us[1]:.2g} us (99th "
        f"percentile), and brought or took {fine.changed_percent:.2g} %",
        "same rays": f"the setting's own rays every {EXACT_PX:.3g} px, each crossing then bisected to 0.1 us; the "
        "microsecond of a stamp alone makes a median of 0.5 us",
        "matching": f"events within {sweep.recipe.window_us:,} us, the time of one pixel of the fastest motion",
        "machine": f"{processor()}, {os.cpu_count()} logical CPUs; davis_rs {__version__}",
        "command": f"`{command}`",
    }
    if interrupted:
        facts["interrupted"] = "these are the settings measured until then"
    return facts


def processor() -> str:
    """Return the processor's name, as far as the system tells."""
    information = Path("/proc/cpuinfo")
    if information.is_file():
        for line in information.read_text("utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def pareto(points: Sequence[tuple[float, float]]) -> list[int]:
    """Return indices of the points (time, error) that no other is at least as good as in both; by time."""
    front: list[int] = []
    for i in sorted(range(len(points)), key=points.__getitem__):
        if not math.isnan(points[i][1]) and (not front or points[i][1] < points[front[-1]][1]):
            front.append(i)
    return front


def markdown(measured: Sequence[Measurement], facts: Mapping[str, str]) -> str:
    """Write a page: the facts of the sweep, and a table of the settings by time, a Pareto front's points in bold."""
    ordered = sorted(measured, key=lambda measurement: measurement.median_wall_s)
    fronts = {
        name: pareto([(measurement.median_wall_s, value(measurement.in_all)) for measurement in ordered])
        for name, (_, value) in _ERRORS.items()
    }
    lines = ["# Accuracy against time", "", *(f"- {name}: {text}" for name, text in facts.items()), ""]
    lines += [
        "Errors of time are in microseconds (median / 99th percentile), missing and spurious events in per cent of the",
        "reference's, log luma's rms error in units of C. *All*: against the fine reference; *time*: against the exact",
        "crossings of the same rays. *Kept*: adaptive sampling promises that log luma errs less than that in 95 % of",
        "all pixels; this share keeps the promise. Bold: no setting is both quicker and better in this number.",
        "",
        "| setting | wall s per s | frames/s | Mrays/s | all: median | p99 | missing + spurious | log luma "
        "| time: median / p99 | missing + spurious | log luma | kept |",
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for i, measurement in enumerate(ordered):
        errors, same = measurement.in_all, measurement.in_time
        bold = {name: "**" if i in front else "" for name, front in fronts.items()}
        preset = (
            f" ({measurement.setting.preset})" if measurement.setting.preset not in measurement.setting.name else ""
        )
        cells = [
            measurement.setting.name + preset,
            f"{measurement.median_wall_s:.3g}",
            f"{measurement.keyframes_per_s:.0f}",
            f"{measurement.rays_per_s / 1e6:.0f}",
            f"{bold['median']}{errors.median_us:.1f}{bold['median']}",
            f"{bold['p99']}{errors.p99_us:.0f}{bold['p99']}",
            f"{bold['counts']}{errors.missing_percent:.2f} + {errors.spurious_percent:.2f}{bold['counts']}",
            f"{errors.log_rms:.4f}",
            "-" if same is None else f"{same.median_us:.1f} / {same.p99_us:.0f}",
            "-" if same is None else f"{same.missing_percent:.2f} + {same.spurious_percent:.2f}",
            "-" if same is None else f"{same.log_rms:.4f}",
            kept_text(measurement),
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def kept_text(measurement: Measurement) -> str:
    """Say what the sampling promises, and how many pixels keep it."""
    if measurement.kept_percent is None:
        return "-"
    return f"{measurement.setting.promised:g} C: {measurement.kept_percent:.1f} %"


COLOURS = ("#0072B2", "#D55E00", "#56B4E9", "#E69F00", "#009E73", "#66C2A5", "#CC79A7", "#000000", "#7F7F7F")
"""Okabe and Ito's, which the usual kinds of colour blindness tell apart."""

_MARKERS = "ososs^D*X"


def draw(measured: Sequence[Measurement], path: Path, title: str) -> None:
    """Draw six panels: median, 99th percentile, missing and spurious against time; of all errors, and of those in time.

    Raises:
        ImportError: without matplotlib, saying how to get it.
    """
    with from_extra("view"):
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

    figure = Figure(figsize=(13.5, 8.6), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, 3, sharex=True)
    names = ("all errors (against 1,024 rays a pixel)", "errors in time alone (against the same rays)")
    kinds: tuple[Callable[[Measurement], Errors | None], ...] = (lambda m: m.in_all, lambda m: m.in_time)
    families = list(dict.fromkeys(m.setting.family for m in measured))
    for row, (name, kind) in enumerate(zip(names, kinds, strict=True)):
        for axis, (label, value) in zip(axes[row], _ERRORS.values(), strict=True):
            points = [(m, m.median_wall_s, value(errors)) for m in measured if (errors := kind(m)) is not None]
            _panel(axis, points, families)
            axis.set_ylabel(label.replace("(us)", "(µs)"))
            axis.set_title(name, fontsize=9)
    for axis in axes[1]:
        axis.set_xlabel("wall time per simulated second (s)")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5, frameon=False, fontsize=8.5)
    figure.suptitle(title, fontsize=11)
    with whole_file(path) as working:
        figure.savefig(working, format="png")


def _panel(axis: Axes, points: Sequence[tuple[Measurement, float, float]], families: Sequence[str]) -> None:
    front = [points[i] for i in pareto([(x, y) for _, x, y in points])]
    step_x = [x for _, x, _ in front]
    axis.step(step_x, [y for *_, y in front], where="post", color="0.75", lw=5, zorder=1, label="Pareto front")
    for k, family in enumerate(families):
        own = [(x, y) for m, x, y in points if m.setting.family == family]
        style: dict[str, Any] = {"color": COLOURS[k % len(COLOURS)], "marker": _MARKERS[k % len(_MARKERS)]}
        # The presets differ in everything: no line joins them.
        style |= {"ms": 11, "lw": 0, "mec": "white"} if family == PRESETS else {"ms": 5, "lw": 1}
        axis.plot(*zip(*own, strict=True) if own else ([], []), label=family, zorder=3, **style)
    middle = math.sqrt(min(x for _, x, _ in points) * max(x for _, x, _ in points))
    presets = sorted((x, y, m.setting.preset) for m, x, y in points if m.setting.preset)
    for index, (x, y, name) in enumerate(presets):
        # Below and above in turn, as two may lie close together.
        axis.annotate(
            name,
            (x, y),
            xytext=(8 if x < middle else -8, 10 if index % 2 else -18),
            ha="left" if x < middle else "right",
            textcoords="offset points",
            fontsize=9,
            fontweight="bold",
            bbox={"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.6},
            arrowprops={"arrowstyle": "-", "lw": 0.6},
            zorder=4,
        )
    make_logarithmic(axis)


def make_logarithmic(axis: Axes) -> None:
    """Make both scales of a panel logarithmic, with numbers at 1, 2 and 5."""
    from matplotlib.ticker import LogLocator, NullFormatter

    axis.set_xscale("log")
    axis.set_yscale("log")
    for scale in (axis.xaxis, axis.yaxis):
        scale.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=9))
        scale.set_major_formatter("{x:g}")
        scale.set_minor_formatter(NullFormatter())
    axis.grid(True, which="major", lw=0.4, color="0.85")
