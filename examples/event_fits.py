"""What the examples that fit models to event times have in common."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from davis_rs import Scene, simulate
from davis_rs.differentiable.event_jacobian import EventTimeModel
from davis_rs.differentiable.event_levels import EventLevels
from davis_rs.differentiable.event_residuals import MIDDLE_US
from davis_rs.differentiable.log_luma import LogLuma
from davis_rs.events import EventArray, concatenate_events

FloatArray = npt.NDArray[np.float64]


def events_of(scene: Scene, **run: Any) -> EventArray:
    """All events of a run."""
    return concatenate_events([packet.events for packet in simulate(scene, frame_rate_hz=0, depth_rate_hz=0, **run)])


def with_noise(events: EventArray, sigma_us: float, end_us: float, seed: int = 1) -> EventArray:
    """Events with normal noise on their stamps, sorted again, in whole microseconds within the run."""
    stream = events.copy()
    noise = np.random.default_rng(seed).normal(0.0, sigma_us, len(stream))
    stream["t"] = np.clip(np.round(stream["t"] + noise), 1, np.floor(end_us)).astype(np.int64)
    return stream[np.argsort(stream["t"], kind="stable")]


class Seen(NamedTuple):
    """Events of a stream, as an estimate of path and scene has them.

    Attributes:
        t_s: (n,) the middle of the microsecond that ends at the stamp.
        levels: of the events.
        start, here: log luma at the start of the run, and at ``t_s``.
        residual: (n,) log luma less the level that the event says it has.
    """

    t_s: FloatArray
    levels: EventLevels
    start: LogLuma
    here: LogLuma
    residual: FloatArray


def log_luma_residuals(scene: Scene, events: EventArray, **run: Any) -> Seen:
    """How far log luma is from the levels of events at their stamps.

    Next to the solution that is the residual of the event's time, times -dL/dt. Far from it, it is the better one: a
    time residual needs the event's own crossing, which may be far away or not there at all; this one is one look.
    """
    model = EventTimeModel(scene, **run)
    levels = model.levels(events)
    start, level = model.start_and_level(levels)
    t_us = levels.t_us - MIDDLE_US
    here = model.field.at(t_us, levels.pixel)
    return Seen(t_us * 1e-6, levels, start, here, here.value - level)


def spread(residual: FloatArray) -> float:
    """The standard deviation of normal noise with this median of sizes: what outliers do not touch."""
    return float(1.4826 * np.median(np.abs(residual)))


def tukey(residual: FloatArray, width: float) -> FloatArray:
    """Weights of Tukey's biweight: 1 at 0, none from ``width`` on. Source: Beaton and Tukey, Technometrics 1974."""
    inside = np.clip(1 - (residual / width) ** 2, 0.0, None)
    return inside**2


def save(figure: Any, path: Path | Sequence[str] | str) -> None:
    """Write a picture of a few tens of kB."""
    figure.savefig(str(path), dpi=110)
    print(f"wrote {path}")
