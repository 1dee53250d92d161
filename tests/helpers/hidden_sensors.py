"""Sensors with hidden parameters, drawn from a seed, and recordings of them: short ones with frames, static ones."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from davis_rs import (
    CrossingEngine,
    FrameSource,
    MeasuredRecording,
    SensorParameters,
    StampedFrame,
    fit_sensor,
    measure_recording,
)
from davis_rs.calibrate.sensor import SensorFit
from davis_rs.calibrate.sensor.static_scene import before_a_leak, static_events
from davis_rs.events.arrays import EventArray, concatenate_events
from davis_rs.sensor.effects import (
    Aps,
    Effects,
    HotPixels,
    LeakRate,
    PhotoreceptorBandwidth,
    ShotNoise,
    ThresholdMismatch,
)
from davis_rs.sensor.presets import SensorFile

WIDTH, HEIGHT, STRIP = 80, 72, 24
MOVES_US, RESTS_US, STEP_US, FRAME_US = 2_000_000, 12_000_000, 1_000, 40_000
_LUX = 100.0
"""What the strip of constant light is said to see; any number does."""
_SETTLED_US = 40_000_000
"""With noise a leak's first event comes early, because references begin anywhere below a level: that is left out."""
_SHORTLY_SETTLED_US = 8_000_000
"""The same where the leak is not asked for."""


class HiddenSensor(NamedTuple):
    """What is drawn, by the names of :class:`davis_rs.SensorParameters`, and what else there is."""

    contrast_threshold: float
    contrast_threshold_off: float
    threshold_mismatch: float
    threshold_column_parity: float
    source_follower_bandwidth_hz: float
    leak_rate_hz: float
    hot_pixel_fraction: float
    hot_pixel_rate_hz: float
    aps_read_noise_dn: float
    noise_hz: float
    refractory_us: float
    exposure_us: int
    black_dn: float
    light: float
    contrast: float
    texture_px: float
    travel_px: float
    photoreceptor_bandwidth_hz: float = math.inf


OVER_LIGHT = (*HiddenSensor._fields[:5], "photoreceptor_bandwidth_hz")
"""What is told of recordings in known light, and what is fitted together with it."""


