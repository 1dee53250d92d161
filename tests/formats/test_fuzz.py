"""The fuzzer of `tests/fuzz` for a few mutants of every reader, the same in every run."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from places import ROOT

FUZZER = ROOT / "tests" / "fuzz" / "readers.py"


EVERY_RUN = ("text", "aedat4", "dsec", "bag", "gltf", "check-events")
"""What is fuzzed without ``--long``: to make a good file of every kind takes longer than to fuzz it."""


def test_no_mutant_does_harm(tmp_path: Path, long: bool) -> None:
    """None crashes, hangs, fills memory, raises what is not documented, or gives events that break the rules."""
    command = [sys.executable, str(FUZZER), "--mutants", "60", "--seed", "7", "--keep", str(tmp_path / "found")]
    if not long:
        command += [word for target in EVERY_RUN for word in ("--target", target)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert run.returncode == 0, f"{run.stdout}\n{run.stderr[-3000:]}"
    assert run.stdout.count(" 0 findings;") == run.stdout.count(" findings;") >= (26 if long else len(EVERY_RUN))
