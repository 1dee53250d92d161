"""The fuzzer of `tests/fuzz` for a few mutants of every reader, the same in every run."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from places import ROOT

FUZZER = ROOT / "tests" / "fuzz" / "readers.py"


def test_no_mutant_does_harm(tmp_path: Path) -> None:
    """None crashes, hangs, fills memory, raises what is not documented, or gives events that break the rules."""
    command = [sys.executable, str(FUZZER), "--mutants", "60", "--seed", "7", "--keep", str(tmp_path / "found")]
    run = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert run.returncode == 0, f"{run.stdout}\n{run.stderr[-3000:]}"
    assert run.stdout.count(" 0 findings;") == run.stdout.count(" findings;") > 25
