"""Converts event arrays to the layouts of other libraries, and back."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from .arrays import EVENT_DTYPE, EventArray, as_events

LAYOUTS: Mapping[str, np.dtype[np.void]] = {
    "tonic": np.dtype([("x", "<i2"), ("y", "<i2"), ("t", "<i8"), ("p", "?")]),
    "faery": np.dtype([("t", "<u8"), ("x", "<u2"), ("y", "<u2"), ("on", "?")]),
    "event_stream": np.dtype([("t", "<u8"), ("x", "<u2"), ("y", "<u2"), ("on", "?")]),
    "metavision": np.dtype(
        {
            "names": ["x", "y", "p", "t"],
            "formats": ["<u2", "<u2", "<i2", "<i8"],
            "offsets": [0, 2, 4, 8],
            "itemsize": 16,
        }
    ),
    "dv": np.dtype([("timestamp", "<i8"), ("x", "<i2"), ("y", "<i2"), ("polarity", "i1")]),
}
"""Layouts by the library that uses them; times are microseconds in all."""

_NAMES = {
    "t": ("t", "ts", "timestamp", "time"),
    "x": ("x", "xs"),
    "y": ("y", "ys"),
    "p": ("p", "ps", "on", "polarity", "pol"),
}
"""What the fields are called, ours first."""


def to_tonic(events: EventArray) -> npt.NDArray[np.void]:
    """Return events in tonic's layout: fields x, y int16, t int64 in microseconds, p bool; a copy.

    Raises:
        ValueError: for a coordinate above 32,767, with the event's index.

    Source: tonic, ``tonic.io.make_structured_array``.
    """
    return to_structured(events, "tonic")


def to_structured(events: EventArray, layout: str | npt.DTypeLike) -> npt.NDArray[np.void]:
    """Return a copy of events in another layout.

    Args:
        layout: a name of :data:`LAYOUTS`, or a structured dtype with one field each for time (t, ts, timestamp,
            time; microseconds), x (xs), y (ys) and polarity (p, ps, on, polarity, pol). Polarity is 0 or 1.

    Raises:
        ValueError: if a value does not fit its field exactly, with the event's index; for an unknown layout.
    """
    named = LAYOUTS.get(layout) if isinstance(layout, str) else None
    return _converted(as_events(events), EVENT_DTYPE, np.dtype(layout) if named is None else named)


def from_structured(events: npt.NDArray[np.void]) -> EventArray:
    """Return another library's events as a new :data:`~davis_rs.EVENT_DTYPE` array; fields as in :func:`to_structured`.

    Raises:
        ValueError: if a field is missing or a value does not fit, with the event's index; for a polarity other than
            0 and 1 (or false and true).
    """
    if np.asarray(events).dtype.names is None:
        return as_events(events)  # columns by name; others are refused
    converted = _converted(events, events.dtype, EVENT_DTYPE)
    if len(converted) and converted["p"].max() > 1:
        at = int(converted["p"].argmax())
        raise ValueError(f"polarity must be 0 or 1: event {at} has {converted['p'][at]}")
    return converted


def _converted(
    events: npt.NDArray[np.void], source_type: np.dtype[np.void], to: np.dtype[np.void]
) -> npt.NDArray[np.void]:
    source, target = _fields(source_type), _fields(to)
    converted = np.zeros(events.shape, to)
    for name in _NAMES:
        column = events[source[name]]
        field = converted[target[name]]
        field[...] = column
        # Compared as they are: NumPy takes integers of either sign for what they are worth.
        wrong = field != column
        if wrong.any():
            at = int(wrong.argmax())
            raise ValueError(f"{source[name]} of event {at} is {column[at]}, which {field.dtype} cannot hold exactly")
    return converted


def _fields(dtype: np.dtype[np.void]) -> dict[str, str]:
    """Return the name that a layout gives to each of our fields."""
    matching = {ours: [name for name in names if name in (dtype.names or ())] for ours, names in _NAMES.items()}
    for ours, names in matching.items():
        if len(names) != 1:
            raise ValueError(
                f"a layout of events needs one field that is one of {', '.join(_NAMES[ours])}; {dtype} has {len(names)}"
            )
    return {ours: names[0] for ours, names in matching.items()}
