"""Follows a few pixels through a few short stretches of a path, to see before a run what its events will be."""

from __future__ import annotations

import math
from itertools import islice

import numpy as np
import numpy.typing as npt

from .._core import CrossingEngine
from ..events.arrays import EventArray
from ..events.luma import LumaFrames
from ..geometry.trajectory.trajectory import Trajectory
from ..geometry.trajectory.views import Views
from ..render.base import Renderer
from ..sampling.rules import MaxDisplacement

IntArray = npt.NDArray[np.int64]

KEYFRAMES = 25
"""Of a stretch: 8 pixels of motion, at the paper's third of a pixel a keyframe."""


def stretches_of(renderer: Renderer, trajectory: Trajectory, rule: MaxDisplacement, stretches: int) -> list[IntArray]:
    """Return the keyframes of stretches, spread evenly over the path; of a short path all that there are."""
    end_us = round(trajectory.duration_s * 1e6)
    wanted = stretches * KEYFRAMES
    first = [0, *islice(rule.instants(renderer, trajectory, end_us), wanted)]
    if len(first) <= wanted:
        return [np.unique(np.array([*first, end_us], np.int64))]
    stretches_us = [np.array(first[:KEYFRAMES], np.int64)]
    for number in range(1, stretches):
        start_us = max(end_us * number // stretches, int(stretches_us[-1][-1]))
        rest = trajectory.crop(start_us * 1e-6)
        instants = islice(rule.instants(renderer, rest, end_us - start_us, start_us=start_us), KEYFRAMES - 1)
        t_us = np.array([start_us, *(start_us + t_us for t_us in instants)], np.int64)
        if len(t_us) > 1:
            stretches_us.append(t_us)
    return stretches_us


def spread_pixels(size: int, count: int) -> IntArray:
    """Return indices y W + x of ``count`` pixels: one in each of ``count`` equal runs, without a pattern."""
    edges = np.linspace(0, size, count + 1)
    golden = np.arange(count) * ((math.sqrt(5) - 1) / 2) % 1
    return np.minimum((edges[:-1] + golden * np.diff(edges)).astype(np.int64), size - 1)


def luma_of_pixels(
    renderer: Renderer, trajectory: Trajectory, t_us: IntArray, pixel: IntArray, *, rays: int | None = None
) -> LumaFrames:
    """Return the luma (instants, pixels) of pixels at some instants; ``rays`` as of :meth:`Renderer.samples`."""
    views = Views.along(trajectory, t_us * 1e-6)
    view = np.repeat(np.arange(len(views)), len(pixel))
    return renderer.samples(views, view, np.tile(pixel, len(views)), rays=rays).reshape(-1, len(pixel))


def events_of_pixels(
    luma: npt.NDArray[np.floating], t_us: IntArray, thresholds: tuple[float, float], log_eps: float
) -> EventArray:
    """Return the events of pixels (keyframes, pixels)."""
    engine = CrossingEngine(
        luma.shape[1],
        1,
        contrast_threshold=thresholds[0],
        contrast_threshold_off=thresholds[1],
        log_eps=log_eps,
        threads=1,
    )
    rows = luma.astype(np.float32)[:, None]
    return np.concatenate([engine.push(t, row) for t, row in zip((t_us - t_us[0]).tolist(), rows, strict=True)])
