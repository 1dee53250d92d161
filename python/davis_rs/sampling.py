"""Sampling in time: at which instants a sequence is rendered."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import numpy.typing as npt

from .render import Renderer
from .trajectory import Trajectory

FloatArray = npt.NDArray[np.float64]


def periodic_instants(rate_hz: float, start_us: int, end_us: int) -> Iterator[int]:
    """Instants round(k 1e6 / rate) us, k = 0, 1, ..., that lie in [start_us, end_us]; none for rate 0.

    Rounded half up in exact arithmetic, so that no rate drifts.

    Raises:
        ValueError: for a rate that is negative, not finite or above 1e6 Hz (two instants in one microsecond).
    """
    if not 0 <= rate_hz <= 1e6:
        raise ValueError(f"a rate must lie in 0..1e6 Hz, got {rate_hz} Hz")
    return _periodic_instants(Fraction(rate_hz), start_us, end_us)


def _periodic_instants(rate_hz: Fraction, start_us: int, end_us: int) -> Iterator[int]:
    if rate_hz == 0:
        return
    period = 1_000_000 / rate_hz
    k = max(0, int(start_us / period) - 1)
    while (t_us := int(k * period + Fraction(1, 2))) <= end_us:
        if t_us >= start_us:
            yield t_us
        k += 1


class TimeSampling(ABC):
    """A rule for the instants at which luma is rendered. Between them log luma is interpolated."""

    @abstractmethod
    def instants(self, renderer: Renderer, trajectory: Trajectory, end_us: int) -> Iterator[int]:
        """Strictly increasing instants in (0, end_us], in microseconds of the trajectory; not necessarily the end."""


@dataclass(frozen=True)
class FixedRate(TimeSampling):
    """Render at a fixed rate in Hz, whatever moves; 1000 is the dataset's own.

    Raises:
        ValueError: for a rate outside of (0, 1e6] Hz.
    """

    rate_hz: float

    def __post_init__(self) -> None:
        if not 0 < self.rate_hz <= 1e6:
            raise ValueError(f"the render rate must lie in (0, 1e6] Hz, got {self.rate_hz} Hz")

    def instants(self, renderer: Renderer, trajectory: Trajectory, end_us: int) -> Iterator[int]:
        return periodic_instants(self.rate_hz, 1, end_us)


@dataclass(frozen=True)
class MaxDisplacement(TimeSampling):
    """Render whenever the fastest pixel has moved by ``pixels``, in a scene that stands still.

    The speed of a pixel is its optical flow, from depth and the camera's twist; depth maps are rendered every 10 ms
    and pooled so that the nearest surface in 4 x 4 pixels and at both ends of the 10 ms counts. A camera at rest asks
    for no instants.

    Raises:
        ValueError: for a displacement that is not positive and finite.

    Source: Mueggler et al., IJRR 2017, section 6; Rebecq, Gehrig, Scaramuzza, ESIM, CoRL 2018 (sampling by flow).
    """

    pixels: float = 1 / 3

    _BLOCK_US = 10_000
    _STEP_US = 1_000
    _TILE = 4

    def __post_init__(self) -> None:
        if not 0 < self.pixels < np.inf:
            raise ValueError(f"the displacement between renders must be > 0 pixels, got {self.pixels}")

    def instants(self, renderer: Renderer, trajectory: Trajectory, end_us: int) -> Iterator[int]:
        flow = _Flow(renderer, self._TILE)
        moved, last_us = 0.0, 0
        nearest = flow.nearest(trajectory, 0)
        for start_us in range(0, end_us, self._BLOCK_US):
            stop_us = min(start_us + self._BLOCK_US, end_us)
            nearest_at_stop = flow.nearest(trajectory, stop_us)
            steps = -(-(stop_us - start_us) // self._STEP_US)
            t_us = np.linspace(start_us, stop_us, steps + 1)
            speed = flow.fastest(np.minimum(nearest, nearest_at_stop), trajectory, t_us * 1e-6)
            nearest = nearest_at_stop
            path = moved + np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(t_us) * 1e-6)])
            for count in range(1, int(path[-1] / self.pixels) + 1):
                due_us = int(np.interp(count * self.pixels, path, t_us))
                if due_us > last_us:
                    last_us = due_us
                    yield due_us
            moved = float(path[-1] % self.pixels)


class _Flow:
    """Optical flow of a scene at rest, for tiles of pixels."""

    def __init__(self, renderer: Renderer, tile: int) -> None:
        camera = renderer.camera
        self._renderer, self._tile = renderer, tile
        self._rows = np.arange(0, camera.height, tile)
        self._columns = np.arange(0, camera.width, tile)
        centres = np.stack(np.meshgrid(self._columns + (tile - 1) / 2, self._rows + (tile - 1) / 2), -1)
        limits = (camera.width - 1, camera.height - 1)
        self._rays = camera.rays(np.minimum(centres, limits)).reshape(-1, 2)
        # d(pixel x)/d(ray x, y) and d(pixel y)/d(ray x, y), each an array over the tiles.
        self._jacobian = np.moveaxis(camera.distortion_jacobian(self._rays), 0, -1)

    def nearest(self, trajectory: Trajectory, t_us: int) -> FloatArray:
        """The least depth in each tile at an instant."""
        depth = self._renderer.depth([trajectory.pose(t_us * 1e-6)])[0]
        pooled = np.minimum.reduceat(np.minimum.reduceat(depth, self._rows, 0), self._columns, 1)
        return np.asarray(pooled.ravel(), np.float64)

    def fastest(self, depth: FloatArray, trajectory: Trajectory, t_s: FloatArray) -> FloatArray:
        """The largest flow of any tile at each time, in pixels per second."""
        velocity = np.einsum("nij,ni->nj", trajectory.rotations(t_s), trajectory.velocities(t_s))  # camera axes
        vx, vy, vz = velocity.T[:, :, None]
        wx, wy, wz = trajectory.angular_rates(t_s).T[:, :, None]
        x, y = self._rays.T
        # A point of a scene at rest moves by -v - w x X in camera axes; its image (X, Y) / Z accordingly.
        u = (-vx + x * vz) / depth + x * y * wx - (1 + x * x) * wy + y * wz
        v = (-vy + y * vz) / depth + (1 + y * y) * wx - x * y * wy - x * wz
        (xx, xy), (yx, yy) = self._jacobian
        return np.asarray(np.sqrt(((xx * u + xy * v) ** 2 + (yx * u + yy * v) ** 2).max(-1)))
