"""Calibrates intrinsics from views of a checkerboard: focal lengths, principal point and distortion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...geometry.camera import Camera
from ...scene.builtin.checkerboard import Checkerboard
from .corners import BoardView
from .opencv import load_opencv
from .reprojection import rotation_of

PARAMETERS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")

_LEAST_VIEWS = 6
_LEAST_TILT_RAD = np.radians(10.0)
_LARGEST_DEVIATION = 0.05
"""Of the focal length, as a share of it."""

_LONGEST_FOCAL_LENGTH = 20.0
"""In widths of the sensor: a view of three degrees, in which no board shows perspective."""

_MOST_VIEWS = 80
"""More are thinned evenly: neighbouring frames say little new, and time grows with them."""


@dataclass(frozen=True)
class Intrinsics:
    """What calibrating a camera by itself found.

    Attributes:
        camera: with k3 = 0.
        deviations: standard deviation of each of ``PARAMETERS``, in its unit, as far as the corners' scatter
            about the fit tells.
        rms_px: root mean square distance of corners from where the fit sees them.
        views: number of views used.
        frame_rms_px: of each of those, by its frame's number.
    """

    camera: Camera
    deviations: dict[str, float]
    rms_px: float
    views: int
    frame_rms_px: dict[int, float]


def calibrate_intrinsics(
    views: Sequence[BoardView], board: Checkerboard, *, width: int, height: int, most_views: int = _MOST_VIEWS
) -> Intrinsics:
    """Fit OpenCV's radial-tangential model with k3 = 0 to views of a board, at most ``most_views`` of them.

    Raises:
        ValueError: for fewer than six views, or where they do not tell the parameters (all from one direction, say).
        ImportError: without OpenCV 4.

    Source: Zhang, PAMI 2000, as OpenCV's ``calibrateCamera``; Mueggler et al., IJRR 2017, section 5.
    """
    if len(views) < _LEAST_VIEWS:
        raise ValueError(f"intrinsics need at least {_LEAST_VIEWS} views of the board, got {len(views)}")
    cv2 = load_opencv()
    used = thinned(views, most_views)
    rms, matrix, distortion, turns, _, deviations, _, frame_rms = cv2.calibrateCameraExtended(
        [board.corners.astype(np.float32)] * len(used),
        [view.corners.astype(np.float32) for view in used],
        (width, height),
        None,
        None,
        flags=cv2.CALIB_FIX_K3,
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-12),
    )
    values = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *distortion.ravel()[:4]]
    spread = deviations.ravel()[: len(PARAMETERS)]
    tilt = np.arccos(np.clip(rotation_of(np.reshape(turns, (-1, 3)))[:, 2, 2], -1, 1)).max()
    # Seen straight, a board near a short lens looks like one far from a long lens, and the fit's deviations are void.
    focal, deviation = float(matrix[0, 0]), float(spread[:2].max())
    if not (
        tilt > _LEAST_TILT_RAD
        and np.isfinite(spread).all()
        and deviation < _LARGEST_DEVIATION * focal
        and focal < _LONGEST_FOCAL_LENGTH * width
    ):
        raise ValueError(
            f"these {len(used)} views do not tell the focal length ({focal:.4g} +- {deviation:.3g} px, the board "
            f"tilted by {np.degrees(tilt):.2g} degrees at most): it must be seen from several directions"
        )
    camera = Camera(width, height, *(float(value) for value in values))
    for view in used:
        camera.rays(view.corners)  # refuses a distortion that folds over where corners were seen
    return Intrinsics(
        camera=camera,
        deviations=dict(zip(PARAMETERS, spread.tolist(), strict=True)),
        rms_px=float(rms),
        views=len(used),
        frame_rms_px={view.frame: float(r) for view, r in zip(used, frame_rms.ravel(), strict=True)},
    )


def thinned(views: Sequence[BoardView], most: int) -> list[BoardView]:
    """Return at most ``most`` of the views, evenly spread."""
    if len(views) <= most:
        return list(views)
    return [views[i] for i in np.linspace(0, len(views) - 1, most).round().astype(int)]
