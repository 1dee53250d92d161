"""Computes the camera's velocities and accelerations in its own axes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ...geometry.pose import NO_VELOCITIES, Velocities
from ...geometry.trajectory.trajectory import Trajectory


def camera_velocities(trajectory: Trajectory, t_us: npt.NDArray[np.int64]) -> Velocities:
    """Return velocities and accelerations along a trajectory at times (n,) in microseconds of it.

    Raises:
        ValueError: for a time outside of the trajectory.
    """
    if not len(t_us):
        return NO_VELOCITIES
    t = t_us * 1e-6
    to_camera = np.swapaxes(trajectory.rotations(t), 1, 2)
    linear, acceleration = (
        np.einsum("nij,nj->ni", to_camera, values) for values in (trajectory.velocities(t), trajectory.accelerations(t))
    )
    return Velocities(t_us, linear, trajectory.angular_rates(t), acceleration, trajectory.angular_accelerations(t))
