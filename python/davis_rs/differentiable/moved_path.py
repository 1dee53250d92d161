"""Moves a camera path by increments, which are the unknowns of pose and trajectory estimation."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ..geometry.pose import FloatArray, hamilton
from ..geometry.trajectory.trajectory import Trajectory
from ..scene.scene import Scene
from .spline_weights import spline_weight_rates, spline_weights

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

_SMALL = 1e-4
"""Angle, radians, below which series are used; their error is less than 1e-16."""


class MovedPath(Trajectory):
    """Moves the poses of a path by increments: position + row[:3] in world axes, rotation times exp(row[3:]).

    Args:
        path: that is moved.
        increments: (6,), the same all the time, or (m, 6), control points of
            :func:`~davis_rs.differentiable.spline_weights` over the path:
            metres in world axes, then a rotation vector in camera axes, radians.
        degree: of the spline.

    Raises:
        ValueError: for another shape, fewer than degree + 1 control points, or a number that is not finite.
    """

    def __init__(self, path: Trajectory, increments: npt.ArrayLike, *, degree: int = 3) -> None:
        rows = np.array(increments, np.float64)
        if rows.shape != (6,) and (rows.ndim != 2 or rows.shape[1] != 6 or len(rows) < degree + 1):
            raise ValueError(f"increments must have shape (6,), or (m, 6) of m >= {degree + 1}, got {rows.shape}")
        if not np.isfinite(rows).all():
            raise ValueError(f"increments must be finite, got {rows[~np.isfinite(rows)][0]}")
        self.duration_s, self._path, self._rows, self._degree = path.duration_s, path, rows, degree

    def increments(self, t_s: npt.ArrayLike) -> FloatArray:
        """Return the increments (n, 6) at times (n,)."""
        times = self.times(t_s)
        if self._rows.ndim == 1:
            return np.tile(self._rows, (len(times), 1))
        weights = spline_weights(times, len(self._rows), duration_s=self.duration_s, degree=self._degree)
        return np.asarray(weights @ self._rows)

    def positions(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._path.positions(t_s) + self.increments(t_s)[:, :3]

    def quaternions(self, t_s: npt.ArrayLike) -> FloatArray:
        return hamilton(self._path.quaternions(t_s), self._turns(t_s).as_quat())

    def velocities(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._path.velocities(t_s) + self._rates(t_s)[:, :3]

    def angular_rates(self, t_s: npt.ArrayLike) -> FloatArray:
        own = self._turns(t_s).apply(self._path.angular_rates(t_s), inverse=True)
        vectors, rates = self.increments(t_s)[:, 3:], self._rates(t_s)[:, 3:]
        return np.asarray(own + np.einsum("nij,nj->ni", right_jacobians(vectors), rates))

    def breaks_s(self) -> FloatArray:
        return self._path.breaks_s()

    def describe(self) -> dict[str, object]:
        by = {"increments": self._rows.tolist(), "degree": self._degree}
        return {"kind": "moved", "duration_s": self.duration_s, **by, "trajectory": self._path.describe()}

    def _turns(self, t_s: npt.ArrayLike) -> Rotation:
        from scipy.spatial.transform import Rotation

        return Rotation.from_rotvec(self.increments(t_s)[:, 3:])

    def _rates(self, t_s: npt.ArrayLike) -> FloatArray:
        times = self.times(t_s)
        if self._rows.ndim == 1:
            return np.zeros((len(times), 6))
        rates = spline_weight_rates(times, len(self._rows), duration_s=self.duration_s, degree=self._degree)
        return np.asarray(rates @ self._rows)


def moved(scene: Scene, increments: npt.ArrayLike, *, degree: int = 3) -> Scene:
    """Return a scene whose camera path is moved by increments, all the time the same (6,) or a spline's (m, 6).

    >>> scene = moved(scene, 1e-3 * np.eye(6)[0])  # 1 mm along the world's x

    The path keeps its length. Its derivatives, ``pose`` and ``control_points``, are those by an addition to these
    increments. Take a part of a scene (``scene.crop``) before, not after.

    Raises:
        ValueError: as :class:`MovedPath`.
    """
    path = MovedPath(scene.path, increments, degree=degree)
    return replace(scene, trajectory=path, baked_along=scene.path_of_bake)


def right_jacobians(vectors: FloatArray) -> FloatArray:
    """Return J (n, 3, 3) of rotation vectors (n, 3): exp(v + d) = exp(v) exp(J d), to first order in d.

    Source: Sola et al., A micro Lie theory for state estimation in robotics, 2018, eq. 143.
    """
    angle = np.linalg.norm(vectors, axis=1)
    small = angle < _SMALL
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 0.5 - angle**2 / 24, 2 * np.sin(safe / 2) ** 2 / safe**2)
    second = np.where(small, 1 / 6 - angle**2 / 120, (safe - np.sin(safe)) / safe**3)
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    hat = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], 1).reshape(-1, 3, 3)
    return np.asarray(np.eye(3) - first[:, None, None] * hat + second[:, None, None] * (hat @ hat))
