"""Leak and noise from pixels that see no signal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..stream_statistics import StreamStatistics
from ..stream_statistics.stream_statistics import Measured
from .finding import Finding, combined


def find_leak(recordings: Sequence[StreamStatistics]) -> tuple[Finding, ...]:
    leaks, noise, scatter = [], [], []
    for one in recordings:
        off, on = (counts[one.quiet].astype(np.float64) for counts in one.counts)
        if not len(on):
            continue
        events = one.counts.sum(axis=0)
        seen = neighbours_with_events(events, one.quiet)
        if seen.observed > seen.expected + 4 * math.sqrt(seen.expected) + 3:
            why = (
                f"the quietest pixels of {one.name} see signal: {seen.observed} pairs of neighbours have events, "
                f"{seen.expected:.3g} would by chance"
            )
            return tuple(Finding(*names, None, why) for names in (_LEAK, _NOISE))
        least = 1 / (len(on) * one.duration_s)
        noise.append(_mean(2 * off, one.duration_s, 2 * least))
        # Noise adds to ON less OFF events where a pixel's thresholds differ, so pixels with the least of it tell.
        calm = off <= np.quantile(off, _CALM_SHARE)
        leaks.append(_mean((on - off)[calm], one.duration_s, 1 / (int(calm.sum()) * one.duration_s)))
        scatter.append(float(events[one.quiet].var() / max(events[one.quiet].mean(), 1e-300)))
    if not leaks:
        return tuple(Finding(*names, None, "no pixel is quiet") for names in (_LEAK, _NOISE))
    pairs = f"its rms needs thresholds and recordings of known light; it makes {combined(noise)} Hz here"
    leak = combined(leaks)
    if leak.value < -3 * leak.sigma:
        said = f"ON less OFF events of quiet pixels are {leak} Hz, and a leak makes ON events"
        return Finding(*_LEAK, None, said), Finding(*_NOISE, None, pairs)
    note = (
        f"ON less OFF events of {sum(int(one.quiet.sum()) for one in recordings):,} quiet pixels, whose counts scatter "
        f"{max(scatter):.2g} times as much as those of a Poisson process"
    )
    sigma = math.hypot(leak.sigma, _MODEL_SHARE * leak.value)
    return Finding(*_LEAK, Measured(max(leak.value, 0.0), sigma), note), Finding(*_NOISE, None, pairs)


_LEAK, _NOISE = ("leak", "leak_rate_hz"), ("shot noise", "shot_noise_rms")


_CALM_SHARE = 0.3
_MODEL_SHARE = 0.025
"""What leaks of simulated streams with noise are off, however long they are."""


class Pairs(NamedTuple):
    """Diagonal neighbours that both have events, and how many there would be if pixels fired independently."""

    observed: int
    expected: float


def neighbours_with_events(counts: npt.NDArray[np.int64], quiet: npt.NDArray[np.bool_]) -> Pairs:
    """Whether pixels fire together with their neighbours, as signal makes them, and noise does not.

    Diagonal neighbours, because quiet pixels were chosen by the ones next to them, see
    :data:`~davis_rs.stream_statistics.stream_statistics.QUIET_SHARE`.
    """
    fired = (counts > 0) & quiet
    share = float(fired.sum() / max(quiet.sum(), 1))
    observed, pairs = 0, 0
    for here, there in ((np.s_[:-1, :-1], np.s_[1:, 1:]), (np.s_[:-1, 1:], np.s_[1:, :-1])):
        pairs += int(np.count_nonzero(quiet[here] & quiet[there]))
        observed += int(np.count_nonzero(fired[here] & fired[there]))
    return Pairs(observed, pairs * share**2)


def _mean(counts: npt.NDArray[np.float64], duration_s: float, least: float) -> Measured:
    """Mean rate of pixels, with the standard deviation of their scatter."""
    scatter = float(counts.std(ddof=1)) / math.sqrt(len(counts)) / duration_s if len(counts) > 1 else math.inf
    return Measured(float(counts.mean()) / duration_s, max(scatter, least))
