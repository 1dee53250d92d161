"""The shutter: what pixels that integrate light gather while it is open, as the mean of sub-frames."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from copy import copy
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from ..pose import FloatArray
from ..rendering.render import Renderer
from ..rendering.scene_motion import SceneMotion
from ..scene.light_profile import LightProfile, SampledProfile
from .displacement import DisplacementClock
from .keyframes import Stretch

IntArray = npt.NDArray[np.int64]

SUBFRAME_PX = 0.5
"""The fastest pixel moves by no more than this from one sub-frame to the next: less than the pixel's own width, so
that sub-frames overlap and a blurred edge has no steps."""

_SPEED_STEP_US = 1_000
"""Speed is looked at this often, which is as often as the displacement clock does."""

_LIGHT_STEP_US = 10
"""Lights are averaged over samples so far apart."""

_STEADY = SampledProfile([0.0, 1.0], [1.0, 1.0])


def expose(
    luma: npt.NDArray[np.float32], stretches: Sequence[Stretch], t_us: int, exposure_us: int
) -> npt.NDArray[np.float64]:
    """Mean luma (H, W), float64, over the time (t_us - exposure_us, t_us] in which the shutter is open.

    The shutter closes at the frame's own instant, so that a frame needs nothing of the future. It cannot open before
    the first stretch begins: there the exposure is shorter, and the mean is that of what is left. A shutter that does
    not open at all, or before which nothing changes, sees ``luma`` itself, bit by bit.

    The window (each stretch's share of it) is divided into equal parts, as many as keep the fastest pixel's motion, by
    :class:`~davis_rs.sampling.displacement.DisplacementClock`, within :data:`SUBFRAME_PX` a part. Each part is rendered
    once, at the microsecond in its middle, in the mean light of the part: flicker costs no sub-frames. What the clock
    does not see, the shadow of a moving object, is blurred only as finely as the rest of the image moves.

    Args:
        luma: what is seen at ``t_us``.
        stretches: without a gap between them, in order; the last one holds ``t_us``. Those that end before the
            shutter opens are ignored.
        exposure_us: >= 0.
    """
    open_us = t_us - exposure_us
    bounds = [(stretch, max(stretch.start_us, open_us), min(stretch.end_us, t_us)) for stretch in stretches]
    parts = [(*bound, _fastest(*bound)) for bound in bounds if bound[1] < bound[2]]
    if all(speed == 0 and not stretch.renderer.motion.lights for stretch, _, _, speed in parts):
        return luma.astype(np.float64)
    # A running sum in order: the same bits, however many sub-frames are rendered in one call.
    total, duration_us = np.zeros(luma.shape), sum(end_us - start_us for _, start_us, end_us, _ in parts)
    for stretch, start_us, end_us, speed in parts:
        instants = _middles(start_us, end_us, speed)
        part_us = (end_us - start_us) / len(instants)
        renderer, weight = _in_mean_light(stretch.renderer, part_us), part_us / duration_us
        for first in range(0, len(instants), stretch.batch):
            for frame in renderer.luma(stretch.views(instants[first : first + stretch.batch])):
                total += weight * frame.astype(np.float64)
    return total


class KeyframeExposure:
    """The mean luma while the shutter is open, from keyframes between which luma runs straight.

    It holds the keyframes of one exposure, and one before.

    Args:
        exposure_us: how long the shutter is open, >= 0.
    """

    def __init__(self, exposure_us: int) -> None:
        self._exposure_us = exposure_us
        self._seen: deque[tuple[int, npt.NDArray[np.float32]]] = deque()

    def add(self, t_us: int, luma: npt.NDArray[np.float32]) -> None:
        """The next keyframe."""
        self._seen.append((t_us, luma))
        while len(self._seen) > 1 and self._seen[1][0] <= t_us - self._exposure_us:
            self._seen.popleft()

    def mean(self, t_us: int) -> npt.NDArray[np.float64]:
        """Mean luma (H, W) over the exposure that ends at ``t_us``, the last keyframe; shorter at the very start."""
        open_us = max(t_us - self._exposure_us, self._seen[0][0])
        last = self._seen[-1][1].astype(np.float64)
        if open_us >= t_us:
            return last
        total = np.zeros_like(last)
        for (begin_us, before), (end_us, after) in pairwise(self._seen):
            first_us = max(begin_us, open_us)
            share = 0.5 * (first_us + end_us - 2 * begin_us) / (end_us - begin_us)  # the middle of the part that counts
            total += (end_us - first_us) * (before + share * (after.astype(np.float64) - before))
        return total / (t_us - open_us)


def subframe_instants(stretch: Stretch, start_us: int, end_us: int) -> IntArray:
    """When sub-frames are rendered for a shutter that is open in (start_us, end_us] of a stretch, start_us < end_us."""
    return _middles(start_us, end_us, _fastest(stretch, start_us, end_us))


def _middles(start_us: int, end_us: int, speed: float) -> IntArray:
    """The middles of equal parts in which no pixel of that speed, in pixels per microsecond, moves too far."""
    length_us = end_us - start_us
    count = int(np.clip(np.ceil(length_us * speed / SUBFRAME_PX), 1, length_us))
    return start_us + ((2 * np.arange(count) + 1) * length_us + count) // (2 * count)


def _fastest(stretch: Stretch, start_us: int, end_us: int) -> float:
    """The largest speed of any pixel in (start_us, end_us], in pixels per microsecond."""
    offset_us, length_us = start_us - stretch.start_us, end_us - start_us
    # The clock would count the change of lights too, in which sub-frames need not be told apart.
    renderer = _with_lights(stretch.renderer, dict.fromkeys(stretch.renderer.motion.lights, _STEADY))
    path = stretch.trajectory.crop(offset_us * 1e-6, length_us * 1e-6)
    clock = DisplacementClock(renderer, path, length_us, start_us=start_us)
    times = np.append(np.arange(0, length_us, _SPEED_STEP_US), length_us)
    moved = np.array([clock.path_at(t_us) for t_us in times.tolist()])
    return float((np.diff(moved) / np.diff(times)).max())


class _MeanProfile(LightProfile):
    """Another profile averaged over ``length_us`` around each instant."""

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
        of = self._profile.breaks_s(start_s - half, end_s + half)
        both = np.unique(np.concatenate([of - half, of + half]))
        return both[(both >= start_s) & (both <= end_s)]

    def describe(self) -> dict[str, object]:
        return {"kind": "mean", "length_s": self._length_s, "of": self._profile.describe()}


def _in_mean_light(renderer: Renderer, length_us: float) -> Renderer:
    """The renderer, with lights as they are on the average over ``length_us`` around each instant."""
    return _with_lights(
        renderer, {name: _MeanProfile(profile, length_us) for name, profile in renderer.motion.lights.items()}
    )


def _with_lights(renderer: Renderer, lights: Mapping[str, LightProfile]) -> Renderer:
    """The renderer, with other profiles for the same lights; it shares all else with the one given."""
    if not lights:
        return renderer
    motion, other = renderer.motion, copy(renderer)
    other.motion = SceneMotion(motion.objects, lights, dict(zip(motion.objects, motion.boxes, strict=True)))
    return other
