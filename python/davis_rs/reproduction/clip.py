"""Holds a recording with frames, and divides it into the half that is fitted and the half that is compared."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..calibrate.sensor import FrameSource, StampedFrame
from ..calibrate.sensor.frame_source import open_frames
from ..events.arrays import EventArray, concatenate_events
from ..inspection.statistics import open_event_stream

LEAST_FRAMES = 3
"""Each half needs an interval between two frames; the halves may share the frame in the middle."""


class Half(NamedTuple):
    """Holds one half of a recording.

    Attributes:
        name: ``first`` or ``second``.
        frames: the numbers of its frames.
        start_us, stop_us: from its first frame, or the recording's first event, to its last frame, [start, stop).
    """

    name: str
    frames: range
    start_us: int
    stop_us: int


@dataclass(frozen=True, eq=False)
class RecordedClip:
    """Holds a recording with frames.

    Attributes:
        name: of the file or folder.
        size: (width, height) of the sensor in pixels.
        events: :data:`davis_rs.EVENT_DTYPE`, sorted by time, all inside the sensor.
        source: its frames, read again each time.
        stamps_us: float64 (n,), increasing: the middle of each frame's exposure, on the events' clock.
        exposures_us: float64 (n,): how long each was exposed; 0 where that is not known.

    Raises:
        ValueError: for fewer than three frames, stamps that do not increase, or events outside of the sensor.
    """

    name: str
    size: tuple[int, int]
    events: EventArray
    source: FrameSource
    stamps_us: npt.NDArray[np.float64]
    exposures_us: npt.NDArray[np.float64]

    def __post_init__(self) -> None:
        if len(self.stamps_us) < LEAST_FRAMES:
            raise ValueError(
                f"{self.name}: {_frames(len(self.stamps_us))}, and at least {LEAST_FRAMES} are needed: one half is "
                "fitted, the other half is compared"
            )
        if not (np.diff(np.round(self.stamps_us)) > 0).all():
            raise ValueError(f"{self.name}: stamps of frames must increase by at least a microsecond")
        width, height = self.size
        if len(self.events) and (self.events["x"].max() >= width or self.events["y"].max() >= height):
            raise ValueError(f"{self.name}: events must lie inside the sensor's {width} x {height} pixels")
        for half in self.halves:
            if not len(self.between(half.start_us, half.stop_us)):
                raise ValueError(f"{self.name}: there are no events between the frames of the {half.name} half")

    @classmethod
    def of(
        cls, name: str, size: tuple[int, int], events: EventArray, frames: Sequence[StampedFrame], unit: str = "DN"
    ) -> RecordedClip:
        """Make a clip of arrays.

        Args:
            name: in words.
            size: (width, height) of the sensor in pixels.
            events: sorted by time.
            frames: in the order of time, values (H, W) linear in light.
            unit: of their values.

        Raises:
            ValueError: as of the class.
        """
        source = FrameSource(lambda: iter(frames), unit, of_camera=unit == "DN")
        stamps = np.array([frame.t_us for frame in frames], np.float64)
        exposures = np.array([frame.exposure_us for frame in frames], np.float64)
        return cls(name, size, events, source, stamps, exposures)

    @property
    def halves(self) -> tuple[Half, Half]:
        """Return both halves; an odd number of frames has one in the middle that belongs to both."""
        count = len(self.stamps_us)
        return self._half("first", range((count + 1) // 2)), self._half("second", range(count // 2, count))

    def frames(self, numbers: range) -> Iterator[StampedFrame]:
        """Yield the frames with these numbers."""
        for number, frame in enumerate(self.source.frames()):
            if number >= numbers.stop:
                return
            if number >= numbers.start:
                yield frame

    def between(self, start_us: float, stop_us: float) -> EventArray:
        """Return the events with start_us <= t < stop_us."""
        first, last = np.searchsorted(self.events["t"], [start_us, stop_us])
        return self.events[first:last]

    def outside(self, half: Half) -> EventArray:
        """Return all events that are not of a half."""
        first, last = np.searchsorted(self.events["t"], [half.start_us, half.stop_us])
        return np.concatenate([self.events[:first], self.events[last:]])

    def _half(self, name: str, numbers: range) -> Half:
        stamps = np.round(self.stamps_us[[numbers[0], numbers[-1]]]).astype(np.int64)
        begin_us = int(self.events["t"][0]) if len(self.events) else 0
        return Half(name, numbers, max(int(stamps[0]), begin_us), int(stamps[1]))


def open_clip(
    path: str | os.PathLike[str],
    *,
    size: tuple[int, int] | None = None,
    start_s: float = 0.0,
    stop_s: float | None = None,
    progress: Callable[[float], object] | None = None,
) -> RecordedClip:
    """Read a recording with frames: any that :func:`davis_rs.open_reader` opens.

    Events are held in memory, at 16 bytes each; frames are read one by one. Times count from the first event, because
    the clock of a recording may be anything.

    Args:
        size: (width, height) of the sensor in pixels, where the file does not say.
        start_s, stop_s: take start_s <= t < stop_s, in seconds after the first event; by default all.
        progress: is told the fraction that is read, 0..1.

    Raises:
        OSError, DecodeError: if it cannot be read.
        ValueError: if it has no frames, fewer than three of them, or no events between them.
    """
    stream = open_event_stream(path, size=size)
    width, height = stream.size
    pieces = []
    for piece in stream.pieces(progress or (lambda _: None)):
        pieces.append(piece[(piece["x"] < width) & (piece["y"] < height) & (piece["p"] <= 1)])
    events = concatenate_events(pieces)
    if not len(events):
        raise ValueError(f"{stream.name}: there are no events")
    if (np.diff(events["t"]) < 0).any():
        events = events[np.argsort(events["t"], kind="stable")]
    zero_us = int(events["t"][0])
    events["t"] -= zero_us
    start_us, stop_us = start_s * 1e6, np.inf if stop_s is None else stop_s * 1e6
    recorded = open_frames(path, stream.size)
    if recorded is None:
        raise ValueError(f"{stream.name}: there are no frames, and light comes from frames")

    def frames() -> Iterator[StampedFrame]:
        for frame in recorded.frames():
            moved = frame._replace(t_us=frame.t_us - zero_us)
            if moved.t_us < stop_us:
                yield moved

    stamps = np.array([(frame.t_us, frame.exposure_us) for frame in frames()], np.float64).reshape(-1, 2)
    if not len(stamps):
        raise ValueError(f"{stream.name}: there are no frames, and light comes from frames")
    # One frame before the first event says what light the events begin at.
    skipped = max(int(np.searchsorted(stamps[:, 0], start_us, side="right")) - 1, 0)
    source = FrameSource(lambda: islice(frames(), skipped, None), recorded.unit, recorded.black, recorded.of_camera)
    inside = events[(events["t"] >= start_us) & (events["t"] < stop_us)]
    return RecordedClip(stream.name, stream.size, inside, source, stamps[skipped:, 0], stamps[skipped:, 1])


def _frames(count: int) -> str:
    return "there is one frame" if count == 1 else f"there are {count} frames"
