"""Holds the path of an object that a caller moves while a simulation runs."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..pose import IDENTITY, FloatArray, Pose, describe_pose
from .trajectory import SegmentTrajectory, Trajectory

FOREVER_S = float(1 << 53) * 1e-6
"""No simulation is longer, because a step's time is below 2^53 us."""

HALF_TICK_S = 0.5e-6
"""Instants are whole microseconds, so half of one tells two of them apart, however their seconds are rounded."""


class _Move(NamedTuple):
    start_s: float
    end_s: float
    segment: SegmentTrajectory


class SteeredPath(Trajectory):
    """Follows what a caller decides, move after move; between two moves, and after the last one, it rests.

    Each move is at constant velocity and body rate. Only those moves are kept that an open shutter may still see.
    """

    duration_s = FOREVER_S

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Forget all moves."""
        self._first = self._last = IDENTITY
        self._moves: list[_Move] = []

    def put(self, pose: Pose) -> None:
        """Begin at a pose; nothing may have moved yet."""
        self._first = self._last = pose

    def move(self, start_us: int, end_us: int, pose: Pose, *, seen_from_us: float) -> None:
        """Move from the last pose to ``pose`` over (start_us, end_us]; forget what ended before ``seen_from_us``."""
        while self._moves and self._moves[0].end_s < seen_from_us * 1e-6:
            self._first = self._moves.pop(0).segment.end
        segment = SegmentTrajectory(self._last, pose, (end_us - start_us) * 1e-6)
        self._moves.append(_Move(start_us * 1e-6, end_us * 1e-6, segment))
        self._last = pose

    def positions(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._of_moves(t_s, 3, lambda path, t: path.positions(t), self._first.position, moving=False)

    def quaternions(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._of_moves(t_s, 4, lambda path, t: path.quaternions(t), self._first.quaternion, moving=False)

    def velocities(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._of_moves(t_s, 3, lambda path, t: path.velocities(t), np.zeros(3), moving=True)

    def angular_rates(self, t_s: npt.ArrayLike) -> FloatArray:
        return self._of_moves(t_s, 3, lambda path, t: path.angular_rates(t), np.zeros(3), moving=True)

    def breaks_s(self) -> FloatArray:
        """Return where moves begin and end, but for the end of the last one, after which nothing is known yet."""
        ends = {time for move in self._moves for time in (move.start_s, move.end_s)}
        return np.array(sorted(ends)[:-1], np.float64)

    def crop(self, start_s: float = 0.0, duration_s: float | None = None) -> Trajectory:
        """Return the path itself: its caller counts from where the sequence begins."""
        return self

    def describe(self) -> dict[str, object]:
        return {"kind": "steered", "now": describe_pose(self._last)}

    def _of_moves(
        self,
        t_s: npt.ArrayLike,
        width: int,
        values_of: Callable[[SegmentTrajectory, FloatArray], FloatArray],
        before: FloatArray,
        *,
        moving: bool,
    ) -> FloatArray:
        """Return values (n, width) of the moves at times; where one move ends and the next begins, those of the next.

        Args:
            before: the value before the first move.
            moving: whether the values are rates, which are 0 at rest.
        """
        t = self.times(t_s)
        starts = [move.start_s for move in self._moves]
        numbers = np.searchsorted(starts, t + HALF_TICK_S, side="right") - 1
        values = np.tile(before, (len(t), 1))
        for number in np.unique(numbers[numbers >= 0]).tolist():
            move, of_move = self._moves[number], numbers == number
            inside = np.clip(t[of_move] - move.start_s, 0.0, move.segment.duration_s)
            values[of_move] = values_of(move.segment, inside)
            if moving:
                values[of_move & (t > move.end_s + HALF_TICK_S)] = 0.0
        return values
