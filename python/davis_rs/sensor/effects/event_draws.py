"""Draws random numbers that belong to events, for effects of a user's own."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ...events.arrays import EventArray, as_events

_SHIFTS_AND_FACTORS = ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB))
_STEP = 0x9E3779B97F4A7C15


def event_draws(events: EventArray, seed: int, purpose: int = 0) -> npt.NDArray[np.float64]:
    """Return a uniform draw in [0, 1) for each event: a function of (seed, purpose, t, x, y, p) alone.

    So they do not depend on how the stream is cut into packets, which a generator that draws one number after the other
    would. Two events of one pixel at the same microsecond with the same polarity have the same draw.

    Args:
        events: (n,), as :func:`davis_rs.as_events` takes them.
        seed: 0..2^64 - 1, for example that of ``begin``.
        purpose: 0..2^64 - 1; each gives other numbers.

    Returns:
        (n,) float64.

    Raises:
        ValueError: for a seed or a purpose out of range.

    Source: Steele, Lea, Flood, "Fast splittable pseudorandom number generators", OOPSLA 2014 (SplitMix64).
    """
    for name, value in (("seed", seed), ("purpose", purpose)):
        if not 0 <= value < 2**64:
            raise ValueError(f"{name} must be an integer in 0..2^64 - 1, got {value!r}")
    events = as_events(events)
    pixel = (events["y"].astype(np.uint64) << np.uint64(17)) | (events["x"].astype(np.uint64) << np.uint64(1))
    words = np.full(len(events), seed, np.uint64)
    for word in (
        np.uint64(purpose),
        events["t"].astype(np.int64).view(np.uint64),
        pixel | events["p"].astype(np.uint64),
    ):
        words = _mixed(words + np.uint64(_STEP)) ^ word
    return np.asarray((_mixed(words + np.uint64(_STEP)) >> np.uint64(11)) * 2.0**-53, np.float64)


def _mixed(words: npt.NDArray[np.uint64]) -> npt.NDArray[np.uint64]:
    """Apply SplitMix64's finaliser; NumPy's integers compute modulo 2^64, as it needs."""
    for shift, factor in _SHIFTS_AND_FACTORS:
        words = (words ^ (words >> np.uint64(shift))) * np.uint64(factor)
    return words ^ (words >> np.uint64(31))
