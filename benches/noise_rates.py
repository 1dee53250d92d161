"""Measures how often noise takes a pixel from one level to the next.

That is the table of ``davis_rs.sensor.effects.noise_rates``.

python benches/noise_rates.py

Pixels stand still half way between two levels, so that they go from one to the other and back. The engine counts. The
table has the share of Rice's rate of upward crossings, by the distance in standard deviations and the ratio of poles.
Thresholds and noise are small, so that the light is the same in all phases.
"""

from __future__ import annotations

import math
import time

import numpy as np

from davis_rs import CrossingEngine, Effects
from davis_rs.sensor.effects import ShotNoise

DISTANCES = 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0
RATIO_POWERS = 0, -2, -4, -6, -8, -10
FOLLOWER_HZ, C, SIDE = 300.0, 1e-4, 48
EVENTS, MOST_S = 20_000, 5.0


def half_way_rate_hz(distance: float, ratio: float) -> tuple[float, int]:
    """Events a second of a pixel whose levels are each so many standard deviations away, and how many were counted."""
    rms = C / 2 / distance * math.sqrt(1 + ratio)
    noise = ShotNoise(rms, half_luma=1 / ratio, bandwidth_hz=FOLLOWER_HZ)
    engine = CrossingEngine(SIDE, SIDE, contrast_threshold=C, effects=Effects(shot_noise_rms=noise), log_eps=1e-9)
    scene = np.zeros((SIDE, SIDE))
    engine.push_log(0, scene - C / 2)
    engine.push_log(1, scene)
    expected_hz = FOLLOWER_HZ * math.sqrt(ratio) * math.exp(-(distance**2) / 2)
    t_us, events, started = 1, 0, time.process_time()
    settle_us = int(1e6 * 3 / (2 * math.pi * FOLLOWER_HZ * min(1.0, ratio)))
    first_us = t_us + settle_us
    engine.push_log(first_us, scene)
    t_us = first_us
    while events < EVENTS and time.process_time() - started < MOST_S:
        t_us += max(int(1e6 * min(1000 / expected_hz / SIDE**2 * 5, 2.0)), 1000)
        events += len(engine.push_log(t_us, scene))
    return events / SIDE**2 / ((t_us - first_us) * 1e-6), events


def main() -> None:
    """Measure and print."""
    for power in RATIO_POWERS:
        ratio = 2.0**power
        shares = []
        for distance in DISTANCES:
            rate_hz, events = half_way_rate_hz(distance, ratio)
            share = rate_hz / (FOLLOWER_HZ * math.sqrt(ratio) * math.exp(-(distance**2) / 2))
            # Where noise is so rare that too few events come, the logarithm goes on straight.
            shares.append(share if events > 500 else shares[-1] ** 2 / shares[-2])
        print(f"    ({', '.join(f'{share:.3f}' for share in shares)}),  # 2^{power}", flush=True)


if __name__ == "__main__":
    main()
