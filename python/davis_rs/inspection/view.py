"""A figure of a dataset: intensity frame, events, depth map and the space-time cloud of events."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..dataset.reader import Dataset, StampedImage
from ..events import EventArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ON_RGB = (202, 0, 32)
OFF_RGB = (5, 113, 176)
"""Red and blue that the usual kinds of colour blindness tell apart (the ends of ColorBrewer's RdBu)."""

_EVENTS_A_PIXEL = 0.2
_CLOUD_EVENTS_A_PIXEL = 1.0
_CLOUD_POINTS = 50_000
_MISSING_DEPTH = "0.82"
_WIDTH_IN, _TITLE_IN, _GAP_IN = 7.2, 0.25, 0.15
_LEFT, _RIGHT, _PANEL_WIDTH = 0.015, 0.54, 4 / 9  # of the figure's width
_STYLE: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.size": 8,
    "axes.titlesize": 9,
    "axes.linewidth": 0.6,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}


def view_dataset(
    path: str | Path, output_png: str | Path, *, t_s: float | None = None, window_s: float | None = None
) -> Path:
    """Draw one moment of a dataset as a figure of four panels, 7.2 inches wide at 200 dots an inch.

    The intensity frame; the events of a short window around it, ON red and OFF blue, over the faded frame; the depth
    map (grey where nothing is hit); and the events of a longer window in space and time. Frames hold linear light, so
    they are drawn with sRGB's transfer curve.

    Args:
        path: the dataset folder.
        output_png: the file to write.
        t_s: the moment in seconds; by default the middle. The nearest frame and depth map are shown.
        window_s: length of the window of events, centred on the frame's time; by default such that it holds about 0.2
            events a pixel.

    Returns:
        The path of the figure.

    Raises:
        ImportError: without matplotlib, saying how to get it.
        ValueError: for a time outside of the dataset or a window that is not positive.
        DecodeError, OSError: if the dataset cannot be read or the figure cannot be written.
    """
    try:
        import matplotlib as mpl
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ImportError("drawing a dataset needs matplotlib: pip install 'davis_rs[view]'") from error

    dataset = Dataset(path)
    events, camera = dataset.events, dataset.camera
    end_us = sequence_end_us(dataset)
    if t_s is not None and not 0 <= t_s * 1e6 <= end_us:
        raise ValueError(f"t_s must lie in the dataset, 0..{end_us / 1e6} s, got {t_s}")
    if window_s is not None and not 0 < window_s < math.inf:
        raise ValueError(f"window_s must be positive and finite, got {window_s}")
    t_us = end_us // 2 if t_s is None else round(t_s * 1e6)
    frame, depth = nearest(dataset.frames, t_us), nearest(dataset.depth_maps, t_us)
    if frame is not None:
        t_us = dataset.frames[frame].t_us
    pixels = camera.width * camera.height
    shown, shown_ms = _around(events, t_us, _EVENTS_A_PIXEL * pixels, window_s)
    cloud, cloud_ms = _around(events, t_us, _CLOUD_EVENTS_A_PIXEL * pixels, None if window_s is None else 5 * window_s)
    grey = np.ones((camera.height, camera.width)) if frame is None else display_grey(dataset.read_image(frame))

    with mpl.rc_context(_STYLE):
        # The three pictures have one size, whatever stands beside them.
        panel_in = _PANEL_WIDTH * _WIDTH_IN * camera.height / camera.width
        height_in = 2 * (_TITLE_IN + panel_in + _GAP_IN)
        figure = Figure(figsize=(_WIDTH_IN, height_in), dpi=200)
        FigureCanvasAgg(figure)
        axes = [
            figure.add_axes(
                (left, bottom + _GAP_IN / height_in, _PANEL_WIDTH, panel_in / height_in), xticks=[], yticks=[]
            )
            for left, bottom in ((_LEFT, 0.5), (_RIGHT, 0.5), (_LEFT, 0.0))
        ]
        axes[0].imshow(grey, cmap="gray", vmin=0, vmax=1)
        axes[0].set_title("(a) intensity frame, " + _time(t_us) if frame is not None else "(a) no intensity frames")
        axes[1].imshow(event_picture(grey, shown), interpolation="nearest")
        axes[1].set_title(f"(b) events within {shown_ms:.3g} ms: ON red, OFF blue")
        _draw_depth(axes[2], dataset, depth)
        _draw_cloud(figure, cloud, t_us, cloud_ms, camera.width, camera.height)
        output = Path(output_png)
        figure.savefig(output, format="png")
    return output


def sequence_end_us(dataset: Dataset) -> int:
    """The last instant that anything in the dataset is stamped with, in microseconds."""
    last = [series[-1].t_us for series in (dataset.frames, dataset.depth_maps) if series]
    events = dataset.events
    return max([*last, int(events["t"][-1]) if len(events) else 0, int(dataset.meta.get("duration_us", 0))])


