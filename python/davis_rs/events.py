"""The event array: the one type in which every source of events and every consumer of them meets."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

EVENT_DTYPE: np.dtype[np.void] = np.dtype([("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")], align=True)
"""One event in 16 bytes: ``t`` in microseconds from the start of the sequence, ``x`` to the right, ``y`` down,
``p`` 1 = ON (brighter), 0 = OFF (darker)."""

EventArray = npt.NDArray[np.void]


def as_events(array: npt.ArrayLike) -> EventArray:
    """Return ``array`` as a contiguous, aligned array of :data:`EVENT_DTYPE`, without a copy where it is one already.

    A structured array of another layout is accepted when it has the fields t, x, y and p.

    Raises:
        ValueError: if it is not a one-dimensional structured array with these fields.
    """
    source: npt.NDArray[Any] = np.asarray(array)
    names = source.dtype.names or ()
    if source.ndim != 1 or not {"t", "x", "y", "p"} <= set(names):
        raise ValueError(
            "events must be a one-dimensional structured array with fields t, x, y, p (davis_rs.EVENT_DTYPE); "
            f"got shape {source.shape} and dtype {source.dtype}"
        )
    if source.dtype == EVENT_DTYPE:
        return np.require(source, requirements=["C", "ALIGNED"])
    events = np.zeros(source.shape, EVENT_DTYPE)
    for name in ("t", "x", "y", "p"):
        column = source[name]
        if not np.array_equal(column.astype(EVENT_DTYPE[name]), column):
            raise ValueError(f"event field {name!r} holds values that {EVENT_DTYPE[name]} cannot hold exactly")
        events[name] = column
    return events


def concatenate_events(packets: Sequence[EventArray]) -> EventArray:
    """Join event arrays into one, padding bytes included: ``np.concatenate`` leaves those to chance, and equal streams
    would no longer be equal bytes."""
    whole = [np.ascontiguousarray(events).view(f"V{EVENT_DTYPE.itemsize}") for events in packets]
    return np.concatenate(whole).view(EVENT_DTYPE) if whole else np.zeros(0, EVENT_DTYPE)
