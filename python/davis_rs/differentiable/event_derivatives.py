"""Computes derivatives of the times of events, and of log luma at them, as dense columns and as sparse blocks."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from .._util.argument_error import ArgumentError
from .._util.close_names import did_you_mean
from .event_levels import EventLevels
from .log_luma import LogLuma, LogLumaField
from .moved_path import MovedPath, right_jacobians
from .spline_weights import spline_weights

if TYPE_CHECKING:
    from scipy.sparse import csr_array

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

QUANTITIES = ("pose", "contrast_threshold", "log_eps", "clock_offset", "clock_drift", "light")
"""The names that ``of`` may have."""

_US = 1e6


@dataclass(frozen=True, eq=False)
class EventDerivatives(ABC):
    """Derivatives of a quantity of n events by unknowns.

    Sparse blocks are ``scipy.sparse.csr_array``; their rows of events that are not known are empty. Blocks with the
    same rows stand next to each other by ``scipy.sparse.hstack``.

    Attributes:
        t_us: (n,) when log luma was evaluated.
        levels: of the events.
        start, here: log luma at the start of the run, and at ``t_us``.
        smooth: (n,) whether the derivatives are those of log luma there.
        field: log luma of the run.
    """

    t_us: FloatArray
    levels: EventLevels
    start: LogLuma
    here: LogLuma
    smooth: Flags
    field: LogLumaField

    @property
    def ok(self) -> Flags:
        """(n,) where derivatives are known."""
        return self.smooth

    def jacobian(self, quantities: Sequence[str]) -> FloatArray:
        """Return the derivatives (n, columns) by unknowns, NaN where they are not known.

        The unknowns are those quantities :func:`~davis_rs.differentiable.event_time_jacobian`.

        Raises:
            ValueError: for an unknown that does not exist.
        """
        check_quantities(quantities)
        columns = [np.zeros((len(self.t_us), 0)), *(self._columns(name) for name in quantities)]
        jacobian = np.concatenate(columns, 1)
        jacobian[~self.ok] = np.nan
        return jacobian

    def pose_parts(self) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives (n, 6) by an increment of the pose at the event, and by one at the start of the run.

        Units and axes are those of ``pose`` in :func:`~davis_rs.differentiable.event_time_jacobian`, whose columns are
        the sum of both. 0 where nothing is known. The derivatives by any
        parameters of a path of increments follow: multiply by the weights of the parameters at the event and at the
        start. For a path made by :func:`~davis_rs.differentiable.moved` they are those by an addition to its
        increments.
        """
        at_event, at_start = self._own_pose_parts()
        if isinstance(self.field.path, MovedPath):
            instants = np.clip(self.t_us * 1e-6, 0.0, self.field.duration_s), np.zeros(len(self.t_us))
            for rows, t_s in zip((at_event, at_start), instants, strict=True):
                turns = right_jacobians(self.field.path.increments(t_s)[:, 3:])
                rows[:, 3:] = np.einsum("ni,nij->nj", rows[:, 3:], turns)
        return at_event, at_start

    def control_points(self, count: int, *, degree: int = 3) -> csr_array:
        """Return sparse derivatives (n, 6 ``count``) by the control points of a spline of increments of the path.

        The spline is that of :func:`~davis_rs.differentiable.spline_weights` over the run's path, as in
        :func:`~davis_rs.differentiable.moved`. Column 6 i + k is number
        k of control point i: k = 0..2 is its position in world axes, metres, k = 3..5 its rotation vector in camera
        axes, radians. A row has the control points at the event, and those at the start of the run.

        Raises:
            ValueError: for fewer than degree + 1 control points.
        """
        from scipy.sparse import csr_array

        duration_s, n = self.field.duration_s, len(self.t_us)
        instants = np.clip(self.t_us * 1e-6, 0.0, duration_s), np.zeros(n)
        columns, values = [], []
        for t_s, rows in zip(instants, self.pose_parts(), strict=True):
            weights = spline_weights(t_s, count, duration_s=duration_s, degree=degree)
            points, weight = (part.reshape(n, degree + 1, 1) for part in (weights.indices, weights.data))
            columns.append((6 * points + np.arange(6)).reshape(n, -1))
            values.append((weight * rows[:, None]).reshape(n, -1))
        return _rows_of(csr_array, np.concatenate(columns, 1), np.concatenate(values, 1), 6 * count)

    def contrast_threshold_map(self) -> csr_array:
        """Return sparse derivatives (n, 2 W H) by each pixel's own thresholds, natural-log units.

        Column y W + x is the ON threshold of pixel (x, y), column W H + y W + x its OFF threshold. 0 for a jump.
        """
        from scipy.sparse import csr_array

        camera = self.field.renderer.camera
        pixels = camera.width * camera.height
        columns = self.levels.pixel[:, None] + np.array([0, pixels])
        return _rows_of(csr_array, columns, self._columns("contrast_threshold") * self.ok[:, None], 2 * pixels)

    def reflectance(self) -> csr_array:
        """Return sparse derivatives (n, texels) by the reflectance of each texel, all channels alike; 0 for a jump.

        A texel is 0..1; :meth:`texture_columns` tells the column of each. With J this matrix, ``J.T @ g`` is the
        gradient of a loss whose derivatives by the quantity are g (n,): reverse mode. Baked light that bounces from a
        surface is taken as fixed.
        """
        from scipy.sparse import csr_array

        per_log = csr_array((self._per_log()[:, 0], (np.arange(len(self.t_us)),) * 2))
        pixels, of_pixel = np.unique(self.levels.pixel, return_inverse=True)
        start = self.field.by_texel(np.zeros(len(pixels)), pixels)[of_pixel]
        return per_log @ (start - self.field.by_texel(self.t_us, self.levels.pixel))

    def texture_columns(self) -> dict[str, IntArray]:
        """Return, by the name ``<id>.reflectance`` of each shape, the columns (H, W) of its texels in
        :meth:`reflectance`."""
        table = self.field.renderer.table
        return {
            f"{shape.id()}.reflectance": first + np.arange(height * width).reshape(height, width)
            for shape, (first, width, height, _) in zip(
                table.scene.shapes(), table.textures.sizes.tolist(), strict=True
            )
        }

    @abstractmethod
    def _per_log(self) -> FloatArray:
        """Return (n, 1) the derivative by the event's level less log luma, per natural-log unit."""

    def _own_pose_parts(self) -> tuple[FloatArray, FloatArray]:
        """Return :meth:`pose_parts` by increments of the path as it is."""
        return -self.here.pose * self._per_log(), self.start.pose * self._per_log()

    def _columns(self, name: str) -> FloatArray:
        here, start, per_log = self.here, self.start, self._per_log()
        if name == "pose":
            return np.add(*self.pose_parts())
        if name == "contrast_threshold":
            return np.stack([self.levels.on, -self.levels.off], 1) * per_log
        if name == "log_eps":
            return -(here.log_eps - start.log_eps)[:, None] * per_log
        if name == "light":
            return -((here.lights - start.lights) @ self.field.of_light_name) * per_log
        if name == "clock_offset":
            return (here.rate - start.rate)[:, None] * per_log
        # A drift delays nothing at the start of the run.
        return (here.rate * self.t_us * 1e-6)[:, None] * per_log


