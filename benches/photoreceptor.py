"""What photoreceptor and source follower make of steps and sines, in light and in the dark, next to their law.

python benches/photoreceptor.py [-o docs/photoreceptor.png]
"""

from __future__ import annotations

import math

import numpy as np
from effect_figure import picture

from davis_rs import SENSORS, CrossingEngine, Effects
from davis_rs.events.arrays import concatenate_events
from davis_rs.geometry.pose import FloatArray
from davis_rs.sensor.effects import PhotoreceptorBandwidth

LUX = 0.0, 1.0, 10.0, 100.0, 1000.0
"""Of the scene; the sensor's dark current comes on top."""

SENSOR = SENSORS["davis240c"]
SIZE, LEVELS = 4e-3, 40
"""A step or a sine so small that the light hardly changes, and how many events are on its way."""


def pixel(light: float, c: float) -> CrossingEngine:
    """A pixel under the sensor's low-passes, one luma being a lux, and a threshold."""
    effects = Effects(photoreceptor_bandwidth_hz=SENSOR.effects(1.0).photoreceptor_bandwidth_hz)
    engine = CrossingEngine(1, 1, contrast_threshold=c, effects=effects)
    engine.push_log(0, np.full((1, 1), math.log(light)))
    return engine


def step_response(light: float, corners_hz: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """Seconds of events after a small step, and the share of it that they stand for."""
    engine = pixel(light, SIZE / LEVELS)
    seconds = 3 / (math.pi * min(corners_hz))
    frame = np.full((1, 1), math.log(light) + SIZE)
    ends = 1 + np.unique(np.geomspace(1, seconds * 1e6, 100).astype(np.int64))
    events = concatenate_events([engine.push_log(int(t), frame) for t in (1, *ends)])
    return (events["t"] - 0.5) * 1e-6, np.arange(1, len(events) + 1) / LEVELS


def step_law(t_s: FloatArray, corners_hz: tuple[float, float]) -> FloatArray:
    """Of two poles."""
    first, second = (2 * math.pi * hz for hz in corners_hz)
    return np.asarray(1 - (second * np.exp(-first * t_s) - first * np.exp(-second * t_s)) / (second - first))


def sine_response(light: float, frequency_hz: float, expected: complex) -> complex:
    """The complex gain of a small sine, by least squares over what events stand for."""
    c = SIZE * abs(expected) / LEVELS
    engine = pixel(light, c)
    w, periods = 2e-6 * math.pi * frequency_hz, 4
    slowest_hz = 3.0 * light
    settled_us = 1e6 * math.ceil(1.5 * frequency_hz / min(slowest_hz, 286.0)) / frequency_hz
    times = np.unique(np.rint(np.arange(1, 400 * (settled_us * frequency_hz * 1e-6 + periods)) / (4e-4 * frequency_hz)))
    frames = ((int(t), np.full((1, 1), math.log(light) + SIZE * math.sin(w * t))) for t in times)
    events = concatenate_events([engine.push_log(t, frame) for t, frame in frames])
    level = c * np.cumsum(np.where(events["p"] == 1, 1.0, -1.0))
    kept = events["t"] > settled_us
    at = w * (events["t"][kept] - 0.5)
    parts = np.stack([np.sin(at), np.cos(at), np.ones_like(at)], 1)
    in_phase, quadrature, _ = np.linalg.lstsq(parts, level[kept], rcond=None)[0]
    return complex(in_phase, quadrature) / SIZE


def main() -> None:
    """Run, print, draw."""
    effect, dark = SENSOR.effects(1.0).photoreceptor_bandwidth_hz, SENSOR.dark_luma(1.0)
    assert isinstance(effect, PhotoreceptorBandwidth)
    assert dark is not None
    with picture(__doc__, panels=3, size=(8.4, 2.7)) as (steps, gains, phases):
        for k, lux in enumerate(LUX):
            light, colour = lux + dark, f"C{k}"
            corners_hz = effect.hz * light, effect.source_follower_hz
            t_s, reached = step_response(light, corners_hz)
            fine = np.geomspace(1e-5, 1, 400)
            steps.semilogx(fine, step_law(fine, corners_hz), color=colour, linewidth=1, label=f"{lux:g} lux")
            steps.plot(t_s, reached, ".", color=colour, markersize=3)
            off = np.abs(step_law(t_s, corners_hz) - reached).max()
            frequencies = np.geomspace(0.1, 3000, 10)
            law = effect.response(frequencies, light)
            shown = np.abs(law) > 0.011
            found = np.array([sine_response(light, f, g) for f, g in zip(frequencies[shown], law[shown], strict=True)])
            fine = np.geomspace(0.05, 5000, 300)
            curve = effect.response(fine, light)
            gains.loglog(fine, np.abs(curve), color=colour, linewidth=1)
            gains.plot(frequencies[shown], np.abs(found), ".", color=colour, markersize=5)
            phases.semilogx(fine, np.angle(curve, deg=True), color=colour, linewidth=1)
            phases.plot(frequencies[shown], np.angle(found, deg=True), ".", color=colour, markersize=5)
            gain_error = np.abs(np.abs(found) / np.abs(law[shown]) - 1).max()
            phase = np.angle(found / law[shown], deg=True)
            print(
                f"{lux:g} lux: poles at {corners_hz[0]:.3g} and {corners_hz[1]:.3g} Hz; off the law at most by "
                f"{100 * off:.2f} % of the step, {100 * gain_error:.2f} % in gain, {np.abs(phase).max():.2f} degrees"
            )
        steps.set(xlabel="time after a step (s)", ylabel="share of the step", xlim=(1e-5, 1), ylim=(0, 1.05))
        steps.legend()
        gains.axhline(math.sqrt(0.5), color="k", linestyle=":", linewidth=0.7)
        gains.text(0.06, 0.45, "-3 dB", fontsize=6.5)
        gains.set(xlabel="frequency (Hz)", ylabel="gain", ylim=(1e-2, 1.5))
        phases.set(xlabel="frequency (Hz)", ylabel="phase (degrees)", yticks=[0, -45, -90, -135, -180])


if __name__ == "__main__":
    main()
