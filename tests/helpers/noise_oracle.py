"""Follows pixels under shot noise in small steps of time: the oracle that the engine's noise is tested against.

Written from what ``ShotNoise`` says, not from the engine: a Gaussian process behind two poles is added to the signal, a
level is reached where a step ends at or beyond it, and the reference moves to that level.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from davis_rs.geometry.pose import FloatArray

STEPS_A_TIME_CONSTANT = 50
"""Steps over the time constant of the faster pole."""


@dataclass(frozen=True)
class TwoPoles:
    """White noise behind two first-order low-passes.

    Attributes:
        photoreceptor_hz, follower_hz: the corners of both.
        rms: standard deviation behind both.
    """

    photoreceptor_hz: float
    follower_hz: float
    rms: float

    @property
    def step_s(self) -> float:
        return 1 / (2 * math.pi * max(self.photoreceptor_hz, self.follower_hz) * STEPS_A_TIME_CONSTANT)

    def transition(self, step_s: float) -> tuple[FloatArray, FloatArray]:
        """The matrix that takes (first output, second output) over a step, and the root of what noise adds to them."""
        a, b = (2 * math.pi * hz * step_s for hz in (self.photoreceptor_hz, self.follower_hz))
        b *= 1 + 1e-6 * (a == b)  # not a double root
        across = b * (math.exp(-a) - math.exp(-b)) / (b - a)
        step = np.array([[math.exp(-a), 0.0], [across, math.exp(-b)]])
        root = np.linalg.cholesky(self.covariance - step @ self.covariance @ step.T)
        return step, root

    @property
    def covariance(self) -> FloatArray:
        """Of both outputs in the stationary state."""
        first = self.rms**2 * (1 + self.photoreceptor_hz / self.follower_hz)
        return np.array([[first, self.rms**2], [self.rms**2, self.rms**2]])


def noisy_events(
    poles: TwoPoles,
    c: tuple[float, float],
    signal: Callable[[float], float],
    *,
    pixels: int,
    seconds: float,
    seed: int = 1,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times in seconds, pixels and polarities (1 or -1) of the events of pixels whose references begin at 0."""
    random = np.random.default_rng(seed)
    step, root = poles.transition(poles.step_s)
    noise = np.linalg.cholesky(poles.covariance) @ random.standard_normal((2, pixels))
    reference = np.zeros(pixels)
    events: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    for k in range(1, int(seconds / poles.step_s) + 1):
        noise = step @ noise + root @ random.standard_normal((2, pixels))
        seen = signal(k * poles.step_s) + noise[1]
        while True:
            moved = (seen >= reference + c[0]).astype(int) - (seen <= reference - c[1])
            hit = np.flatnonzero(moved)
            if not len(hit):
                break
            events.append((np.full(len(hit), k * poles.step_s), hit.astype(float), moved[hit].astype(float)))
            reference += np.where(moved > 0, c[0], -c[1]) * (moved != 0)
    if not events:
        return np.zeros(0), np.zeros(0), np.zeros(0)
    t, pixel, polarity = (np.concatenate(values) for values in zip(*events, strict=True))
    return t, pixel, polarity
