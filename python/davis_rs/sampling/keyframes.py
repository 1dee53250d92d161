"""Defines keyframes, which are rendered and handed to the crossing engine, and the stretches of a sequence."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from .._core import log_intensity
from ..events.luma import LumaFrames
from ..geometry.pose import FloatArray
from ..geometry.trajectory.trajectory import Trajectory
from ..geometry.trajectory.views import Views
from ..render.base import Renderer
from .breaks import Break, break_instants, find_breaks

BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]
LogLuma = npt.NDArray[np.float32]


class SparseSamples(NamedTuple):
    """Samples of some pixels between two keyframes, sorted by pixel and then by time.

    Attributes:
        pixel: uint32 (m,), y W + x.
        t_us: int64 (m,), strictly between the keyframes.
        luma: float32 (m,).
    """

    pixel: npt.NDArray[np.uint32]
    t_us: npt.NDArray[np.int64]
    luma: npt.NDArray[np.float32]

    def neighbours(
        self, pixel: IntArray, t_us: IntArray, *, after: Literal["at", "past"]
    ) -> tuple[tuple[IntArray, BoolArray], tuple[IntArray, BoolArray]]:
        """Return the samples of n pixels before and after n instants of the interval, each as (index, whether it
        exists).

        Args:
            after: whether a sample ``at`` the instant counts as after it, or only one ``past`` it.
        """
        start_us = min(int(self.t_us.min()), int(np.min(t_us, initial=np.iinfo(np.int64).max)))
        span = max(int(self.t_us.max()), int(np.max(t_us, initial=0))) - start_us + 1
        keys = self.pixel.astype(np.int64) * span + (self.t_us - start_us)
        side: Literal["left", "right"] = "left" if after == "at" else "right"
        following = np.searchsorted(keys, pixel * span + (t_us - start_us), side=side)

        def own(index: IntArray) -> tuple[IntArray, BoolArray]:
            inside = np.clip(index, 0, len(keys) - 1)
            return inside, (index == inside) & (self.pixel[inside] == pixel)

        return own(following - 1), own(following)


class Keyframe(NamedTuple):
    """Holds a rendered instant.

    Attributes:
        t_us: microseconds of the sequence.
        luma: linear luma (H, W), float32.
        rate: dY/dt in luma per second (H, W), float32, where log luma is interpolated by cubics.
        sparse: samples since the keyframe before, if any.
    """

    t_us: int
    luma: npt.NDArray[np.float32]
    rate: npt.NDArray[np.float32] | None = None
    sparse: SparseSamples | None = None


@dataclass(frozen=True)
class Stretch:
    """Holds a stretch of a sequence that is to be rendered.

    Attributes:
        renderer: what renders it.
        trajectory: the camera's; its time 0 is at ``start_us`` of the sequence.
        start_us, end_us: the stretch.
        first: whether nothing lies before it; else its start is the last keyframe of the stretch before.
        due: strictly increasing instants of the stretch at which there must be a keyframe: the end, the start of a
            first stretch, and any between.
        contrast_threshold: the smallest of the sensor, in natural-log units.
        log_eps: dark level in units of luma.
        batch: how many keyframes are rendered in one call at most.
        start_luma: luma (H, W) at its start, where the stretch before has rendered it; else who needs it renders it.
    """

    renderer: Renderer
    trajectory: Trajectory
    start_us: int
    end_us: int
    first: bool
    due: Iterable[int]
    contrast_threshold: float
    log_eps: float
    batch: int
    start_luma: LumaFrames | None = None

    def breaks(self) -> Iterator[Break]:
        """Yield the breaks of motion and light within it, see ``davis_rs.sampling.breaks.find_breaks``."""
        return find_breaks(self.trajectory, self.renderer.motion, self.start_us, self.end_us)

    def required(self, *, both: bool) -> Iterator[int]:
        """Return the strictly increasing instants at which any rule has keyframes: those required, and those at breaks.

        Args:
            both: require keyframes on both sides of each break, for cubics; else only of jumps.
        """
        at_breaks = break_instants(self.breaks(), self.start_us, both=both)
        return (t_us for t_us, _ in groupby(heapq.merge(self.due, at_breaks)))

    def views(self, t_us: npt.ArrayLike) -> Views:
        """Return the camera at instants of the sequence."""
        t = (np.asarray(t_us, np.int64) - self.start_us) * 1e-6
        return Views.along(self.trajectory, t, start_s=self.start_us * 1e-6)

    def log_luma(self, luma: LumaFrames) -> LumaFrames:
        """Return ln(luma + log_eps) in float32: for estimates, not for events."""
        return np.asarray(np.log(luma + np.float32(self.log_eps)))


def exact_log_luma(luma: npt.NDArray[np.float32], log_eps: float) -> FloatArray:
    """Return log intensity (n,) of n samples, with the bits of the crossing engine."""
    columns = 1024
    padded = np.zeros(-(-len(luma) // columns) * columns, np.float32)
    padded[: len(luma)] = luma
    return np.asarray(log_intensity(padded.reshape(-1, columns), log_eps).ravel()[: len(luma)])


def slope(t_us: Sequence[int], log_luma: Sequence[LogLuma], k: int) -> LogLuma:
    """Return the slope dL/dt (H, W), 1/s, at frame k of two or more: of the parabola through it and its neighbours.

    At the first and the last frame it is the slope of the chord.

    Args:
        t_us: instants of the frames, increasing.
        log_luma: (H, W), float32, each.
    """
    if k in (0, len(t_us) - 1):
        return _chord(t_us, log_luma, max(k - 1, 0))
    fraction = np.float32((t_us[k + 1] - t_us[k]) / (t_us[k + 1] - t_us[k - 1]))
    result = _chord(t_us, log_luma, k - 1)
    result *= fraction
    result += (1 - fraction) * _chord(t_us, log_luma, k)
    return result


def _chord(t_us: Sequence[int], log_luma: Sequence[LogLuma], k: int) -> LogLuma:
    """Return the slope of the line from frame k to the next."""
    result = log_luma[k + 1] - log_luma[k]
    result /= np.float32((t_us[k + 1] - t_us[k]) * 1e-6)
    return result


def lagrange_weights(t: FloatArray, at: float) -> FloatArray:
    """Return the weights (n,) of the samples at n instants in the polynomial through them, at another instant."""
    others = ~np.eye(len(t), dtype=np.bool_)
    ratios = (at - t)[None] / np.where(others, t[:, None] - t[None], 1.0)
    return np.asarray(np.where(others, ratios, 1.0).prod(1))
