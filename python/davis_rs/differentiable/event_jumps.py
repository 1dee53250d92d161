"""Finds events at which one ray jumps, and when the edge passes that ray, from the geometry.

The time of such an event is that of the edge, whatever the level. Where an edge passes several rays at one instant, and
they would move by different amounts, the event's time has a kink there, and so no derivative.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .edge_passes import EdgePasses
from .log_luma import LogLumaField

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

_TOGETHER_S = 2e-7
"""Rays that an edge passes within this time are passed at one instant, but for the rounding of their directions."""

_ALIKE = 0.005
"""By which fraction the derivatives of such rays may differ; more is a kink, which has no derivative."""


class Jumps(NamedTuple):
    """Holds events at which a ray jumps.

    Attributes:
        known: (n,) whether the ray and its edge are known.
        pose: (n, 6) seconds by an increment of the camera's pose, as in :class:`LogLuma`; 0 where no edge was found.
    """

    known: Flags
    pose: FloatArray


class EventJumps:
    """Finds the edges that make events, in the scene of a field of log luma."""

    def __init__(self, field: LogLumaField) -> None:
        self._field, self._edges = field, EdgePasses(field.renderer)

    def find(
        self, from_us: FloatArray, to_us: FloatArray, pixel: IntArray, sign: FloatArray, luma: FloatArray
    ) -> Jumps:
        """Find the jumps by which luma of pixels (n,) reaches a level between two instants (n,), a short time apart.

        Args:
            sign: (n,) 1 where it rises to the level, -1 where it falls.
            luma: (n,) at the level.
        """
        jumps = Jumps(np.zeros(len(pixel), np.bool_), np.zeros((len(pixel), 6)))
        if len(pixel) == 0:
            return jumps
        ends = self._field.views(from_us), self._field.views(to_us)
        start, stop, rays = self._edges.changed(ends, pixel)
        length_s = ends[1].t_s - ends[0].t_s
        passes = self._edges.passes(ends, rays)
        # The edges pass one after the other, until the level is reached.
        order = np.lexsort((passes.fraction, rays.event))
        event = rays.event[order]
        first = np.diff(event, prepend=-1) != 0
        total = np.cumsum(rays.change[order])
        before = (total - rays.change[order])[first][np.cumsum(first) - 1] if len(event) else total
        drift = (stop - start)[event] * passes.fraction[order]
        after = sign[event] * (start[event] + drift + total - before - luma[event])
        # The jump must reach the level, not the drift of luma before it.
        reached = (after >= 0) & (after - sign[event] * rays.change[order] < 0)
        at = order[reached]
        event, unique = np.unique(rays.event[at], return_index=True)
        at = at[unique]
        # If luma was at the level from the start, or an earlier pass is not known, this jump does not make the event.
        unknown = np.zeros(len(pixel), np.bool_)
        unknown[rays.event[np.isnan(passes.fraction)]] = True
        unknown |= sign * (start - luma) >= 0
        # Rays that an edge passes at one instant are passed one after the other as soon as the camera moves.
        own = np.full(len(pixel), -1)
        own[event] = at
        with_own = own[rays.event]
        together = (with_own >= 0) & (
            np.abs(passes.fraction - passes.fraction[with_own]) * length_s[rays.event] <= _TOGETHER_S
        )
        unknown[rays.event[together & _differ(passes.pose, passes.pose[with_own])]] = True
        jumps.known[event] = ~unknown[event]
        jumps.pose[event] = passes.pose[at] * length_s[event, None]
        jumps.pose[~jumps.known] = 0.0
        return jumps


def _differ(first: FloatArray, second: FloatArray) -> Flags:
    """Return whether rows (n, 6) by an increment of the pose differ, in their position or in their rotation."""
    off, size = ((part.reshape(-1, 2, 3) ** 2).sum(-1) for part in (first - second, second))
    return np.asarray((off > _ALIKE**2 * size).any(1))
