"""Measures a recording in one pass: the statistics of its events, and its frames next to them."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..._util.argument_error import ArgumentError
from ..._util.close_names import names_checked
from ...events.arrays import EVENT_DTYPE, EventArray, concatenate_events
from ...inspection.statistics import StreamStatistics, measure_stream, open_event_stream
from ...inspection.statistics.event_stream import EventStream
from ...inspection.statistics.stream_statistics import Region
from .frame_source import FrameSource, open_frames
from .signal_samples import SignalSampler, SignalSamples


@dataclass(frozen=True, eq=False)
class MeasuredRecording:
    """Holds what was measured of a recording, for :func:`fit_sensor`.

    Attributes:
        statistics: of the events.
        source: of the frames; None without any.
        samples: of the frames, next to what events say.
        lux: illuminance that quiet pixels see; None if it is not known.
        events: those of a recording with frames, up to the first 4,194,304 of them.
    """

    statistics: StreamStatistics
    source: FrameSource | None = None
    samples: SignalSamples | None = None
    lux: float | None = None
    events: EventArray = field(default_factory=lambda: np.zeros(0, EVENT_DTYPE))


MOST_EVENTS = 1 << 22
"""Of a recording that are held for a fit to its frames: 64 MiB."""


class _Beginning:
    """Holds the first events of a stream."""

    def __init__(self) -> None:
        self._parts: list[EventArray] = []
        self._room = MOST_EVENTS

    def add(self, events: EventArray) -> None:
        """Take the next events, as far as there is room."""
        taken = events[: self._room]
        self._room -= len(taken)
        if len(taken):
            self._parts.append(taken.copy())

    def events(self) -> EventArray:
        """Return all that were taken."""
        return concatenate_events(self._parts)


@names_checked
def measure_recording(
    source: str | os.PathLike[str] | EventStream | EventArray,
    *,
    frames: FrameSource | None = None,
    size: tuple[int, int] | None = None,
    quiet: Region | None = None,
    start_s: float = 0.0,
    stop_s: float | None = None,
    lux: float | None = None,
    progress: Callable[[float], object] | None = None,
) -> MeasuredRecording:
    """Measure a recording for :func:`fit_sensor`: its events as :func:`measure_stream` does, and its frames.

    Args:
        source: as of :func:`measure_stream`.
        frames: next to a stream or an array; those of a file or folder are found.
        size, quiet, start_s, stop_s, progress: as of :func:`measure_stream`.
        lux: illuminance that the quiet pixels see, > 0, in the lux of :class:`~davis_rs.SensorParameters`; None if it
            is not known. Shot noise, and how bandwidth goes with light, are fitted where it is.

    Raises:
        OSError, DecodeError, ValueError: as of :func:`measure_stream`; ValueError for an illuminance that is not finite
            and > 0.
    """
    if lux is not None and not 0 < lux < math.inf:
        raise ArgumentError("{lux} must be finite and > 0, or None, got {!r}", lux)
    if isinstance(source, str | os.PathLike):
        path, source = source, open_event_stream(source, size=size)
        frames = open_frames(path, source.size)
    known = source.size if isinstance(source, EventStream) else size
    sampler = None if frames is None or known is None else SignalSampler(*known, frames.frames())
    beginning = _Beginning()

    def also(events: EventArray) -> None:
        if sampler is not None:
            sampler.add(events)
            beginning.add(events)

    statistics = measure_stream(
        source,
        size=size,
        quiet=quiet,
        start_s=start_s,
        stop_s=stop_s,
        progress=progress,
        also=also,
    )
    samples = None if sampler is None else sampler.finish()
    seen = samples if samples is not None and samples.frames else None
    return MeasuredRecording(statistics, frames, seen, lux, beginning.events())
