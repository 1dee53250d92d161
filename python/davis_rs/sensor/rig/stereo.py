"""Computes the truth of a stereo pair from depth: rectification, disparity, occlusion, left-right consistency."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..._util.argument_error import ArgumentError
from ...geometry.camera import Camera
from ...geometry.pose import FloatArray
from .rig import Rig

_NEARER = 0.01
"""A pixel of the other camera hides a point if all it sees near there is nearer by this share of the depth."""

_CONSISTENT_PX = 1.0
"""Disparities of both cameras agree within this."""


class Rectification(NamedTuple):
    """Holds two virtual cameras side by side, into which the images of a pair can be warped.

    Attributes:
        camera: lens and size of both: the left camera's size, no distortion.
        baseline_m: the distance of the right camera from the left one, along x.
        left_rotation, right_rotation: (3, 3), from the axes of a camera to those of its virtual lens.
        left_map, right_map: (H, W, 2), float32: where each pixel of a virtual camera lies in the camera's image, x and
            y, as ``cv2.remap`` takes it.
    """

    camera: Camera
    baseline_m: float
    left_rotation: FloatArray
    right_rotation: FloatArray
    left_map: npt.NDArray[np.float32]
    right_map: npt.NDArray[np.float32]


class StereoTruth(NamedTuple):
    """Holds the truth of a pair at one instant, at the left camera's own pixels.

    Attributes:
        disparity: (H, W), float32: how far to the left the right virtual camera of :func:`rectify` sees the point, in
            pixels; NaN where the left camera sees nothing.
        match: (H, W, 2), float32: where in the right camera's own image the point lies, x and y; NaN where it is
            behind that camera.
        occluded: (H, W): the right camera does not see the point: something is nearer, or it is outside of the image.
        consistent: (H, W): the disparity at the matching pixel of the right camera is the same within 1 px.
    """

    disparity: npt.NDArray[np.float32]
    match: npt.NDArray[np.float32]
    occluded: npt.NDArray[np.bool_]
    consistent: npt.NDArray[np.bool_]


def rectify(rig: Rig, left: int = 0, right: int = 1) -> Rectification:
    """Return the rectification of two cameras of a rig.

    The virtual cameras look along the mean of both optical axes, as far as the baseline, which becomes their x axis,
    allows. Their focal length is the left camera's fx.

    Args:
        rig: the rig.
        left, right: numbers of its cameras.

    Raises:
        ValueError: for a camera that the rig does not have, or two cameras at one place.

    Source: Fusiello, Trucco, Verri, "A compact algorithm for rectification of stereo pairs", 2000.
    """
    first, second = (rig.cameras[rig.checked_index(index)] for index in (left, right))
    across = second.mount.position - first.mount.position
    baseline_m = float(np.linalg.norm(across))
    if baseline_m == 0:
        raise ArgumentError("cameras {} and {} of the {rig} are at one place: there is no disparity", left, right)
    x = across / baseline_m
    ahead = first.mount.rotation[:, 2] + second.mount.rotation[:, 2]
    y = np.cross(ahead, x)
    if np.linalg.norm(y) < 1e-6:
        raise ArgumentError("cameras {} and {} of the {rig} lie behind each other: they cannot be rectified",
                            left, right)  # fmt: skip
    y /= np.linalg.norm(y)
    virtual = np.stack([x, y, np.cross(x, y)])  # rows: its axes in the body's
    lens = first.camera
    camera = Camera(lens.width, lens.height, lens.fx, lens.fx, lens.cx, lens.cy)
    rotations = [virtual @ each.mount.rotation for each in (first, second)]
    grid = np.stack(np.meshgrid(np.arange(lens.width), np.arange(lens.height)), -1)
    rays = np.concatenate([camera.rays(grid), np.ones((*grid.shape[:2], 1))], -1)
    maps = [
        each.camera.project(rays @ rotation).astype(np.float32)
        for each, rotation in zip((first, second), rotations, strict=True)
    ]
    return Rectification(camera, baseline_m, rotations[0], rotations[1], maps[0], maps[1])


def stereo_truth(
    rig: Rig,
    left_depth: npt.NDArray[np.float32],
    right_depth: npt.NDArray[np.float32],
    left: int = 0,
    right: int = 1,
) -> StereoTruth:
    """Return disparity, matches, occlusion and consistency of a pair from the depth maps of one instant.

    Args:
        rig: the rig.
        left_depth, right_depth: (H, W) of each camera, z along its optical axis in metres, inf where nothing is hit.
        left, right: numbers of the cameras.

    Raises:
        ValueError: for depth maps of another size than the camera's, or as :func:`rectify`.
    """
    rectified = rectify(rig, left, right)
    forward = _seen_by(rig, left, right, left_depth, rectified.left_rotation, rectified)
    backward = _seen_by(rig, right, left, right_depth, rectified.right_rotation, rectified)
    near = _neighbours(forward.match, right_depth)
    with np.errstate(invalid="ignore"):
        occluded = ~((near >= (1 - _NEARER) * forward.depth[..., None]).any(-1)) & np.isfinite(left_depth)
        others = _neighbours(forward.match, backward.disparity)
        apart = np.abs(others - forward.disparity[..., None])
    consistent = (apart <= _CONSISTENT_PX).any(-1)
    return StereoTruth(forward.disparity, forward.match, occluded, consistent)


class _SeenPoints(NamedTuple):
    """Holds the points that a camera sees: their disparity, where another camera sees them, and their depth there."""

    disparity: npt.NDArray[np.float32]
    match: npt.NDArray[np.float32]
    depth: FloatArray


def _seen_by(
    rig: Rig, camera: int, other: int, depth: npt.NDArray[np.float32], rotation: FloatArray, rectified: Rectification
) -> _SeenPoints:
    lens = rig.cameras[camera].camera
    if depth.shape != (lens.height, lens.width):
        raise ValueError(f"the depth map of cam{camera} must have shape {(lens.height, lens.width)}, got {depth.shape}")
    grid = np.stack(np.meshgrid(np.arange(lens.width), np.arange(lens.height)), -1)
    hit = np.isfinite(depth)
    z = np.where(hit, depth, np.nan).astype(np.float64)[..., None]
    points = np.concatenate([lens.rays(grid), np.ones((*depth.shape, 1))], -1) * z
    with np.errstate(invalid="ignore", divide="ignore"):
        disparity = rectified.camera.fx * rectified.baseline_m / (points @ rotation[2])
        pose = rig.relative_pose(other, camera)
        there = points @ pose.rotation.T + pose.position
        match = rig.cameras[other].camera.project(there)
    return _SeenPoints(disparity.astype(np.float32), match.astype(np.float32), there[..., 2])


def _neighbours(at: npt.NDArray[np.float32], image: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return the values of the four pixels around places (H, W, 2) in an image, (H, W, 4); NaN outside of it."""
    height, width = image.shape
    low = np.floor(np.where(np.isfinite(at), np.clip(at, -2, 65537), -2)).astype(np.int64)
    values = []
    for right, down in ((0, 0), (1, 0), (0, 1), (1, 1)):
        x, y = low[..., 0] + right, low[..., 1] + down
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        taken = image[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)]
        values.append(np.where(inside, taken, np.float32(np.nan)))
    return np.stack(values, -1)
