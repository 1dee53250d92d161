"""Renders luma at every few microseconds, whatever happens: slow, and blind to no cause."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .._core import CrossingEngine, log_intensity
from ..events.arrays import EventArray, concatenate_events
from ..geometry.trajectory.trajectory import Trajectory
from ..geometry.trajectory.views import Views
from ..render.base import Renderer

IntArray = npt.NDArray[np.int64]


class DenseProbe(NamedTuple):
    """Says what :func:`dense_probe` finds.

    Attributes:
        events: along lines between its frames.
        unchanged_until_us: (H, W) the last instant at which a pixel's luma was still, to the bit, what it was at first.
    """

    events: EventArray
    unchanged_until_us: IntArray


def dense_probe(
    renderer: Renderer, trajectory: Trajectory, *, step_us: int, contrast_threshold: float, log_eps: float = 1e-3
) -> DenseProbe:
    """Render a camera's path every ``step_us``, its end too, and take log luma to run straight in between."""
    end_us = round(trajectory.duration_s * 1e6)
    times = np.unique(np.append(np.arange(0, end_us, step_us), end_us))
    camera = renderer.camera
    engine = CrossingEngine(camera.width, camera.height, contrast_threshold=contrast_threshold, log_eps=log_eps)
    unchanged_until = np.zeros((camera.height, camera.width), np.int64)
    still = np.ones(unchanged_until.shape, np.bool_)
    pieces, first = [], None
    for start in range(0, len(times), renderer.poses_per_launch):
        batch = times[start : start + renderer.poses_per_launch]
        for t_us, luma in zip(batch.tolist(), renderer.luma(Views.along(trajectory, batch * 1e-6)), strict=True):
            first = luma.copy() if first is None else first
            still &= luma == first
            unchanged_until[still] = t_us
            pieces.append(engine.push_log(t_us, log_intensity(luma, log_eps)))
    return DenseProbe(concatenate_events(pieces), unchanged_until)


def early(events: EventArray, probe: DenseProbe, *, by_us: int) -> int:
    """Count the events that come more than ``by_us`` before their pixel's luma first changes."""
    return int((events["t"] < probe.unchanged_until_us[events["y"], events["x"]] - by_us).sum())
