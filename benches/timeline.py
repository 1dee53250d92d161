"""What a run does when: python benches/timeline.py [SCENE] [PRESET] [--size WxH] [--duration SECONDS] [-o PICTURE]

Prints for one simulated second (or --duration, or the whole path, where that is shorter) how much of the wall time went
into rendering, crossing and both at once, and what share was neither: sampling rules, packets, everything in Python. A
run renders in a thread of its own while the crossing engine works on the keyframes before; --threads 1 shows it in
turn.
With -o, a picture of the middle of the run.
"""

from __future__ import annotations

import argparse
import threading
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import davis_rs
from davis_rs import ACCURACY, Simulator

SHOWN_S = 0.5
"""How much of the wall time the picture shows."""

COLOURS = {"frames": "#0072B2", "single pixels": "#56B4E9", "depth": "#009E73", "crossing": "#D55E00"}


class Work(NamedTuple):
    """What a thread did from when to when, in seconds of wall time."""

    kind: str
    thread: str
    start: float
    end: float


class Timed:
    """An object, some of whose methods are timed."""

    def __init__(self, timed: Any, kinds: dict[str, str], done: list[Work]) -> None:
        self._timed, self._kinds, self._done = timed, kinds, done

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._timed, name)
        if name not in self._kinds:
            return found

        def call(*arguments: Any, **named: Any) -> Any:
            start = time.perf_counter()
            try:
                return found(*arguments, **named)
            finally:
                thread = "ahead" if threading.current_thread().name == "davis_rs ahead" else "main"
                self._done.append(Work(self._kinds[name], thread, start, time.perf_counter()))

        return call


def run(
    scene: str, preset: str, threads: int | None, size: str | None, duration_s: float
) -> tuple[list[Work], float, float]:
    """Return all that was done, and when the run began and ended."""
    whole = davis_rs.load_scene(scene)
    part = whole.crop(0.0, min(duration_s, whole.path.duration_s))
    simulator = Simulator(part, accuracy=preset, threads=threads, size=size, frame_rate_hz=24)
    done: list[Work] = []
    renderer = simulator.renderer
    renderer.luma(
        davis_rs.geometry.trajectory.views.Views.along(part.path, np.zeros(1))
    )  # what is made when it is first asked for
    kinds = {
        "luma": "frames",
        "line_luma": "frames",
        "samples": "single pixels",
        "line_samples": "single pixels",
        "depth": "depth",
    }
    renderer._core = Timed(renderer._core, kinds, done)
    simulator._engine = Timed(simulator._engine, {"push": "crossing"}, done)
    begin = time.perf_counter()
    for _ in simulator.run():
        pass
    return done, begin, time.perf_counter()


def covered(work: list[Work], begin: float, end: float) -> np.ndarray:
    """Whether any of the work goes on, in each of 20,000 parts of the wall time."""
    parts = np.zeros(20_000, np.bool_)
    scale = len(parts) / (end - begin)
    for one in work:
        parts[int((one.start - begin) * scale) : max(int((one.end - begin) * scale), 1)] = True
    return parts


def draw(done: list[Work], begin: float, end: float, title: str, path: Path) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 2.4), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    axis = figure.subplots()
    middle = (begin + end) / 2
    first = max(begin, middle - SHOWN_S / 2)
    rows = {"main": 0, "ahead": 1}
    for kind, colour in COLOURS.items():
        for thread, row in rows.items():
            spans = [
                (1e3 * (w.start - first), 1e3 * (w.end - w.start)) for w in done if (w.kind, w.thread) == (kind, thread)
            ]
            axis.broken_barh(spans, (row - 0.4, 0.8), color=colour, lw=0)
        axis.plot([], [], color=colour, lw=6, label=kind)
    axis.set_xlim(0, 1e3 * min(SHOWN_S, end - begin))
    axis.set_yticks([0, 1], ["main thread", "thread that\nrenders ahead"])
    axis.set_xlabel("wall time (ms)")
    axis.set_title(title, fontsize=10)
    figure.legend(loc="outside right center", frameon=False, fontsize=9)
    figure.savefig(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", default="three_planes", metavar="SCENE")
    parser.add_argument("preset", nargs="?", default="balanced", choices=tuple(ACCURACY), metavar="PRESET")
    parser.add_argument("--threads", type=int, metavar="N", help="as of the simulator")
    parser.add_argument("--size", metavar="WxH", help="of the image, pixels; default: the scene's")
    parser.add_argument("--duration", type=float, default=1.0, metavar="SECONDS", help="of the path")
    parser.add_argument("-o", "--output", type=Path, metavar="PICTURE", help="the picture to write")
    options = parser.parse_args()
    done, begin, end = run(options.scene, options.preset, options.threads, options.size, options.duration)
    rendering = covered([one for one in done if one.kind != "crossing"], begin, end)
    crossing = covered([one for one in done if one.kind == "crossing"], begin, end)
    shares = {
        "rendering alone": (rendering & ~crossing).mean(),
        "crossing alone": (crossing & ~rendering).mean(),
        "both at once": (rendering & crossing).mean(),
        "neither": (~rendering & ~crossing).mean(),
    }
    text = ", ".join(f"{name} {share:.0%}" for name, share in shares.items())
    title = f"{options.scene}, {options.preset}: {end - begin:.2f} s of wall time; {text}"
    print(title)
    if options.output is not None:
        draw(done, begin, end, title, options.output)


if __name__ == "__main__":
    main()
