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


def span_of_events(events: EventArray, most: int, around_us: int | None = None) -> EventArray:
    """Return all events of one span of time, at most ``most``: of that around a time, or where they are densest.

    Args:
        around_us: a time in microseconds, with as many events before as after it; None for the span that takes the
            least time.

    Raises:
        ValueError: if ``most`` is not at least 1.
    """
    if most < 1:
        raise ValueError(f"at least 1 event must be kept, got {most}")
    count, t_us = len(events), events["t"]
    if count <= most:
        return events
    if around_us is None:
        first = int(np.argmin(t_us[most - 1 :] - t_us[: count - most + 1]))
    else:
        first = int(np.clip(np.searchsorted(t_us, around_us) - most // 2, 0, count - most))
    stop = first + most
    # A microsecond at an end counts if all of its events do.
    whole_first, whole_stop = first, stop
    if first > 0 and t_us[first - 1] == t_us[first]:
        whole_first = int(np.searchsorted(t_us, t_us[first], "right"))
    if stop < count and t_us[stop - 1] == t_us[stop]:
        whole_stop = int(np.searchsorted(t_us, t_us[stop], "left"))
    return events[whole_first:whole_stop] if whole_first < whole_stop else events[first:stop]


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
