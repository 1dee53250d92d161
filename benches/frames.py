"""Events from frames against the bare engine, interleaved, in processor and wall time: a table with ratios.

python benches/frames.py [--frames 1000] [--rounds 3]

The clip is 346 x 260: a texture in motion with noise, by two pixels a frame. ``engine`` is CrossingEngine fed with the
same linear luma by hand. Decoding and the conversion to light run in a thread next to the engine.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from davis_rs import CrossingEngine, events_from_frames, open_frames
from davis_rs.simulation.from_frames.frame_source import Encoding
from davis_rs.simulation.from_frames.light import Light

WIDTH, HEIGHT, FPS = 346, 260, 240


def clip(count: int) -> npt.NDArray[np.uint8]:
    """Grey frames (n, H, W)."""
    y, x = np.mgrid[:HEIGHT, : WIDTH + 2 * count].astype(np.float32)
    wide = 120 + 20 * np.sin(x * 0.21 + y * 0.07) + 20 * np.sin(x * 0.05 - y * 0.13)
    wide += np.random.default_rng(0).normal(0, 1, wide.shape)
    grey = np.clip(wide, 0, 255).astype(np.uint8)
    return np.stack([grey[:, 2 * k : 2 * k + WIDTH] for k in range(count)])


def engine(luma: npt.NDArray[np.float32], log_eps: float) -> int:
    """How many events the bare engine makes."""
    one = CrossingEngine(WIDTH, HEIGHT, log_eps=log_eps)
    return sum(len(one.push(round(k * 1e6 / FPS), frame)) for k, frame in enumerate(luma))


def counted(frames: Any, **settings: Any) -> int:
    return sum(len(packet.events) for packet in events_from_frames(frames, **settings))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    grey = clip(options.frames)
    light = Light(Encoding.of(grey.dtype, "bench"))
    luma = np.stack([light.luma(frame, "bench") for frame in grey])
    log_eps = 2e-3
    with tempfile.TemporaryDirectory() as folder:
        video = Path(folder) / "clip.mp4"
        write_video(video, grey)
        by_rule: dict[str, Callable[[], int]] = {
            "engine": lambda: engine(luma, log_eps),
            "float frames, linear": lambda: counted(luma, fps=FPS, interpolation="linear", log_eps=log_eps),
            "8-bit frames, linear": lambda: counted(grey, fps=FPS, interpolation="linear", log_eps=log_eps),
            "H.264, linear": lambda: counted(open_frames(video), interpolation="linear", log_eps=log_eps),
            "float frames, cubic": lambda: counted(luma, fps=FPS, interpolation="cubic", log_eps=log_eps),
            "float frames, auto": lambda: counted(luma[:30], fps=FPS, interpolation="auto", log_eps=log_eps),
        }
        wall = {name: [np.inf] for name in by_rule}
        cpu = {name: [np.inf] for name in by_rule}
        events = {}
        for _ in range(options.rounds):
            for name, run in by_rule.items():
                started, before = time.perf_counter(), time.process_time()
                events[name] = run()
                wall[name].append(time.perf_counter() - started)
                cpu[name].append(time.process_time() - before)
    taken = {name: 30 if name.endswith("auto") else options.frames for name in by_rule}
    print("| | events | ms a frame | processor ms a frame | speed, of the engine's |\n|---|---:|---:|---:|---:|")
    per_frame = {name: min(wall[name]) / taken[name] for name in by_rule}
    for name in by_rule:
        ratio = per_frame["engine"] / per_frame[name]
        cells = (
            f"{events[name]:,} | {1e3 * per_frame[name]:.2f} | {1e3 * min(cpu[name]) / taken[name]:.2f} | {ratio:.0%}"
        )
        print(f"| {name} | {cells} |")


def write_video(path: Path, frames: npt.NDArray[np.uint8]) -> None:
    """H.264 with the library's usual settings."""
    import av

    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream("libx264", rate=FPS)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        for image in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="gray").reformat(format="yuv420p")))
        container.mux(stream.encode(None))


if __name__ == "__main__":
    main()
