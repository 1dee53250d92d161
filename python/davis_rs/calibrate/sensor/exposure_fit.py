"""Fits contrast thresholds to pairs of frames and all events in between, with the blur of their exposures."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...inspection.statistics.stream_statistics import Measured
from .exposure_pairs import ExposurePairs, FloatArray

GROUPS = 24
"""Errors come from leaving out one group of tiles at a time."""

LEAST_PAIRS, LEAST_EVENTS = 200, 100

_ROUNDS = 25
_OUTLIER = 4.0
_BINS = 8
_DARKEST = 0.02
"""Pairs below this fraction of the usual value are left out: noise there is not small against the light."""

_MODEL = 0.04
"""What thresholds of simulated streams err by, as a fraction, however many pairs there are: pixels with low thresholds
have more events, and light does not run straight between two of them."""

_LEAST_CLOSED = 0.1
"""Fraction of the pairs that lie between events on either side, below which nothing is fitted."""

_RANGE = (0.03, 2.0)
_LEAST_SIGNIFICANCE = 5.0


@dataclass(frozen=True)
class ExposureFit:
    """Holds thresholds, and what had to be known with them.

    Attributes:
        on, off: C_on and C_off, means over the pixels.
        black: the value of a frame without light, in the frames' own units; below it by the dark current.
        pairs: that were used.
        noise: standard deviation of a pair's log ratio that is not explained.
        blurred: the fraction of the pairs' events that fall into exposures.
    """

    on: Measured
    off: Measured
    black: Measured
    pairs: int
    noise: float
    blurred: float


class _Unknowns(NamedTuple):
    on: float
    off: float
    open_before: float
    open_after: float
    dark: float


def fit_exposures(pairs: ExposurePairs, *, leak_hz: float = 0.0, black: Measured | None = None) -> ExposureFit | str:
    """Fit thresholds to all pairs of frames; or say why there are none.

    A frame is the mean of the light over its exposure. Events tell how log intensity goes within it: from its middle,
    by n_on C_on - n_off C_off. So with E = ln mean exp(n_on C_on - n_off C_off) over each exposure

        ln(I2 / I1) = n_on C_on - n_off C_off + E2 - E1 + b2 p2 - b1 p1 + error,    I = value - black

    where n counts events from middle to middle, with fractions. That is the event-based double integral, solved for the
    thresholds; of short exposures E is 0. p is 0 but where a frame lies before a pixel's first event, or behind its
    last one, of polarity p: there nothing tells the fraction, and b is what it is in the mean.

    Pairs weigh by what pairs of their brightness scatter, and outliers are left out (Tukey's biweight). Errors are
    those of the jackknife over groups of tiles.

    Args:
        pairs: of :func:`~davis_rs.calibrate.sensor.exposure_pairs.exposure_pairs`, in ``GROUPS`` groups.
        leak_hz: of the pixels.
        black: what is known of the black level; None for nothing.

    Source: Pan, Scheerlinck, Yu, Hartley, Liu, Dai, "Bringing a blurry frame alive at high frame-rate with an event
    camera", CVPR 2019 (the double integral).
    """
    events = float((pairs.on + pairs.off).sum())
    fewest = min(float(np.abs(pairs.on).sum()), float(np.abs(pairs.off).sum()))
    if len(pairs.pixel) < LEAST_PAIRS or fewest < LEAST_EVENTS:
        need = f"{LEAST_PAIRS} with {LEAST_EVENTS} events of each polarity are needed"
        return f"{len(pairs.pixel):,} pairs of frames have {events:,.0f} events in between, {need}"
    closed = float((pairs.open_ends == 0).all(axis=0).mean())
    if closed < _LEAST_CLOSED:
        return f"only {100 * closed:.2g} % of the pairs of frames lie between events on either side"
    fit = _Fit(pairs, leak_hz, black)
    whole = fit.solve(np.ones(len(pairs.pixel), np.bool_), None)
    if whole is None:
        return "log intensity of frames does not follow the events between them"
    groups = np.unique(pairs.group)
    without_group = np.array([fit.solve(pairs.group != group, whole) or whole for group in groups])
    n = len(groups)
    sigma = np.sqrt((n - 1) / n * ((without_group - without_group.mean(axis=0)) ** 2).sum(axis=0))
    on, off = (
        Measured(value, math.hypot(error, _MODEL * value))
        for value, error in zip(whole[:2], sigma[:2].tolist(), strict=True)
    )
    if on.value < _LEAST_SIGNIFICANCE * on.sigma or off.value < _LEAST_SIGNIFICANCE * off.sigma:
        return f"log intensity of frames follows events too loosely: C_on {on}, C_off {off}"
    within = sum(float((np.diff(inside.row) == 0).sum()) for inside in pairs.inside) / 2
    return ExposureFit(
        on, off, Measured(whole.dark, float(sigma[4])), int(np.count_nonzero(fit.weight)), fit.scatter, within / events
    )


class _Fit:
    """Gauss-Newton steps over all unknowns, with weights that follow the residuals."""

    def __init__(self, pairs: ExposurePairs, leak_hz: float, black: Measured | None) -> None:
        self.pairs, self.on = pairs, pairs.on - leak_hz * pairs.seconds
        self.usual = float(np.median(pairs.value))
        lowest = float(np.quantile(pairs.value, 0.001))
        self.most_black = lowest - 0.01 * (self.usual - lowest)
        known = black or Measured(min(0.0, self.most_black), 0.05 * self.usual)
        self.black = Measured(min(known.value, self.most_black), max(known.sigma, 1e-6 * self.usual))
        self.weight = np.ones(len(pairs.pixel))
        self.scatter = math.nan

    def solve(self, kept: np.ndarray[tuple[int], np.dtype[np.bool_]], start: _Unknowns | None) -> _Unknowns | None:
        """Return the unknowns of some of the pairs; None where the steps lead nowhere."""
        at = start or _Unknowns(0.25, 0.25, 0.0, 0.0, self.black.value)
        for turn in range(_ROUNDS if start is None else 4):
            residual, columns = self.linearised(at)
            if start is None:
                self.weigh(residual, turn)
            weight = self.weight * kept
            normal = (columns * weight) @ columns.T
            right = (columns * weight) @ residual
            normal[4, 4] += self.black.sigma**-2
            right[4] += (self.black.value - at.dark) / self.black.sigma**2
            scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
            ridge = 1e-9 * np.eye(5)
            try:
                step = np.linalg.solve(normal / np.outer(scale, scale) + ridge, right / scale) / scale
            except np.linalg.LinAlgError:
                return None
            step[:4] = np.clip(step[:4], -0.1, 0.1)
            moved = np.array(at) + step
            moved[:2] = np.clip(moved[:2], *_RANGE)
            moved[2:4] = np.clip(moved[2:4], -0.5, 0.5)
            moved[4] = min(moved[4], self.most_black)
            at = _Unknowns(*moved.tolist())
        if not np.isfinite(at).all() or min(at.on, at.off) <= _RANGE[0] or max(at.on, at.off) >= _RANGE[1]:
            return None
        return at

    def linearised(self, at: _Unknowns) -> tuple[FloatArray, FloatArray]:
        """Return by how much values miss each other when both are brought to the instant between them, as a fraction of
        their mean, and what each unknown adds to that, (5, n).

        Noise is in the values, and the scale does not follow the unknowns. Log ratios would: a black level far below
        all values makes them small, and the thresholds with them.
        """
        pairs, rows = self.pairs, len(self.pairs.pixel)
        light = np.maximum(pairs.value - at.dark, 1e-3 * self.usual)
        first, second = (inside.log_mean(at.on, at.off, rows) for inside in pairs.inside)
        blur, by_on, by_off = (late - early for early, late in zip(first, second, strict=True))
        explained = at.on * self.on - at.off * pairs.off + blur
        explained += at.open_after * pairs.open_ends[1] - at.open_before * pairs.open_ends[0]
        up, down = np.exp(explained / 2), np.exp(-explained / 2)
        scale = np.maximum(pairs.value.mean(axis=0) - self.black.value, 1e-3 * self.usual)
        residual = (light[1] * down - light[0] * up) / scale
        steep = (light[1] * down + light[0] * up) / (2 * scale)
        moves = np.stack([self.on + by_on, -pairs.off + by_off, -pairs.open_ends[0], pairs.open_ends[1]])
        return residual, np.concatenate([steep * moves, ((down - up) / scale)[None]])

    def weigh(self, residual: FloatArray, turn: int) -> None:
        """Weigh pairs by what those of their brightness scatter."""
        level = self.pairs.value.min(axis=0)
        order = np.argsort(level)
        sigma = np.empty(len(residual))
        for chunk in np.array_split(order, _BINS):
            sigma[chunk] = max(1.4826 * float(np.median(np.abs(residual[chunk]))), 1e-3)
        scaled = np.abs(residual) / sigma
        robust = np.maximum(1 - (scaled / _OUTLIER) ** 2, 0) ** 2 if turn > 4 else 1 / np.maximum(1, scaled / 1.5)
        self.weight = robust * (level > _DARKEST * self.usual) / sigma**2
        self.scatter = float(np.median(sigma))