@dataclass(frozen=True, eq=False)
class EventTimeDerivatives(EventDerivatives):
    """Derivatives of the times of n events, in microseconds per unit of an unknown.

    Sparse blocks are ``scipy.sparse.csr_array``; their rows of events that are not known are empty. Blocks with the
    same rows stand next to each other by ``scipy.sparse.hstack``.

    Attributes:
        t_us: (n,) when log luma was evaluated: for a refined event the middle of the microsecond that ends at its
            stamp, for another the crossing that was found.
        levels: of the events.
        start, here: log luma at the start of the run, and at ``t_us``.
        smooth: (n,) whether log luma reaches the level at ``t_us``, and rises or falls through it.
        field: log luma of the run.
        jump: (n,) whether a ray of the pixel jumps there because of a known edge.
        jump_pose: (n, 6) for those, seconds by an increment of the pose.
    """

    jump: Flags
    jump_pose: FloatArray

    @property
    def ok(self) -> Flags:
        """(n,) where derivatives are known."""
        return self.smooth | self.jump

    def _per_log(self) -> FloatArray:
        """Return (n, 1) microseconds per unit of log luma, 0 where the event does not come from log luma."""
        return np.where(self.smooth, _US / np.where(self.smooth, self.here.rate, 1.0), 0.0)[:, None]

    def _own_pose_parts(self) -> tuple[FloatArray, FloatArray]:
        at_event, at_start = super()._own_pose_parts()
        return at_event + self.jump_pose * self.jump[:, None] * _US, at_start

    def _columns(self, name: str) -> FloatArray:
        # An edge passes as much later as its motion is delayed.
        if name == "clock_offset":
            return np.where(self.jump[:, None], _US, super()._columns(name))
        if name == "clock_drift":
            return self.t_us[:, None].copy()
        return super()._columns(name)


@dataclass(frozen=True, eq=False)
class LogLumaDerivatives(EventDerivatives):
    """Derivatives of log luma of n events' pixels, less the events' levels: natural-log units per unit of an unknown.

    Instants are fixed. Which surface a ray hits, and whether a light is hidden from it, is taken as fixed too: at an
    edge only the part of the surfaces counts. For the rest see :class:`EventTimeDerivatives`.

    Attributes:
        t_us: (n,) when log luma was evaluated: the middle of the microsecond that ends at the stamp.
        levels: of the events.
        start, here: log luma at the start of the run, and at ``t_us``.
        smooth: (n,) True: log luma has a value everywhere.
        field: log luma of the run.
    """

    def _per_log(self) -> FloatArray:
        return np.full((len(self.t_us), 1), -1.0)


def check_quantities(quantities: Sequence[str]) -> None:
    """Refuse a name that is not one of :data:`QUANTITIES`."""
    for name in quantities:
        if name not in QUANTITIES:
            raise ArgumentError(
                "{of} must name {}; got {!r}{}", ", ".join(QUANTITIES), name, did_you_mean(name, QUANTITIES)
            )


def _rows_of(csr_array: type, columns: IntArray, values: FloatArray, width: int) -> csr_array:
    """Make a sparse matrix from (n, k) entries, k in each row."""
    n, k = columns.shape
    matrix = csr_array((values.ravel(), columns.ravel(), np.arange(n + 1) * k), shape=(n, width))
    matrix.sum_duplicates()
    matrix.eliminate_zeros()
    return matrix
