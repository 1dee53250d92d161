"""Finds bounds that any stream gives: on the refractory period and on the bus; and the parity of columns and rows."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from ...inspection.statistics import StreamStatistics
from ...inspection.statistics.bursts import WINDOW_US
from ...inspection.statistics.stream_statistics import Measured
from .finding import Finding, combined

_TIMES_QUIET = 10.0


def find_refractory_period(shortest: int | None) -> Finding:
    bound = (
        "no pixel has two events" if shortest is None else f"at most {shortest:,} us, the shortest interval of a pixel"
    )
    return Finding("refractory period", "refractory_period_us", None, bound)


def row_bound_us(recordings: Sequence[StreamStatistics]) -> float:
    """Return how long a row takes at most, infinity if nothing tells: of n bursts in a window n - 1 took less."""
    windows = [(us, most) for one in recordings for us, most in _most_rows(one) if most > 1]
    return min((us / (most - 1) for us, most in windows), default=math.inf)


def _most_rows(recording: StreamStatistics) -> list[tuple[int, int]]:
    """Return windows in us, and the most row bursts in one."""
    bursts = recording.bursts
    return [(1, bursts.rows_per_us.most or 0), (WINDOW_US, bursts.rows_per_window.most or 0)]


def find_readout(recordings: Sequence[StreamStatistics]) -> Iterable[Finding]:
    counts = [max(most for _, most in window) for window in zip(*map(_most_rows, recordings), strict=True)]
    bound_us = row_bound_us(recordings)
    told = f"a row costs less than {bound_us:.2g} us" if math.isfinite(bound_us) else "what a row costs is not seen"
    yield Finding(
        "readout", "readout_events_per_s", None,
        f"at most {counts[0]} row bursts of one stamp, and {counts[1]} in {WINDOW_US} us: {told}",
    )  # fmt: skip


def find_parity(recordings: Sequence[StreamStatistics]) -> Iterable[Finding]:
    """Yield events at even over odd positions, and what that says of thresholds if events go by 1 / C."""
    ratios: dict[tuple[str, int], Measured] = {}
    for words, pairs in (
        ("even / odd columns", [one.column_parity for one in recordings]),
        ("even / odd rows", [one.row_parity for one in recordings]),
    ):
        for polarity, name in ((1, "ON"), (0, "OFF")):
            known = [pair[polarity] for pair in pairs if math.isfinite(pair[polarity].sigma)]
            mean = combined(known) if known else None
            if mean is not None:
                ratios[words, polarity] = mean
            yield Finding(f"{words}, {name}", None, mean)
    yield _column_parity(recordings, [ratios[key] for key in ratios if key[0] == "even / odd columns"])


COLUMN_PARITY = ("parity of columns", "threshold_column_parity")


def _column_parity(recordings: Sequence[StreamStatistics], ratios: Sequence[Measured]) -> Finding:
    events = sum(one.events / one.counts[0].size / one.duration_s for one in recordings) / len(recordings)
    quiet = max(one.quiet_rate_hz.value for one in recordings)
    if len(ratios) < 2:
        return Finding(*COLUMN_PARITY, None, "it needs events of both polarities in even and odd columns")
    if not events > _TIMES_QUIET * quiet:
        why = "events are not those of a moving scene: the quietest pixels have as many as a tenth of the mean"
        return Finding(*COLUMN_PARITY, None, why)
    parities = [Measured((r - 1) / (r + 1), 2 * sigma / (r + 1) ** 2) for r, sigma in ratios]
    average = combined(parities)
    apart = abs(parities[0].value - parities[1].value) / 2
    said = "of thresholds, if events go by 1 / C"
    return Finding(*COLUMN_PARITY, Measured(average.value, math.hypot(average.sigma, apart)), said)
