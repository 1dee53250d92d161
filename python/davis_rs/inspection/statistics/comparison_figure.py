"""Draws the statistics of two streams as one page of pictures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..._util.extras import from_extra
from ..._util.whole_file import whole_file
from .comparison import StreamComparison
from .counts import Histogram, bin_edges
from .stream_statistics import StreamStatistics

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis

_COLOURS = {"real": "#1b1b1b", "simulated": "#d95f02"}
_FLOOR_HZ = 1e-3


def draw_comparison(comparison: StreamComparison, output: str | Path) -> Path:
    """Draw intervals, rates, bursts, parity and the maps of two streams; returns the picture's path.

    Raises:
        ImportError: without matplotlib, saying how to get it.
        OSError: if it cannot be written.
    """
    with from_extra("view"):
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    streams = {"real": comparison.real, "simulated": comparison.simulated}
    figure = Figure(figsize=(13, 7.6), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, 3)
    for name, stream in streams.items():
        colour = _COLOURS[name]
        _draw_intervals(axes[0, 0], stream, name, colour)
        _draw_rates(axes[0, 1], stream, name, colour)
        _draw_bursts(axes[0, 2], stream, name, colour)
        _draw_columns(axes[1, 2], stream, name, colour)
    _label(axes[0, 0], "interval of a pixel (ms)", "share of intervals an octave", "full: same polarity, dotted: any")
    _label(axes[0, 1], "rate of a pixel (Hz)", "share of pixels above", "full: ON, dotted: OFF")
    _label(
        axes[0, 2], "row bursts in 10 us, or events in a burst", "share", "full: rows in 10 us, dotted: events in a row"
    )
    _label(
        axes[1, 2], "column x (px)", "events of a pixel, compared with the mean", "columns (thin: each, thick: 8 px)"
    )
    _plain_ticks(axes[0, 1].xaxis)
    limits = _map_limits([stream.rates_hz.sum(axis=0) for stream in streams.values()])
    for ax, (name, stream) in zip(axes[1, :2], streams.items(), strict=True):
        image = _draw_map(ax, stream, name, limits)
    bar = figure.colorbar(image, ax=axes[1, 1], label="events a second", shrink=0.8)
    _plain_ticks(bar.ax.yaxis)
    with whole_file(output) as working_path:
        figure.savefig(working_path, dpi=120)
    return Path(output)


def _label(ax: Axes, x: str, y: str, title: str) -> None:
    ax.set_xlabel(x)
    ax.set_ylabel(y)
    ax.set_title(title, fontsize=9)
    if ax.get_legend_handles_labels()[0]:
        ax.legend(fontsize=8)


def _plain_ticks(axis: Axis) -> None:
    """Name the rates along a logarithmic axis as plain numbers that do not overlap: 10, 20, 50."""
    from matplotlib.ticker import LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    subs = range(1, 10) if high < 4 * low else (1, 2, 5) if high < 1e3 * low else (1,)
    axis.set_major_locator(LogLocator(subs=subs))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def _map_limits(maps: list[npt.NDArray[np.float64]]) -> tuple[float, float]:
    """Return the least and the largest rate of the colours: nearly all pixels with events, at most three decades."""
    rates = np.concatenate([one[one > 0] for one in maps])
    least, largest = np.percentile(rates, [0.5, 99.5]) if len(rates) else (0.0, 0.0)
    largest = max(float(largest), 10 * _FLOOR_HZ)
    return min(max(float(least), largest * 1e-3), largest / 2), largest


def _draw_intervals(ax: Axes, stream: StreamStatistics, name: str, colour: str) -> None:
    edges = 2.0 ** np.arange(0, 41, 0.5)
    for histogram, style, label in ((stream.same, "-", name), (stream.any, ":", None)):
        if histogram.total:
            fraction = _rebinned(histogram, edges) / histogram.total * 2  # two bins an octave
            ax.plot(
                np.sqrt(edges[:-1] * edges[1:]) / 1e3,
                np.where(fraction > 0, fraction, np.nan),
                style,
                color=colour,
                label=label,
            )
    ax.set_xscale("log")
    ax.set_yscale("log")


def _rebinned(histogram: Histogram, edges: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Counts between other edges, by the middles of the histogram's own bins."""
    own = bin_edges()
    middles = 0.5 * (own[:-1].astype(np.float64) + own[1:] - 1)
    return np.histogram(middles, edges, weights=histogram.counts)[0]


def _draw_rates(ax: Axes, stream: StreamStatistics, name: str, colour: str) -> None:
    for polarity, style, label in ((1, "-", name), (0, ":", None)):
        rates = np.sort(stream.rates_hz[polarity].ravel())
        values, first = np.unique(rates[rates > 0], return_index=True)
        first = first + np.count_nonzero(rates == 0)
        ax.step(values, 1 - first / len(rates), style, where="pre", color=colour, label=label)
    ax.set_xscale("log")
    ax.set_yscale("log")


def _draw_bursts(ax: Axes, stream: StreamStatistics, name: str, colour: str) -> None:
    for histogram, style, label in (
        (stream.bursts.rows_per_window, "-", name),
        (stream.bursts.events_per_row, ":", None),
    ):
        if histogram.total:
            shown = histogram.counts[: min(histogram.most or 0, 127) + 1] / histogram.total
            ax.plot(np.flatnonzero(shown), shown[shown > 0], style, marker=".", color=colour, label=label)
    ax.set_yscale("log")


def _draw_columns(ax: Axes, stream: StreamStatistics, name: str, colour: str) -> None:
    counts = stream.counts.sum(axis=0).astype(np.float64)
    counts[stream.hot_pixels.y, stream.hot_pixels.x] = np.nan
    columns = np.nanmean(counts, axis=0) if len(counts) > 1 else counts[0]
    mean = columns.mean()
    if not mean > 0:
        return
    ax.plot(columns / mean, lw=0.4, color=colour)
    if len(columns) >= 8:
        smooth = np.convolve(columns, np.full(8, 1 / 8), mode="valid")
        ax.plot(np.arange(len(smooth)) + 3.5, smooth / mean, lw=1.6, color=colour, label=name)


_AROUND = 9
"""Pixels across of the square in which quiet pixels are counted."""


def _draw_map(ax: Axes, stream: StreamStatistics, name: str, limits: tuple[float, float]) -> Any:
    from matplotlib.colors import LogNorm

    rates = np.ma.masked_equal(stream.rates_hz.sum(axis=0), 0)
    image = ax.imshow(rates, cmap="viridis", norm=LogNorm(*limits))
    ax.set_facecolor("0.85")
    marks = []
    if 0 < stream.quiet.mean() < 1 and min(stream.quiet.shape) > 1:
        from scipy.ndimage import uniform_filter

        # Where most pixels around are quiet: single ones, each with an outline, would hide the map.
        ax.contour(uniform_filter(stream.quiet.astype(np.float32), _AROUND), levels=[0.55], colors="k", linewidths=0.5)
        marks.append("quiet pixels outlined")
    hot = stream.hot_pixels
    if len(hot.x):
        ax.plot(hot.x, hot.y, "o", mfc="none", mec="r", ms=7)
        marks.insert(0, "hot pixels circled")
    ax.set_title("\n".join([f"{name}: {stream.name}", ", ".join(marks)]).rstrip(), fontsize=9)
    return image
