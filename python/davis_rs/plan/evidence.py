"""What neglecting an effect does to a sequence, and what was seen of the sequence that says so: effect by effect."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ..effects import (
    Effect,
    Effects,
    HotPixels,
    LeakRate,
    LensBlur,
    PhotoreceptorBandwidth,
    Readout,
    RefractoryPeriod,
    ShotNoise,
    ThresholdMismatch,
    Vignetting,
)
from ..effects.optics import Optics
from ..events import EventArray
from .bus import through_bus
from .footage import Footage
from .neglect import Neglect, neglect, neglect_of_added
from .probe import Probe

_FLOOD = 3_000_000
"""So many events need no engine: they bury all else, or so few are those of the scene."""

_FEW = 30
"""So few events of a leak say less of its rate than the rate itself."""

_NO_LEAK = 1e-9
"""So many events of a pixel in the whole sequence."""


@dataclass(frozen=True)
class Judge:
    """Foresees what neglecting effects does to the events of a probed sequence."""

    probe: Probe
    window_us: int
    shift_us: float

    def __call__(self, effect: Effect) -> tuple[Neglect, str]:
        """What neglecting an effect on events does, and the evidence in words."""
        judge = _JUDGES[type(effect)]
        return judge(self, effect)

    def compare(self, footage: Footage, without: EventArray, with_effect: EventArray) -> Neglect:
        return neglect(without, with_effect, size=footage.size, window_us=self.window_us, shift_us=self.shift_us)

    def in_engine(self, effect: Effect) -> Neglect:
        """By the engine's own run on the scattered pixels."""
        footage = self.probe.pixels
        return self.compare(footage, footage.ideal, footage.events(Effects.of([effect])))

    @property
    def scene_events(self) -> float:
        """Of ideal pixels, for the whole sensor and sequence: events go by motion, as keyframes do."""
        footage = self.probe.pixels
        seen = sum(len(part.t_us) - 1 for part in footage.parts)
        return len(footage.ideal) / footage.part_of_sensor * ((len(self.probe.t_us) - 1) / seen)

    def of_rate(self, hz: float) -> float:
        """How many events so many a pixel and second come to."""
        return hz * self.probe.camera.width * self.probe.camera.height * self.probe.duration_us * 1e-6

    def added(self, hz: float) -> Neglect:
        """By events at a rate a pixel that come on top of the scene's."""
        return neglect_of_added(self.of_rate(hz), self.scene_events)


def _vignetting(judge: Judge, effect: Vignetting) -> tuple[Neglect, str]:
    footage, probe = judge.probe.pixels, judge.probe
    gain = effect.gain(probe.camera).ravel()
    shaded = footage.through(lambda luma: luma * gain[probe.pixel])
    darkest = float(np.percentile(np.concatenate([part.luma.ravel() for part in shaded.parts]), 1))
    seen = (
        f"corners get {100 * gain.min():.3g} % of the light; then 1 % of all pixels see less than luma {darkest:.3g}, "
        f"against a dark level of {footage.log_eps:g}"
    )
    return judge.compare(footage, footage.ideal, shaded.ideal), seen


def _lens_blur(judge: Judge, effect: LensBlur) -> tuple[Neglect, str]:
    footage = judge.probe.frames
    blurred = footage.through(Optics(judge.probe.camera, None, effect).frames)
    eps = np.float32(footage.log_eps)
    pairs = zip(footage.parts, blurred.parts, strict=True)
    squares = [np.mean(np.log((a.luma + eps) / (b.luma + eps)) ** 2, dtype=np.float64) for a, b in pairs]
    rms = math.sqrt(np.mean(squares)) / footage.contrast_threshold
    seen = f"a spot of {effect.sigma_px:g} px takes {rms:.2g} C (rms) from log luma: detail as fine as that"
    return judge.compare(footage, footage.ideal, blurred.ideal), seen


def _bandwidth(judge: Judge, effect: PhotoreceptorBandwidth) -> tuple[Neglect, str]:
    footage = judge.probe.pixels
    steps = footage.steps()
    corner_hz = np.clip(effect.hz * np.exp(steps.log), effect.floor_hz, effect.ceiling_hz)
    slope = np.abs(steps.change) / steps.length_s[:, None].astype(np.float32)
    quick = slope > 2 * np.pi * corner_hz * footage.contrast_threshold
    moved = float(np.abs(steps.change).sum(dtype=np.float64))
    share = float(np.abs(steps.change)[quick].sum(dtype=np.float64)) / moved if moved else 0.0
    seen = (
        f"corner {corner_hz.min():.3g}..{corner_hz.max():.3g} Hz (median {np.median(corner_hz):.3g}); dL/dt up to "
        f"{slope.max():.3g} /s: {100 * share:.3g} % of the change is faster than C in a time constant"
    )
    return judge.in_engine(effect), seen


