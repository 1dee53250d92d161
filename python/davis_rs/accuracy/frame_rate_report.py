"""Writes what a frame rate costs, as a table and as a picture."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

from .._util.extras import from_extra
from .._util.whole_file import whole_file
from .frame_rates import VideoErrors

_COLUMNS = (
    *("fps", "bits", "interpolation", "displacement_px", "events"),
    *("median_us", "p99_us", "missing_percent", "spurious_percent"),
)

_COLOURS = {"linear": "#D55E00", "cubic": "#0072B2", "flow": "#009E73", "auto": "#000000"}
"""Okabe and Ito's, which the usual kinds of colour blindness tell apart."""


def write_frame_rates_csv(measured: Sequence[VideoErrors], path: Path) -> None:
    """Write a line for each setting."""
    with whole_file(path) as working, working.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(_COLUMNS)
        for errors in measured:
            writer.writerow([*errors.setting, *(f"{value:.6g}" for value in errors[1:])])


def frame_rates_markdown(measured: Sequence[VideoErrors], facts: Mapping[str, str]) -> str:
    """Write a page: the facts, and a table; of each rate and depth the least error in bold."""
    lines = ["# Frame rates", "", *(f"- {name}: {text}" for name, text in facts.items()), ""]
    lines += [
        "Errors of time are in microseconds, missing and spurious events in per cent of the exact ones. Bold: the",
        "least of linear, cubic and flow at this rate and depth.",
        "",
        "| frames/s | px a frame | values | interpolation | events | median | p99 | missing + spurious |",
        "|---:|---:|---|---|---:|---:|---:|---:|",
    ]
    for errors in measured:
        rivals = [
            other
            for other in measured
            if other.setting[:2] == errors.setting[:2] and other.setting.interpolation != "auto"
        ]
        cells = [
            f"{errors.setting.fps:g}",
            f"{errors.displacement_px:.2f}",
            "8 bits" if errors.setting.bits == 8 else "float",
            errors.setting.interpolation,
            f"{errors.events:,}",
            _bold(f"{errors.median_us:.0f}", errors.median_us, [other.median_us for other in rivals], errors),
            _bold(f"{errors.p99_us:.0f}", errors.p99_us, [other.p99_us for other in rivals], errors),
            _bold(
                f"{errors.missing_percent:.2f} + {errors.spurious_percent:.2f}",
                _wrong(errors),
                [_wrong(other) for other in rivals],
                errors,
            ),
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def draw_frame_rates(measured: Sequence[VideoErrors], path: Path, title: str) -> None:
    """Draw three panels: median, 99th percentile, missing and spurious, against frames a second.

    Raises:
        ImportError: without matplotlib, saying how to get it.
    """
    with from_extra("view"):
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
        from matplotlib.ticker import LogLocator, NullFormatter

    figure = Figure(figsize=(13.5, 4.9), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    panels = {
        "median time error (ms)": lambda errors: errors.median_us / 1000,
        "99th percentile of the time error (ms)": lambda errors: errors.p99_us / 1000,
        "missing + spurious events (% of the exact ones)": _wrong,
    }
    rates = sorted({errors.setting.fps for errors in measured})
    for axis, (label, value) in zip(figure.subplots(1, 3), panels.items(), strict=True):
        for rule, colour in _COLOURS.items():
            for bits, style in ((32, "-"), (8, "--")):
                own = [
                    errors
                    for errors in measured
                    if errors.setting.interpolation == rule and errors.setting.bits == bits
                ]
                if not own:
                    continue
                name = f"{rule}, {'8 bits' if bits == 8 else 'float'}"
                marker = {"marker": "o", "ms": 4} if rule != "auto" else {"marker": "x", "ms": 7}
                width = 1.6 if rule != "auto" else 0.7
                x, y = [errors.setting.fps for errors in own], [value(errors) for errors in own]
                axis.plot(x, y, style, color=colour, lw=width, label=name, **marker)
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_xticks(rates, [f"{rate:g}" for rate in rates])
        axis.xaxis.set_minor_formatter(NullFormatter())
        axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=9))
        axis.yaxis.set_major_formatter("{x:g}")
        axis.yaxis.set_minor_formatter(NullFormatter())
        axis.set_xlabel("frames a second")
        axis.set_ylabel(label)
        axis.grid(True, which="major", lw=0.4, color="0.88")
    handles, labels = axis.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    figure.suptitle(title, fontsize=11)
    with whole_file(path) as working:
        figure.savefig(working, format="png")


def _wrong(errors: VideoErrors) -> float:
    return errors.missing_percent + errors.spurious_percent


def _bold(text: str, value: float, rivals: Sequence[float], errors: VideoErrors) -> str:
    return f"**{text}**" if errors.setting.interpolation != "auto" and value == min(rivals) else text
