"""Draws how well a recording is reproduced, on one page."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from .._util.extras import from_extra
from .._util.terminal_text import printable
from .._util.whole_file import whole_file
from ..events.arrays import EventArray
from .reproduced import WITHIN, ReproducedHalf
from .reproduction import Reproduction
from .table import heading_of

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import SubFigure

_COLOURS = ("#0072b2", "#56b4e9", "#999999", "#d55e00", "#009e73", "#cc79a7")
"""Of the streams next to the recording's: colours that all eyes tell apart (Okabe and Ito)."""

_REAL = "#000000"
_MOST_Z = 12.0


def draw_reproduction(reproduction: Reproduction, output: str | Path) -> Path:
    """Draw events, intervals, z-scores and correlations of each half that was compared; returns the path.

    Raises:
        ImportError: without matplotlib, saying how to get it.
        OSError: if it cannot be written.
    """
    with from_extra("view"):
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    halves = reproduction.halves
    figure = Figure(figsize=(10, 6.9 * len(halves)), layout="constrained")
    FigureCanvasAgg(figure)
    parts = figure.subfigures(len(halves), 1, squeeze=False)[:, 0]
    for part, half in zip(parts, halves, strict=True):
        _draw_half(part, reproduction.name, half)
    with whole_file(output) as working_path:
        figure.savefig(working_path, dpi=150)
    return Path(output)


