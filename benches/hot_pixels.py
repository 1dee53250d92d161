"""Hot pixels: when they fire, how often and how regularly.

python benches/hot_pixels.py [-o docs/hot_pixels.png]
"""

from __future__ import annotations

import argparse

import numpy as np

from davis_rs import CrossingEngine, Effects
from davis_rs.effects import HotPixels

WIDTH, HEIGHT, SECONDS = 240, 180, 60
RECORDED_HZ, RECORDED_CV = (5.0, 54.0), (0.05, 0.5)
"""Ranges of two public recordings of a DAVIS240C."""


def main() -> None:
    """Run, print, draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", help="the picture")
    options = parser.parse_args()
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(7.2, 2.7), layout="constrained")
    points = []
    for seed in range(20):
        engine = CrossingEngine(WIDTH, HEIGHT, effects=Effects(hot_pixels=HotPixels(1.4e-4)), seed=seed)
        frame = np.zeros((HEIGHT, WIDTH), np.float32)
        engine.push(0, frame)
        events = engine.push(SECONDS * 1_000_000, frame)
        events = events[np.lexsort((events["t"], events["x"], events["y"]))]
        pixel = events["y"].astype(int) * WIDTH + events["x"]
        for row, own in enumerate(np.split(events["t"] * 1e-6, np.flatnonzero(np.diff(pixel)) + 1)):
            waits = np.diff(own)
            if len(waits) < 2:  # a sensor without any
                continue
            points.append((1 / waits.mean(), waits.std() / waits.mean()))
            if seed == 0:
                left.plot(own[own < 2], np.full((own < 2).sum(), row), "|", markersize=9)
    rate, cv = np.array(points).T
    low, median, high = np.quantile(rate, (0.1, 0.5, 0.9))
    shown = f"{low:.1f}, {median:.1f}, {high:.1f} Hz (10, 50, 90 %), CV {cv.min():.3f} to {cv.max():.3f}"
    print(f"{len(points)} hot pixels of 20 sensors: {shown}")
    left.set(xlabel="time (s)", ylabel="hot pixel of a sensor")
    right.loglog(rate, cv, ".", markersize=4)
    right.add_patch(
        plt.Rectangle(
            (RECORDED_HZ[0], RECORDED_CV[0]),
            RECORDED_HZ[1] - RECORDED_HZ[0],
            RECORDED_CV[1] - RECORDED_CV[0],
            fill=False,
            linestyle=":",
        )
    )
    right.set(xlabel="events a second", ylabel="CV of intervals", xlim=(1, 200), ylim=(0.03, 0.8))
    if options.output:
        figure.savefig(options.output, dpi=200)


if __name__ == "__main__":
    main()