def _mismatch(judge: Judge, effect: ThresholdMismatch) -> tuple[Neglect, str]:
    gaps_us = _gaps_us(judge.probe.pixels.ideal)
    gap = f"events of a pixel follow each other after {np.median(gaps_us):.3g} us (median)" if len(gaps_us) else ""
    seen = f"thresholds scatter by {100 * effect.sigma:.3g} %; " + (gap or "no pixel has two events")
    return judge.in_engine(effect), seen


def _refractory(judge: Judge, effect: RefractoryPeriod) -> tuple[Neglect, str]:
    gaps_us = _gaps_us(judge.probe.pixels.ideal)
    seen = f"held for {effect.period_us:.3g} us; no pixel has two events"
    if len(gaps_us):
        held = 100 * float((gaps_us < effect.period_us).mean())
        seen = (
            f"held for {effect.period_us:.3g} us; events of a pixel are at least {gaps_us.min():.3g} us apart, half of "
            f"them less than {np.median(gaps_us):.3g} us, {held:.3g} % less than the period"
        )
    return judge.in_engine(effect), seen


def _leak(judge: Judge, effect: LeakRate) -> tuple[Neglect, str]:
    """Against a leak that comes to nothing: what a reference was at the start is as arbitrary without a leak.

    Else every event would count as shifted, by the part of C that each pixel has leaked before the first frame.
    """
    footage, duration_s = judge.probe.pixels, judge.probe.duration_us * 1e-6
    seen = (
        f"{judge.of_rate(effect.rate_hz):.3g} events expected of {effect.rate_hz:.3g} Hz a pixel, beside "
        f"{judge.scene_events:.3g} of the scene; levels drift by {effect.rate_hz * duration_s:.2g} C"
    )
    counted = judge.added(effect.rate_hz)
    made = effect.rate_hz * footage.pixels * duration_s
    if made > _FLOOD:
        return counted, seen
    still = footage.events(Effects(leak_rate_hz=_NO_LEAK / duration_s))
    found = judge.compare(footage, still, footage.events(Effects.of([effect])))
    # What little the sample shows of few events is left to the rate, and so is what falls between the sample's parts.
    missing = max(found.missing_percent, counted.missing_percent)
    change = counted.event_change_percent if made < _FEW else found.event_change_percent
    return replace(found, missing_percent=missing, event_change_percent=change), seen


def _shot_noise(judge: Judge, effect: ShotNoise) -> tuple[Neglect, str]:
    steps = judge.probe.pixels.steps()
    rate = effect.rate_hz / (1 + steps.luma.astype(np.float64) / effect.half_luma)
    hz = float(np.average(rate.mean(1), weights=steps.length_s))
    dark, bright = np.percentile(steps.luma, (1, 99))
    seen = (
        f"luma {dark:.3g}..{bright:.3g} (1 % to 99 %) against the {effect.half_luma:.3g} that halves the rate: "
        f"{hz:.3g} Hz a pixel, so {judge.of_rate(hz):.3g} events beside {judge.scene_events:.3g} of the scene"
    )
    return judge.added(hz), seen


def _hot_pixels(judge: Judge, effect: HotPixels) -> tuple[Neglect, str]:
    camera, hz = judge.probe.camera, effect.fraction * effect.rate_hz
    seen = (
        f"{effect.fraction * camera.width * camera.height:.3g} pixels of {effect.rate_hz:.3g} Hz: "
        f"{judge.of_rate(hz):.3g} events beside {judge.scene_events:.3g} of the scene"
    )
    return judge.added(hz), seen


def _gaps_us(events: EventArray) -> npt.NDArray[np.int64]:
    """Times between consecutive events of a pixel."""
    order = np.lexsort((events["t"], events["x"], events["y"]))
    ordered = events[order]
    same = (np.diff(ordered["x"].astype(int)) == 0) & (np.diff(ordered["y"].astype(int)) == 0)
    return np.asarray(np.diff(ordered["t"])[same])


def _readout(judge: Judge, effect: Readout) -> tuple[Neglect, str]:
    return through_bus(judge.probe.pixels, effect, judge.shift_us)


_JUDGES: dict[type[Effect], Callable[[Judge, Any], tuple[Neglect, str]]] = {
    Vignetting: _vignetting,
    LensBlur: _lens_blur,
    PhotoreceptorBandwidth: _bandwidth,
    ThresholdMismatch: _mismatch,
    RefractoryPeriod: _refractory,
    LeakRate: _leak,
    ShotNoise: _shot_noise,
    HotPixels: _hot_pixels,
    Readout: _readout,
}
