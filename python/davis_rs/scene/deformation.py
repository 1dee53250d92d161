"""Defines meshes that deform: walking people, waving cloth, faces."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..geometry.pose import FloatArray

AT_ONCE = 64
"""Instants that are computed together: matrices of thousands of joints take megabytes each."""

_STEP_S = 1e-6
_SMALLEST_JUMP = 1e-9
"""A smaller step, in metres, is rounding."""


class DeformedMesh(NamedTuple):
    """Holds the vertices of a mesh at an instant, in the object's own frame.

    Attributes:
        positions: (v, 3), metres.
        normals: (v, 3), unit; None where every triangle is flat.
    """

    positions: FloatArray
    normals: FloatArray | None


class MovingPoints(NamedTuple):
    """Holds points of an instant that tell how a mesh moves, in the object's own frame.

    For some time around it, each point of the mesh is a mean of these points by weights that do not change, but for
    its own speed.

    Attributes:
        positions: (k, 3), metres.
        velocities: (k, 3), metres per second.
        own_speed: no point of the mesh is faster than this relative to its mean, metres per second.
    """

    positions: FloatArray
    velocities: FloatArray
    own_speed: float


class Deformation(ABC):
    """Gives the vertices of an object's mesh at any time, and how they move.

    Vertices are in the order of the shape's vertex buffer in the scene's source, which has the mesh as it is at time
    0, and in the object's own frame: its path (:attr:`Scene.objects`) comes on top. Before time 0 and after
    :attr:`duration_s` the mesh keeps the form that it has there.

    Attributes:
        duration_s: seconds, > 0.
    """

    duration_s: float

    @abstractmethod
    def meshes(self, t_s: FloatArray) -> Iterator[DeformedMesh]:
        """Yield the mesh at each of the times (n,), seconds."""

    @abstractmethod
    def velocities(self, t_s: FloatArray) -> Iterator[FloatArray]:
        """Yield the vertices' velocities (v, 3), metres per second, at each of the times (n,)."""

    @abstractmethod
    def hull(self, t_s: FloatArray) -> FloatArray:
        """Return points (n, k, 3) whose convex hull holds the mesh at each of the times (n,), the same k each time."""

    @abstractmethod
    def fastest(self, t_s: FloatArray) -> FloatArray:
        """Return a bound (n,) on the speed of the mesh's points, metres per second, and of those of :meth:`hull`."""

    def moving_points(self, t_s: FloatArray) -> Iterator[MovingPoints]:
        """Yield points that tell how the mesh moves at each of the times (n,): by :meth:`hull` and :meth:`fastest`,
        which do not say in which direction, if a deformation does not know better."""
        for positions, speed in zip(self.hull(t_s), self.fastest(t_s), strict=True):
            yield MovingPoints(positions, np.zeros_like(positions), float(speed))

    @abstractmethod
    def breaks_s(self) -> FloatArray:
        """Return the times within 0 to :attr:`duration_s` at which velocities jump, or the mesh itself does."""

    @abstractmethod
    def describe(self) -> dict[str, object]:
        """Return what it is, as JSON takes it."""

    def box(self) -> FloatArray:
        """Return the lowest and the highest corner (2, 3) of a box that holds the mesh at all times."""
        return self._box

    @cached_property
    def _box(self) -> FloatArray:
        grid = np.unique(np.concatenate([np.linspace(0.0, self.duration_s, 129), self.breaks_s()]))
        hulls = [self.hull(some) for some in _blocks(grid)]
        # Between two instants a point goes no farther from the nearer one than for half of the time.
        times = np.unique(np.concatenate([grid, (grid[1:] + grid[:-1]) / 2]))
        speed = max(float(self.fastest(some).max()) for some in _blocks(times))
        slack = float(np.diff(grid).max(initial=0.0)) / 2 * speed
        low, high = (np.min([hull.min((0, 1)) for hull in hulls], 0), np.max([hull.max((0, 1)) for hull in hulls], 0))
        return np.stack([low - slack, high + slack])

    def jumps(self, t_s: FloatArray) -> npt.NDArray[np.bool_]:
        """Return whether the mesh jumps at each of the times (n,), by more than its velocities explain."""
        jumps = [np.zeros(0, np.bool_)]
        for some in _blocks(t_s):
            before, after = self.hull(some - _STEP_S), self.hull(some + _STEP_S)
            explained = _STEP_S * (self.fastest(some - _STEP_S) + self.fastest(some + _STEP_S))
            jumps.append(np.linalg.norm(after - before, axis=2).max(1) > 2 * explained + _SMALLEST_JUMP)
        return np.concatenate(jumps)

    @cached_property
    def breaks_and_jumps(self) -> tuple[FloatArray, list[bool]]:
        """The times of :meth:`breaks_s` and the end, from which on the mesh keeps its form; and whether it jumps
        there."""
        times = np.union1d(self.breaks_s(), [self.duration_s])
        jumps: list[bool] = self.jumps(times).tolist()
        return times, jumps

    def moves(self, t_s: FloatArray) -> npt.NDArray[np.bool_]:
        """Return whether each of the times (n,) lies within the motion."""
        return np.asarray((t_s >= 0) & (t_s <= self.duration_s))

    def retimed(self, start_s: float, pace: float = 1.0) -> Deformation:
        """Return the same motion by another clock, whose second t is ``start_s + pace * t`` of this one's."""
        return self if (start_s, pace) == (0.0, 1.0) else _Retimed(self, start_s, pace)


def _blocks(t_s: FloatArray) -> Iterator[FloatArray]:
    return (t_s[first : first + AT_ONCE] for first in range(0, len(t_s), AT_ONCE))


class _Retimed(Deformation):
    def __init__(self, deformation: Deformation, start_s: float, pace: float) -> None:
        self._of, self._start_s, self._pace = deformation, start_s, pace
        # After its end the mesh keeps its form: any duration will do.
        left_s = (deformation.duration_s - start_s) / pace
        self.duration_s = left_s if left_s > 0 else 1.0

    def _own(self, t_s: FloatArray) -> FloatArray:
        return self._start_s + self._pace * np.clip(t_s, 0.0, self.duration_s)

    def meshes(self, t_s: FloatArray) -> Iterator[DeformedMesh]:
        return self._of.meshes(self._own(t_s))

    def velocities(self, t_s: FloatArray) -> Iterator[FloatArray]:
        for own, moving in zip(self._of.velocities(self._own(t_s)), self.moves(t_s), strict=True):
            yield own * (self._pace * moving)

    def hull(self, t_s: FloatArray) -> FloatArray:
        return self._of.hull(self._own(t_s))

    def fastest(self, t_s: FloatArray) -> FloatArray:
        return self._of.fastest(self._own(t_s)) * (self._pace * self.moves(t_s))

    def moving_points(self, t_s: FloatArray) -> Iterator[MovingPoints]:
        for points, moves in zip(self._of.moving_points(self._own(t_s)), self.moves(t_s), strict=True):
            pace = self._pace * moves
            yield MovingPoints(points.positions, points.velocities * pace, points.own_speed * pace)

    def breaks_s(self) -> FloatArray:
        breaks = (self._of.breaks_s() - self._start_s) / self._pace
        return breaks[(breaks >= 0) & (breaks <= self.duration_s)]

    def describe(self) -> dict[str, object]:
        return {"kind": "retimed", "start_s": self._start_s, "pace": self._pace, "of": self._of.describe()}

    def retimed(self, start_s: float, pace: float = 1.0) -> Deformation:
        return self._of.retimed(self._start_s + self._pace * start_s, self._pace * pace)
