"""What noise does to slow contrast, and that its events come in pairs: a picture, and the numbers in it.

python benches/noise_reset.py [-o docs/noise_reset.png]
"""

from __future__ import annotations

import math

import numpy as np
from effect_figure import of_each_pixel, picture

from davis_rs import CrossingEngine, Effects
from davis_rs.events.arrays import EventArray, concatenate_events
from davis_rs.sensor.effects import ShotNoise

SIDE, SECONDS, C, SLOPE = 32, 60, 0.2, 0.02
NOISE = ShotNoise.of_rate(5.0, C, half_luma=math.inf)
PERIODS_US = None, 3.37, 100.0, 530.0, 10_000.0


def ramp(slope: float, effects: Effects) -> EventArray:
    """The events of all pixels on a ramp of log intensity."""
    engine = CrossingEngine(SIDE, SIDE, contrast_threshold=C, effects=effects)
    frames = (np.full((SIDE, SIDE), slope * t) for t in range(SECONDS + 1))
    return concatenate_events([engine.push_log(t * 1_000_000, frame) for t, frame in enumerate(frames)])


def standing(effects: Effects) -> EventArray:
    """The events of pixels that stand still, their references at all phases."""
    engine = CrossingEngine(SIDE, SIDE, contrast_threshold=C, effects=effects, start_phase="stationary")
    frame = np.zeros((SIDE, SIDE))
    return concatenate_events([engine.push_log(t * 1_000_000, frame) for t in range(SECONDS + 1)])


def main() -> None:
    """Run, print, draw."""
    with picture(__doc__, panels=2, size=(7.2, 3.0)) as (left, right):
        t_s = np.linspace(0, SECONDS, 601)
        left.plot(t_s, SLOPE * t_s / C, "k:", label="ramp / C")
        for period_us in PERIODS_US:
            events = ramp(SLOPE, Effects(shot_noise_rms=NOISE, refractory_period_us=period_us))
            steps = np.concatenate([[0], np.cumsum(np.where(events["p"] == 1, 1, -1))]) / SIDE**2
            net = steps[np.searchsorted(events["t"], t_s * 1e6, side="right")]
            name = "no refractory period" if period_us is None else f"T = {period_us:g} us"
            left.plot(t_s, net, "--" if period_us == PERIODS_US[1] else "-", label=name, linewidth=1)
            rate_hz = len(events) / SIDE**2 / SECONDS
            print(f"{name}: {rate_hz:.2f} events a second, ON - OFF {net[-1]:.2f} in {SECONDS} s")
        left.set(xlabel="time (s)", ylabel="ON - OFF events a pixel")
        left.legend(fontsize=6)
        events = standing(Effects(shot_noise_rms=NOISE))
        pixels = of_each_pixel(events)
        waits_ms = np.concatenate([np.diff(own["t"]) * 1e-3 for own in pixels])
        opposite = np.concatenate([np.diff(own["p"].astype(int)) != 0 for own in pixels])
        edges = np.geomspace(0.01, 1e4, 61)
        for kept, name in ((opposite, "opposite polarity"), (~opposite, "same polarity")):
            right.stairs(np.histogram(waits_ms[kept], edges)[0], edges, label=name)
        right.set(xscale="log", xlabel="wait for the pixel's next event (ms)", ylabel="events")
        right.legend(fontsize=6)


if __name__ == "__main__":
    main()
