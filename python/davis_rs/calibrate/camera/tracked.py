"""Interpolates poses from a tracker at the times of frames."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ...geometry.pose import GroundTruth
from ...geometry.trajectory.sample_noise import pose_noise
from ...geometry.trajectory.sampled_trajectory import SampledTrajectory
from .reprojection import transform

FloatArray = npt.NDArray[np.float64]

_EXACT_M, _EXACT_RAD = 1e-5, 1e-4
"""Noise below which poses are gone through, not smoothed."""

_RESIDUAL = 0.97
"""What the best curve leaves of the noise: it takes up some itself.

One that leaves all of it is too smooth: it flattens turns, and so moves the camera along its axis by a millimetre.
"""


def tracked_poses(poses: GroundTruth, t_s: npt.ArrayLike) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Return T_world_body (n, 4, 4) at times (n,) in seconds, and which of these the tracker covers; the rest is NaN.

    The poses' own noise is estimated (``davis_rs.geometry.trajectory.sample_noise.pose_noise``) and smoothed away by
    splines (:class:`~davis_rs.SampledTrajectory`).

    Raises:
        ValueError: for fewer than ten poses, or those that make no trajectory.
    """
    if len(poses.t_us) < 10:
        raise ValueError(f"a tracked body needs at least 10 poses, got {len(poses.t_us)}")
    stamps = poses.t_us * 1e-6
    position_sigma, rotation_sigma = pose_noise(stamps, poses.positions, poses.quaternions)
    path = SampledTrajectory(
        stamps,
        poses.positions,
        poses.quaternions,
        position_sigma_m=_RESIDUAL * position_sigma if position_sigma > _EXACT_M else 0.0,
        rotation_sigma_rad=_RESIDUAL * rotation_sigma if rotation_sigma > _EXACT_RAD else 0.0,
    )
    t = np.asarray(t_s, np.float64)
    covered = (t >= stamps[0]) & (t <= stamps[-1])
    matrices = np.full((len(t), 4, 4), np.nan)
    inside = t[covered] - stamps[0]
    matrices[covered] = transform(path.rotations(inside), path.positions(inside))
    return matrices, covered
