"""Chooses the part of a long sequence that a page or a recording for a viewer keeps."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..events.arrays import EventArray

Indices = npt.NDArray[np.int64]


def sample_events(events: EventArray, most: int) -> EventArray:
    """Return at most ``most`` events, in their order: one drawn at random from each of ``most`` runs of equal length.

    So the rate of events stays the same share everywhere, and no regular pattern in the order of pixels becomes
    visible, as it would if every k-th event were taken. The seed is fixed: the same events give the same sample.

    Raises:
        ValueError: if ``most`` is not at least 1.
    """
    if most < 1:
        raise ValueError(f"at least 1 event must be kept, got {most}")
    if len(events) <= most:
        return events
    edges = np.arange(most + 1, dtype=np.int64) * len(events) // most
    offsets = np.random.default_rng(0).integers(0, np.diff(edges))
    return events[edges[:-1] + offsets]


def evenly_spaced(count: int, most: int) -> Indices:
    """Return at most ``most`` of the indices 0 .. ``count`` - 1, evenly spaced, with the first and the last."""
    if count <= most:
        return np.arange(count)
    return np.round(np.linspace(0, count - 1, most)).astype(np.int64)


def event_counts(
    events: EventArray, start_us: int, end_us: int, bins: int
) -> tuple[float, npt.NDArray[np.uint32], npt.NDArray[np.uint32]]:
    """Return events from ``start_us`` to ``end_us``, counted in ``bins`` intervals of equal length.

    There are fewer intervals where they would be shorter than a microsecond.

    Returns:
        The length of an interval in microseconds, and the counts of ON and of OFF events, uint32 (n,).
    """
    duration_us = max(1, end_us - start_us)
    bins = min(bins, duration_us)
    at = np.minimum((events["t"] - start_us) * bins // duration_us, bins - 1)
    on, off = (np.bincount(at[events["p"] == p], minlength=bins).astype(np.uint32) for p in (1, 0))
    return duration_us / bins, on, off
