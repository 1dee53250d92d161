"""Checks whether the pixels that count as quiet see no signal."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...inspection.statistics import StreamStatistics


class Pairs(NamedTuple):
    """Diagonal neighbours that both have events, and how many there would be if pixels fired independently."""

    observed: int
    expected: float


def signal_in(one: StreamStatistics) -> str | None:
    """Return why the quiet pixels of a recording are not quiet; None if they are.

    Neighbours that fire together see signal. Where nearly every pixel has events this cannot be told, and is not.
    """
    events = one.counts.sum(axis=0)
    seen = neighbours_with_events(events, one.quiet)
    if seen.observed <= seen.expected + 4 * math.sqrt(seen.expected) + 3:
        return None
    return (
        f"the quietest pixels of {one.name} see signal: {seen.observed} pairs of neighbours have events, "
        f"{seen.expected:.3g} would by chance"
    )


def neighbours_with_events(counts: npt.NDArray[np.int64], quiet: npt.NDArray[np.bool_]) -> Pairs:
    """Return whether pixels fire together with their neighbours, as signal makes them, and noise does not.

    Diagonal neighbours, because quiet pixels were chosen by the ones next to them, see
    :data:`~davis_rs.inspection.statistics.stream_statistics.QUIET_SHARE`.
    """
    fired = (counts > 0) & quiet
    share = float(fired.sum() / max(quiet.sum(), 1))
    observed, pairs = 0, 0
    for here, there in DIAGONALS:
        pairs += int(np.count_nonzero(quiet[here] & quiet[there]))
        observed += int(np.count_nonzero(fired[here] & fired[there]))
    return Pairs(observed, pairs * share**2)


DIAGONALS = ((np.s_[:-1, :-1], np.s_[1:, 1:]), (np.s_[:-1, 1:], np.s_[1:, :-1]))
"""Slices of an image (H, W), so that pixels at the same place in both are diagonal neighbours."""
