"""Measures what a rig of two cameras costs compared with one of them: python benches/rigs.py

Processor time of whole processes, imports included, interleaved; the least of several.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile


def seconds(arguments: list[str]) -> float:
    """Return the processor time of one run of davis-rs."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(["davis-rs", "simulate", *arguments, "-o", f"{folder}/out", "--quiet"], check=True,
                       stdout=subprocess.DEVNULL)  # fmt: skip
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return (after.ru_utime + after.ru_stime) - (before.ru_utime + before.ru_stime)


def main() -> int:
    """Print the least times, and their ratio."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--scene", default="three_planes")
    parser.add_argument("--rig", default="stereo-davis346")
    parser.add_argument("--duration", default="0.1")
    parser.add_argument("--runs", type=int, default=3)
    options = parser.parse_args()
    command = [options.scene, "--rig", options.rig, "--duration", options.duration]
    pairs = [(seconds([*command, "--camera-index", "0"]), seconds(command)) for _ in range(options.runs)]
    one, two = (min(times) for times in zip(*pairs, strict=True))
    print(f"one camera {one:.2f} s, two cameras {two:.2f} s: {two / one:.2f} times")
    return 0


if __name__ == "__main__":
    sys.exit(main())
