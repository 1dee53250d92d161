"""Computes the optical flow that the camera's motion makes in a scene at rest."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..geometry.camera import Camera
from ..geometry.pose import FloatArray
from ..geometry.trajectory.views import Views


class OpticalFlow:
    """Optical flow at fixed image points of a camera, with its lens distortion.

    Args:
        pixels: (p, 2) pixel coordinates (x, y); they may be fractions.
    """

    def __init__(self, camera: Camera, pixels: npt.ArrayLike) -> None:
        rays = camera.rays(pixels)
        x, y = rays.T
        jacobian = camera.distortion_jacobian(rays)
        zero, unit = np.zeros_like(x), np.ones_like(x)
        # A point of a scene at rest moves by -v - w x X in camera axes; its image (X, Y) / Z accordingly.
        by_velocity = jacobian @ np.stack([np.stack([-unit, zero, x], -1), np.stack([zero, -unit, y], -1)], -2)
        by_rate = jacobian @ np.stack(
            [np.stack([x * y, -(1 + x * x), y], -1), np.stack([1 + y * y, -x * y, -x], -1)], -2
        )
        # (3, 2 p), all x before all y: NumPy is ten times faster along p than along short axes.
        self._by_velocity, self._by_rate = (part.transpose(2, 1, 0).reshape(3, -1) for part in (by_velocity, by_rate))

    def of_pixels(
        self, views: Views, view: npt.NDArray[np.int64], pixel: npt.NDArray[np.int64], depth: npt.ArrayLike
    ) -> FloatArray:
        """Return flow (m, 2) in pixels per second, at points ``pixel`` (m,) of views ``view`` (m,), ``depth`` (m,)
        away.

        See :meth:`__call__` for what it is.
        """
        velocities = np.einsum("nij,ni->nj", views.rotations, views.velocities)[view]  # camera axes
        by_velocity, by_rate = (part.reshape(3, 2, -1)[:, :, pixel] for part in (self._by_velocity, self._by_rate))
        moved = np.einsum("mk,kcm->mc", velocities, by_velocity) / np.asarray(depth, np.float64)[:, None]
        return np.asarray(moved + np.einsum("mk,kcm->mc", views.angular_rates[view], by_rate))

    def of_motion(self, pixel: npt.NDArray[np.int64], velocities: FloatArray, depth: npt.ArrayLike) -> FloatArray:
        """Return flow (m, 2) in pixels per second, of what moves itself before a camera at rest.

        Args:
            pixel: (m,), which of the points.
            velocities: (m, 3), in camera axes, metres per second.
            depth: (m,), how far away it is.
        """
        by_velocity = self._by_velocity.reshape(3, 2, -1)[:, :, pixel]
        moved = np.einsum("mk,kcm->mc", velocities, by_velocity)
        return np.asarray(-moved / np.asarray(depth, np.float64)[:, None])

    def fastest_of_motion(
        self, pixel: npt.NDArray[np.int64], speed: float, depth: npt.NDArray[np.float32]
    ) -> FloatArray:
        """Return a bound (m,) on :meth:`of_motion`, in pixels per second, for whatever direction of this speed."""
        by_velocity = self._by_velocity.reshape(3, 2, -1)[:, :, pixel]
        return np.asarray(speed * np.sqrt((by_velocity**2).sum((0, 1))) / depth)

    def fastest(self) -> tuple[float, float]:
        """Return bounds on the flow at any of the points, in pixels per second: where the camera moves by 1 m/s, of
        surfaces at a depth of 1 m, and where it turns by 1 rad/s."""
        maps = (part.reshape(3, 2, -1).transpose(2, 1, 0) for part in (self._by_velocity, self._by_rate))
        by_velocity, by_rate = (float(np.linalg.norm(part, 2, (1, 2)).max()) for part in maps)
        return by_velocity, by_rate

    def __call__(self, views: Views, depth: npt.ArrayLike) -> FloatArray:
        """Return flow (n, p, 2) in pixels per second, of surfaces at ``depth`` (n, p) or (p,): z in metres, inf for
        none.

        At depth inf it is the flow of the rotation alone.

        Source: Longuet-Higgins, Prazdny, The interpretation of a moving retinal image, Proc. R. Soc. B 208, 1980.
        """
        velocities = np.einsum("nij,ni->nj", views.rotations, views.velocities)  # camera axes
        shape = (len(views), 2, -1)
        flow = (velocities @ self._by_velocity).reshape(shape)
        flow /= np.asarray(depth, np.float64)[..., None, :]
        flow += (views.angular_rates @ self._by_rate).reshape(shape)
        return np.moveaxis(flow, 1, -1)
