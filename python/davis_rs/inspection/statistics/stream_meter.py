"""Measures a stream in one pass."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator

import numpy as np

from ..._util.argument_error import ArgumentError
from ..._util.close_names import names_checked
from ...events.arrays import EventArray, as_events, check_sorted
from .bursts import SIZES_BY_COLUMNS, Bursts
from .event_stream import EventStream, cut, open_event_stream
from .pixel_sums import PixelSums
from .stream_statistics import Region, StreamStatistics, evaluate

MOST_PIXELS = 1 << 22
"""Of a sensor: sums of each pixel take some 90 bytes."""


class StreamMeter:
    """Takes the events of a stream piece by piece; memory is that of the sensor's pixels, however long it is.

    Events earlier than one before them, and those outside of the sensor, are counted and left out.

    Args:
        width, height: of the sensor in pixels.

    Raises:
        ValueError: for a sensor without pixels, or of more than 4,194,304.
    """

    def __init__(self, width: int, height: int) -> None:
        if width < 1 or height < 1 or width * height > MOST_PIXELS:
            raise ValueError(f"a sensor must have 1..{MOST_PIXELS} pixels to be measured, got {width} x {height}")
        self._width, self._height = width, height
        self._pixels = PixelSums(width, height)
        self._bursts = Bursts(by_columns=(width, height) in SIZES_BY_COLUMNS)
        self._first_us: int | None = None
        self._last_us = 0
        self._backward = self._outside = 0

    def add(self, events: EventArray) -> EventArray:
        """Add the next events of the stream, :data:`davis_rs.EVENT_DTYPE`; returns those that were not left out.

        Raises:
            ValueError: for an array of another kind.
        """
        events = as_events(events)
        inside = (events["x"] < self._width) & (events["y"] < self._height) & (events["p"] <= 1)
        if not inside.all():
            self._outside += int(len(events) - np.count_nonzero(inside))
            events = events[inside]
        if not len(events):
            return events
        latest = np.maximum.accumulate(events["t"])
        if self._first_us is not None:
            latest = np.maximum(latest, self._last_us)
        in_order = events["t"] >= latest
        if not in_order.all():
            self._backward += int(len(events) - np.count_nonzero(in_order))
            events = events[in_order]
        if not len(events):
            return events
        if self._first_us is None:
            self._first_us = int(events["t"][0])
        self._last_us = int(events["t"][-1])
        self._pixels.add(events)
        self._bursts.add(events)
        return events

    def finish(self, name: str = "", kind: str = "", *, quiet: Region | None = None) -> StreamStatistics:
        """Return what was found; the meter takes no more events after this.

        Args:
            name, kind: of the stream, for tables.
            quiet: (x0, y0, x1, y1): the pixels x0 <= x < x1, y0 <= y < y1 that see no signal; if not given, the
                quietest are looked for.

        Raises:
            ValueError: for a region that is not in the sensor.
        """
        self._bursts.finish()
        span = (0, 0) if self._first_us is None else (self._first_us, self._last_us)
        return evaluate(
            self._pixels,
            self._bursts,
            span,
            name=name,
            kind=kind,
            backward=self._backward,
            outside=self._outside,
            quiet=quiet,
        )


@names_checked
def measure_stream(
    source: str | os.PathLike[str] | EventStream | EventArray,
    *,
    size: tuple[int, int] | None = None,
    fallback_size: tuple[int, int] | None = None,
    quiet: Region | None = None,
    start_s: float = 0.0,
    stop_s: float | None = None,
    progress: Callable[[float], object] | None = None,
    also: Callable[[EventArray], object] | None = None,
) -> StreamStatistics:
    """Measure a stream: rates, intervals, bursts, hot and quiet pixels, parity.

    >>> print(measure_stream("recording.aedat").hot_pixels)

    Args:
        source: a dataset folder, an event file of any format, a camera's bytes, a recording (AEDAT), or an array of
            events.
        size: (width, height) of the sensor in pixels, where the source does not say.
        fallback_size: its size where neither the source nor ``size`` says one, such as that of another stream.
        quiet: (x0, y0, x1, y1) of pixels that see no signal; if not given, the quietest are looked for.
        start_s, stop_s: only events with start_s <= t < stop_s, in seconds after the first event; by default all.
        progress: is told the fraction that is read, 0..1.
        also: is given the events that are measured, piece by piece.

    Raises:
        OSError, DecodeError: if it cannot be read.
        ValueError: for an array whose times go back; if nothing says how large the sensor is, for one of more than
            4,194,304 pixels, a region that is not in it, or a part that does not begin before it ends.
    """
    if not 0 <= start_s < (math.inf if stop_s is None else stop_s):
        raise ArgumentError("a part must have 0 <= {start_s} < {stop_s}, got {!r} and {!r}", start_s, stop_s)
    if not isinstance(source, str | os.PathLike | EventStream):
        events = as_events(source)
        check_sorted(events)
        size = size or fallback_size
        if size is None:
            raise ArgumentError("an array does not say the sensor's size: give {size}")
        source = EventStream("events", "array", size, lambda told: cut(events, told))
    stream = (
        source if isinstance(source, EventStream) else open_event_stream(source, size=size, fallback_size=fallback_size)
    )
    meter = StreamMeter(*stream.size)
    for piece in _between(stream.pieces(progress or (lambda _: None)), start_s, stop_s):
        measured = meter.add(piece)
        if also is not None:
            also(measured)
    return meter.finish(stream.name, stream.kind, quiet=quiet)


def _between(pieces: Iterator[EventArray], start_s: float, stop_s: float | None) -> Iterator[EventArray]:
    """Yield the events of a part, in seconds after the first event."""
    if start_s == 0 and stop_s is None:
        yield from pieces
        return
    first_us: int | None = None
    for piece in pieces:
        if not len(piece):
            continue
        first_us = int(piece["t"][0]) if first_us is None else first_us
        after_us = piece["t"] - first_us
        inside = after_us >= start_s * 1e6
        if stop_s is not None:
            if (after_us >= stop_s * 1e6).all():
                return
            inside &= after_us < stop_s * 1e6
        yield piece[inside]
