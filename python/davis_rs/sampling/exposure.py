"""Simulates the shutter: averages sub-frames over the time in which it is open.

A global shutter opens and closes for all rows at once; a rolling one does so row by row, from the first to the last.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from copy import copy
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from ..geometry.pose import FloatArray
from ..render.base import Renderer
from ..scene.light_profile import LightProfile, SampledProfile
from .displacement import DisplacementClock
from .keyframes import Stretch

IntArray = npt.NDArray[np.int64]

SUBFRAME_PX = 0.5
"""The fastest pixel moves by no more than this from one sub-frame to the next: less than the pixel's own width, so
that sub-frames overlap and a blurred edge has no steps."""

ROLLING_PX = 0.25
"""The same limit under a rolling shutter. Rows open and close within the part of time of a single render, so each row
shows its own time within half of a part: an eighth of a pixel of motion."""

_ROLLING_LIGHT_US = 100
"""Largest distance of sub-frames under a rolling shutter where lights change, because each row shows its own time."""

_SPEED_STEP_US = 1_000
"""Distance of the instants at which speed is sampled, as in the displacement clock."""

_LIGHT_STEP_US = 10
"""Distance of the samples over which lights are averaged."""

_STEADY = SampledProfile([0.0, 1.0], [1.0, 1.0])


def expose(
    luma: npt.NDArray[np.float32],
    stretches: Sequence[Stretch],
    t_us: int,
    exposure_us: int,
    row_readout_us: float = 0.0,
) -> FloatArray:
    """Compute mean luma (H, W), float64, over the time (t_us - exposure_us, t_us] in which the shutter is open.

    The shutter closes at the frame's own instant, so that a frame needs nothing of the future. It cannot open before
    the first stretch begins: there the exposure is shorter. A shutter that does not open at all, or
    before which nothing changes, gives the bits of ``luma``.

    The window (the part of it in each stretch) is divided into equal parts, as many as keep the fastest pixel's motion,
    by :class:`~davis_rs.sampling.displacement.DisplacementClock`, within :data:`SUBFRAME_PX` a part. Each part is
    rendered once, at the microsecond in its middle, in the mean light of the part: flicker costs no sub-frames. The
    shadow of a moving object, which the clock does not count, is blurred only as finely as the rest of the image moves.

    Under a rolling shutter row y of H closes (H - 1 - y) row_readout_us before ``t_us``. The parts then tile the time
    of all rows, and a row is the mean of the parts in which it is open, each weighted by how long. Parts are shorter
    (:data:`ROLLING_PX`, and 100 us where lights change), because a row takes a part's light at its edges, too, as that
    of the part's middle. A row without an exposure lies between two renders so far apart, and is interpolated.

    Args:
        luma: rendered at ``t_us``.
        stretches: without a gap between them, in order; the last one contains ``t_us``. Those that end before the
            shutter opens are ignored.
        exposure_us: >= 0.
        row_readout_us: time between the ends of exposure of a row and of the next one below, >= 0; 0 is a global
            shutter.
    """
    if row_readout_us > 0:
        return _expose_rows(luma, stretches, _RowTimes(len(luma), t_us, exposure_us, row_readout_us))
    open_us = t_us - exposure_us
    bounds = [(stretch, max(stretch.start_us, open_us), min(stretch.end_us, t_us)) for stretch in stretches]
    spans = [(*bound, _fastest(*bound)) for bound in bounds if bound[1] < bound[2]]
    if all(speed == 0 and not stretch.renderer.motion.lights for stretch, _, _, speed in spans):
        return luma.astype(np.float64)
    # Sums are made in order, so that the bits do not depend on how many sub-frames are rendered in one call.
    total, duration_us = np.zeros(luma.shape), sum(end_us - start_us for _, start_us, end_us, _ in spans)
    for stretch, start_us, end_us, speed in spans:
        instants = _middles(start_us, end_us, speed, SUBFRAME_PX)
        part_us = (end_us - start_us) / len(instants)
        renderer, weight = _in_mean_light(stretch.renderer, part_us), part_us / duration_us
        for first in range(0, len(instants), stretch.batch):
            for frame in renderer.luma(stretch.views(instants[first : first + stretch.batch])):
                total += weight * frame.astype(np.float64)
    return total


class _RowTimes:
    """Holds the times at which the rows of a rolling shutter open and close, float64 (H,)."""

    def __init__(self, height: int, t_us: int, exposure_us: int, row_readout_us: float) -> None:
        self.t_us = t_us
        self.close_us: FloatArray = t_us - row_readout_us * np.arange(height - 1, -1, -1.0)
        self.open_us: FloatArray = self.close_us - exposure_us

    @property
    def instant(self) -> bool:
        """Return whether the exposure has no duration."""
        return bool(np.all(self.open_us == self.close_us))

    def fractions(self, edges_us: FloatArray) -> FloatArray:
        """Return the fraction (n, H) of each row's exposure that lies in each part (n + 1 edges) of the time of all
        rows.

        What lies before the first edge is left out: the exposure is shorter. A row that closes before it takes the
        first part.
        """
        close = np.maximum(self.close_us, edges_us[0])
        opened = np.maximum(self.open_us, edges_us[0])
        length, start, end = close - opened, edges_us[:-1, None], edges_us[1:, None]
        within = np.clip(np.minimum(end, close) - np.maximum(start, opened), 0.0, None)
        first = np.arange(len(start))[:, None] == 0
        return np.asarray(np.where(length > 0, within / np.where(length > 0, length, 1.0), first))

    def between(self, nodes_us: FloatArray) -> FloatArray:
        """Return the weights (n, H) of instants (n,) at the end of each row's exposure, for linear interpolation."""
        at = np.interp(self.close_us, nodes_us, np.arange(len(nodes_us)))
        weights: FloatArray = np.clip(1 - np.abs(at - np.arange(len(nodes_us))[:, None]), 0.0, None)
        return weights


