"""Defines the pose of the IMU relative to the sensor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...geometry.pose import FloatArray

DAVIS_T_IMU_CAMERA = (
    (0.9999, -0.0122, 0.0063, 0.0067),
    (0.0121, 0.9998, 0.0093, 0.0007),
    (-0.0064, -0.0092, 0.9999, 0.0342),
    (0.0, 0.0, 0.0, 1.0),
)
"""T_IMU,E of the public dataset's DAVIS240C in four decimals, as a paper prints it, metres.

The digits are those of the calibration that the dataset's authors publish with twelve (DAVIS-IJRR17.yaml of Ultimate
SLAM, Rosinol Vidal et al., RA-L 2018), cut after the fourth. That takes it 1.7e-4 off orthonormal; :class:`Mounting`
projects it, and the rotation is then within 0.01 degrees of the one with twelve digits.
"""

_TOLERANCE = 1e-3


@dataclass(frozen=True, eq=False, init=False)
class Mounting:
    """T_imu_camera: maps points in camera axes to the axes of the IMU, rigidly.

    Args:
        matrix: (4, 4), last row 0 0 0 1, metres. Its rotation must be orthonormal within 1e-3, as printed ones are, and
            is replaced by the nearest rotation (in the Frobenius norm, by singular values).

    Raises:
        ValueError: for another shape, a value that is not finite, or what is no rigid transform.

    Source of the projection: Schoenemann, "A generalized solution of the orthogonal Procrustes problem", Psychometrika
    31 (1966).
    """

    matrix: FloatArray

    def __init__(self, matrix: npt.ArrayLike = DAVIS_T_IMU_CAMERA) -> None:
        m = np.array(matrix, np.float64)
        if m.shape != (4, 4) or not np.isfinite(m).all() or not np.array_equal(m[3], (0.0, 0.0, 0.0, 1.0)):
            raise ValueError(f"a mounting must be finite, of shape (4, 4), with last row 0 0 0 1, got {m.tolist()}")
        r = m[:3, :3]
        off = float(np.abs(r @ r.T - np.eye(3)).max())
        if off > _TOLERANCE or np.linalg.det(r) < 0:
            raise ValueError(
                f"a mounting must hold a right-handed rotation, orthonormal within {_TOLERANCE}, got {r.tolist()}, "
                f"which is off by {off:.3g}"
            )
        u, _, vt = np.linalg.svd(r)
        m[:3, :3] = u @ vt
        m.flags.writeable = False
        object.__setattr__(self, "matrix", m)

    @property
    def rotation(self) -> FloatArray:
        """R_imu_camera, (3, 3)."""
        return self.matrix[:3, :3]

    @property
    def lever_arm(self) -> FloatArray:
        """The position of the IMU in camera axes, (3,), metres."""
        arm: FloatArray = -self.rotation.T @ self.matrix[:3, 3]
        return arm