def nearest(series: Sequence[StampedImage], t_us: int) -> int | None:
    """The index of the image nearest in time, None in an empty series."""
    return min(range(len(series)), key=lambda i: abs(series[i].t_us - t_us), default=None)


def display_grey(frame: npt.NDArray[np.uint8]) -> npt.NDArray[np.float64]:
    """Linear 8-bit values as a display wants them, in 0..1 (IEC 61966-2-1, the sRGB transfer curve)."""
    linear = frame / 255.0
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def event_picture(grey: npt.NDArray[np.float64], events: EventArray) -> npt.NDArray[np.uint8]:
    """Events over a faded image: uint8 (H, W, 3); a pixel with events has the colour of its last one."""
    picture = np.repeat(np.rint(255 * (0.45 + 0.55 * grey))[..., None], 3, axis=2).astype(np.uint8)
    # Assignment with repeated indices keeps the last value: events are in the order of time.
    picture[events["y"], events["x"]] = np.where(events["p"][:, None] == 1, ON_RGB, OFF_RGB)
    return picture


def _around(events: EventArray, t_us: int, count: float, window_s: float | None) -> tuple[EventArray, float]:
    """The events of a window centred on ``t_us``, and its length in ms: as given, or what holds ``count`` events."""
    t = events["t"]
    if window_s is not None:
        half_us = round(window_s * 0.5e6)
    elif len(events):
        last = min(int(count), len(events) - 1)
        half_us = int(np.partition(np.abs(t - t_us), last)[last])
    else:
        half_us = 0
    window = slice(np.searchsorted(t, t_us - half_us), np.searchsorted(t, t_us + half_us, side="right"))
    return events[window], 2 * half_us / 1e3


def _draw_depth(ax: Axes, dataset: Dataset, index: int | None) -> None:
    if index is None:
        ax.set_title("(c) no depth maps")
        ax.set_axis_off()
        return
    ax.set_facecolor(_MISSING_DEPTH)
    image = ax.imshow(np.ma.masked_invalid(dataset.read_depth(index)), cmap="viridis_r", interpolation="nearest")
    ax.set_title(f"(c) depth, {_time(dataset.depth_maps[index].t_us)}")
    bar = ax.figure.colorbar(image, cax=ax.inset_axes((1.02, 0.0, 0.03, 1.0)))
    bar.set_label("z (m)")
    bar.ax.tick_params(width=0.6, length=2)


def _draw_cloud(figure: Figure, events: EventArray, t_us: int, span_ms: float, width: int, height: int) -> None:
    # Three-dimensional axes keep wide margins for themselves: the box reaches out of its cell to fill it.
    ax: Any = figure.add_axes((0.505, -0.02, 0.47, 0.49), projection="3d", proj_type="ortho")
    figure.text(
        _RIGHT + _PANEL_WIDTH / 2,
        0.5
        - (_TITLE_IN - 6 / 72) / figure.get_figheight(),  # as high as the title beside it, 6 points over its picture
        f"(d) events in space and time, {span_ms:.3g} ms",
        ha="center",
        va="baseline",
        fontsize=_STYLE["axes.titlesize"],
    )
    # A fixed generator: the same dataset gives the same figure.
    chosen = np.random.default_rng(0).permutation(len(events))[:_CLOUD_POINTS]
    points = events[np.sort(chosen)]
    colours = np.where(points["p"][:, None] == 1, ON_RGB, OFF_RGB) / 255.0
    # y runs down: it is drawn along the vertical axis with its limits exchanged.
    ax.scatter((points["t"] - t_us) / 1e3, points["x"], points["y"], c=colours, s=0.5, linewidths=0, depthshade=False)
    if span_ms > 0:
        ax.set_xlim(-span_ms / 2, span_ms / 2)
    ax.set_ylim(0, width)
    ax.set_zlim(height, 0)
    ax.locator_params(axis="x", nbins=5)
    ax.set_yticks([0, width // 2])
    ax.set_zticks([0, height // 2, height])
    ax.set_box_aspect((2.2, width / height, 1.0), zoom=1.03)
    ax.view_init(elev=18, azim=-60)
    ax.set_xlabel(f"time from {t_us / 1e6:.3f} s (ms)", labelpad=4)
    ax.set_ylabel("x (px)", labelpad=0)
    ax.set_zlabel("y (px)", labelpad=-6)
    for axis in (ax.xaxis, ax.yaxis, ax.zaxis):
        axis.pane.set_facecolor("white")
        axis._axinfo["grid"].update(linewidth=0.3, color="0.85")
    ax.tick_params(pad=-2, length=2)


def _time(t_us: int) -> str:
    return f"t = {t_us / 1e6:.3f} s"
