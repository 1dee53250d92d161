"""Draws a figure of a sequence: intensity frame, events, depth map, and events over time."""

from __future__ import annotations

import io
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .._util.argument_checks import check_number
from .._util.argument_error import ArgumentError
from .._util.close_names import names_checked
from .._util.extras import from_extra
from .._util.quantities import time_text
from .._util.srgb import to_srgb
from ..events.arrays import EventArray
from .truth_panels import Panel, draw_map, truth_panels
from .visual_sequence import VisualSequence, nearest, open_visual_sequence

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ON_RGB = (202, 0, 32)
OFF_RGB = (5, 113, 176)
"""Red and blue that the usual kinds of colour blindness tell apart (the ends of ColorBrewer's RdBu)."""

_EVENTS_A_PIXEL = 0.2
_BAND_ROWS, _BAND_EVENTS_A_COLUMN, _BAND_WINDOWS = 5, 30, 20
_BAND_SHARE, _HOT = 0.25, 10
_FORMATS = ("png", "pdf", "svg", "eps", "jpg", "jpeg", "tif", "tiff", "webp")
_WIDTH_IN, _TITLE_IN, _TICKS_IN, _LABEL_IN = 7.2, 0.25, 0.3, 0.18
_LABEL_CHARACTERS = 100
_LEFT, _CENTRED, _RIGHT, _PANEL_WIDTH = 0.055, 0.305, 0.555, 0.39  # of the figure's width
_STYLE: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.size": 8,
    "axes.titlesize": 9,
    "axes.linewidth": 0.6,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}


