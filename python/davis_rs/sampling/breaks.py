"""Finds breaks: instants at which motion or light bends or jumps, across which luma must not be interpolated."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator
from itertools import groupby
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..geometry.pose import FloatArray
from ..geometry.trajectory.trajectory import Trajectory
from ..render.motion.scene_motion import SceneMotion
from ..scene.light_profile import LightProfile

BoolArray = npt.NDArray[np.bool_]

_WINDOW_US = 1_000_000
"""Length of time for which breaks of lights are computed at once; a light that flickers has no last break."""

_ROUNDING_US = 1e-3
"""An instant less than this after a whole microsecond counts as that microsecond."""

_LEAST_BEND = 0.01
"""A bend of light counts if it is at least this fraction of the light's strength, between the breaks before and after
it. A profile of many samples has smaller ones, which sampling by displacement follows as it follows a sine."""

_STEP_S = 1e-6
_UNEXPLAINED = 2.0
_SMALLEST_JUMP = 1e-9
"""A smaller change, in metres or of a quaternion, is rounding; for speeds it is per second."""


class Break(NamedTuple):
    """Holds one instant at which something is not smooth.

    Attributes:
        before_us: the last microsecond before the break.
        jump: whether luma itself jumps until the next microsecond; else only its rate does.
    """

    before_us: int
    jump: bool

    def instants(self, *, both: bool) -> tuple[int, ...]:
        """Return the keyframes of a break: one before it, and one a microsecond later if luma jumps or with
        ``both``."""
        return (self.before_us, self.before_us + 1) if self.jump or both else (self.before_us,)


def find_breaks(trajectory: Trajectory, motion: SceneMotion, start_us: int, end_us: int) -> Iterator[Break]:
    """Yield the breaks of a camera's path, of moving objects and of lights after ``start_us``, in order.

    Args:
        trajectory: the camera's; its time 0 is at ``start_us`` of the sequence.
        end_us: end of the sequence; later breaks are left out.
    """
    paths = [_path_breaks(trajectory, trajectory.breaks_s(), start_us)]
    for path in motion.objects.values():
        paths.append(_path_breaks(path, _object_breaks(path), 0))
    for deformation in motion.deformations.values():
        breaks_s, jumps = deformation.breaks_and_jumps
        paths.append([Break(*item) for item in zip(_before_us(breaks_s, 0), jumps, strict=True)])
    paths.append([Break(t_us, False) for t_us in _before_us(motion.bends_s, 0)])
    merged = heapq.merge(*paths, *(_light_breaks(light, start_us, end_us) for light in motion.lights.values()))
    for before_us, same in groupby(merged, key=lambda item: item.before_us):
        if start_us <= before_us < end_us:
            yield Break(before_us, any(item.jump for item in same))


def break_instants(breaks: Iterable[Break], start_us: int, *, both: bool) -> Iterator[int]:
    """Yield increasing instants after ``start_us`` at which breaks need keyframes, see :meth:`Break.instants`."""
    times = (t_us for item in breaks for t_us in item.instants(both=both))
    return (t_us for t_us, _ in groupby(times) if t_us > start_us)


def _object_breaks(path: Trajectory) -> FloatArray:
    """Return the breaks of an object's path, and its end, from which on the object stands still."""
    end = [path.duration_s]
    moves = max(np.abs(path.velocities(end)).max(), np.abs(path.angular_rates(end)).max()) > _SMALLEST_JUMP
    return np.concatenate([path.breaks_s(), end if moves else []])


def _path_breaks(path: Trajectory, breaks_s: FloatArray, zero_us: int) -> list[Break]:
    """Return the breaks of a path whose time 0 is at ``zero_us``."""
    if len(breaks_s) == 0:
        return []
    return [Break(*item) for item in zip(_before_us(breaks_s, zero_us), _teleports(path, breaks_s), strict=True)]


def _before_us(breaks_s: FloatArray, zero_us: int) -> list[int]:
    """Return the last microseconds before breaks of what has its time 0 at ``zero_us``."""
    before: list[int] = (np.ceil(zero_us + breaks_s * 1e6 - _ROUNDING_US).astype(np.int64) - 1).tolist()
    return before


def _teleports(path: Trajectory, t_s: FloatArray) -> list[bool]:
    """Return whether the pose changes at each instant by more than its rates explain."""
    sides = [np.clip(t_s + step, 0.0, path.duration_s) for step in (-_STEP_S, _STEP_S)]
    jumps = np.zeros(len(t_s), np.bool_)
    for poses, rates in ((path.positions, path.velocities), (path.quaternions, path.angular_rates)):
        moved = np.linalg.norm(poses(sides[1]) - poses(sides[0]), axis=1)
        explained = _STEP_S * sum(np.linalg.norm(rates(side), axis=1) for side in sides)
        jumps |= moved > _UNEXPLAINED * explained + _SMALLEST_JUMP
    result: list[bool] = jumps.tolist()
    return result


def _light_breaks(light: LightProfile, start_us: int, end_us: int) -> Iterator[Break]:
    last_us = -1
    for first_us in range(start_us, end_us, _WINDOW_US):
        stop_us = min(first_us + _WINDOW_US, end_us)
        # A break at the very start of a window may begin in the microsecond before.
        for item in _breaks_within(light, start_us, first_us, stop_us):
            if item.before_us > last_us:
                yield item
                last_us = item.before_us


def _breaks_within(light: LightProfile, zero_us: int, first_us: int, stop_us: int) -> Iterator[Break]:
    breaks_s = light.breaks_s((first_us - 1) * 1e-6, (stop_us + 1) * 1e-6)
    if len(breaks_s) == 0:
        return
    at_us = breaks_s * 1e6
    nearest = np.rint(at_us).astype(np.int64)
    around = nearest[:, None] + np.array([-1, 0, 1])
    # These are, to the bit, the times that the renderer will use.
    times = zero_us * 1e-6 + (around - zero_us) * 1e-6
    factors = light.factor(times.ravel()).reshape(around.shape)
    steps = np.abs(np.diff(factors, axis=1))
    jumps = steps.max(1) > _LEAST_BEND * factors.max(1)
    before = np.where(jumps, around[np.arange(len(around)), steps.argmax(1)], np.ceil(at_us - _ROUNDING_US) - 1)
    bends = np.ones(len(breaks_s), np.bool_)
    if len(breaks_s) > 2:
        value = light.factor(breaks_s)
        fraction = (breaks_s[1:-1] - breaks_s[:-2]) / (breaks_s[2:] - breaks_s[:-2])
        line = value[:-2] + fraction * (value[2:] - value[:-2])
        largest = np.maximum(np.maximum(value[:-2], value[2:]), value[1:-1])
        bends[1:-1] = np.abs(value[1:-1] - line) > _LEAST_BEND * largest
    for k in np.flatnonzero(jumps | bends).tolist():
        yield Break(int(before[k]), bool(jumps[k]))
