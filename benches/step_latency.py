"""How long a step of a closed loop takes: python benches/step_latency.py [--preset fast ...] [--size 128x128 ...]

Steps of 1 ms along three_planes, without frames and depth, on one thread: the median of the processor time of a step,
and the 90th percentile. What the core takes is timed by itself; the rest of a step is Python's. The sizes' turns are
interleaved, so that what else runs on the machine slows all of them alike.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from davis_rs import Camera, Simulator, load_scene

PRESETS = ("fast", "paper", "balanced")
SIZES = ("64x64", "128x128", "240x180", "346x260")
WARM_UP, STEP_US, TURNS = 20, 1000, 5


class TimedCore:
    """Passes calls to a part of the Rust core, and adds up their time."""

    def __init__(self, core: Any) -> None:
        self._core, self.taken_s = core, 0.0

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._core, name)
        return self._timed(value) if callable(value) else value

    def _timed(self, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **named: Any) -> Any:
            start = time.thread_time()
            try:
                return function(*arguments, **named)
            finally:
                self.taken_s += time.thread_time() - start

        return call


class Loop:
    """Steps one simulator along the scene's path, and notes the time of each step in all and in Python."""

    def __init__(self, preset: str, size: str, rays_per_pixel: int | None) -> None:
        width, height = map(int, size.split("x"))
        scene = load_scene("three_planes")
        focal = 200.0 * width / 240
        camera = Camera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)
        settings: dict[str, Any] = {"accuracy": preset, "camera": camera, "frame_rate_hz": 0, "depth_rate_hz": 0}
        if rays_per_pixel is not None:
            settings["rays_per_pixel"] = rays_per_pixel
        self.simulator = Simulator(scene, threads=1, **settings)
        self._path, self._step = scene.path, 0
        self._cores = TimedCore(self.simulator.renderer._core), TimedCore(self.simulator._engine)  # type: ignore[attr-defined]
        self.simulator.renderer._core, self.simulator._engine = self._cores  # type: ignore[attr-defined, assignment]
        self.taken_ms: list[float] = []
        self.python_ms: list[float] = []
        self.run(WARM_UP)
        self.taken_ms.clear()
        self.python_ms.clear()

    def run(self, steps: int) -> None:
        """Step on."""
        for _ in range(steps):
            t_us = self._step * STEP_US
            pose = self._path.pose(t_us * 1e-6)
            for core in self._cores:
                core.taken_s = 0.0
            start = time.thread_time()
            self.simulator.step(t_us, pose)
            taken_s = time.thread_time() - start
            self.taken_ms.append(1e3 * taken_s)
            self.python_ms.append(1e3 * (taken_s - sum(core.taken_s for core in self._cores)))
            self._step += 1


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--preset", nargs="+", choices=PRESETS, default=PRESETS)
    parser.add_argument("--size", nargs="+", default=SIZES, help="WIDTHxHEIGHT")
    parser.add_argument("--steps", type=int, default=500)
    parser.add_argument("--rays-per-pixel", type=int)
    options = parser.parse_args()
    loops = {(p, s): Loop(p, s, options.rays_per_pixel) for p in options.preset for s in options.size}
    for _ in range(TURNS):
        for loop in loops.values():
            loop.run(options.steps // TURNS)
    print("| accuracy | size | median | 90 of 100 | of it Python |")
    print("|---|---|---|---|---|")
    for (preset, size), loop in loops.items():
        median, most = np.percentile(loop.taken_ms, [50, 90])
        name = size.replace("x", " x ")
        print(f"| `{preset}` | {name} | {median:.2f} ms | {most:.2f} ms | {np.median(loop.python_ms):.2f} ms |")


if __name__ == "__main__":
    main()
