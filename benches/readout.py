"""What the readout bus does: how many bursts of rows leave in a stretch, with and without the cost of a row's address.

python benches/readout.py [-o docs/readout.png]
"""

from __future__ import annotations

import numpy as np
from effect_figure import picture

from davis_rs import CrossingEngine, Effects
from davis_rs.events.arrays import EventArray, concatenate_events
from davis_rs.geometry.pose import FloatArray
from davis_rs.sensor.effects import Readout

WIDTH, HEIGHT, STEP_US = 240, 180, 500
ROWS_US = 0.0, 0.32


def edge(speed_px_per_s: float, row_us: float | None) -> EventArray:
    """The events of a slanted edge that crosses the sensor, behind a bus or without one."""
    bus = None if row_us is None else Readout(9e6, latency_us=3.0, row_us=row_us)
    engine = CrossingEngine(WIDTH, HEIGHT, effects=Effects(readout=bus, threshold_mismatch=0.12))
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    packets = []
    for t_us in range(0, int(0.4 * WIDTH / speed_px_per_s * 1e6), STEP_US):
        place = x - 0.3 * y - 20 - speed_px_per_s * t_us * 1e-6
        packets.append(engine.push_log(t_us, 1.5 * np.tanh(place / 2.0)))
    return concatenate_events([*packets, engine.flush()])


def bursts_in(events: EventArray, window_us: int) -> FloatArray:
    """Rows of one stamp in the window that begins with each."""
    t = np.unique(events[["t", "y"]])["t"].astype(np.int64)
    return np.asarray(np.searchsorted(t, t + window_us) - np.arange(len(t)), np.float64)


def main() -> None:
    """Run, print, draw."""
    with picture(__doc__, panels=2, size=(7.2, 2.7)) as axes:
        for row_us in ROWS_US:
            events = edge(4_000, row_us)
            for axis, window_us in zip(axes, (1, 10), strict=True):
                made = bursts_in(events, window_us)
                axis.hist(made, np.arange(0.5, 90), histtype="step", density=True, label=f"row_us = {row_us:g}")
                axis.set(xlabel=f"bursts of rows in {window_us} us", ylabel="share", yscale="log")
                print(f"row_us {row_us:g}: at most {made.max():.0f} bursts in {window_us} us, of {len(events)} events")
        axes[0].set_xlim(0, 15)
        for axis, most in zip(axes, (3, 17), strict=True):
            axis.axvline(most, color="k", linestyle=":", label="most in two recordings")
            axis.legend(fontsize=6)


if __name__ == "__main__":
    main()
