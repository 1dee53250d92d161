"""Checks whether the pixels that count as quiet see no signal."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...inspection.statistics import StreamStatistics
from ...inspection.statistics.hot_pixels import HotPixels
from ...inspection.statistics.stream_statistics import Measured


class Pairs(NamedTuple):
    """Diagonal neighbours that both have events, and how many there would be if pixels fired independently."""

    observed: int
    expected: float


def signal_in(stream: StreamStatistics) -> str | None:
    """Return why the quiet pixels of a recording are not quiet; None if they are.

    Neighbours that fire together see signal. Where nearly every pixel has events this cannot be told, and is not.
    """
    events = stream.counts.sum(axis=0)
    seen = neighbours_with_events(events, stream.quiet)
    if seen.observed <= seen.expected + 4 * math.sqrt(seen.expected) + 3:
        return None
    return (
        f"the quietest pixels of {stream.name} see signal: {seen.observed} pairs of neighbours have events, "
        f"{seen.expected:.3g} would by chance"
    )


def neighbours_with_events(counts: npt.NDArray[np.int64], quiet: npt.NDArray[np.bool_]) -> Pairs:
    """Return whether pixels fire together with their neighbours, as signal makes them, and noise does not.

    Diagonal neighbours, because quiet pixels were chosen by the ones next to them, see
    :data:`~davis_rs.inspection.statistics.stream_statistics.QUIET_SHARE`.
    """
    fired = (counts > 0) & quiet
    fraction = float(fired.sum() / max(quiet.sum(), 1))
    observed, pairs = 0, 0
    for here, there in DIAGONALS:
        pairs += int(np.count_nonzero(quiet[here] & quiet[there]))
        observed += int(np.count_nonzero(fired[here] & fired[there]))
    return Pairs(observed, pairs * fraction**2)


_MOST_VARIATION, _LEAST_ON_SHARE = 0.7, 0.8


def fires_by_itself(hot: HotPixels) -> npt.NDArray[np.bool_]:
    """Return which of the pixels that look hot are: nearly periodic, with ON events. Noise has a variation of 1, and as
    many OFF events."""
    return np.asarray((hot.variation < _MOST_VARIATION) & (hot.on_share > _LEAST_ON_SHARE))


def quiet_or_noisy(stream: StreamStatistics, *, hot: bool) -> npt.NDArray[np.bool_]:
    """Return the quiet pixels, bool (H, W), and those among them that only noise makes look hot.

    Noise fires often where a leak, or chance, has brought the signal near to a level, and where thresholds are low.
    Without these pixels there would be too little noise, and too few of the leak's events.

    Args:
        hot: take those that are hot, too.
    """
    chosen = stream.quiet.copy()
    around = np.zeros(chosen.shape, np.int64)
    for here, there in DIAGONALS:
        around[here] += stream.quiet[there]
        around[there] += stream.quiet[here]
    seen = stream.hot_pixels
    taken = np.ones(len(seen.x), np.bool_) if hot else ~fires_by_itself(seen)
    x, y = seen.x[taken], seen.y[taken]
    chosen[y, x] |= around[y, x] >= 2
    return chosen


DIAGONALS = ((np.s_[:-1, :-1], np.s_[1:, 1:]), (np.s_[:-1, 1:], np.s_[1:, :-1]))
"""Slices of an image (H, W), so that pixels at the same place in both are diagonal neighbours."""


def mean_rate(counts: npt.NDArray[np.float64], duration_s: float, least: float) -> Measured:
    """Return mean rate of pixels, with the standard deviation of their scatter, but no less than ``least``."""
    scatter = float(counts.std(ddof=1)) / math.sqrt(len(counts)) / duration_s if len(counts) > 1 else math.inf
    return Measured(float(counts.mean()) / duration_s, max(scatter, least))
