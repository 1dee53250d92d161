"""What a sequence of a plan for training costs, and what bounds it: processor time by part, one thread, one process.

    python benches/training_throughput.py [--sequences 20] [--textures FOLDER] [--shared]

Without a folder of images it makes some. ``--shared``: all sequences in one built-in scene, which has its own textures.
"""

from __future__ import annotations

import argparse
import functools
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from davis_rs.generate import job, load_sequence_plan
from davis_rs.generate.generate import draw_sequences
from davis_rs.generate.sequence import DrawnSequence
from davis_rs.io.dataset.writer import DatasetWriter
from davis_rs.scene.textures import patchwork
from davis_rs.simulation import folder as simulation_folder
from davis_rs.simulation.simulator import Simulator

PLAN = """
seed: 1
sequences: {sequences}
scene: {scene}
start: {start}
duration: 0.1
contrast_threshold: {{uniform: [0.15, 0.3]}}
flow_rate: 40
accuracy: fast
"""

PARTS = (
    (DrawnSequence, "scene", "scene"),
    (job, "_scene_at", "scene"),
    (DrawnSequence, "on_path", "scene"),
    (simulation_folder, "make_simulator", "start-up of the simulator, images read"),
    (Simulator, "_truth", "flow"),
    (Simulator, "_take", "crossing"),
    (DatasetWriter, "write", "writing"),
    (DatasetWriter, "finish", "writing"),
    (job, "publish", "writing"),
    (job, "describe_folder", "writing"),
)
"""What is timed; the rest is rendering, and sampling in time."""


class PartTimes:
    """Processor time of functions by part, each without that of others within it, in whatever thread."""

    def __init__(self) -> None:
        self.seconds: Counter[str] = Counter()
        self._inner = threading.local()

    def watch(self, owner: Any, name: str, part: str) -> None:
        """Time a function of a module or class from now on."""
        function = getattr(owner, name)

        @functools.wraps(function)
        def timed(*args: Any, **keywords: Any) -> Any:
            outer, self._inner.s = getattr(self._inner, "s", 0.0), 0.0
            began = time.thread_time()
            try:
                return function(*args, **keywords)
            finally:
                took = time.thread_time() - began
                self.seconds[part] += took - self._inner.s
                self._inner.s = outer + took

        setattr(owner, name, timed)


def write_images(folder: Path, count: int = 40) -> None:
    """JPEG images of 512 x 384."""
    folder.mkdir()
    for k in range(count):
        grey = patchwork(512, k, low=0.02, high=0.98, grain=0.5, shapes=200, tint=(1.0, 0.97, 0.92))
        Image.fromarray(np.round(255 * grey ** (1 / 2.2)).astype(np.uint8)[:384]).save(folder / f"{k}.jpg")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sequences", type=int, default=20)
    parser.add_argument("--textures", type=Path)
    parser.add_argument("--shared", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        base, times = Path(folder), PartTimes()
        textures = options.textures or base / "images"
        scene = f"{{kind: random_planes, textures: {textures.absolute()}, planes: {{integers: [2, 6]}}}}"
        if not (options.shared or options.textures):
            write_images(textures)
        (base / "plan.yaml").write_text(
            PLAN.format(
                sequences=options.sequences + 1,
                scene="three_planes" if options.shared else scene,
                start="{uniform: [0, 1.8]}" if options.shared else 0,
            )
        )
        began_s = time.process_time()
        job.begin_worker(1)
        root = base / "root"
        root.mkdir()
        sequences = draw_sequences(load_sequence_plan(base / "plan.yaml"))
        job.make_sequence(sequences[0], root, 1)  # what is imported and kept when it is first used
        first_s = time.process_time() - began_s
        for owner, name, part in PARTS:
            times.watch(owner, name, part)
        began_s, began_wall_s = time.process_time(), time.perf_counter()
        for sequence in sequences[1:]:
            job.make_sequence(sequence, root, 1)
        total_s, wall_s = time.process_time() - began_s, time.perf_counter() - began_wall_s
    count = len(sequences) - 1
    times.seconds["rendering, sampling in time"] = total_s - sum(times.seconds.values())
    print(f"{count} sequences of 0.1 s: {0.1 * count / total_s:.3f} simulated seconds a second of one core's time")
    print(f"({0.1 * count / wall_s:.3f} a second of wall time; {1e3 * total_s / count:.0f} ms of processor time each)")
    for part, seconds in times.seconds.most_common():
        print(f"{100 * seconds / total_s:5.1f} %  {1e3 * seconds / count:6.0f} ms  {part}")
    print(f"once in a worker, after its imports: {first_s:.1f} s until its first sequence is whole")


if __name__ == "__main__":
    main()
