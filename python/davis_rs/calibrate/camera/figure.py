"""Draws a figure of a calibration: corners in a frame, and where they are off."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..._util.extras import from_extra
from ..._util.whole_file import whole_file
from ...io.dataset.reader import Dataset
from ...scene.builtin.checkerboard import Checkerboard
from .board_pose import board_pose
from .corners import BoardView, encode
from .intrinsics import Intrinsics
from .reprojection import inverse


def draw_intrinsics(
    dataset: Dataset, views: Sequence[BoardView], board: Checkerboard, result: Intrinsics, path: str | Path
) -> Path:
    """Draw three panels: the worst used frame with its corners, all corners over the sensor, and each one's residual.

    Returns:
        The path of the figure.

    Raises:
        ImportError: without matplotlib, saying how to get it.
        OSError: if the file cannot be written.
    """
    with from_extra("view"):
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    camera = result.camera
    used = [view for view in views if view.frame in result.frame_rms_px]
    left = []
    for view in used:
        pose = inverse(board_pose(view, board, camera).matrix)
        left.append(view.corners - camera.project(board.corners @ pose[:3, :3].T + pose[:3, 3]))
    worst = max(used, key=lambda view: result.frame_rms_px[view.frame])

    figure = Figure(figsize=(7.2, 2.3), dpi=200, layout="constrained")
    FigureCanvasAgg(figure)
    frame, sensor, rest = figure.subplots(1, 3)
    frame.imshow(encode(dataset.read_image(worst.frame)), cmap="gray", vmin=0, vmax=255)
    frame.plot(*worst.corners.T, "-", color="#0571b0", linewidth=0.6)
    frame.scatter(*worst.corners.T, s=8, facecolors="none", edgecolors="#ca0020", linewidths=0.6)
    frame.scatter(*worst.corners[0], s=9, color="#ca0020")
    frame.set_title(f"(a) worst frame, {result.frame_rms_px[worst.frame]:.3f} px rms", fontsize=8)
    corners = np.concatenate([view.corners for view in used])
    sensor.scatter(*corners.T, s=0.8, linewidths=0, color="#0571b0")
    sensor.set(xlim=(-0.5, camera.width - 0.5), ylim=(camera.height - 0.5, -0.5), aspect="equal")
    sensor.set_title(f"(b) {len(corners):,} corners", fontsize=8)
    off = np.concatenate(left)
    rest.scatter(*off.T, s=0.5, linewidths=0, color="#0571b0")
    reach = 1.1 * float(np.abs(off).max())
    rest.set(xlim=(-reach, reach), ylim=(reach, -reach), aspect="equal")
    rest.set_title(f"(c) found - fitted, {result.rms_px:.3f} px rms", fontsize=8)
    for axes, x, y in (
        (frame, "x (px)", "y (px)"),
        (sensor, "x (px)", "y (px)"),
        (rest, "x error (px)", "y error (px)"),
    ):
        axes.tick_params(labelsize=6)
        axes.set_xlabel(x, fontsize=7)
        axes.set_ylabel(y, fontsize=7)
    with whole_file(path) as working_path:
        figure.savefig(working_path)
    return Path(path)
