"""What event recordings tell of a sensor, and what they do not."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..sensor_parameters import SensorParameters
from ..stream_statistics import StreamStatistics
from ..stream_statistics.hot_pixels import LEAST_EVENTS
from ..stream_statistics.stream_statistics import Measured
from .sensor_file import SensorFile, unit_of


class Finding(NamedTuple):
    """What was found of one quantity.

    Attributes:
        what: in words.
        parameter: of :class:`~davis_rs.SensorParameters` that it gives; None for none.
        value: with its standard deviation; None where the recordings do not tell it.
        note: what else there is to say: a bound, why it cannot be told, or by how much the law fails.
    """

    what: str
    parameter: str | None
    value: Measured | None
    note: str = ""

    def __str__(self) -> str:
        said = "not identifiable from these recordings"
        if self.value is not None:
            unit = "" if self.parameter is None or unit_of(self.parameter) == "1" else f" {unit_of(self.parameter)}"
            said = f"{self.value}{unit}"
        return f"{self.what:<22} {said}{f'; {self.note}' if self.note else ''}"


@dataclass(frozen=True)
class SensorFit:
    """What recordings of one sensor tell of it.

    Attributes:
        size: (width, height) in pixels.
        recordings: their names.
        findings: one by one.
        refractory_bound_us: the refractory period is at most as long; None without two events of a pixel.
    """

    size: tuple[int, int]
    recordings: tuple[str, ...]
    findings: tuple[Finding, ...]
    refractory_bound_us: int | None

    def __str__(self) -> str:
        return "\n".join(map(str, self.findings))

    def file(self, base: SensorFile | None = None) -> SensorFile:
        """The sensor: what was found, and all else from ``base``.

        Where the base has a refractory period above the bound it is left out.

        Raises:
            ValueError: for a base of another size.
        """
        start = base or SensorFile(SensorParameters())
        own = (start.parameters.width, start.parameters.height)
        if None not in own and own != self.size:
            raise ValueError(
                f"the recordings have {self.size[0]} x {self.size[1]} pixels, "
                f"the sensor that gives all else has {own[0]} x {own[1]}"
            )
        source = f"fitted to {', '.join(self.recordings)}"
        values: dict[str, Any] = {"width": self.size[0], "height": self.size[1]}
        sources = dict(start.sources) | {"width": source, "height": source}
        sigmas = dict(start.uncertainties)
        for _, parameter, value, note in self.findings:
            if parameter is not None and value is not None:
                values[parameter], sigmas[parameter] = value.value, value.sigma
                sources[parameter] = f"{source}{f'; {note}' if note else ''}"
        held_us, bound_us = start.parameters.refractory_period_us, self.refractory_bound_us
        if held_us is not None and bound_us is not None and held_us > bound_us:
            values["refractory_period_us"] = None
            sources.pop("refractory_period_us", None)
            sigmas.pop("refractory_period_us", None)
        description = f"Fitted to {', '.join(self.recordings)}. {start.description}".strip()
        return SensorFile(replace(start.parameters, **values), description, sources, sigmas)


def fit_sensor(recordings: Sequence[StreamStatistics]) -> SensorFit:
    """Fit what events alone can tell of the sensor that they come from.

    - Hot pixels: their share, and the median of their rates.
    - Leak: ON less OFF events of quiet pixels, because events of noise come in pairs of both polarities. Its standard
      deviation is that of the pixels' scatter. It is not identifiable where quiet pixels fire together with their
      neighbours.
    - Refractory period: at most the shortest interval of any pixel.
    - Readout: at least as many row bursts as were seen.
    - Parity of columns and rows.

    Args:
        recordings: of one sensor with the same biases, measured by :func:`~davis_rs.measure_stream`.

    Raises:
        ValueError: for none, for recordings of different sizes, or without events.
    """
    if not recordings:
        raise ValueError("at least one recording is needed")
    sizes = {one.size for one in recordings}
    if len(sizes) > 1:
        listed = ", ".join(f"{width} x {height}" for width, height in sorted(sizes))
        raise ValueError(f"the recordings must be of one sensor: their sizes are {listed}")
    for one in recordings:
        if one.duration_s <= 0:
            raise ValueError(f"{one.name}: there are no two events at different times, nothing can be fitted")
    shortest = min((one.any.least for one in recordings if one.any.least is not None), default=None)
    findings = (
        *_hot_pixels(recordings),
        *_leak(recordings),
        _refractory_period(shortest),
        *_readout(recordings),
        *_parity(recordings),
    )
    return SensorFit(recordings[0].size, tuple(one.name for one in recordings), findings, shortest)


def _hot_pixels(recordings: Sequence[StreamStatistics]) -> tuple[Finding, ...]:
    pixels = recordings[0].size[0] * recordings[0].size[1]
    places = [set(zip(one.hot_pixels.x.tolist(), one.hot_pixels.y.tolist(), strict=True)) for one in recordings]
    longest = max(recordings, key=lambda one: one.duration_s)
    seen = len(set().union(*places))
    share = Measured(seen / pixels, math.sqrt(max(seen, 1)) / pixels)
    unseen = f"those below {LEAST_EVENTS / longest.duration_s:.2g} Hz are not seen"
    fraction = Finding("hot pixels", "hot_pixel_fraction", share, f"{seen} of {pixels:,}; {unseen}")
    if not seen:
        return fraction, Finding("rate of hot pixels", "hot_pixel_rate_hz", None, "there are none")
    rates = np.concatenate([one.hot_pixels.rate_hz for one in recordings])
    variation = np.concatenate([one.hot_pixels.variation for one in recordings])
    # Rates are log-normal: the median is the geometric mean. Of one pixel alone it is as uncertain as the rate itself.
    logs = np.log(rates)
    spread = float(logs.std(ddof=1)) if len(logs) > 1 else 1.0
    median = float(np.exp(logs.mean()))
    sigma = median * spread / math.sqrt(len(logs))
    regular = (
        f"the median; {rates.min():.3g} to {rates.max():.3g} Hz; variation of intervals {np.median(variation):.2g} "
        "(median), 1 for a Poisson process"
    )
    return fraction, Finding("rate of hot pixels", "hot_pixel_rate_hz", Measured(median, sigma), regular)


def _leak(recordings: Sequence[StreamStatistics]) -> tuple[Finding, ...]:
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
        leaks.append(_mean(on - off, one.duration_s, least))
        noise.append(_mean(2 * off, one.duration_s, 2 * least))
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
    return Finding(*_LEAK, Measured(max(leak.value, 0.0), leak.sigma), note), Finding(*_NOISE, None, pairs)


_LEAK, _NOISE = ("leak", "leak_rate_hz"), ("shot noise", "shot_noise_rms")


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


def _refractory_period(shortest: int | None) -> Finding:
    bound = (
        "no pixel has two events" if shortest is None else f"at most {shortest:,} us, the shortest interval of a pixel"
    )
    return Finding("refractory period", "refractory_period_us", None, bound)


def _readout(recordings: Sequence[StreamStatistics]) -> Iterable[Finding]:
    rows = max(one.bursts.rows_per_window.most or 0 for one in recordings)
    yield Finding(
        "readout", "readout_events_per_s", None,
        f"at least {rows} row bursts in 10 us were carried: a row costs at most {10 / max(rows, 1):.2g} us",
    )  # fmt: skip


def _parity(recordings: Sequence[StreamStatistics]) -> Iterable[Finding]:
    for words, pairs in (
        ("even / odd columns", [one.column_parity for one in recordings]),
        ("even / odd rows", [one.row_parity for one in recordings]),
    ):
        for polarity, name in ((1, "ON"), (0, "OFF")):
            known = [pair[polarity] for pair in pairs if math.isfinite(pair[polarity].sigma)]
            yield Finding(f"{words}, {name}", None, combined(known) if known else None)


def _mean(counts: npt.NDArray[np.float64], duration_s: float, least: float) -> Measured:
    """Mean rate of pixels, with the standard deviation of their scatter."""
    scatter = float(counts.std(ddof=1)) / math.sqrt(len(counts)) / duration_s if len(counts) > 1 else math.inf
    return Measured(float(counts.mean()) / duration_s, max(scatter, least))


def combined(found: Sequence[Measured]) -> Measured:
    """The mean of measurements of one quantity, weighted by their variances."""
    weights = np.array([1 / max(one.sigma, 1e-150) ** 2 for one in found])
    value = float(np.average([one.value for one in found], weights=weights))
    return Measured(value, float(1 / math.sqrt(weights.sum())))
