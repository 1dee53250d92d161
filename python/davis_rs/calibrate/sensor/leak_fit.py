"""Fits leak from pixels that see no signal: its rate, how it differs from pixel to pixel, and how regular it is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...inspection.statistics import StreamStatistics
from ...inspection.statistics.stream_statistics import Measured
from .finding import Finding, combined
from .noise_fit import noise_of_threshold
from .quiet_pixels import DIAGONALS, mean_rate, quiet_or_noisy, signal_in

_LEAK = ("leak", "leak_rate_hz")
_SPREAD, _JITTER = ("leak's spread", "leak_spread"), ("leak's jitter", "leak_jitter")

_CALM_SHARE = 0.3
_MODEL_SHARE = 0.025
"""What leaks of simulated streams with noise are off, however long they are."""

_RATIO_SIGMA, _NOISE_SIGMA = 0.25, 0.15
"""Standard deviation of C_off / C_on where it is not known. What noise does to the leak of simulated streams otherwise,
as a share of its OFF events: pixels with much of it look hot, and others are few."""

_LEAST_EVENTS = 5.0
"""Leak events of a pixel in the mean, from which on its rate tells more than where its first event happens to be."""

_MOST_NOISE = 0.3
"""OFF events by leak events of the calm pixels, above which noise hides how the leak scatters."""

_LEAST_PAIRS, _LEAST_INTERVALS = 100, 100
_SPREAD_MODEL, _JITTER_MODEL = 0.02, 0.02
"""Shares that the models of spread and jitter err by, on simulated streams."""

_SCATTER_OF_LEAD, _SCATTER_SIGMA = 0.43, 0.5
"""How far from the level noise makes a slow leak's events scatters, in its standard deviations; how uncertain the
square of that is, as a share."""

_CHOICE_SIGMA = 0.4
"""Pixels without an OFF event are those whose intervals scatter less: by up to this share of the variance, times the
share of the pixels that have OFF events."""

_PHASE_VARIANCE, _PHASE_SIGMA = 1 / 6, 1 / 12
"""Variance of the number of ticks of a clock in a time, where the clock's phase is not known: from 0 to 1/4, because
the time is a whole number of periods or not."""


def find_leak(recordings: Sequence[StreamStatistics], off_over_on: float | None = None) -> Finding:
    """Return the mean rate: what references of quiet pixels moved by, in units of C_on.

    Each ON event moves a reference up by C_on, each OFF event down by C_off, whether they come of a leak or of noise.
    So a leak makes ON events less C_off / C_on times OFF events. All quiet pixels are counted: those without OFF
    events are those that no leak has taken to a level, where noise makes events of both polarities.

    Args:
        recordings: of the sensor.
        off_over_on: C_off / C_on; None if it is not known: it is taken as 1, within a quarter.
    """
    leaks, scatter = [], []
    for stream in recordings:
        if not stream.quiet.any():
            continue
        why = signal_in(stream) or _signal_hides_leak(stream)
        if why is not None:
            return Finding(*_LEAK, None, why)
        counted = quiet_or_noisy(stream, hot=False)
        off, on = (counts[counted].astype(np.float64) for counts in stream.counts)
        net = on - (1.0 if off_over_on is None else off_over_on) * off
        mean = mean_rate(net, stream.duration_s, 1 / (len(net) * stream.duration_s))
        unknown = (_RATIO_SIGMA if off_over_on is None else _NOISE_SIGMA) * float(off.mean()) / stream.duration_s
        leaks.append(Measured(mean.value, math.hypot(mean.sigma, unknown)))
        events = stream.counts.sum(axis=0)[stream.quiet]
        scatter.append(float(events.var() / max(events.mean(), 1e-300)))
    if not leaks:
        return Finding(*_LEAK, None, "no pixel is quiet")
    leak = combined(leaks)
    if leak.value < -3 * leak.sigma:
        said = f"ON less OFF events of quiet pixels are {leak} Hz, and a leak makes ON events"
        return Finding(*_LEAK, None, said)
    note = (
        f"ON less OFF events of {sum(int(one.quiet.sum()) for one in recordings):,} quiet pixels, whose counts scatter "
        f"{max(scatter):.2g} times as much as those of a Poisson process"
    )
    sigma = math.hypot(leak.sigma, _MODEL_SHARE * leak.value)
    return Finding(*_LEAK, Measured(max(leak.value, 0.0), sigma), note)


def _signal_hides_leak(stream: StreamStatistics) -> str | None:
    """Return why ON less OFF events of the calm pixels are no leak; None if they may be.

    Where nearly every pixel has events, :func:`signal_in` cannot tell. But if pixels have more OFF events than they
    have ON events above these, and the difference is alike in neighbours, it comes from what they see.
    """
    calm, net = _calm(stream), (stream.counts[1] - stream.counts[0]).astype(np.float64)
    extra, off = float(net[calm].mean()), float(stream.counts[0][calm].mean())
    pairs = np.concatenate([np.stack([net[a], net[b]])[:, calm[a] & calm[b]] for a, b in DIAGONALS], axis=1)
    if not 0 < extra < off or pairs.shape[1] < _LEAST_PAIRS or not pairs.std(axis=1).all():
        return None
    alike = float(np.corrcoef(pairs)[0, 1])
    # A pixel is in up to four pairs, so they count as fewer.
    if alike < 4 / math.sqrt(pairs.shape[1] / 2):
        return None
    return (
        f"the quietest pixels of {stream.name} see signal: they have {off:.3g} OFF events and {extra:.3g} ON events "
        f"more than these, which is alike in neighbours (correlation {alike:.2g})"
    )


def find_leak_variation(recordings: Sequence[StreamStatistics]) -> tuple[Finding, Finding]:
    """Return how rates differ from pixel to pixel, and how intervals of one pixel do, as shares of their means.

    The spread is that of ON less OFF events between diagonal neighbours, so that what varies smoothly over the sensor,
    as a signal or light does, is no part of it. Subtracted is what counts of one rate scatter: a clock's unknown phase,
    and the jitter. The jitter is the scatter of a pixel's intervals, where it has no OFF event, so hardly any noise.
    """
    told = [_variation(one) for one in recordings if one.quiet.any()]
    spreads, jitters = ([part for part in parts if isinstance(part, Measured)] for parts in zip(*told, strict=True))
    if not told:
        return Finding(*_SPREAD, None, "no pixel is quiet"), Finding(*_JITTER, None, "no pixel is quiet")
    why_spread, why_jitter = ("; ".join(sorted({str(one) for one in parts})) for parts in zip(*told, strict=True))
    return (
        Finding(*_SPREAD, combined(spreads), "of rates, between diagonal neighbours")
        if spreads
        else Finding(*_SPREAD, None, why_spread),
        Finding(*_JITTER, combined(jitters), "of intervals of pixels that have no OFF event")
        if jitters
        else Finding(*_JITTER, None, why_jitter),
    )


class _Variation(NamedTuple):
    """Holds what one recording tells of both, or why it does not."""

    spread: Measured | str
    jitter: Measured | str


def _variation(stream: StreamStatistics) -> _Variation:
    why = signal_in(stream)
    if why is not None:
        return _Variation(why, why)
    calm = _calm(stream)
    off, on = (counts.astype(np.float64) for counts in stream.counts)
    events, noise = float((on - off)[calm].mean()), float(off[calm].mean())
    if events < _LEAST_EVENTS:
        few = f"quiet pixels have {max(events, 0.0):.2g} leak events each, {_LEAST_EVENTS:g} are needed"
        return _Variation(few, few)
    if noise > _MOST_NOISE * events:
        noisy = f"quiet pixels have {noise:.2g} noise events of each polarity for {events:.2g} leak events"
        return _Variation(noisy, noisy)
    with_off = float((off[stream.quiet] > 0).mean())
    jitter = _jitter(stream, calm & (off == 0), _variance_of_early_events(stream), with_off)
    return _Variation(_spread(on - off, calm, jitter if isinstance(jitter, Measured) else None), jitter)


def _variance_of_early_events(stream: StreamStatistics) -> Measured:
    """Return what noise adds to the relative variance of leak intervals of pixels without an OFF event.

    It makes each ON event before the leak does, by a distance to the level that scatters by 0.43 of the noise's
    standard deviation, as the largest of very many normal numbers does, and an interval has two ends.
    """
    noise = noise_of_threshold(stream, least_events=3)
    variance = 2 * (_SCATTER_OF_LEAD * (noise or 0.0)) ** 2
    return Measured(variance, _SCATTER_SIGMA * variance)


def _jitter(stream: StreamStatistics, alone: npt.NDArray[np.bool_], early: Measured, with_off: float) -> Measured | str:
    count, total, squares = (part[alone] for part in stream.on_intervals)
    enough = count > 1
    count, total, squares = count[enough], total[enough], squares[enough]
    freedom = int((count - 1).sum())
    if freedom < _LEAST_INTERVALS:
        return f"pixels without an OFF event have {freedom} intervals to compare, {_LEAST_INTERVALS} are needed"
    mean = total / count
    variance = float(((squares - count * mean**2) / mean**2).sum() / freedom)
    value = math.sqrt(max(variance - early.value, 0.25 * variance))
    of_square = math.hypot(variance * math.sqrt(2 / freedom), early.sigma, _CHOICE_SIGMA * with_off * variance)
    sigma = of_square / (2 * value) if value > 0 else math.sqrt(of_square)
    return Measured(value, math.hypot(sigma, _JITTER_MODEL * value))


def _spread(net: npt.NDArray[np.float64], calm: npt.NDArray[np.bool_], jitter: Measured | None) -> Measured | str:
    squares = np.concatenate(
        [((net[here] - net[there])[calm[here] & calm[there]]) ** 2 / 2 for here, there in DIAGONALS]
    )
    if len(squares) < _LEAST_PAIRS:
        return f"there are {len(squares)} pairs of calm neighbours, {_LEAST_PAIRS} are needed"
    mean = float(net[calm].mean())
    own = _PHASE_VARIANCE + (0.0 if jitter is None else jitter.value**2 * mean)
    variance = (float(squares.mean()) - own) / mean**2
    # A pixel is in up to four pairs, so they count as fewer.
    sigma = math.hypot(float(squares.std()) / math.sqrt(len(squares) / 2), _PHASE_SIGMA) / mean**2
    if variance < 2 * sigma:
        most = math.sqrt(max(variance, 0.0) + 2 * sigma)
        return f"it is at most {most:.2g}: counts scatter no more than those of clocks of one rate"
    value = math.sqrt(variance)
    return Measured(value, math.hypot(sigma / (2 * value), _SPREAD_MODEL * value))


def _calm(stream: StreamStatistics) -> npt.NDArray[np.bool_]:
    """Return those of the quiet pixels that have the fewest OFF events."""
    off = stream.counts[0]
    return np.asarray(stream.quiet & (off <= np.quantile(off[stream.quiet], _CALM_SHARE)))
