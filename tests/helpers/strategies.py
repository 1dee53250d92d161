"""Hypothesis strategies: log-intensity sequences built to sit on, just off and far from the levels of the engine.

The examples are the same in every run; with DAVIS_RS_EXAMPLES=20000 in the environment that many random ones are
tried instead.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from reference import LogFrame

_RANDOM_EXAMPLES = os.environ.get("DAVIS_RS_EXAMPLES")

EXAMPLES = settings(
    max_examples=int(_RANDOM_EXAMPLES or 50),
    derandomize=_RANDOM_EXAMPLES is None,
    database=None,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
"""Settings of every property test of the engine (a decorator)."""

EPOCH_US = 1_700_000_000_000_000
"""A Unix time in microseconds: what recordings of real cameras begin with."""


@dataclass(frozen=True)
class Step:
    """How a pixel comes from one sample to the next; see :func:`next_sample`."""

    kind: Literal["hold", "first", "jump", "creep", "ramp", "level", "aim"]
    up: int = 0
    down: int = 0
    amount: float = 0.0
    ulps: int = 0


@dataclass(frozen=True)
class Sequence:
    """Frames of float64 log intensity, their times, and the thresholds to run them with."""

    c_on: float
    c_off: float
    times_us: list[int]
    frames: list[LogFrame]

    @property
    def shape(self) -> tuple[int, int]:
        height, width = self.frames[0].shape
        return height, width


def nudged(value: float, ulps: int) -> float:
    """``value`` moved by ``ulps`` floats up or down."""
    for _ in range(abs(ulps)):
        value = math.nextafter(value, math.copysign(math.inf, ulps))
    return value


def next_sample(step: Step, samples: list[float], c_on: float, c_off: float) -> float:
    """The sample after ``samples`` in a pixel whose first one is its base B."""
    base, last = samples[0], samples[-1]
    level = base + step.up * c_on - step.down * c_off
    match step.kind:
        case "hold":
            value = last
        case "first":
            value = base
        case "jump":
            value = base + step.amount * c_on
        case "creep":
            value = last + step.amount * 1e-6 * c_on
        case "ramp":
            value = last + (last - samples[-2] if len(samples) > 1 else c_on * step.amount)
        case "level":
            value = level
        case "aim":  # at a crossing of the level that lies at this fraction of the interval, to the float
            value = last + (level - last) / step.amount
    if abs(value - base) > 16 * c_on:  # no aim or ramp runs away: each level costs the oracle time
        value = level
    return nudged(value, step.ulps)


_ULPS = st.integers(-2, 2)
_COUNTS = st.integers(0, 5)
steps: st.SearchStrategy[Step] = st.one_of(
    st.builds(Step, st.just("hold")),
    st.builds(Step, st.just("first"), ulps=_ULPS),
    st.builds(Step, st.just("jump"), amount=st.floats(-6, 6)),
    st.builds(Step, st.just("creep"), amount=st.floats(-1, 1), ulps=_ULPS),
    st.builds(Step, st.just("ramp"), amount=st.floats(-0.5, 0.5)),
    st.builds(Step, st.just("level"), _COUNTS, _COUNTS, ulps=_ULPS),
    st.builds(Step, st.just("aim"), _COUNTS, _COUNTS, st.sampled_from([0.125, 0.25, 1 / 3, 0.5, 0.7, 1.0]), _ULPS),
)

thresholds: st.SearchStrategy[float] = st.one_of(st.sampled_from([0.15, 0.25, 0.1, 0.001, 2.0]), st.floats(0.001, 2.0))

threshold_pairs: st.SearchStrategy[tuple[float, float]] = st.builds(
    lambda c_on, ratio: (c_on, c_on * ratio),
    thresholds,
    st.one_of(st.sampled_from([1.0, 1 + 2.0**-52, 0.5, 2.0]), st.floats(0.3, 3.0)),
)

start_times: st.SearchStrategy[int] = st.sampled_from([0, 1, 1_000_000_000, EPOCH_US])

intervals: st.SearchStrategy[int] = st.one_of(
    st.sampled_from([1, 2, 3, 1_000, 33_333, 3_600_000_000, 1 << 40, (1 << 53) - 1]), st.integers(1, 1_000_000)
)

base_levels: st.SearchStrategy[float] = st.one_of(
    st.sampled_from([0.0, -0.0, 1.0, math.log(1e-3), 13.8, -700.0, 5e-324, -1e-17]), st.floats(-20, 20)
)


@st.composite
def sequences(draw: st.DrawFn, *, max_frames: int = 9, gaps: st.SearchStrategy[int] = intervals) -> Sequence:
    """A few pixels over a few frames, each pixel on a path of its own."""
    c_on, c_off = draw(threshold_pairs)
    height, width = draw(st.sampled_from([(1, 1), (1, 3), (3, 2)]))
    count = draw(st.integers(2, max_frames))
    times_us = [draw(start_times)]
    for _ in range(count - 1):
        times_us.append(times_us[-1] + draw(gaps))
    frames = np.empty((count, height, width))
    for y, x in np.ndindex(height, width):
        samples = [draw(base_levels)]
        for step in draw(st.lists(steps, min_size=count - 1, max_size=count - 1)):
            samples.append(next_sample(step, samples, c_on, c_off))
        frames[:, y, x] = samples
    return Sequence(c_on, c_off, times_us, list(frames))


def random_paths(count: int, frames: int) -> npt.NDArray[np.float64]:
    """(frames, count) random walks with jumps, the same in every run."""
    rng = np.random.default_rng(7)
    steps = rng.normal(0, 0.2, (frames, count)) + rng.choice([0, 1.5], (frames, count), p=[0.9, 0.1])
    walks: npt.NDArray[np.float64] = np.cumsum(steps, axis=0)
    return walks
