"""Measures a recording in one pass: the statistics of its events, and its frames next to them."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

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

    @property
    def lux_of_quiet(self) -> npt.NDArray[np.float64] | None:
        """Return what quiet pixels see, float64 (n,) in lux, an equal number of them each; None if it is not known.

        Frames tell how it differs between pixels, but for their black level, which is taken for 0; ``lux`` is its mean.
        """
        if self.lux is None:
            return None
        values = np.zeros(0) if self.samples is None else self.samples.mean[self.statistics.quiet]
        values = np.maximum(values[np.isfinite(values)], 0)
        if not values.any():
            return np.array([self.lux])
        shares = (np.arange(_LIGHTS) + 0.5) / _LIGHTS
        return np.asarray(self.lux * np.quantile(values / values.mean(), shares), np.float64)


_LIGHTS = 32
"""Quantiles of the light of quiet pixels that stand for all."""


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