def _expose_rows(luma: npt.NDArray[np.float32], stretches: Sequence[Stretch], rows: _RowTimes) -> FloatArray:
    """Compute :func:`expose` for a rolling shutter."""
    first_us = math.floor(rows.open_us[0])
    bounds = [(stretch, max(stretch.start_us, first_us), min(stretch.end_us, rows.t_us)) for stretch in stretches]
    spans = [(*bound, _fastest(*bound)) for bound in bounds if bound[1] < bound[2]]
    if all(speed == 0 and not stretch.renderer.motion.lights for stretch, _, _, speed in spans):
        return luma.astype(np.float64)
    renders: list[tuple[Stretch, Renderer, IntArray]] = []
    edges = [np.array([spans[0][1]], np.float64)]
    for stretch, start_us, end_us, speed in spans:
        longest_us = _ROLLING_LIGHT_US if stretch.renderer.motion.lights else math.inf
        middles = _middles(start_us, end_us, max(speed / ROLLING_PX, 1 / longest_us), 1.0)
        ends = start_us + (end_us - start_us) * np.arange(1, len(middles) + 1) / len(middles)
        if rows.instant:
            ends = np.rint(ends)
            nodes = ends.astype(np.int64) if renders else np.append(start_us, ends.astype(np.int64))
            renders.append((stretch, stretch.renderer, nodes))
        else:
            renders.append((stretch, _in_mean_light(stretch.renderer, (end_us - start_us) / len(middles)), middles))
        edges.append(ends)
    tiled = np.concatenate(edges)
    weights = iter(rows.between(tiled) if rows.instant else rows.fractions(tiled))
    total = np.zeros(luma.shape)
    for stretch, renderer, instants in renders:
        for first in range(0, len(instants), stretch.batch):
            for frame in renderer.luma(stretch.views(instants[first : first + stretch.batch])):
                total += next(weights)[:, None] * frame.astype(np.float64)
    return total


class KeyframeExposure:
    """Averages luma while the shutter is open, from keyframes between which luma is linear in time.

    It holds the keyframes of one frame's exposure, and one before.

    Args:
        exposure_us: how long the shutter is open, >= 0.
        row_readout_us: as for :func:`expose`.
        height: rows of the sensor; needed for a rolling shutter.
    """

    def __init__(self, exposure_us: int, row_readout_us: float = 0.0, height: int = 1) -> None:
        self._exposure_us, self._row_readout_us = exposure_us, row_readout_us
        self._reach_us = exposure_us + row_readout_us * (height - 1)
        self._seen: deque[tuple[int, npt.NDArray[np.float32]]] = deque()

    def add(self, t_us: int, luma: npt.NDArray[np.float32]) -> None:
        """Add the next keyframe."""
        self._seen.append((t_us, luma))
        while len(self._seen) > 1 and self._seen[1][0] <= t_us - self._reach_us:
            self._seen.popleft()

    def mean(self, t_us: int) -> npt.NDArray[np.float64]:
        """Return mean luma (H, W) over the exposure that ends at ``t_us``, the last keyframe; shorter at the start."""
        if self._row_readout_us > 0:
            return self._mean_of_rows(t_us)
        open_us = max(t_us - self._exposure_us, self._seen[0][0])
        last = self._seen[-1][1].astype(np.float64)
        if open_us >= t_us:
            return last
        total = np.zeros_like(last)
        for (begin_us, before), (end_us, after) in pairwise(self._seen):
            first_us = max(begin_us, open_us)
            fraction = (
                0.5 * (first_us + end_us - 2 * begin_us) / (end_us - begin_us)
            )  # the middle of the part that counts
            total += (end_us - first_us) * (before + fraction * (after.astype(np.float64) - before))
        return total / (t_us - open_us)

    def _mean_of_rows(self, t_us: int) -> FloatArray:
        """Return :meth:`mean` of each row over its own time; a row without exposure shows the instant at which it
        closes."""
        first, last = self._seen[0], self._seen[-1]
        rows = _RowTimes(len(last[1]), t_us, self._exposure_us, self._row_readout_us)
        close = np.maximum(rows.close_us, first[0])
        opened = np.clip(rows.open_us, first[0], close)
        instant = close == opened
        total = np.where(close[:, None] == first[0], first[1].astype(np.float64), 0.0)
        for (begin_us, before), (end_us, after) in pairwise(self._seen):
            since, until = np.maximum(opened, begin_us), np.minimum(close, end_us)
            # The instant of a row without exposure, else the middle of the part that counts.
            length = np.where(instant, (close > begin_us) & (close <= end_us), np.clip(until - since, 0.0, None))
            fraction = (0.5 * (since + until) - begin_us) / (end_us - begin_us)
            total += length[:, None] * (before + fraction[:, None] * (after.astype(np.float64) - before))
        return np.asarray(total / np.where(instant, 1.0, close - opened)[:, None])