def draw(seed: int, number: int) -> tuple[HiddenSensor, np.random.Generator]:
    """One of the sensors of a seed, and the generator for all else."""
    rng = np.random.default_rng([seed, number])

    def even(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    def ratio(low: float, high: float) -> float:
        return math.exp(even(math.log(low), math.log(high)))

    on = ratio(0.1, 0.35)
    return HiddenSensor(
        contrast_threshold=on,
        contrast_threshold_off=on * ratio(0.7, 1.4),
        threshold_mismatch=even(0.03, 0.15),
        threshold_column_parity=even(-0.08, 0.08),
        source_follower_bandwidth_hz=ratio(80, 600),
        leak_rate_hz=ratio(0.02, 0.3),
        hot_pixel_fraction=ratio(1e-3, 5e-3),
        hot_pixel_rate_hz=ratio(5, 40),
        aps_read_noise_dn=even(1, 4),
        noise_hz=ratio(0.02, 0.3),
        refractory_us=ratio(1, 20),
        exposure_us=round(ratio(500, 8000)),
        black_dn=even(0, 30),
        light=even(0.15, 0.3),
        contrast=even(0.4, 0.6),
        texture_px=even(2.5, 4),
        travel_px=even(4, 12),
    ), rng


def draw_over_light(seed: int, number: int) -> tuple[HiddenSensor, np.random.Generator]:
    """The same with a photoreceptor, whose corner goes with light; its bandwidth is that in the light of the strip."""
    sensor, rng = draw(seed, number)
    receptor_hz, follower_hz = np.exp(rng.uniform(np.log([40, 100]), np.log([200, 800]))).tolist()
    return sensor._replace(
        photoreceptor_bandwidth_hz=receptor_hz,
        source_follower_bandwidth_hz=follower_hz,
        contrast=float(rng.uniform(0.6, 1.0)),
    ), rng


class _Light:
    """A texture that moves about below a strip of constant light, then rests."""

    def __init__(self, sensor: HiddenSensor, rng: np.random.Generator) -> None:
        shape = (HEIGHT - STRIP, WIDTH)
        self._ky, self._kx = np.fft.fftfreq(shape[0])[:, None], np.fft.fftfreq(shape[1])[None]
        smooth = np.exp(-((2 * math.pi * np.hypot(self._ky, self._kx) * sensor.texture_px) ** 2) / 2)
        smooth[0, 0] = 0
        spectrum = smooth * np.fft.fft2(rng.standard_normal(shape))
        self._spectrum = spectrum * (sensor.contrast / np.fft.ifft2(spectrum).real.std())
        self._light, self._travel = sensor.light, sensor.travel_px
        self._rates = rng.uniform(0.5, 1.5, 4) * [1, 1.7, 1, 1.7]
        self._phases = rng.uniform(0, 2 * math.pi, 4)

    def luma(self, t_us: float) -> npt.NDArray[np.float32]:
        t_s = min(t_us, MOVES_US) * 1e-6
        waves = self._travel * np.sin(2 * math.pi * self._rates * t_s + self._phases) * [1, 0.6, 1, 0.6]
        moved = np.exp(-2j * math.pi * (self._kx * waves[:2].sum() + self._ky * waves[2:].sum()))
        found = np.full((HEIGHT, WIDTH), self._light, np.float32)
        found[STRIP:] = self._light * np.exp(np.fft.ifft2(self._spectrum * moved).real)
        return found


class HiddenStaticSensor(NamedTuple):
    """What is drawn of a sensor that sees static scenes, by the names of :class:`davis_rs.SensorParameters`, and two
    lights."""

    leak_rate_hz: float
    leak_spread: float
    leak_jitter: float
    shot_noise_rms: float
    shot_noise_half_lux: float
    known: SensorParameters
    lux: tuple[float, float]
    duration_s: float


def draw_static(seed: int, number: int) -> HiddenStaticSensor:
    """One of the sensors of a seed, with noise that makes 0.01 to 0.2 events a second in the darker light."""
    rng = np.random.default_rng([seed, number])

    def ratio(low: float, high: float) -> float:
        return math.exp(float(rng.uniform(math.log(low), math.log(high))))

    on, half, dark, leak = ratio(0.1, 0.35), ratio(50, 500), ratio(0.05, 1.5), ratio(0.05, 0.5)
    off, bandwidth = on * ratio(0.7, 1.4), ratio(80, 600)
    noise = ShotNoise.of_rate(ratio(0.01, 0.2), min(on, off), light=dark * half, half_luma=half, bandwidth_hz=bandwidth)
    return HiddenStaticSensor(
        leak_rate_hz=leak,
        leak_spread=float(rng.uniform(0.1, 0.4)),
        leak_jitter=float(rng.uniform(0.03, 0.2)),
        shot_noise_rms=noise.rms,
        shot_noise_half_lux=half,
        known=SensorParameters(
            contrast_threshold=on,
            contrast_threshold_off=off,
            threshold_mismatch=float(rng.uniform(0.02, 0.12)),
            shot_noise_bandwidth_hz=bandwidth,
        ),
        lux=(dark * half, dark * half * ratio(1.6, 2.5)),
        duration_s=ratio(8, 30) / leak,
    )


def static_recordings(sensor: HiddenStaticSensor, seed: int) -> list[MeasuredRecording]:
    """A recording in each of its lights."""
    drawn = sensor._asdict()
    fields = {name: drawn[name] for name in HiddenStaticSensor._fields[:5]}
    made = replace(sensor.known, **fields)
    found = []
    for lux in sensor.lux:
        events = static_events(
            made, (WIDTH, HEIGHT), sensor.duration_s, settled_s=2 / sensor.leak_rate_hz, lux=lux, seed=seed
        )
        found.append(measure_recording(events, size=(WIDTH, HEIGHT), quiet=(0, 0, WIDTH, HEIGHT), lux=lux))
    return found


def static_pulls(seed: int, number: int) -> dict[str, float]:
    """As :func:`pulls`, of static recordings."""
    sensor = draw_static(seed, number)
    fit = fit_sensor(static_recordings(sensor, number), SensorFile(sensor.known))
    return _pulls(fit, sensor)


def effects_of(sensor: HiddenSensor) -> Effects:
    """The effects on its events."""
    receptor_hz = sensor.photoreceptor_bandwidth_hz / (sensor.light + 1e-3)  # the engine's log_eps
    low = min(sensor.contrast_threshold, sensor.contrast_threshold_off)
    return Effects(
        photoreceptor_bandwidth_hz=PhotoreceptorBandwidth(receptor_hz, sensor.source_follower_bandwidth_hz),
        threshold_mismatch=ThresholdMismatch(sensor.threshold_mismatch, column_parity=sensor.threshold_column_parity),
        refractory_period_us=sensor.refractory_us,
        leak_rate_hz=LeakRate(sensor.leak_rate_hz),
        shot_noise_rms=ShotNoise.of_rate(sensor.noise_hz, low, half_luma=math.inf) if sensor.noise_hz else None,
        hot_pixels=HotPixels(sensor.hot_pixel_fraction, rate_hz=sensor.hot_pixel_rate_hz),
    )


def record(
    sensor: HiddenSensor, rng: np.random.Generator, seed: int, settled_us: int = _SETTLED_US
) -> tuple[EventArray, list[StampedFrame]]:
    """A recording of it: 2 s of motion with frames, then 12 s of rest with some."""
    light = _Light(sensor, rng)
    engine = CrossingEngine(
        WIDTH,
        HEIGHT,
        contrast_threshold=sensor.contrast_threshold,
        contrast_threshold_off=sensor.contrast_threshold_off,
        effects=effects_of(sensor).engine_settings(),
        seed=seed,
        interpolation="linear",
    )
    engine.push(0, before_a_leak(light.luma(0), engine, seed))
    for t_us in (1, *range(settled_us // 4, settled_us + 1, settled_us // 4)):
        engine.push(t_us, light.luma(0))
    instants: Iterable[int] = [*range(STEP_US, MOVES_US + 1, STEP_US), *range(MOVES_US + 500_000, RESTS_US, 500_000)]
    events = concatenate_events([engine.push(settled_us + t_us, light.luma(t_us)) for t_us in instants])
    events["t"] -= settled_us
    aps = Aps(sensor.exposure_us, read_noise_dn=sensor.aps_read_noise_dn, bits=10, full_scale_luma=1.0)
    frames = []
    for number, middle_us in enumerate([*range(10_000, MOVES_US, FRAME_US), *range(3_000_000, 9_000_000, 250_000)]):
        parts = middle_us + sensor.exposure_us * (np.arange(4) - 1.5) / 4
        luma = np.mean([light.luma(t_us) for t_us in parts], axis=0)
        values = np.clip(aps.read_out(luma, frame=number, seed=seed) * 1023 + round(sensor.black_dn), 0, 1023)
        frames.append(StampedFrame(float(middle_us), float(sensor.exposure_us), values))
    return events, frames


def recorded(sensor: HiddenSensor, rng: np.random.Generator, seed: int, lux: float | None = None) -> MeasuredRecording:
    """The same, measured."""
    events, frames = record(sensor, rng, seed, _SETTLED_US if lux is None else _SHORTLY_SETTLED_US)
    return measure_recording(
        events, size=(WIDTH, HEIGHT), frames=FrameSource(lambda: iter(frames), "DN", of_camera=True), lux=lux
    )


def pulls(seed: int, number: int) -> dict[str, float]:
    """Fitted less true value over the error that is told, of each parameter that is found."""
    sensor, rng = draw(seed, number)
    return _pulls(fit_sensor([recorded(sensor, rng, number)]), sensor)


def pulls_over_light(seed: int, number: int) -> dict[str, float]:
    """As :func:`pulls`, with a photoreceptor, in known light: of what is fitted together with its bandwidth."""
    sensor, rng = draw_over_light(seed, number)
    found = _pulls(fit_sensor([recorded(sensor, rng, number, _LUX)]), sensor)
    return {name: pull for name, pull in found.items() if name in OVER_LIGHT}


def _pulls(fit: SensorFit, sensor: HiddenSensor | HiddenStaticSensor) -> dict[str, float]:
    found = {}
    for one in fit.findings:
        truth = getattr(sensor, one.parameter or "", None)
        if one.value is not None and truth is not None:
            found[str(one.parameter)] = (one.value.value - truth) / one.value.sigma
    return found
