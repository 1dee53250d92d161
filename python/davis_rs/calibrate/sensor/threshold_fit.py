"""Fits contrast thresholds to frames: changes of log intensity between two, against the events in between."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...inspection.statistics.stream_statistics import Measured
from ...sensor.effects import ShotNoise
from .frame_pairs import GROUPS, FloatArray, FramePairs
from .signal_samples import SignalSamples

LEAST_PAIRS = 500
LEAST_PIXELS = 100
"""With fewer pairs of frames, or pixels, nothing is fitted."""

_BINS = 12
_OUTLIER = 5.0
_LARGEST_NOISE = 0.1
_ROUNDS = 12
_LEAST_SIGNIFICANCE = 10.0
_SHARES = (0.01, 0.5)
_LAG_SIGMA_S = 0.01
_NOISE_SHARE, _LEAST_NOISE = 0.3, 0.06
"""What noise of quiet pixels says of that of the others is so uncertain; noise that makes too few events to be seen is
about so large compared with a threshold, at most."""
_LEAD_ERROR = 0.1
"""What :func:`lead` errs by, in standard deviations of noise. A lag errs by the time that the signal takes for it."""
_CURVATURE, _NOISY_CURVATURE = 0.0012, 0.02
"""Where a signal turns often compared with thresholds, curves between events err, and pixels with low thresholds are
preferred. Thresholds of simulated streams err by up to this share over the square of the share of samples around which
the signal does not turn, with any number of events; it is added to all errors. Noise adds the second number, times its
variance over the square of the threshold."""
_LAG_LOSS, _LAG_LOSS_ERROR, _MOST_LAG_LOSS = 4.0, 0.25, 0.16
"""Noise moves the times of events, so that slopes err, and a regression on regressors that err gives too small a lag:
by the first number times the variance of noise over the square of the threshold, as a share. In simulated streams that
is right to a quarter, up to the third number. Larger noise may be signal of pixels that seem to be quiet: lags are left
as they are then, and that number is their error."""
_LEAST_STRAIGHT = 0.3
"""With a smaller share of such samples no mismatch is told."""
_COMMON_ERROR = 0.15
"""Which share of a pixel's errors its two halves may have in common."""
_LAG_SHARE, _MISMATCH_SHARE, _PARITY = 0.025, 0.015, 0.0007
"""Likewise, as a share of the lag and of the mismatch, and as the parity itself."""
_JACKKNIFE = 1.1
"""By how much errors of the jackknife are too small, because groups of tiles are few and light is common to them."""


@dataclass(frozen=True)
class ThresholdFit:
    """Thresholds and what had to be known with them.

    Attributes:
        on, off: C_on and C_off, means of the pixels.
        mismatch: standard deviation of a pixel's own threshold as a share; None where pixels have too few pairs.
        parity: by which share thresholds of even columns are lower, and those of odd ones higher.
        lag_s: how much later events are than the frames' light; what goes with light is not in it, if that is fitted.
        lag_by_light: the lag's other part, times a pixel's value above black: that of the photoreceptor, whose corner
            is proportional to light. None where one lag is fitted to all pixels.
        black: value of a frame without light, in the frames' own units.
        pixels, pairs: that were used.
        outliers: share of the pairs that were left out as no sum of events and noise.
        noise: standard deviation of a pair's log ratio that is not explained, the median.
    """

    on: Measured
    off: Measured
    mismatch: Measured | None
    parity: Measured
    lag_s: Measured
    lag_by_light: Measured | None
    black: Measured
    pixels: int
    pairs: int
    outliers: float
    noise: float


class NotIdentifiable(Exception):
    """Says what a recording does not tell, and why."""