@names_checked
def view(
    source: str | Path,
    *,
    t_s: float | None = None,
    window_s: float | None = None,
    size: tuple[int, int] | None = None,
) -> Figure:
    """Draw one moment of a sequence as a figure of some panels, 7.2 inches wide; in a notebook it shows itself.

    The intensity frame; the events of a short window around it, ON red and OFF blue, over the faded frame; the depth
    map (grey where nothing is hit); and column over time of the events of a few rows, in a longer window: those in the
    middle, or the fullest ones where the middle has less than a quarter of their events. Where a folder has them:
    optical flow as the usual colour wheel, shapes, surface normals, and in the folder of a rig's first camera the
    disparity with the second one. Frames hold linear light, so they are drawn with sRGB's transfer curve; those of a
    colour sensor are demosaiced. What the source does not have gets no panel. ``savefig`` of the figure writes PNG,
    PDF, SVG and others, by the suffix.

    Args:
        source: a dataset folder, an event file of any format, or a recording (AEDAT, or a camera's bytes).
        t_s: the moment in seconds, by default the middle. The nearest frame and depth map are shown. Times are those of
            the file; those of a recording count from its start.
        window_s: length of the window of events, centred on the frame's time; by default such that it holds about 0.2
            events a pixel.
        size: (width, height) of the sensor in pixels, where the source does not say.

    Returns:
        A matplotlib Figure.

    Raises:
        ImportError: without matplotlib, saying how to get it.
        ValueError: for a time outside of the sequence, a window that is not positive, or a size that nobody knows.
        DecodeError, OSError: if the source cannot be read.
    """
    mpl = _matplotlib()
    if window_s is not None:
        check_number("window_s", window_s, 0, above_low=True)
    sequence = open_visual_sequence(source, size=size)
    start_us, end_us = sequence.start_us, sequence.end_us
    if t_s is not None and not start_us <= t_s * 1e6 <= end_us:
        raise ArgumentError("{t_s} must lie in the sequence, {:g}..{:g} s, got {}", start_us / 1e6, end_us / 1e6, t_s)
    t_us = (start_us + end_us) // 2 if t_s is None else round(t_s * 1e6)
    frame = nearest(sequence.frame_times, t_us)
    if frame is not None:
        t_us = sequence.frame_times[frame]
    depth = nearest(sequence.depth_times, t_us)
    width, height = sequence.size
    pixels = width * height
    limits_us = start_us, end_us
    shown, shown_us = events_around(sequence.events, t_us, _EVENTS_A_PIXEL * pixels, window_s, limits_us)
    rows = _band_rows(sequence.events, sequence.size)
    in_band = (sequence.events["y"] >= rows[0]) & (sequence.events["y"] < rows[1])
    band, band_us = events_around(
        sequence.events[in_band],
        t_us,
        _BAND_EVENTS_A_COLUMN * width,
        None if window_s is None else min(_BAND_WINDOWS * window_s, max((end_us - start_us) / 1e6, window_s)),
        limits_us,
    )
    grey = np.ones((height, width)) if frame is None else to_srgb(sequence.read_frame(frame))

    with mpl.rc_context(_STYLE):
        # The three pictures have one size, whatever stands next to them.
        panel_in = _PANEL_WIDTH * _WIDTH_IN * height / width
        pictures, truth = _panels(sequence, t_us, grey, frame, depth, shown, shown_us), truth_panels(sequence, t_us)
        bands: list[Panel] = []
        if len(band):
            bands.append(lambda ax, letter: _draw_band(ax, letter, band, rows, t_us, band_us, width))
        # A band may have any width: of an odd number of panels it is the last one, and fills the row.
        odd = (len(pictures) + len(bands) + len(truth)) % 2 == 1
        panels = [*pictures, *truth, *bands] if odd else [*pictures, *bands, *truth]
        rows_of_panels = (len(panels) + 1) // 2
        label = textwrap.wrap(sequence.label, _LABEL_CHARACTERS)
        label_in = _LABEL_IN * len(label) + 0.07
        height_in = rows_of_panels * (_TITLE_IN + panel_in + _TICKS_IN) + label_in
        figure = _make_figure((_WIDTH_IN, height_in))
        row = (_TITLE_IN + panel_in + _TICKS_IN) / height_in

        def panel(number: int) -> Axes:
            left, panel_width = (_LEFT, _RIGHT)[number % 2], _PANEL_WIDTH
            if odd and number == len(panels) - 1:
                left, panel_width = (_LEFT, _RIGHT + _PANEL_WIDTH - _LEFT) if bands else (_CENTRED, _PANEL_WIDTH)
            bottom = (rows_of_panels - 1 - number // 2) * row
            return figure.add_axes((left, bottom + _TICKS_IN / height_in, panel_width, panel_in / height_in))

        middle = 1 - 0.55 * label_in / height_in
        figure.text(0.5, middle, "\n".join(label), ha="center", va="center", fontsize=9)
        for number, (draw, letter) in enumerate(zip(panels, "abcdefgh", strict=False)):
            ax = panel(number)
            draw(ax, letter)
            if ax.images:  # others have their own ticks
                ax.set_xticks(_ticks(width))
                ax.set_yticks(_ticks(height))
                ax.tick_params(labelsize=6, width=0.5, length=2, pad=1.5)
    return figure


def check_figure_path(path: str | Path) -> Path:
    """Return ``path`` as a Path, if its suffix is a picture format that can be written.

    Raises:
        ValueError: for another suffix, or none; the message lists those there are.
    """
    if Path(path).suffix.lower().removeprefix(".") not in _FORMATS:
        known = ", ".join(f".{name}" for name in _FORMATS)
        raise ValueError(f"the suffix of {str(path)!r} is no picture format: it must be one of {known}")
    return Path(path)


def _matplotlib() -> Any:
    with from_extra("view"):
        import matplotlib as mpl
    return mpl


def _make_figure(inches: tuple[float, float]) -> Figure:
    """Return a figure outside of pyplot (nothing keeps it alive), which a notebook shows nevertheless."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    class NotebookFigure(Figure):
        def _repr_png_(self) -> bytes:
            stream = io.BytesIO()
            self.savefig(stream, format="png", dpi=100)
            return stream.getvalue()

    figure = NotebookFigure(figsize=inches, dpi=200)
    FigureCanvasAgg(figure)
    return figure


def event_picture(image: npt.NDArray[np.float64], events: EventArray) -> npt.NDArray[np.uint8]:
    """Return events over a faded image, grey (H, W) or colours (H, W, 3), 0 to 1: uint8 (H, W, 3); a pixel with events
    has the colour of its last one."""
    faded = np.rint(255 * (0.45 + 0.55 * image))
    picture = (np.repeat(faded[..., None], 3, axis=2) if faded.ndim == 2 else faded).astype(np.uint8)
    # Assignment with repeated indices keeps the last value: events are in the order of time.
    picture[events["y"], events["x"]] = np.where(events["p"][:, None] == 1, ON_RGB, OFF_RGB)
    return picture


def events_around(
    events: EventArray, t_us: int, count: float, window_s: float | None, limits_us: tuple[int, int]
) -> tuple[EventArray, tuple[int, int]]:
    """Return the events of a window centred on ``t_us``, and its beginning and end in microseconds.

    Its length is as given, or such that it holds ``count`` events; then what lies outside of the limits is cut off.
    """
    t = events["t"]
    if window_s is not None:
        half_us = round(window_s * 0.5e6)
        limits_us = t_us - half_us, t_us + half_us
    elif len(events):
        last = min(int(count), len(events) - 1)
        half_us = int(np.partition(np.abs(t - t_us), last)[last])
    else:
        half_us = 0
    window = slice(np.searchsorted(t, t_us - half_us), np.searchsorted(t, t_us + half_us, side="right"))
    return events[window], (max(t_us - half_us, min(limits_us[0], t_us)), min(t_us + half_us, max(limits_us[1], t_us)))


def _band_rows(events: EventArray, size: tuple[int, int]) -> tuple[int, int]:
    """Return the first row of the band that is drawn over time, and the one after its last.

    That is the middle of the sensor, or the fullest band where the middle has less than a quarter of its events. A
    pixel counts at most ten times the median of those with events, so that a hot one does not decide.
    """
    width, height = size
    rows = min(_BAND_ROWS, height)
    middle = max(0, height // 2 - _BAND_ROWS // 2)
    middle = min(middle, height - rows)
    pixels = np.bincount(events["y"].astype(np.int64) * width + events["x"], minlength=width * height)
    if pixels.any():
        pixels = np.minimum(pixels, _HOT * np.median(pixels[pixels > 0]))
    of_rows = np.concatenate([[0], np.cumsum(pixels.reshape(height, width).sum(axis=1))])
    of_bands = of_rows[rows:] - of_rows[:-rows]
    first = middle if of_bands[middle] >= _BAND_SHARE * of_bands.max() else int(of_bands.argmax())
    return first, first + rows


def _panels(
    sequence: VisualSequence,
    t_us: int,
    grey: npt.NDArray[np.float64],
    frame: int | None,
    depth: int | None,
    events: EventArray,
    window_us: tuple[int, int],
) -> list[Panel]:
    """Return the pictures that there are: frame, events over it, depth."""

    def draw_frame(ax: Axes, letter: str) -> None:
        ax.imshow(grey, cmap="gray", vmin=0, vmax=1, interpolation="nearest")
        ax.set_title(f"({letter}) intensity frame, {_time(t_us)}")

    def draw_events(ax: Axes, letter: str) -> None:
        ax.imshow(event_picture(grey, events), interpolation="nearest")
        counted = f"{len(events):,} events in {time_text(window_us[1] - window_us[0])}: ON red, OFF blue"
        ax.set_title(f"({letter}) " + (counted if len(events) else "no events in this window"))

    panels: list[Panel] = [] if frame is None else [draw_frame]
    panels.append(draw_events)
    if depth is not None:
        panels.append(lambda ax, letter: _draw_depth(ax, letter, sequence, depth))
    return panels


def _draw_depth(ax: Axes, letter: str, sequence: VisualSequence, index: int) -> None:
    title = f"({letter}) depth, {_time(sequence.depth_times[index])}"
    draw_map(ax, title, sequence.read_depth(index), symbol="z", unit="m", colours="viridis_r")


def _draw_band(
    ax: Axes, letter: str, events: EventArray, rows: tuple[int, int], t_us: int, window_us: tuple[int, int], width: int
) -> None:
    """Draw column over time of all events of a few rows: what moves evenly draws straight lines."""
    colours = np.where(events["p"][:, None] == 1, ON_RGB, OFF_RGB) / 255.0
    span_us = window_us[1] - window_us[0]
    unit_us, unit = (1e6, "s") if span_us >= 2e6 else (1e3, "ms")
    ax.scatter((events["t"] - t_us) / unit_us, events["x"], c=colours, s=1.5, linewidths=0, rasterized=True)
    counted = f"{len(events):,} events of rows {rows[0]} to {rows[1] - 1}"
    ax.set_title(f"({letter}) {counted}, {time_text(span_us)}")
    ax.set_xlim(*((edge_us - t_us) / unit_us for edge_us in (window_us if span_us > 0 else (t_us - 1e3, t_us + 1e3))))
    ax.set_ylim(-0.5, width - 0.5)
    ax.set_yticks(_ticks(width))
    ax.set_xlabel(f"time from {t_us / 1e6:.3f} s ({unit})", labelpad=1, fontsize=7)
    ax.set_ylabel("x (px)", labelpad=1, fontsize=7)
    ax.tick_params(labelsize=6, width=0.5, length=2, pad=1.5)


def _ticks(side: int) -> list[int]:
    """Return pixels to name along a side: at most five, at round distances."""
    step = next(step for step in (1, 2, 5, 10, 20, 30, 40, 60, 80, 100, 200, 400, 1000, 20_000) if side / step <= 4.5)
    return list(range(0, side, step))


def _time(t_us: int) -> str:
    return f"t = {t_us / 1e6:.3f} s"
