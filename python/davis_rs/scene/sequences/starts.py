"""Makes poses from which a camera starts in a scene."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ...geometry.pose import Pose
from ..parts import look_at


def start_looking_at(position: npt.ArrayLike, target: npt.ArrayLike) -> Pose:
    """Return the pose of an upright camera at a point that looks at another."""
    from scipy.spatial.transform import Rotation

    start, end = np.asarray(position, np.float64), np.asarray(target, np.float64)
    return Pose(start, Rotation.from_matrix(look_at(start, end)).as_quat())
