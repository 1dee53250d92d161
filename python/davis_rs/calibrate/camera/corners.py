"""Finds the corners of a checkerboard in frames, to a fraction of a pixel."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..._util.progress import doing
from ...io.dataset.reader import Dataset
from ...scene.builtin.checkerboard import Checkerboard
from .corner_fit import fit_corners
from .opencv import load_opencv

FloatArray = npt.NDArray[np.float64]

_ENLARGED = 2
"""Boards are searched in frames enlarged by this factor, because tiles of a far board are only a few pixels wide."""

_LARGEST_WINDOW_PX = 6


@dataclass(frozen=True, eq=False)
class BoardView:
    """Holds a checkerboard in one frame.

    Attributes:
        t_us: the frame's time, microseconds.
        frame: its number.
        corners: (n, 2) pixel coordinates of the inner corners in the order of
            :attr:`~davis_rs.scene.builtin.checkerboard.Checkerboard.corners`; a pixel's centre has whole coordinates.
    """

    t_us: int
    frame: int
    corners: FloatArray


def find_corners(image: npt.NDArray[np.uint8], board: Checkerboard) -> FloatArray | None:
    """Find the inner corners of a board in a frame of linear light, (n, 2); None where not all of them are found.

    The frame's contrast is stretched and gamma-coded, and the board looked for in an enlargement; then each corner is
    refined in the frame itself, in linear light, within a window that holds no other: first by OpenCV's
    ``cornerSubPix``, then by a fit to what each pixel integrates over its area. The board looks alike upside down but
    for its colours; these decide which corner is the first.

    Raises:
        ValueError: if the image is not uint8 (H, W).
        ImportError: without OpenCV 4.
    """
    if image.ndim != 2 or image.dtype != np.uint8:
        raise ValueError(f"a frame must be uint8 of shape (H, W), got {image.dtype} {image.shape}")
    cv2 = load_opencv()
    rows, columns = board.rows - 1, board.columns - 1
    coded = encode(image)
    enlarged = cv2.resize(coded, None, fx=_ENLARGED, fy=_ENLARGED, interpolation=cv2.INTER_CUBIC)
    # OpenCV's fast check is left out: it misses one board in fifty.
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    detected, corners = cv2.findChessboardCorners(enlarged, (columns, rows), flags=flags)
    if not detected:
        return None
    # Pixel centres lie at whole numbers in both, so the enlargement is about the image's corner, at -1/2.
    grid = ((corners.reshape(rows, columns, 2) + 0.5) / _ENLARGED - 0.5).astype(np.float32)
    half_window = int(np.clip(0.5 * _least_spacing(grid) - 1, 2, _LARGEST_WINDOW_PX))
    inside = (grid >= half_window) & (grid <= np.array(image.shape[::-1]) - 1 - half_window)
    if not inside.all():
        return None
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-4)
    refined = cv2.cornerSubPix(
        image, grid.reshape(-1, 1, 2).copy(), (half_window, half_window), (-1, -1), stop
    ).reshape(grid.shape)
    if np.abs(refined - grid).max() > half_window:
        return None
    refined = np.asarray(refined, np.float64)
    refined = fit_corners(image, refined.reshape(-1, 2), _edge_directions(refined), half_window).reshape(refined.shape)
    if _upside_down(image, refined):
        refined = refined[::-1, ::-1]
    return refined.reshape(-1, 2)


def find_board(
    dataset: Dataset, board: Checkerboard, *, start_s: float = 0.0, stop_s: float | None = None
) -> list[BoardView]:
    """Find the board in every frame of a dataset that shows all of it.

    Args:
        start_s, stop_s: only frames from ``start_s`` on and before ``stop_s`` (None: to the end), in seconds after the
            first frame.

    Raises:
        ValueError: if it is in none, or there are no frames in that part.
        OSError, DecodeError: if a frame cannot be read.
        ImportError: without OpenCV 4.
    """
    first_us = dataset.frames[0].t_us if len(dataset.frames) else 0
    chosen = list(range(len(dataset.frames)))
    if start_s or stop_s is not None:
        last_s = math.inf if stop_s is None else stop_s
        chosen = [k for k in chosen if start_s <= 1e-6 * (dataset.frames[k].t_us - first_us) < last_s]
        if not chosen:
            raise ValueError(f"{dataset.path} has no frame from {start_s:g} s to {last_s:g} s after the first one")
    views = []
    for done, number in enumerate(chosen):
        doing(f"frame {done + 1} of {len(chosen)}")
        frame = dataset.frames[number]
        corners = find_corners(dataset.read_image(number), board)
        if corners is not None:
            views.append(BoardView(frame.t_us, number, corners))
    if not views:
        raise ValueError(
            f"none of the {len(chosen)} frames of {dataset.path} shows all of a checkerboard of "
            f"{board.rows} x {board.columns} tiles"
        )
    return views


def encode(image: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Return a frame of linear light, (H, W), its brightest hundredth brought to white, gamma-coded."""
    white = max(float(np.percentile(image, 99)), 1.0)
    coded: npt.NDArray[np.uint8] = np.round(255 * np.clip(image / white, 0, 1) ** (1 / 2.2)).astype(np.uint8)
    return coded


def _least_spacing(grid: npt.NDArray[np.float32]) -> float:
    """Return the least distance between neighbouring corners, in pixels."""
    return float(min(np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1)))


def _edge_directions(grid: FloatArray) -> FloatArray:
    """Return the angles (n, 2) of both edges through each corner, in radians, by its neighbours."""
    along = (np.gradient(grid, axis=axis) for axis in (1, 0))
    return np.stack([np.arctan2(ways[..., 1], ways[..., 0]) for ways in along], -1).reshape(-1, 2)


def _upside_down(image: npt.NDArray[np.uint8], grid: FloatArray) -> bool:
    """Return whether the tiles between the corners are white where they should be black."""
    middles = (grid[1:, 1:] + grid[:-1, 1:] + grid[1:, :-1] + grid[:-1, :-1]) / 4
    x, y = np.round(middles).astype(int).reshape(-1, 2).T
    row, column = np.indices(middles.shape[:2])
    black = ((row + column) % 2 == 0).ravel()
    brightness = image[y, x].astype(np.float64)
    return bool(brightness[black].mean() > brightness[~black].mean())
