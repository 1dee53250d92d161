"""Hot pixels: when they fire, how often and how regularly.

python benches/hot_pixels.py [-o docs/hot_pixels.png]
"""

from __future__ import annotations

import numpy as np
from effect_figure import of_each_pixel, on_static_scene, picture

from davis_rs import Effects
from davis_rs.sensor.effects import HotPixels

WIDTH, HEIGHT, SECONDS = 240, 180, 60
RECORDED_HZ, RECORDED_CV = (5.0, 54.0), (0.05, 0.5)
"""Ranges of two public recordings of a DAVIS240C."""


def main() -> None:
    """Run, print, draw."""
    with picture(__doc__, panels=2, size=(7.2, 2.7)) as (left, right):
        points = []
        for seed in range(20):
            effects = Effects(hot_pixels=HotPixels(1.4e-4))
            _, events = on_static_scene(effects, 0.0, SECONDS, size=(WIDTH, HEIGHT), seed=seed)
            for row, own in enumerate(pixel["t"] * 1e-6 for pixel in of_each_pixel(events)):
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
        (slow, fast), (regular, irregular) = RECORDED_HZ, RECORDED_CV
        box = [slow, fast, fast, slow, slow], [regular, regular, irregular, irregular, regular]
        right.plot(*box, "k:", linewidth=1, label="two recordings")
        right.legend(loc="lower left")
        right.set(xlabel="events a second", ylabel="CV of intervals", xlim=(1, 200), ylim=(0.03, 0.8))


if __name__ == "__main__":
    main()