def subframe_instants(stretch: Stretch, start_us: int, end_us: int) -> IntArray:
    """Return the times of sub-frames for a global shutter that is open in (start_us, end_us] of a stretch."""
    return _middles(start_us, end_us, _fastest(stretch, start_us, end_us), SUBFRAME_PX)


def _middles(start_us: int, end_us: int, speed: float, step: float) -> IntArray:
    """Return the middles of equal parts of a time, in each of which something at ``speed`` moves by at most
    ``step``."""
    length_us = end_us - start_us
    count = int(np.clip(np.ceil(length_us * speed / step), 1, length_us))
    return start_us + ((2 * np.arange(count) + 1) * length_us + count) // (2 * count)


def _fastest(stretch: Stretch, start_us: int, end_us: int) -> float:
    """Return the largest speed of any pixel in (start_us, end_us], in pixels per microsecond."""
    offset_us, length_us = start_us - stretch.start_us, end_us - start_us
    # Lights are made steady, because their change needs no sub-frames.
    renderer = _with_lights(stretch.renderer, dict.fromkeys(stretch.renderer.motion.lights, _STEADY))
    path = stretch.trajectory.crop(offset_us * 1e-6, length_us * 1e-6)
    clock = DisplacementClock(renderer, path, length_us, start_us=start_us)
    times = np.append(np.arange(0, length_us, _SPEED_STEP_US), length_us)
    moved = np.array([clock.path_at(t_us) for t_us in times.tolist()])
    return float((np.diff(moved) / np.diff(times)).max())


class _MeanProfile(LightProfile):
    """Averages a profile over ``length_us`` around each instant."""

    def __init__(self, profile: LightProfile, length_us: float) -> None:
        self._profile, self._length_s = profile, length_us * 1e-6
        count = int(np.ceil(length_us / _LIGHT_STEP_US))
        self._offsets_s = self._length_s * ((np.arange(count) + 0.5) / count - 0.5)

    def factor(self, t_s: npt.ArrayLike) -> FloatArray:
        return np.array([self._profile.factor(t + self._offsets_s).mean() for t in np.asarray(t_s, np.float64)])

    def rate(self, t_s: npt.ArrayLike) -> FloatArray:
        t, half = np.asarray(t_s, np.float64), self._length_s / 2
        return (self._profile.factor(t + half) - self._profile.factor(t - half)) / self._length_s

    def breaks_s(self, start_s: float, end_s: float) -> FloatArray:
        half = self._length_s / 2
        breaks = self._profile.breaks_s(start_s - half, end_s + half)
        both = np.unique(np.concatenate([breaks - half, breaks + half]))
        return both[(both >= start_s) & (both <= end_s)]

    def describe(self) -> dict[str, object]:
        return {"kind": "mean", "length_s": self._length_s, "of": self._profile.describe()}


def _in_mean_light(renderer: Renderer, length_us: float) -> Renderer:
    """Return the renderer with lights averaged over ``length_us`` around each instant."""
    return _with_lights(
        renderer, {name: _MeanProfile(profile, length_us) for name, profile in renderer.motion.lights.items()}
    )


def _with_lights(renderer: Renderer, lights: Mapping[str, LightProfile]) -> Renderer:
    """Return a renderer with other profiles for the same lights, which shares all else with the given one."""
    if not lights:
        return renderer
    other = copy(renderer)
    other.motion = renderer.motion.with_lights(lights)
    return other
