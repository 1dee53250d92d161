"""Events at which one ray jumps: when the edge that passes it does so, by geometry.

The time of such an event is that of the edge, whatever the level. Where an edge passes several rays at one instant, and
they would move by other amounts, the event's time has a kink there, and no derivative: it is not told.
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
"""How long after each other rays are passed that are passed at one instant but for the rounding of their directions."""

_ALIKE = 0.005
"""By what share derivatives of such rays may differ: more is a kink, which has no derivative."""


class Jumps(NamedTuple):
    """Events at which a ray jumps.

    Attributes:
        found: (n,) whether the ray and its edge are known.
        pose: (n, 6) seconds by an increment of the camera's pose, as in :class:`LogLuma`; 0 where nothing was found.
    """

    found: Flags
    pose: FloatArray


class EventJumps:
    """Finds the edges that make events, in the scene of a field of log luma."""

    def __init__(self, field: LogLumaField) -> None:
        self._field, self._edges = field, EdgePasses(field.renderer)

    def find(
        self, from_us: FloatArray, to_us: FloatArray, pixel: IntArray, sign: FloatArray, luma: FloatArray
    ) -> Jumps:
        """Return the jumps by which luma of pixels (n,) reaches a level between two instants (n,), a short time apart.

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
        # Pass by pass, until the level is reached.
        order = np.lexsort((passes.share, rays.event))
        event = rays.event[order]
        first = np.diff(event, prepend=-1) != 0
        total = np.cumsum(rays.change[order])
        before = (total - rays.change[order])[first][np.cumsum(first) - 1] if len(event) else total
        drift = (stop - start)[event] * passes.share[order]
        after = sign[event] * (start[event] + drift + total - before - luma[event])
        # It is the jump that reaches the level, not what luma does meanwhile.
        reached = (after >= 0) & (after - sign[event] * rays.change[order] < 0)
        at = order[reached]
        event, unique = np.unique(rays.event[at], return_index=True)
        at = at[unique]
        # Where luma was there from the beginning, or a pass before it is not known, this is not the one.
        unknown = np.zeros(len(pixel), np.bool_)
        unknown[rays.event[np.isnan(passes.share)]] = True
        unknown |= sign * (start - luma) >= 0
        # Rays that an edge passes at one instant pass it one after the other as soon as the camera moves.
        own = np.full(len(pixel), -1)
        own[event] = at
        with_own = own[rays.event]
        together = (with_own >= 0) & (
            np.abs(passes.share - passes.share[with_own]) * length_s[rays.event] <= _TOGETHER_S
        )
        unknown[rays.event[together & _differ(passes.pose, passes.pose[with_own])]] = True
        jumps.found[event] = ~unknown[event]
        jumps.pose[event] = passes.pose[at] * length_s[event, None]
        jumps.pose[~jumps.found] = 0.0
        return jumps


def _differ(one: FloatArray, other: FloatArray) -> Flags:
    """Return whether rows (n, 6) by an increment of the pose differ, in their position's part or in their
    rotation's."""
    off, size = ((part.reshape(-1, 2, 3) ** 2).sum(-1) for part in (one - other, other))
    return np.asarray((off > _ALIKE**2 * size).any(1))
