"""What the examples that fit models to event times have in common."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from davis_rs import Scene, simulate
from davis_rs.events.arrays import EventArray, concatenate_events

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
