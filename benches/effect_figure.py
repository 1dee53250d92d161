"""What the pictures of single effects have in common: their command line, the figure, and pixels on static scenes."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from davis_rs import CrossingEngine, Effects
from davis_rs.calibrate.sensor.static_scene import before_a_leak
from davis_rs.events.arrays import EventArray, concatenate_events


@contextmanager
def picture(description: str | None, *, panels: int, size: tuple[float, float]) -> Iterator[Any]:
    """The axes (panels,) of a figure, side by side. ``size`` is in inches. ``-o FILE`` says where it is written."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("-o", "--output", help="the picture")
    options = parser.parse_args()
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    plt.rcParams.update({"font.size": 8, "axes.labelsize": 8, "legend.fontsize": 6.5, "legend.frameon": False})
    figure, axes = plt.subplots(1, panels, figsize=size, layout="constrained")
    yield axes
    if options.output:
        figure.savefig(options.output, dpi=200)


def on_static_scene(
    effects: Effects, luma: float, seconds: float, *, size: tuple[int, int], **settings: Any
) -> tuple[CrossingEngine, EventArray]:
    """Pixels (width, height) that see one luma for so long, and their events; ``settings`` are those of the engine.

    Those that leak have leaked before.
    """
    engine = CrossingEngine(*size, effects=effects, **settings)
    frame = np.full(size[::-1], luma, np.float32)
    engine.push(0, frame if effects.leak_rate_hz is None else before_a_leak(frame, engine, 0))
    events = [engine.push(t_us, frame) for t_us in (1, int(seconds * 1e6))]
    return engine, concatenate_events(events)


def of_each_pixel(events: EventArray) -> list[EventArray]:
    """The events of each pixel that has any, in the order of time."""
    own = events[np.lexsort((events["t"], events["x"], events["y"]))]
    place = (own["y"].astype(np.int64) << 16) | own["x"]
    return np.split(own, np.flatnonzero(np.diff(place)) + 1)
