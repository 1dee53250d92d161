"""What noise does to slow contrast, and that its events come in pairs: a picture, and the numbers in it.

python benches/noise_reset.py [-o docs/noise_reset.png]
"""

from __future__ import annotations

import argparse
import math

import numpy as np

from davis_rs import CrossingEngine, Effects
from davis_rs.effects import ShotNoise
from davis_rs.events import EventArray, concatenate_events

SIDE, SECONDS, C, SLOPE = 64, 60, 0.2, 0.02
NOISE = ShotNoise.of_rate(5.0, C, half_luma=1e9)
PERIODS_US = None, 3.37, 100.0, 530.0, 10_000.0


def ramp(slope: float, effects: Effects) -> EventArray:
    """The events of all pixels on a ramp of log intensity."""
    engine = CrossingEngine(SIDE, SIDE, contrast_threshold=C, effects=effects)
    frames = (np.full((SIDE, SIDE), slope * t) for t in range(SECONDS + 1))
    return concatenate_events([engine.push_log(t * 1_000_000, frame) for t, frame in enumerate(frames)])


def main() -> None:
    """Run, print, draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", help="the picture")
    options = parser.parse_args()
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(7.2, 3.0), layout="constrained")
    t_s = np.linspace(0, SECONDS, 601)
    left.plot(t_s, SLOPE * t_s / C, "k:", label="ramp / C")
    for period_us in PERIODS_US:
        events = ramp(SLOPE, Effects(shot_noise_rms=NOISE, refractory_period_us=period_us))
        steps = np.concatenate([[0], np.cumsum(np.where(events["p"] == 1, 1, -1))]) / SIDE**2
        net = steps[np.searchsorted(events["t"], t_s * 1e6, side="right")]
        name = "no refractory period" if period_us is None else f"T = {period_us:g} us"
        left.plot(t_s, net, "--" if period_us == PERIODS_US[1] else "-", label=name, linewidth=1)
        print(f"{name}: {len(events) / SIDE**2 / SECONDS:.2f} events a second, ON - OFF {net[-1]:.2f} in {SECONDS} s")
    left.set(xlabel="time (s)", ylabel="ON - OFF events a pixel")
    left.legend(fontsize=6)
    events = ramp(0.0, Effects(shot_noise_rms=NOISE))
    own = events[np.lexsort((events["t"], events["x"], events["y"]))]
    same = (np.diff(own["x"].astype(int)) == 0) & (np.diff(own["y"].astype(int)) == 0)
    opposite = np.diff(own["p"].astype(int)) != 0
    waits_ms = np.diff(own["t"]) * 1e-3
    edges = np.geomspace(0.01, 1e4, 61)
    for kept, name in ((same & opposite, "opposite polarity"), (same & ~opposite, "same polarity")):
        right.stairs(np.histogram(waits_ms[kept], edges)[0], edges, label=name)
    tau_ms = 1e3 / (2 * math.pi * NOISE.bandwidth_hz)
    law = np.exp(-edges[:-1] / tau_ms) - np.exp(-edges[1:] / tau_ms)
    right.plot(np.sqrt(edges[1:] * edges[:-1]), law * (same.sum() + 1) / 2, "k:", label=f"exponential, {tau_ms:.3f} ms")
    right.set(xscale="log", xlabel="wait for the pixel's next event (ms)", ylabel="events")
    right.legend(fontsize=6)
    if options.output:
        figure.savefig(options.output, dpi=200)


if __name__ == "__main__":
    main()
