"""What runs take in memory, by pixel, next to what was forecast: python benches/memory_forecast.py

Each run is made on a small sensor and on a large one, in processes of their own. What the large one takes more, by the
pixels that it has more, is what a pixel takes. ``davis_rs._util.memory_forecast`` has its numbers from here.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

SMALL, LARGE = 64, 1024
SIMULATE = ("simulate", "three_planes", "--duration", "0.002")
DRAWN = ("threshold_mismatch=0.03", "leak_rate_hz=0.1", "shot_noise_rms=0.02", "refractory_period_us=100")

RUNS: dict[str, tuple[str, ...]] = {
    "paper": (*SIMULATE, "--accuracy", "paper"),
    "fast": (*SIMULATE, "--accuracy", "fast"),
    "balanced": SIMULATE,
    "exact": (*SIMULATE, "--accuracy", "exact"),
    "effects": (*SIMULATE, *(word for effect in DRAWN for word in ("--effect", effect))),
    "aps": (*SIMULATE, "--effect", "aps"),
    "flow": (*SIMULATE, "--flow-rate", "100"),
    "table kernel": (*SIMULATE, "--renderer", "table"),
    "frames, linear": ("frames", "FRAMES", "--fps", "1000", "--interpolation", "linear"),
    "frames, cubic": ("frames", "FRAMES", "--fps", "1000", "--interpolation", "cubic"),
    "frames, flow": ("frames", "FRAMES", "--fps", "1000", "--interpolation", "flow"),
}

PROGRAM = """
import re, sys
from pathlib import Path
forecasts = []
from davis_rs.simulation.from_frames.frame_run import FrameRun
from davis_rs.simulation.simulator import Simulator
for made, name in ((Simulator, "_set_up"), (FrameRun, "__init__")):
    def set_up(self, *arguments, before=getattr(made, name), **settings):
        before(self, *arguments, **settings)
        forecasts.append(self.memory.bytes)
    setattr(made, name, set_up)
from davis_rs.cli import main
status = main(sys.argv[1:])
peak = re.search(r"VmHWM:\\s+(\\d+) kB", Path("/proc/self/status").read_text())  # unlike ru_maxrss, not of the parent
print("took", int(peak.group(1)) * 1024, "forecast", max(forecasts, default=0))
sys.exit(status)
"""


def measure(words: tuple[str, ...], side: int, folder: Path) -> tuple[int, int]:
    """Bytes that a run took at most, and that were forecast."""
    frames = folder / f"frames_{side}.npy"
    if not frames.exists():
        rows, columns, k = np.mgrid[:side, :side, :8].astype(np.float32)
        moving = 128 + 100 * np.sin((columns + 2 * k) / 9) * np.sin(rows / 11)
        np.save(frames, np.ascontiguousarray(moving.transpose(2, 0, 1).astype(np.uint8)))
    size = () if "FRAMES" in words else ("--size", f"{side}x{side}")
    given = [str(frames) if word == "FRAMES" else word for word in words]
    command = [sys.executable, "-c", PROGRAM, *given, *size, "-o", str(folder / "out"), "--overwrite", "--quiet"]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    found = re.search(r"took (\d+) forecast (\d+)", printed)
    assert found is not None
    return int(found.group(1)), int(found.group(2))


def main() -> None:
    pixels = LARGE**2 - SMALL**2
    print("| run | bytes a pixel | forecast |\n|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name, words in RUNS.items():
            (small, small_forecast), (large, forecast) = (measure(words, side, Path(folder)) for side in (SMALL, LARGE))
            print(
                f"| {name} | {(large - small) / pixels:.0f} | {(forecast - small_forecast) / pixels:.0f} |", flush=True
            )


if __name__ == "__main__":
    main()
