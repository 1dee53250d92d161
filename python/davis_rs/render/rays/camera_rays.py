"""Makes the rays of a camera's pixels: as a table for the Rust core, and as Dr.Jit arrays, which may move."""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..._core import PixelRays
from ..._mitsuba.types import JitArray, JitFloat, JitIndex, JitMatrix, JitRay, JitVector
from ..._mitsuba.variants import FAST, variant
from ...geometry.camera import Camera
from ...geometry.lattice import rank1_lattice
from ...geometry.trajectory.views import Views

_BLOCK_BYTES = 32 << 20
"""Bytes of the float64 rays of a block of rows, while a table is made."""

_TILE_ROWS = 8
"""Rows of a tile of the core: a block has whole tiles."""


def pixel_centres(camera: Camera, first: int = 0, end: int | None = None) -> npt.NDArray[np.float64]:
    """Return the coordinates (H * W, 2) of a camera's pixels, row by row, or those of the rows [first, end)."""
    x, y = np.meshgrid(np.arange(camera.width), np.arange(first, camera.height if end is None else end))
    return np.stack([x, y], -1).reshape(-1, 2).astype(np.float64)


def ray_table(camera: Camera, rays: int) -> npt.NDArray[np.float64]:
    """Return undistorted ray directions (rays, H * W, 2): x and y of (x, y, 1) in camera axes, row by row."""
    return camera.rays(pixel_centres(camera)[None] + rank1_lattice(rays)[:, None])


@functools.lru_cache(maxsize=4)
def pixel_rays(camera: Camera, rays: int) -> PixelRays:
    """Return the lattice rays of each pixel, ``rays`` of them, as the Rust core takes them.

    The last few tables are kept, because each takes as long as some frames, and many short simulations with one camera
    need the same ones. Without distortion a table has only columns and rows; else it is made block by block.
    """
    lattice = rank1_lattice(rays)
    return _grid(camera, lattice) if not any(camera.distortion) else _table(camera, lattice)


@functools.lru_cache(maxsize=4)
def pixel_corners(camera: Camera) -> PixelRays:
    """Return the corners of each pixel, as the Rust core takes them for lines.

    They are all four of them, row by row; without distortion the upper left and the lower right one.
    """
    corners = np.array([[-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5], [0.5, 0.5]])
    return _grid(camera, corners[[0, 3]]) if not any(camera.distortion) else _table(camera, corners)


def table_bytes(camera: Camera, rays: int) -> int:
    """Return the bytes that :func:`pixel_rays` takes."""
    if not any(camera.distortion):
        return 4 * rays * (camera.width + camera.height)
    return 8 * rays * camera.width * camera.height


def _grid(camera: Camera, points: npt.NDArray[np.float64]) -> PixelRays:
    """Return the rays through points (n, 2) of each pixel, from its centre, of a camera without distortion."""
    x, y = (_along(camera, axis, points) for axis in (0, 1))
    return PixelRays.grid(camera.width, camera.height, len(points), x, y)


def _table(camera: Camera, points: npt.NDArray[np.float64]) -> PixelRays:
    """Return the same of any camera, made block by block."""
    rows = max(_TILE_ROWS, _BLOCK_BYTES // (16 * len(points) * camera.width) // _TILE_ROWS * _TILE_ROWS)

    def block(first: int) -> npt.NDArray[np.float32]:
        centres = pixel_centres(camera, first, min(first + rows, camera.height))
        return camera.rays(centres[None] + points[:, None]).astype(np.float32).ravel()

    return PixelRays.from_parts(camera.width, camera.height, len(points), rows, block)


def _along(camera: Camera, axis: int, lattice: npt.NDArray[np.float64]) -> npt.NDArray[np.float32]:
    """Return the ray coordinates of pixels along an axis of the image, ray by ray, flat."""
    pixels = np.zeros(((camera.width, camera.height)[axis], 2))
    pixels[:, axis] = np.arange(len(pixels))
    return camera.rays(pixels[None] + lattice[:, None])[..., axis].astype(np.float32).ravel()


class Lanes(NamedTuple):
    """Holds a pixel for each lane, and the camera that sees it.

    ``motion`` is the camera's velocity and angular rate in world axes; None without rates.
    """

    pixel: JitIndex
    origin: JitVector
    axes: JitMatrix
    motion: tuple[JitVector, JitVector] | None


class CameraRays:
    """Makes the lattice rays of a camera's pixels in Dr.Jit; tables for the last few numbers of rays are kept."""

    def __init__(self, camera: Camera) -> None:
        self._camera, self.pixels = camera, camera.width * camera.height
        self._buffers = functools.lru_cache(maxsize=4)(self._make_buffers)

    def lanes(self, views: Views, view: JitIndex, pixel: JitIndex, *, motion: bool) -> Lanes:
        """Return the lanes of pixels ``pixel`` seen by the cameras of views ``view``, both arrays of indices."""
        import drjit as dr
        import mitsuba as mi

        def gather(columns: npt.NDArray[np.float64]) -> list[JitFloat]:
            table = columns.reshape(len(views), -1).astype(np.float32)
            return [dr.gather(mi.Float, mi.Float(np.ascontiguousarray(column)), view) for column in table.T]

        origin, axes = mi.Point3f(gather(views.positions)), mi.Matrix3f(*gather(views.rotations))
        if not motion:
            return Lanes(pixel, origin, axes, None)
        rates = np.einsum("nij,nj->ni", views.rotations, views.angular_rates)
        return Lanes(pixel, origin, axes, (mi.Vector3f(gather(views.velocities)), mi.Vector3f(gather(rates))))

    def ray(self, lanes: Lanes, sample: JitIndex, rays: int) -> JitRay:
        """Return lattice ray number ``sample`` of ``rays``. Its z in camera axes is 1, so distance along it is depth.

        With motion its tangent is set: ``dr.forward_to`` then gives the rate of whatever is computed from it.
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

    def _make_buffers(self, rays: int) -> list[JitFloat]:
        table = ray_table(self._camera, rays).astype(np.float32)
        with variant(FAST) as (mi, _):
            return [mi.Float(np.ascontiguousarray(table[..., axis]).ravel()) for axis in (0, 1)]


def rate_of(value: JitArray) -> JitArray:
    """Return the forward-mode derivative of a value computed from moving rays; 0 where it does not depend on them."""
    import drjit as dr

    return dr.forward_to(value) if dr.grad_enabled(value) else dr.zeros(type(value), dr.width(value))
