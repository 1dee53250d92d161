"""Defines the event array: the one type in which every source of events and every consumer of them meets."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from .._util.argument_error import ArgumentError
from .._util.array_types import NumberArray

EVENT_DTYPE: np.dtype[np.void] = np.dtype([("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")], align=True)
"""One event in 16 bytes: ``t`` in microseconds from the start of the sequence, ``x`` to the right, ``y`` down,
``p`` 1 = ON (brighter), 0 = OFF (darker)."""

EventArray = npt.NDArray[np.void]


def event_array(t: npt.ArrayLike, x: npt.ArrayLike, y: npt.ArrayLike, p: npt.ArrayLike) -> EventArray:
    """Return a new array of :data:`EVENT_DTYPE` from columns of one length (n,).

    >>> event_array(t=[10, 20], x=[3, 4], y=[0, 1], p=[1, 0])

    Args:
        t: microseconds, whole numbers.
        x, y: pixels to the right and down, whole numbers in 0..65535.
        p: polarity, 1 or True for ON and 0 or False for OFF.

    Raises:
        ArgumentError: for columns of different lengths, or a value that is not exactly one of these, with its index.
    """
    columns = {name: _column(name, values) for name, values in (("t", t), ("x", x), ("y", y), ("p", p))}
    lengths = {name: len(column) for name, column in columns.items()}
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise ArgumentError("{t}, {x}, {y} and {p} must have one length, got {}", listed)
    events = np.zeros(lengths["t"], EVENT_DTYPE)
    for name, column in columns.items():
        with np.errstate(invalid="ignore"):  # told below
            events[name] = column
        wrong = (events[name] != column) | (column > 1 if name == "p" else False)
        if wrong.any():
            at = int(wrong.argmax())
            raise ArgumentError("{column} must be {}, got {} at index {}", _RULES[name], column[at], at, column=name)
    return events


_RULES = {
    "t": "whole microseconds (np.rint(1e6 * t) of seconds)",
    "x": "whole pixels in 0..65535",
    "y": "whole pixels in 0..65535",
    "p": "0 or 1 (p > 0 of polarities -1 and 1)",
}


def _column(name: str, values: npt.ArrayLike) -> NumberArray:
    column = np.asarray(values)
    if column.ndim != 1 or column.dtype.kind not in "biuf":
        raise ArgumentError(
            "{column} must be a column of numbers (n,), got shape {} and dtype {}",
            column.shape,
            column.dtype,
            column=name,
        )
    return column


def as_events(array: npt.ArrayLike | Mapping[str, npt.ArrayLike]) -> EventArray:
    """Return ``array`` as a contiguous, aligned array of :data:`EVENT_DTYPE`, without a copy where it is one already.

    A structured array of another layout is accepted when it has the fields t, x, y and p, and so are columns by these
    names, in a dictionary or a table. Columns without names are not: other software has them in any order.

    Raises:
        ValueError: if it is neither a one-dimensional structured array with these fields nor such columns, or if a
            value does not fit.
    """
    if hasattr(array, "keys") and {"t", "x", "y", "p"} <= set(array.keys()):
        return event_array(**{name: array[name] for name in ("t", "x", "y", "p")})  # type: ignore[index]
    source: npt.NDArray[np.void] = np.asarray(array)
    names = source.dtype.names or ()
    if source.ndim != 1 or not {"t", "x", "y", "p"} <= set(names):
        made_by = "event_array(t=..., x=..., y=..., p=...) makes one of columns"
        if names:
            made_by = "from_structured(...) makes one of other names"
        elif isinstance(array, str | os.PathLike):
            made_by = "read_events(...) reads one"
        shown = f"shape {source.shape} and dtype {source.dtype}" if source.dtype != object else type(array).__name__
        raise ValueError(
            "events must be a one-dimensional structured array with fields t, x, y, p (davis_rs.EVENT_DTYPE); "
            f"got {shown}; davis_rs.{made_by}"
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


def check_sorted(events: EventArray, name: str = "events") -> None:
    """Raise a ValueError for events whose times go back, with the first one that does."""
    back = events["t"][1:] < events["t"][:-1]
    if back.any():
        at = int(back.argmax()) + 1
        before, t = events["t"][at - 1 : at + 1].tolist()
        raise ValueError(f"{name} must be sorted by time: event {at} at {t} us follows one at {before} us")


def concatenate_events(packets: Sequence[EventArray]) -> EventArray:
    """Join event arrays into one, padding bytes included: ``np.concatenate`` leaves those to chance, and equal streams
    would no longer be equal bytes."""
    whole = [np.ascontiguousarray(events).view(f"V{EVENT_DTYPE.itemsize}") for events in packets]
    return np.concatenate(whole).view(EVENT_DTYPE) if whole else np.zeros(0, EVENT_DTYPE)