def _draw_half(part: SubFigure, recording: str, half: ReproducedHalf) -> None:
    names = [name for name in half.streams if name != "real"]
    colours = dict(zip(names, _COLOURS * (1 + len(names) // len(_COLOURS)), strict=False))
    part.suptitle(f"{printable(recording)}\n{heading_of(half)}", fontsize=10)
    grid = part.add_gridspec(2, 6, height_ratios=(1, 1.15))
    region = _region(half.streams["real"])
    for k, name in enumerate(["real", *names[:1], names[min(2, len(names) - 1)]]):
        _draw_events(part.add_subplot(grid[0, 2 * k : 2 * k + 2]), half, name, region)
    _draw_intervals(part.add_subplot(grid[1, 0:2]), half, colours)
    _draw_scores(part.add_subplot(grid[1, 2:4]), half, colours)
    _draw_agreement(part.add_subplot(grid[1, 4:6]), half, colours)
    # One legend for all panels, so that it hides no curve and no bar.
    told: dict[str, Artist] = {}
    for axes in (part.axes[-3], part.axes[-1]):
        told |= dict(zip(*axes.get_legend_handles_labels()[::-1], strict=True))
    part.legend(told.values(), told.keys(), loc="outside lower center", ncols=4, frameon=False, fontsize=8)


def _region(events: EventArray) -> tuple[int, int, int, int]:
    """Return (x0, y0, x1, y1) around nearly all events."""
    x0, x1 = np.percentile(events["x"], [1, 99]).astype(int)
    y0, y1 = np.percentile(events["y"], [1, 99]).astype(int)
    return int(x0) - 6, int(y0) - 6, int(x1) + 7, int(y1) + 7


def _draw_events(ax: Axes, half: ReproducedHalf, name: str, region: tuple[int, int, int, int]) -> None:
    events = half.streams[name]
    x0, y0, x1, y1 = region
    inside = (events["x"] >= x0) & (events["x"] < x1) & (events["y"] >= y0) & (events["y"] < y1)
    shown = events[inside]
    image = np.zeros((y1 - y0, x1 - x0))
    np.add.at(image, (shown["y"].astype(int) - y0, shown["x"].astype(int) - x0), 2.0 * shown["p"] - 1)
    ax.imshow(image, cmap="RdBu_r", vmin=-3, vmax=3, extent=(x0, x1, y1, y0), interpolation="nearest")
    told = "recording" if name == "real" else name
    ax.set_title(f"{told}: {len(events):,} events\nmore ON red, more OFF blue", fontsize=9)
    ax.set_xlabel("x (px)", fontsize=7, labelpad=1)
    ax.set_ylabel("y (px)", fontsize=7, labelpad=1)
    ax.tick_params(labelsize=7)


def _draw_intervals(ax: Axes, half: ReproducedHalf, colours: dict[str, str]) -> None:
    from matplotlib.ticker import LogFormatter

    for name, events in half.streams.items():
        key = (events["y"].astype(np.int64) * 65536 + events["x"]) * 2 + events["p"]
        order = np.argsort(key, kind="stable")
        key, t = key[order], events["t"][order]
        gaps = np.sort(np.diff(t)[key[1:] == key[:-1]]) / 1e3
        if len(gaps):
            label = "recording" if name == "real" else name
            cumulative: npt.NDArray[np.float64] = np.arange(1, len(gaps) + 1) / len(gaps)
            ax.step(
                gaps,
                cumulative,
                where="post",
                color=colours.get(name, _REAL),
                lw=1.6 if name == "real" else 1.1,
                label=label,
            )
    ax.set_xscale("log")
    ax.xaxis.set_major_formatter(LogFormatter())
    ax.xaxis.set_minor_formatter(LogFormatter())
    ax.set_xlabel("interval between events of one polarity (ms)", fontsize=8)
    ax.set_ylabel("fraction below", fontsize=8)
    ax.tick_params(which="both", labelsize=7)


def _draw_scores(ax: Axes, half: ReproducedHalf, colours: dict[str, str]) -> None:
    judged = [row for row in half.rows if row.judged][::-1]
    ax.axvspan(-WITHIN, WITHIN, color="#eeeeee", zorder=0)
    for k, (name, colour) in enumerate(colours.items()):
        z = np.array([row.others[name][1] for row in judged])
        y = np.arange(len(judged)) + 0.2 - 0.4 * k / max(len(colours) - 1, 1)
        beyond = np.abs(z) > _MOST_Z
        ax.plot(np.clip(z, -_MOST_Z, _MOST_Z), y, "o", color=colour, ms=3.5, label=name)
        for at, value in zip(y[beyond], z[beyond], strict=True):
            ax.text(
                math.copysign(0.93 * _MOST_Z, value),
                at,
                f"{value:+.0f}",
                fontsize=6,
                va="center",
                ha="right" if value > 0 else "left",
            )
    ax.set_yticks(np.arange(len(judged)), [row.name.replace(" are below", "") for row in judged], fontsize=6)
    ax.set_xlim(-1.05 * _MOST_Z, 1.05 * _MOST_Z)
    ax.set_xlabel("difference / standard deviation", fontsize=8)
    ax.tick_params(axis="x", labelsize=7)


def _draw_agreement(ax: Axes, half: ReproducedHalf, colours: dict[str, str]) -> None:
    labels = [row.name.split("(")[-1].rstrip(")").replace("correlation of ", "") for row in half.agreement]
    width = 0.8 / max(len(colours), 1)
    for k, (name, colour) in enumerate(colours.items()):
        told = [row.others[name][0] for row in half.agreement]
        x = np.arange(len(labels)) - 0.4 + (k + 0.5) * width
        ax.bar(
            x,
            [one.value for one in told],
            0.9 * width,
            yerr=[one.sigma for one in told],
            color=colour,
            label=name,
            error_kw={"lw": 0.8},
        )
    for k, (row, whole) in enumerate(zip(half.agreement, half.whole_ceiling, strict=True)):
        ax.plot(
            [k - 0.42, k + 0.42],
            [row.real.value] * 2,
            "--",
            color=_REAL,
            lw=1,
            label="half against half" if k == 0 else None,
        )
        ax.plot([k - 0.42, k + 0.42], [whole] * 2, "-", color=_REAL, lw=1, label="half against all" if k == 0 else None)
    ax.set_xticks(np.arange(len(labels)), labels, fontsize=7)
    ax.set_ylim(0, 1)
    ax.set_ylabel("correlation with the recording", fontsize=8)
    ax.tick_params(axis="y", labelsize=7)
