"""The rays of a camera's pixels in the world, and how they move, as Dr.Jit arrays."""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from .._mitsuba import FAST, variant
from ..camera import Camera
from ..lattice import rank1_lattice
from ..trajectory.views import Views


def pixel_centres(camera: Camera, first: int = 0, end: int | None = None) -> npt.NDArray[np.float64]:
    """Coordinates (H * W, 2) of a camera's pixels, row by row; of the rows first to end - 1 alone, if given."""
    x, y = np.meshgrid(np.arange(camera.width), np.arange(first, camera.height if end is None else end))
    return np.stack([x, y], -1).reshape(-1, 2).astype(np.float64)


def ray_table(camera: Camera, rays: int) -> npt.NDArray[np.float64]:
    """Undistorted ray directions (rays, H * W, 2): x and y of (x, y, 1) in camera axes, row by row."""
    return camera.rays(pixel_centres(camera)[None] + rank1_lattice(rays)[:, None])


class Lanes(NamedTuple):
    """A pixel for each lane, and the camera that sees it. ``motion`` is the camera's velocity and angular rate in world
    axes."""

    pixel: Any
    origin: Any
    axes: Any
    motion: tuple[Any, Any] | None


class CameraRays:
    """Rays of the pixels' lattices, whose tables are kept for the last few numbers of rays."""

    def __init__(self, camera: Camera) -> None:
        self._camera, self.pixels = camera, camera.width * camera.height
        self._buffers = functools.lru_cache(maxsize=4)(self._make_buffers)

    def lanes(self, views: Views, view: Any, pixel: Any, *, motion: bool) -> Lanes:
        """Lanes of the cameras of ``view`` (a Dr.Jit array of indices) and of their pixels."""
        import drjit as dr
        import mitsuba as mi

        def gather(columns: npt.NDArray[np.float64]) -> list[Any]:
            table = columns.reshape(len(views), -1).astype(np.float32)
            return [dr.gather(mi.Float, mi.Float(np.ascontiguousarray(column)), view) for column in table.T]

        origin, axes = mi.Point3f(gather(views.positions)), mi.Matrix3f(*gather(views.rotations))
        if not motion:
            return Lanes(pixel, origin, axes, None)
        rates = np.einsum("nij,nj->ni", views.rotations, views.angular_rates)
        return Lanes(pixel, origin, axes, (mi.Vector3f(gather(views.velocities)), mi.Vector3f(gather(rates))))

    def ray(self, lanes: Lanes, sample: Any, rays: int) -> Any:
        """Lattice ray ``sample`` of ``rays``. Its z in the camera frame is 1, so distance along it is depth.

        With motion its tangent is set: whatever is computed from it then has its rate by ``dr.forward_to``.
        """
        import drjit as dr
        import mitsuba as mi

        x, y = (dr.gather(mi.Float, column, sample * self.pixels + lanes.pixel) for column in self._buffers(rays))
        ray = mi.Ray3f(lanes.origin, lanes.axes @ mi.Vector3f(x, y, 1))
        if lanes.motion is not None:
            velocity, angular_rate = lanes.motion
            turning = dr.cross(angular_rate, ray.d)
            dr.enable_grad(ray.o, ray.d)
            dr.set_grad(ray.o, velocity)
            dr.set_grad(ray.d, turning)
        return ray

    def prepare(self, rays: int) -> None:
        """Make the table for ``rays`` rays. This must not happen while a loop is traced."""
        self._buffers(rays)

    def _make_buffers(self, rays: int) -> list[Any]:
        table = ray_table(self._camera, rays).astype(np.float32)
        with variant(FAST) as (mi, _):
            return [mi.Float(np.ascontiguousarray(table[..., axis]).ravel()) for axis in (0, 1)]


def rate_of(value: Any) -> Any:
    """The forward-mode derivative of a value computed from rays that move; 0 where it does not depend on them."""
    import drjit as dr

    return dr.forward_to(value) if dr.grad_enabled(value) else dr.zeros(type(value), dr.width(value))
