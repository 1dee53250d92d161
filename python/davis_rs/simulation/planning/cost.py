"""Measures what effects cost in time, on whole frames of the sequence itself."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property

import numpy as np

from ...sensor.effects import Aps, Effect, Effects, HotPixels, LeakRate, Readout, ShotNoise
from ...sensor.effects.optics import Optics
from .aps import aps_frame
from .luma_sample import LumaSample, LumaSegment, push_all
from .sequence_sample import SequenceSample

_ROUNDS = 3
_MOST_EVENTS = 3_000_000
"""More of noise are not made for the sake of a measurement."""


class Costs:
    """Times of effects on the frames of a sequence: with the effect minus without, the median of three rounds."""

    def __init__(self, sequence: SequenceSample) -> None:
        self._sequence = sequence

    @cached_property
    def _windows(self) -> LumaSample:
        """Return whole frames in a few windows, each from 0 on: so no noise comes before them."""
        sample = self._sequence.frames
        return replace(
            sample, segments=[LumaSegment(segment.t_us - segment.t_us[0], segment.luma) for segment in sample.segments]
        )

    def __call__(self, effect: Effect) -> tuple[float, float]:
        """Return nanoseconds a pixel and keyframe (of the APS: and intensity frame), and an event; NaN where neither
        fits."""
        if isinstance(effect, Aps):
            return self._aps(effect), np.nan
        sample = self._windows
        if sample.pixel_frames == 0 or self._made(effect) > _MOST_EVENTS:
            return np.nan, np.nan
        effects = Effects.of([effect])
        if effects.optical:
            frames = sum(len(segment.luma) for segment in sample.segments)
            return 1e9 * _median_s(lambda: self._through_lens(effects)) / (frames * sample.pixels), np.nan
        # In turn, so that a slow moment of the machine meets both.
        more_s = [self._pushing_s(effects) - self._pushing_s(None) for _ in range(_ROUNDS)]
        taken_ns = 1e9 * max(float(np.median(more_s)), 0.0)
        if isinstance(effect, Readout):
            events = len(sample.ideal)
            return np.nan, taken_ns / events if events else np.nan
        return taken_ns / sample.pixel_frames, np.nan

    def share_percent(self, chosen: Effects, everything: Effects, kept: Effects) -> float:
        """Return what a set takes more than ``kept`` alone, in percent of what all effects take; NaN if not measurable.

        An APS is left out: what it costs depends on the rate of intensity frames.
        """
        if chosen == everything:
            return 100.0
        if chosen == kept:
            return 0.0
        if any(self._made(effect) > _MOST_EVENTS for effect in everything) or not self._windows.pixel_frames:
            return np.nan
        # In turn, so that a slow moment of the machine meets all.
        taken_s = np.array([[self._whole_s(of) for of in (chosen, everything, kept)] for _ in range(_ROUNDS)])
        some_s, all_s, least_s = np.median(taken_s, axis=0)
        return float(np.clip(100 * (some_s - least_s) / (all_s - least_s), 0, 100)) if all_s > least_s else np.nan

    def _whole_s(self, effects: Effects) -> float:
        """Time lens and engine."""
        lens = effects.optical
        lens_s = _seconds(lambda: self._through_lens(lens)) if lens else 0.0
        return lens_s + self._pushing_s(effects.without([*(effect.name for effect in lens), "aps"]) or None)

    def _through_lens(self, effects: Effects) -> None:
        lens = Optics(self._sequence.camera, effects)
        for segment in self._windows.segments:
            lens.frames(segment.luma)

    def _pushing_s(self, effects: Effects | None) -> float:
        sample = self._windows
        engines = [(sample.engine_at(segment, effects), segment) for segment in sample.segments]
        return _seconds(lambda: [push_all(engine, segment) for engine, segment in engines])

    def _aps(self, aps: Aps) -> float:
        sequence = self._sequence
        t_us = sequence.duration_us
        luma = sequence.luma(np.array([t_us]))[0]
        return 1e9 * _median_s(lambda: aps_frame(sequence, aps, t_us, luma, 0)) / luma.size

    def _made(self, effect: Effect) -> float:
        """Return an upper bound of the number of noise events."""
        sample = self._windows
        seen_us = sum(int(segment.t_us[-1]) for segment in sample.segments)
        return most_noise_hz(effect, sample) * sample.pixels * seen_us * 1e-6


def most_noise_hz(effect: Effect, sample: LumaSample) -> float:
    """Return how many events an effect makes by itself in a pixel and second, in the dark."""
    match effect:
        case LeakRate():
            return float(effect.mean_rate_hz())
        case ShotNoise():
            return float(effect.rate_hz(sample.contrast_threshold, sample.contrast_threshold_off))
        case HotPixels():
            return effect.fraction * float(effect.mean_rate_hz())
    return 0.0


def _seconds(work: Callable[[], object]) -> float:
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


def _median_s(work: Callable[[], object]) -> float:
    return float(np.median([_seconds(work) for _ in range(_ROUNDS)]))
