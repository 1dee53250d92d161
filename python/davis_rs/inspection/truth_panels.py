"""Draws panels of a figure with what a camera cannot give: depth, optical flow, shapes, surface normals, disparity."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from .flow_picture import flow_picture, flow_wheel
from .truth_pictures import HIDDEN, normals_picture, shape_colours
from .visual_sequence import VisualSequence, nearest

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patches import Patch

_MOST_NAMES = 5
_FLAT = 1e-4  # a map whose relief is a smaller share of its values shows rounding alone
_NONE = "0.82"

Panel = Callable[["Axes", str], None]
"""Draws into axes, with a title that begins with a letter."""


def truth_panels(sequence: VisualSequence, t_us: int) -> list[Panel]:
    """Return what there is to draw of a sequence's ground truth, nearest to an instant."""
    panels: list[Panel] = []
    for times, draw in (
        (sequence.flow_times, _draw_flow),
        (sequence.mask_times, _draw_shapes),
        (sequence.normal_times, _draw_normals),
        (sequence.disparity_times, _draw_disparity),
    ):
        index = nearest(times, t_us)
        if index is not None:
            panels.append(_bound(draw, sequence, index, f"t = {times[index] / 1e6:.3f} s"))
    return panels


def draw_map(ax: Axes, title: str, values: npt.NDArray[np.float32], *, symbol: str, unit: str, colours: str) -> None:
    """Draw one number for each pixel, with a bar of colours; grey where there is none.

    Args:
        values: (H, W), not finite where there is none.
        symbol, unit: of the values, for the bar.
        colours: a colour map of Matplotlib.
    """
    from matplotlib.ticker import MaxNLocator

    known = np.ma.masked_invalid(values)
    least: float | None = None
    most: float | None = None
    if known.count() == 0:
        title += ", nothing is hit"
        least, most = 0.0, 1.0
    elif float(np.ptp(known.compressed())) <= _FLAT * float(known.max()):
        mean = float(known.mean())
        title += f", {mean:.3f} {unit} everywhere"
        least, most = 0.95 * mean, 1.05 * mean
    ax.set_facecolor(_NONE)
    image = ax.imshow(known, cmap=colours, interpolation="nearest", vmin=least, vmax=most)
    ax.set_title(title)
    if known.count():
        bar = ax.figure.colorbar(image, cax=ax.inset_axes((1.02, 0.0, 0.03, 1.0)))
        bar.ax.set_title(f"{symbol} ({unit})", fontsize=6, pad=3)
        bar.locator = MaxNLocator(6, steps=[1, 2, 5, 10])  # labels must be short: right of the bar the figure ends
        bar.ax.tick_params(width=0.6, length=2, labelsize=6, pad=1.5)


def _bound(
    draw: Callable[[Axes, str, VisualSequence, int], None], sequence: VisualSequence, index: int, time: str
) -> Panel:
    return lambda ax, letter: draw(ax, f"({letter}) {{}}, {time}", sequence, index)


def _draw_flow(ax: Axes, title: str, sequence: VisualSequence, index: int) -> None:
    flow = sequence.read_flow(index)
    speed = np.hypot(flow[..., 0], flow[..., 1])
    most = float(np.nanpercentile(speed, 99)) if np.isfinite(speed).any() else 1.0
    ax.imshow(flow_picture(flow, most), interpolation="nearest")
    ax.set_title(title.format("optical flow"))
    wheel = ax.inset_axes((1.02, 0.0, 0.12, 0.2))
    wheel.imshow(flow_wheel(61))
    wheel.set_axis_off()
    wheel.set_title(f"rim:\n{most:,.0f}\npx/s", fontsize=6, pad=2)


def _draw_shapes(ax: Axes, title: str, sequence: VisualSequence, index: int) -> None:
    from matplotlib.patches import Patch

    mask = sequence.read_mask(index)
    shown, counts = np.unique(mask, return_counts=True)
    table = shape_colours(int(mask.max()))
    ax.imshow(table[mask], interpolation="nearest")
    largest = [int(k) for k in shown[np.argsort(-counts)] if k > 0][:_MOST_NAMES]
    count = np.count_nonzero(shown)
    named = "" if len(largest) == count else f", the largest {len(largest)} named"
    ax.set_title(title.format(f"{count} shapes{named}"))
    names = sequence.shape_names
    labels = {k: names[k - 1] if k <= len(names) else str(k) for k in sorted(largest)}
    _add_legend(ax, [Patch(color=table[k].tolist(), label=label) for k, label in labels.items()])


def _draw_normals(ax: Axes, title: str, sequence: VisualSequence, index: int) -> None:
    ax.imshow(normals_picture(sequence.read_normals(index)), interpolation="nearest")
    ax.set_title(title.format("normals (right, up, to the camera)"))


def _draw_disparity(ax: Axes, title: str, sequence: VisualSequence, index: int) -> None:
    from matplotlib.patches import Patch

    disparity = sequence.read_disparity(index)
    draw_map(ax, title.format("disparity"), disparity, symbol="d", unit="px", colours="viridis")
    hidden = sequence.read_occlusion(index) & np.isfinite(disparity)
    if hidden.any():
        ax.imshow(np.where(hidden[..., None], (*HIDDEN, 1.0), 0.0), interpolation="nearest")
        _add_legend(ax, [Patch(color=HIDDEN, label="not seen by cam1")])


def _add_legend(ax: Axes, handles: list[Patch]) -> None:
    ax.legend(
        handles=handles,
        fontsize=5,
        loc="lower left",
        framealpha=0.7,
        handlelength=1.0,
        borderpad=0.3,
        labelspacing=0.3,
    )
