"""What effects cost in time, measured on whole frames of the sequence itself."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from ..effects import Aps, Effect, Effects, HotPixels, LeakRate, LensBlur, Readout, ShotNoise, Vignetting
from ..effects.optics import Optics
from .aps import aps_frame
from .luma_sample import push_all
from .sequence_sample import SequenceSample

_ROUNDS = 3
_MOST_EVENTS = 3_000_000
"""More of noise are not made for the sake of a measurement."""


class Costs:
    """Times of effects on the frames of a sequence: with the effect minus without, the median of three rounds."""

    def __init__(self, sequence: SequenceSample) -> None:
        self._sequence = sequence

    def __call__(self, effect: Effect) -> tuple[float, float]:
        """Nanoseconds a pixel and keyframe (of the APS: and intensity frame), and an event; NaN where neither fits."""
        if isinstance(effect, Aps):
            return self._aps(effect), np.nan
        sample = self._sequence.frames
        if sample.pixel_frames == 0 or self._made(effect) > _MOST_EVENTS:
            return np.nan, np.nan
        if isinstance(effect, Vignetting | LensBlur):
            vignetting = effect if isinstance(effect, Vignetting) else None
            blur = effect if isinstance(effect, LensBlur) else None
            lens = Optics(self._sequence.camera, vignetting, blur)
            frames = sum(len(part.luma) for part in sample.parts)
            taken_s = _median_s(lambda: [lens.frames(part.luma) for part in sample.parts])
            return 1e9 * taken_s / (frames * sample.pixels), np.nan
        # In turn, so that a slow moment of the machine meets both.
        effects = Effects.of([effect])
        more_s = [self._pushing_s(effects) - self._pushing_s(None) for _ in range(_ROUNDS)]
        taken_ns = 1e9 * max(float(np.median(more_s)), 0.0)
        if isinstance(effect, Readout):
            events = len(sample.ideal)
            return np.nan, taken_ns / events if events else np.nan
        return taken_ns / sample.pixel_frames, np.nan

    def _pushing_s(self, effects: Effects | None) -> float:
        sample = self._sequence.frames
        engines = [(sample.engine_at(part, effects), part) for part in sample.parts]
        return _seconds(lambda: [push_all(engine, part) for engine, part in engines])

    def _aps(self, aps: Aps) -> float:
        sequence = self._sequence
        t_us = sequence.duration_us
        luma = sequence.luma(np.array([t_us]))[0]
        return 1e9 * _median_s(lambda: aps_frame(sequence, aps, t_us, luma, 0)) / luma.size

    def _made(self, effect: Effect) -> float:
        """At most so many events of noise, on the way to the windows and in them."""
        pixel_s = self._sequence.frames.pixels * len(self._sequence.frames.parts) * self._sequence.duration_us * 1e-6
        match effect:
            case LeakRate():
                return float(effect.mean_rate_hz()) * pixel_s
            case ShotNoise():
                sample = self._sequence.frames
                return float(effect.rate_hz(sample.contrast_threshold, sample.contrast_threshold_off)) * pixel_s
            case HotPixels():
                return effect.fraction * effect.mean_rate_hz() * pixel_s
        return 0.0


def _seconds(work: Callable[[], object]) -> float:
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


def _median_s(work: Callable[[], object]) -> float:
    return float(np.median([_seconds(work) for _ in range(_ROUNDS)]))
