"""Holds segments of a sequence as some pixels see them, and makes events of them under effects."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..._core import CrossingEngine
from ...events.arrays import EventArray, concatenate_events
from ...events.luma import LumaFrames
from ...geometry.pose import FloatArray
from ...sensor.effects import Effects

IntArray = npt.NDArray[np.int64]


class LumaSegment(NamedTuple):
    """Holds consecutive keyframes of some or all pixels.

    Attributes:
        t_us: (k,) microseconds of the sequence.
        luma: (k, H, W) float32; single pixels are a row.
    """

    t_us: IntArray
    luma: LumaFrames


@dataclass(frozen=True)
class LumaSample:
    """Holds segments of a sequence as some pixels see them, and the engine that turns them into events.

    Levels are those of references that begin at the sequence's first instant: there each segment's engine begins, too,
    and goes straight to where the segment does. What happens on the way does not count, but what has leaked until then
    has.

    Attributes:
        origin: (1, H, W), the first instant.
        segments: in order, without overlap.
        contrast_threshold, contrast_threshold_off, log_eps, start_phase, seed: of the engine.
        sensor_share: share of the sensor's pixels.
    """

    origin: LumaFrames
    segments: Sequence[LumaSegment]
    contrast_threshold: float
    contrast_threshold_off: float
    log_eps: float
    start_phase: str
    seed: int
    sensor_share: float

    @property
    def size(self) -> tuple[int, int]:
        """Return width and height."""
        return self.origin.shape[2], self.origin.shape[1]

    @property
    def pixels(self) -> int:
        return self.size[0] * self.size[1]

    @property
    def pixel_frames(self) -> int:
        """Return how many pixels of how many keyframes there are, but for the first of each segment."""
        return sum(len(segment.t_us) - 1 for segment in self.segments) * self.pixels

    @cached_property
    def ideal_segments(self) -> list[EventArray]:
        """Return the events of ideal pixels, segment by segment."""
        return [self.segment_events(segment, None) for segment in self.segments]

    @cached_property
    def ideal(self) -> EventArray:
        """Return the events of ideal pixels."""
        return concatenate_events(self.ideal_segments)

    def events(self, effects: Effects | None) -> EventArray:
        """Make the events of the segments under effects."""
        return concatenate_events([self.segment_events(segment, effects) for segment in self.segments])

    def segment_events(self, segment: LumaSegment, effects: Effects | None) -> EventArray:
        """Make the events of one segment."""
        return concatenate_events(push_all(self.engine_at(segment, effects), segment))

    def engine_at(self, segment: LumaSegment, effects: Effects | None) -> CrossingEngine:
        """Make an engine that has taken the first frame of a segment."""
        width, height = self.size
        engine = CrossingEngine(
            width,
            height,
            contrast_threshold=self.contrast_threshold,
            contrast_threshold_off=self.contrast_threshold_off,
            log_eps=self.log_eps,
            effects=effects,
            start_phase=self.start_phase,
            seed=self.seed,
            threads=1,
        )
        if segment.t_us[0] > 0:
            engine.push(0, self.origin[0])
        engine.push(int(segment.t_us[0]), segment.luma[0])
        return engine

    def through(self, lens: Callable[[LumaFrames], LumaFrames]) -> LumaSample:
        """Return the same behind a lens, which maps luma (k, H, W) to luma."""
        segments = [LumaSegment(segment.t_us, lens(segment.luma)) for segment in self.segments]
        return replace(self, origin=lens(self.origin), segments=segments)

    def steps(self) -> Steps:
        """Return all keyframes with their next ones."""
        eps = np.float32(self.log_eps)
        pairs = [
            (np.diff(segment.t_us) * 1e-6, segment.luma.reshape(len(segment.luma), -1)) for segment in self.segments
        ]
        return Steps(
            np.concatenate([length_s for length_s, _ in pairs]),
            np.concatenate([(luma[:-1] + luma[1:]) / 2 for _, luma in pairs]),
            np.concatenate([(np.log(luma[:-1] + eps) + np.log(luma[1:] + eps)) / 2 for _, luma in pairs]),
            np.concatenate([np.diff(np.log(luma + eps), axis=0) for _, luma in pairs]),
        )


def push_all(engine: CrossingEngine, segment: LumaSegment) -> list[EventArray]:
    """Make the events of all frames of a segment but the first, which the engine has."""
    return [engine.push(t_us, luma) for t_us, luma in zip(segment.t_us[1:].tolist(), segment.luma[1:], strict=True)]


def event_intervals_us(events: EventArray) -> IntArray:
    """Times between consecutive events of a pixel."""
    order = np.lexsort((events["t"], events["x"], events["y"]))
    ordered = events[order]
    same = (np.diff(ordered["x"].astype(int)) == 0) & (np.diff(ordered["y"].astype(int)) == 0)
    return np.asarray(np.diff(ordered["t"])[same])


class Steps(NamedTuple):
    """Holds what lies between consecutive keyframes.

    Attributes:
        length_s: (k,) seconds.
        luma: (k, n) mean luma of both ends.
        log: (k, n) mean log luma.
        change: (k, n) of log luma.
    """

    length_s: FloatArray
    luma: LumaFrames
    log: LumaFrames
    change: LumaFrames
