"""Estimates before a run how long it will take, and says so where that is long."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from .._util.progress import doing
from .._util.quantities import about
from ..geometry.trajectory.trajectory import Trajectory
from ..geometry.trajectory.views import Views
from ..render.base import Renderer
from ..render.native.renderer import NativeRenderer
from ..sampling.displacement import DisplacementClock
from ..sampling.rules import MaxDisplacement, TimeSampling
from ..sampling.tolerance import Tolerance

TOLD_S = 600.0
"""Runs that are shorter show soon enough how long they take."""

_FEW_RAYS, _MORE_RAYS = 2, 8
"""A frame is rendered by so many rays a pixel first, and its time multiplied. That is too long where meshes deform,
which takes the same time for any number of rays, and where reflections need few of a pixel's rays. So a slow frame is
rendered by more rays, too: what they take longer tells the time of a ray."""

_WHOLE_FRAME_S = 30.0
"""A frame that takes no longer than this is rendered again as the run does it."""

_SLOWEST_RAY_S = 2e-5
"""No ray takes longer on one core; those in glass take some 7 us. A run that is short even so is not measured."""


@dataclass(frozen=True)
class RunTime:
    """Says how long a run will take.

    Attributes:
        seconds: for all its frames, on as many threads as the run has.
        frames: how many have to be rendered.
    """

    seconds: float
    frames: int

    def __str__(self) -> str:
        return (
            f"this run will take {about(self.seconds)}: some {self.frames:,} frames of "
            f"{about(self.seconds / self.frames)} each (--size, --rays-per-pixel and --duration change it)"
        )


def estimate_run_time(renderer: Renderer, trajectory: Trajectory, sampling: TimeSampling) -> RunTime | None:
    """Estimate how long a run takes; None where that is not known, or shorter than :data:`TOLD_S`.

    It is known of the native renderer and of rules that space frames by displacement. A frame is rendered in the middle
    of the path.
    """
    end_us = round(trajectory.duration_s * 1e6)
    if not isinstance(renderer, NativeRenderer) or not isinstance(sampling, MaxDisplacement | Tolerance) or end_us < 2:
        return None
    doing("estimating the time of the run")
    frames = int(DisplacementClock(renderer, trajectory, end_us).estimated_renders(sampling.pixels)) + 1
    rays = renderer.rays_per_pixel
    if frames * renderer.camera.width * renderer.camera.height * rays * _SLOWEST_RAY_S < TOLD_S:
        return None
    view = Views.along(trajectory, np.array([end_us / 2e6]))
    few = min(_FEW_RAYS, rays)
    few_s = _seconds(renderer.by_rays(few), view)
    frame_s = few_s * rays / few
    more = min(_MORE_RAYS, rays)
    if frame_s > _WHOLE_FRAME_S and frames * frame_s >= TOLD_S and more > few:
        more_s = _seconds(renderer.by_rays(more), view)
        frame_s = more_s + max(more_s - few_s, 0.0) / (more - few) * (rays - more)
    if frame_s <= _WHOLE_FRAME_S and frames * frame_s >= TOLD_S:
        frame_s = _seconds(renderer, view)
    return RunTime(frames * frame_s, frames) if frames * frame_s >= TOLD_S else None


def _seconds(renderer: Renderer, view: Views) -> float:
    began = time.monotonic()
    renderer.luma(view)
    return time.monotonic() - began