def fit_thresholds(
    samples: SignalSamples,
    width: int,
    *,
    leak_hz: Measured | None = None,
    black: Measured | None = None,
    left_out: npt.NDArray[np.bool_] | None = None,
    over_light: bool = False,
    noise: float | None = None,
) -> ThresholdFit:
    """Fit thresholds to the samples of a recording with frames.

    For a pixel and two of its samples

        ln(I2 / I1) = n_on C_on - n_off C_off + lag (s2 - s1) - leak C_on t + error,   I = value - black

    where counts hold fractions of events, and s is the slope of log intensity that they have. A photoreceptor of first
    order lags by exactly that. Noise takes the signal over a level before it is there (:func:`lead`), which is added
    with a factor that the noise of quiet pixels tells roughly. With ``over_light`` the lag is lag_s + lag_by_light / I
    at each sample. The error is the frames', counts have next to none: so ordinary regression is unbiased for
    thresholds. Slopes err where noise moves the times of events. Lags come out too small by that, which is undone.
    Errors are weighted by what pairs of the same brightness scatter; outliers are left out (Tukey's biweight).

    Thresholds of a pixel are normal about the sensor's mean, apart from the parity of columns; mean, lag and black
    level are those of generalised least squares. A pixel with low thresholds has more events, so its error seems to be
    smaller, and a mean weighted by errors would be too low. Weights therefore go by the error as a share of the pixel's
    own threshold, shrunk to the mean by its own error, which takes that out to second order.

    Mismatch is the covariance between thresholds from the first and from the second half of a pixel's pairs, in which
    the errors of frames do not appear.

    Errors are those of the jackknife over groups of tiles.

    Args:
        samples: of :class:`SignalSampler`.
        width: of the sensor in pixels.
        leak_hz: what is known of the leak; None for nothing.
        black: what is known of the black level; None for nothing.
        left_out: bool (H, W): pixels that are not used, such as hot ones.
        over_light: whether the lag has a second part, which goes by 1 / I.
        noise: standard deviation of the noise over the threshold, roughly; None where it is not known.

    Raises:
        NotIdentifiable: where the samples do not tell, with the reason.
    """
    pairs = FramePairs(samples, width, left_out)
    if len(pairs) < LEAST_PAIRS or len(pairs.pixel) < LEAST_PIXELS:
        raise NotIdentifiable(
            f"{samples.frames} frames make {len(pairs):,} pairs in {len(pairs.pixel):,} pixels in which events show "
            f"how the signal went; {LEAST_PAIRS} in {LEAST_PIXELS} are needed"
        )
    regression = _Regression(pairs, leak_hz or Measured(0.0, 0.3), black, over_light, noise)
    for _ in range(_ROUNDS):
        regression.improve()
    return regression.result()


def lead(noise: float, rate_hz: FloatArray) -> FloatArray:
    """Return how far a steady signal is from the levels of its events, in standard deviations of the noise.

    The mean distance at which noise takes it over a level, behind two equal poles at their usual corner: sqrt(1.65
    ln(1 + k^2 / (k + 0.9))), where k is corner times noise over rate. Within 0.1 of what the engine does.

    Args:
        noise: standard deviation over the threshold.
        rate_hz: events a second that the signal makes.
    """
    k = ShotNoise.bandwidth_hz * noise / np.maximum(rate_hz, 1e-3)
    return np.asarray(np.sqrt(1.65 * np.log1p(k**2 / (k + 0.9))))


class _OfPixels(NamedTuple):
    """Regressions of all pixels: thresholds (2, m), their errors (2, m), infinite where there are no events."""

    value: FloatArray
    error: FloatArray


_LAG, _BLACK, _LEAK, _LEAD, _LAG_BY_LIGHT = range(5)
_ON_EVEN, _OTHERS = 0, 4
"""Unknowns of all pixels: thresholds (ON even, ON odd, OFF even, OFF odd), then lag, step of the black level, leak,
the lead of events by noise, and the lag's part that goes by 1 / I, if it is asked for."""


