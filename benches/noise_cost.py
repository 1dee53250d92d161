"""What shot noise costs: pixels that stand still at a distance from both levels, and a scene that moves.

python benches/noise_cost.py

Processor time of one thread, the least of several interleaved runs. First nanoseconds a pixel and keyframe, keyframes
being 1 ms apart, in three lights and without noise. Then three_planes, rendered once, with the noise of a DAVIS240C,
over the same keyframes without effects.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

from davis_rs import SENSORS, CrossingEngine, Effects, Simulator, load_scene
from davis_rs.geometry.pose import FloatArray
from davis_rs.sensor.effects import ShotNoise

SIDE, KEYFRAMES, RMS, REPEATS = 128, 100, 0.05, 3
DISTANCES = 7.0, 5.5, 5.1, 4.0, 3.0
LIGHTS = 0.02, 1.0, 30.0
"""Over the light in which both poles are alike."""

SECONDS = 0.2
"""Of three_planes."""


def standing_ns(distance: float | None, light: float) -> float:
    """A pixel and keyframe of a scene that stands still, so many standard deviations from both levels."""
    noise, c = None, 0.3
    if distance is not None:
        noise, c = ShotNoise(RMS * math.sqrt(1 + light)), RMS * distance
    engine = CrossingEngine(SIDE, SIDE, contrast_threshold=c, effects=Effects(shot_noise_rms=noise), threads=1)
    here = np.full((SIDE, SIDE), math.log(light))
    for t_us in (0, 1000):
        engine.push_log(t_us, here)
    begun = time.process_time()
    for k in range(KEYFRAMES):
        engine.push_log(2000 + 1000 * k, here)
    return (time.process_time() - begun) / KEYFRAMES / SIDE**2 * 1e9


def moving_s(frames: list[tuple[int, FloatArray]], c: float, noise: ShotNoise | None) -> float:
    """The same keyframes through an engine."""
    height, width = frames[0][1].shape
    engine = CrossingEngine(width, height, contrast_threshold=c, effects=Effects(shot_noise_rms=noise), threads=1)
    begun = time.process_time()
    for t_us, luma in frames:
        engine.push(t_us, luma)
    return time.process_time() - begun


def least(run: Callable[[], float], repeats: int = REPEATS) -> float:
    """The least of several runs."""
    return min(run() for _ in range(repeats))


def main() -> None:
    """Measure and print."""
    print("| light | no noise | " + " | ".join(f"{distance:g} sigma" for distance in DISTANCES) + " |")
    print("|---" * (2 + len(DISTANCES)) + "|")
    for light in LIGHTS:
        values = [least(lambda d=distance, x=light: standing_ns(d, x)) for distance in (None, *DISTANCES)]
        print(f"| {light:g} | " + " | ".join(f"{value:.1f}" for value in values) + " |", flush=True)
    sensor = SENSORS["davis240c"]
    packets = Simulator(load_scene("three_planes").crop(0.0, SECONDS), depth_rate_hz=0).run()
    frames = [(packet.end_us, packet.luma) for packet in packets if packet.luma is not None]
    c = sensor.contrast_threshold or 0.2
    print(f"\nthree_planes, {SECONDS:g} s, {len(frames)} keyframes, C = {c:.3g}:")
    for lux in (20_000.0, 5.0):
        noise = sensor.effects(lux / float(np.mean(frames[0][1]))).shot_noise_rms
        ideal, noisy = (least(lambda n=each: moving_s(frames, c, n)) for each in (None, noise))
        print(f"{lux:,.0f} lux: {noisy / ideal:.1f} x the ideal engine ({1e3 * ideal:.0f} ms)")


if __name__ == "__main__":
    main()
