"""Draws panels of a figure with what a camera cannot give: optical flow, shapes and surface normals."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from .flow_picture import flow_picture, flow_wheel
from .truth_pictures import normals_picture, shape_colours
from .visual_sequence import VisualSequence, nearest

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOST_NAMES = 5

Panel = Callable[["Axes", str], None]
"""Draws into axes, with a title that begins with a letter."""


def truth_panels(sequence: VisualSequence, t_us: int) -> list[Panel]:
    """Return what there is to draw of a sequence's ground truth, nearest to an instant."""
    panels: list[Panel] = []
    for times, draw in (
        (sequence.flow_times, _draw_flow),
        (sequence.mask_times, _draw_shapes),
        (sequence.normal_times, _draw_normals),
    ):
        index = nearest(times, t_us)
        if index is not None:
            panels.append(_bound(draw, sequence, index, f"t = {times[index] / 1e6:.3f} s"))
    return panels


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
    wheel.set_title(f"rim: {most:,.0f}\npx/s", fontsize=6, pad=2)


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
    handles = [Patch(color=table[k].tolist(), label=label) for k, label in labels.items()]
    ax.legend(
        handles=handles,
        fontsize=5,
        loc="lower left",
        framealpha=0.7,
        handlelength=1.0,
        borderpad=0.3,
        labelspacing=0.3,
    )


def _draw_normals(ax: Axes, title: str, sequence: VisualSequence, index: int) -> None:
    ax.imshow(normals_picture(sequence.read_normals(index)), interpolation="nearest")
    ax.set_title(title.format("normals (right, up, to the camera)"))