class _Regression:
    """Made better round by round: unknowns of all, thresholds of pixels, weights."""

    def __init__(
        self, pairs: FramePairs, leak_hz: Measured, black: Measured | None, over_light: bool, noise: float | None
    ) -> None:
        self.pairs, self.leak_known, self.black_known = pairs, leak_hz, black
        dark, usual = (float(np.quantile(pairs.value, share)) for share in (0.001, 0.5))
        self.most_black = dark - 0.02 * (usual - dark)
        self.black = min(0.0 if black is None else black.value, self.most_black)
        self.others = np.array([0.0, 0.0, leak_hz.value, 0.0, 0.0][: 5 if over_light else 4])
        self.mean = np.full((2, 2), 0.2)  # (polarity, odd column)
        self.share = 0.1
        self.own = np.full((2, len(pairs.pixel)), 0.2)
        self.shrink = np.zeros((2, len(pairs.pixel)))
        self.turn = 0
        self.noise = _LEAST_NOISE if noise is None else noise
        self.noise_known = Measured(0.0, _LEAST_NOISE) if noise is None else Measured(noise, _NOISE_SHARE * noise)

    def improve(self) -> None:
        """Make one round."""
        self.columns()
        self.weigh()
        self.solve()
        self.turn += 1

    def columns(self) -> None:
        """Compute the log ratio, and what each unknown adds to it, at the present unknowns."""
        pairs, (on, off) = self.pairs, self.own[:, self.pairs.own]
        light = np.maximum(pairs.value - self.black, 1e-3 * float(np.median(pairs.value)))
        self.ratio = np.diff(np.log(light), axis=0)[0]
        self.middle = light.mean(axis=0)
        self.moves = np.stack([on * pairs.on, -off * pairs.off])
        # The slope goes with a pixel's own threshold. With the mean, pixels with low thresholds would have slopes that
        # are too steep, and weigh more: lags came out 5 % too small.
        slope = np.where(pairs.rate > 0, on, off) * pairs.rate
        # 1 / I at both samples, as a share of that of the usual pair.
        self.usual = float(np.median(self.middle))
        change = np.exp(on * pairs.on - off * pairs.off)
        dark = self.usual / (2 * self.middle) * np.stack([1 + change, 1 + 1 / change])
        # Noise takes a signal over a level before it is there.
        ahead = np.sign(pairs.rate) * np.where(pairs.rate > 0, on, off) * lead(self.noise, np.abs(pairs.rate))
        # What else the unknowns add is told by events and the sensor's mean: neither the noise of frames nor what a
        # pixel's threshold has of its own may be in a regressor.
        on, off = self.mean.mean(axis=1)
        by_black = -2 * np.sinh((on * pairs.on - off * pairs.off) / 2) / self.middle
        unknown = [
            slope[1] - slope[0],
            by_black,
            -(pairs.t_s[1] - pairs.t_s[0]) * on,
            -np.diff(ahead, axis=0)[0],
            np.diff(slope * dark, axis=0)[0],
        ]
        self.unknown = np.stack(unknown[: len(self.others)])

    def weigh(self) -> None:
        """Weights: by what pairs of the same brightness scatter, and what lies far off has none."""
        residual = self.ratio - self.moves.sum(axis=0) - self.others @ self.unknown
        uncertain = self.share**2 * (1 - self.shrink[:, self.pairs.own])
        spread = (uncertain * self.moves**2).sum(axis=0)
        order = np.argsort(self.middle)
        bins = np.empty(len(order), np.int64)
        bins[order] = np.arange(len(order)) * _BINS // len(order)
        sigma = np.empty(_BINS)
        for k in range(_BINS):
            here, known = residual[bins == k], spread[bins == k]
            calm = known <= np.median(known)
            variance = (1.4826 * np.median(np.abs(here[calm]))) ** 2 - np.median(known[calm])
            sigma[k] = math.sqrt(max(variance, 1e-6))
        self.sigma = sigma[bins]
        scaled = np.abs(residual) / np.sqrt(self.sigma**2 + spread)
        biweight = np.maximum(1 - (scaled / _OUTLIER) ** 2, 0) ** 2
        robust = biweight if self.turn > 3 else 1 / np.maximum(1, scaled / 1.5)
        self.inside = robust > 0
        bright = self.sigma <= max(_LARGEST_NOISE, 1.5 * float(sigma.min()))
        self.weight = robust * bright / self.sigma**2

    def solve(self) -> None:
        """Fit thresholds of pixels, then what they have in common."""
        pairs = self.pairs
        fitted = self.of_pixels(self.weight, self.ratio)
        # What each unknown does to the thresholds that a pixel's own regression gives.
        effect = np.stack([self.of_pixels(self.weight, one).value for one in self.unknown], axis=1)
        self.found, self.effect = fitted, effect
        known = np.isfinite(fitted.error)
        relative = np.where(known, fitted.error, 1e6) / self.own
        certain = known * self.share**2 / (self.share**2 + relative**2)
        # Where only pixels with low thresholds have enough events, they would be preferred: the pixels around tell.
        self.surroundings = np.maximum(pairs.around(certain), 0)
        weight = certain * self.surroundings**4 / (self.share * self.mean[:, pairs.odd]) ** 2
        count = _OTHERS + len(self.others)
        normal, right = np.zeros((GROUPS, count, count)), np.zeros((GROUPS, count))

        def grouped(values: FloatArray) -> FloatArray:
            return np.asarray(np.bincount(pairs.group, values, GROUPS), np.float64)

        # Between pixels: value = threshold + effect . unknowns.
        for polarity in (0, 1):
            w, value, slopes = weight[polarity], fitted.value[polarity], effect[polarity]
            for odd in (0, 1):
                k, here = 2 * polarity + odd, w * (pairs.odd == odd)
                normal[:, k, k] += grouped(here)
                right[:, k] += grouped(here * value)
                for a in range(len(self.others)):
                    cross = grouped(here * slopes[a])
                    normal[:, k, _OTHERS + a] += cross
                    normal[:, _OTHERS + a, k] += cross
            for a in range(len(self.others)):
                right[:, _OTHERS + a] += grouped(w * slopes[a] * value)
                for b in range(len(self.others)):
                    normal[:, _OTHERS + a, _OTHERS + b] += grouped(w * slopes[a] * slopes[b])
        # Within pixels: what their own thresholds leave. Where ON and OFF events always come together they have none.
        inside = self.weight * np.asarray(known.any(axis=0))[pairs.own]
        left = [one - self.explained(effect[:, a]) for a, one in enumerate(self.unknown)]
        rest = self.ratio - self.explained(fitted.value)
        for a in range(len(self.others)):
            right[:, _OTHERS + a] += grouped(pairs.sum(inside * left[a] * rest))
            for b in range(len(self.others)):
                normal[:, _OTHERS + a, _OTHERS + b] += grouped(pairs.sum(inside * left[a] * left[b]))
        self.normal, self.right = normal, right
        self.pixel_weight = weight
        solved = self.solved(normal.sum(axis=0), right.sum(axis=0))
        self.mean = np.maximum(solved[:4].reshape(2, 2), 1e-3)
        step = solved[_OTHERS + _BLACK]
        self.others = solved[_OTHERS:].copy()
        self.others[_BLACK] = 0.0
        self.at_black = self.black + float(step)
        value = fitted.value - np.tensordot(solved[_OTHERS:], effect, (0, 1))
        self.spread(value, relative)
        if self.turn < _ROUNDS - 1:
            most = 0.7 * (self.most_black - self.black)
            self.black += float(np.clip(step, -0.3 * float(np.median(self.middle)), max(most, 0.0)))

    def of_pixels(self, weight: FloatArray, rest: FloatArray) -> _OfPixels:
        """Return each pixel's regression of anything on its events."""
        total, on, off = self.pairs.sum, self.pairs.on, -self.pairs.off
        a, b, c = total(weight * on * on), total(weight * on * off), total(weight * off * off)
        u, v = total(weight * on * rest), total(weight * off * rest)
        determinant = a * c - b * b
        both = determinant > 0.05 * a * c
        with np.errstate(divide="ignore", invalid="ignore"):
            value = np.where(both, np.stack([c * u - b * v, a * v - b * u]) / determinant, 0.0)
            error = np.where(both, np.sqrt(np.stack([c, a]) / determinant), np.inf)
            for k, (mine, other, moment) in enumerate(((a, c, u), (c, a, v))):
                alone = (mine > 0) & (other == 0)
                value[k, alone], error[k, alone] = (moment / mine)[alone], (1 / np.sqrt(mine))[alone]
        return _OfPixels(value, error)

    def explained(self, thresholds: FloatArray) -> FloatArray:
        """Return what thresholds (2, m) of the pixels explain."""
        on, off = thresholds[:, self.pairs.own]
        return np.asarray(on * self.pairs.on - off * self.pairs.off, np.float64)

    def solved(self, normal: FloatArray, right: FloatArray) -> FloatArray:
        """Return the unknowns of all, with what is known of them beforehand."""
        normal, right = normal.copy(), right.copy()
        black = self.black_known or Measured(self.black, 1e3 * float(np.median(self.middle)))
        lag = Measured(0.0, _LAG_SIGMA_S)
        priors = (lag, Measured(black.value - self.black, black.sigma), self.leak_known, self.noise_known, lag)
        for k, (value, sigma) in enumerate(priors[: len(self.others)], _OTHERS):
            normal[k, k] += 1 / max(sigma, 1e-6) ** 2
            right[k] += value / max(sigma, 1e-6) ** 2
        return np.asarray(np.linalg.solve(normal, right), np.float64)

    def spread(self, value: FloatArray, relative: FloatArray) -> None:
        """Fit mismatch, and each pixel's thresholds shrunk to the mean by their errors."""
        pairs, centre = self.pairs, self.mean[:, self.pairs.odd]
        rest = self.ratio - self.others @ self.unknown - (self.at_black - self.black) * self.unknown[_BLACK]
        first, second = (self.of_pixels(self.weight * (pairs.half == half), rest) for half in (0, 1))
        known = np.isfinite(first.error) & np.isfinite(second.error)
        with np.errstate(invalid="ignore"):
            error2 = (first.error**2 + second.error**2) / 2 / self.own**2
        off = np.maximum(np.abs(first.value / centre - 1), np.abs(second.value / centre - 1))
        known &= off < _OUTLIER * np.sqrt(self.share**2 + 2 * np.where(known, error2, 0))
        self.product = np.where(known, (first.value / centre - 1) * (second.value / centre - 1), 0.0)
        self.importance = np.where(known, 1 / (self.share**2 + error2) ** 2, 0.0)
        self.error2 = float(np.average(np.where(known, error2, 0), weights=self.importance + 1e-300))
        self.mismatch2 = float((self.product * self.importance).sum() / max(self.importance.sum(), 1e-300))
        self.share = min(max(math.sqrt(max(self.mismatch2, 0.0)), _SHARES[0]), _SHARES[1])
        self.shrink = self.share**2 / (self.share**2 + relative**2)
        self.own = centre * np.clip(1 + self.shrink * (value / centre - 1), 0.3, 3.0)

    def result(self) -> ThresholdFit:
        """Return what was found, with errors.

        Raises:
            NotIdentifiable: where frames do not follow the events.
        """
        groups = np.unique(self.pairs.group)
        whole_normal, whole_right = self.normal.sum(axis=0), self.right.sum(axis=0)
        table = np.array([self.summary(self.solved(whole_normal - self.normal[g], whole_right - self.right[g]),
                                       self.pairs.group != g) for g in groups])  # fmt: skip
        estimate = np.array(
            self.summary(self.solved(whole_normal, whole_right), np.ones(len(self.pairs.pixel), np.bool_))
        )
        n = len(groups)
        sigma = _JACKKNIFE * np.sqrt((n - 1) / n * ((table - table.mean(axis=0)) ** 2).sum(axis=0))
        # What is known beforehand is the same for all groups; its error is that of the solution.
        lags = [_OTHERS + _LAG, *range(_OTHERS + _LAG_BY_LIGHT, len(whole_right))]
        for k, known in ((_BLACK, self.black_known), (_LEAK, self.leak_known), (_LEAD, self.noise_known)):
            if known is not None:
                unit = np.zeros(len(whole_right))
                unit[_OTHERS + k] = 1 / max(known.sigma, 1e-6)
                moved = self.solved(whole_normal, whole_right + unit) - self.solved(whole_normal, whole_right)
                sigma[:2] = np.hypot(sigma[:2], [moved[:2].mean(), moved[2:4].mean()])
                sigma[5:] = np.hypot(sigma[5:], moved[lags])
        preferred = self.share**2 * (1 - np.average(self.surroundings, weights=self.pixel_weight))
        curvature = (_CURVATURE + _NOISY_CURVATURE * self.noise**2) / max(self.pairs.straight_share, 0.01) ** 2
        sigma[:2] = np.hypot(sigma[:2], estimate[:2] * math.hypot(curvature, preferred))
        sigma[3] = math.hypot(sigma[3], 2 * _MISMATCH_SHARE * estimate[3], _COMMON_ERROR * self.error2)
        sigma[2] = math.hypot(sigma[2], _PARITY)
        sigma[4] = math.hypot(sigma[4], curvature * self.usual)
        sigma[5:] = np.hypot(sigma[5:], math.hypot(_LAG_SHARE, 3 * curvature) * estimate[5:])
        loss = _LAG_LOSS * self.noise**2
        loss, of_loss = (loss, _LAG_LOSS_ERROR * loss) if loss <= _MOST_LAG_LOSS else (0.0, _MOST_LAG_LOSS)
        estimate[5:] /= 1 - loss
        sigma[5:] = np.hypot(sigma[5:] / (1 - loss), of_loss * estimate[5:])
        rate_hz = math.sqrt(np.average((self.pairs.rate**2).mean(axis=0), weights=self.weight))
        sigma[5] = math.hypot(sigma[5], _LEAD_ERROR * max(float(self.others[_LEAD]), 0.0) / max(rate_hz, 1.0))
        on, off, parity, mismatch2, black, lag, *by_light = (
            Measured(float(a), float(b)) for a, b in zip(estimate, sigma, strict=True)
        )
        if not (on.value > _LEAST_SIGNIFICANCE * on.sigma and off.value > _LEAST_SIGNIFICANCE * off.sigma):
            raise NotIdentifiable(f"log intensity of frames follows events too loosely: C_on {on}, C_off {off}")
        mismatch = None
        if mismatch2.value > 3 * mismatch2.sigma and self.pairs.straight_share > _LEAST_STRAIGHT:
            deviation = math.sqrt(mismatch2.value)
            mismatch = Measured(deviation, mismatch2.sigma / (2 * deviation))
        return ThresholdFit(
            on, off, mismatch, parity, lag,
            Measured(by_light[0].value * self.usual, by_light[0].sigma * self.usual) if by_light else None,
            black,
            pixels=int(np.count_nonzero(self.pixel_weight.sum(axis=0))),
            pairs=int(np.count_nonzero(self.weight)),
            outliers=1 - float(self.inside.mean()),
            noise=float(np.median(self.sigma)),
        )  # fmt: skip

    def summary(self, solved: FloatArray, kept: npt.NDArray[np.bool_]) -> list[float]:
        """Return C_on, C_off, parity, mismatch^2, black level, lag, its part that goes by 1 / I in the usual light."""
        (on_even, on_odd), (off_even, off_odd) = solved[:4].reshape(2, 2)
        parity = ((on_odd - on_even) / (on_odd + on_even) + (off_odd - off_even) / (off_odd + off_even)) / 2
        importance = self.importance * kept
        mismatch2 = (self.product * importance).sum() / max(importance.sum(), 1e-300)
        on, off = (on_even + on_odd) / 2, (off_even + off_odd) / 2
        black = self.black + solved[_OTHERS + _BLACK]
        return [on, off, parity, mismatch2, black, solved[_OTHERS + _LAG], *solved[_OTHERS + _LAG_BY_LIGHT :]]
