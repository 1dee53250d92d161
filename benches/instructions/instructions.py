"""Instructions that a frame takes in an ideal engine, and a stream in the decoder, here and at another revision.

    python benches/instructions/instructions.py REVISION

Counted by valgrind's callgrind: the same on a busy machine as on a quiet one. Needs git, cargo and valgrind.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
FRAMES = 40
KINDS = ("dense", "quiet", "still", "hermite", "decode-dense", "decode-sparse", "decode-frames")
"""Frames of 240 x 180 pixels by how many of them change, and streams of a camera by what is in them."""

_MANIFEST = """[package]
name = "instructions"
version = "0.0.0"
edition = "2024"

[dependencies]
davis_rs = {{ path = "{source}" }}

[profile.release]
lto = "thin"
codegen-units = 1
"""


def build(source: Path, folder: Path) -> Path:
    """The program, built against a checkout."""
    (folder / "src").mkdir(parents=True)
    (folder / "Cargo.toml").write_text(_MANIFEST.format(source=source))
    (folder / "src" / "main.rs").write_text((HERE / "frames.rs").read_text())
    (folder / "Cargo.lock").write_text((source / "Cargo.lock").read_text())
    subprocess.run(["cargo", "build", "--release", "--quiet"], cwd=folder, check=True)
    return folder / "target" / "release" / "instructions"


def counted(program: Path, kind: str, frames: int) -> int:
    """Instructions of a run."""
    command = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null", str(program), kind, str(frames)]
    report = subprocess.run(command, check=True, capture_output=True, text=True).stderr
    found = re.search(r"Collected : (\d+)", report)
    assert found, report
    return int(found[1])


def main(revision: str) -> None:
    """Build both, count, and print a table."""
    with tempfile.TemporaryDirectory() as folder:
        before = Path(folder) / "before"
        subprocess.run(["git", "worktree", "add", "--quiet", "--detach", str(before), revision], cwd=ROOT, check=True)
        try:
            programs = [build(before, Path(folder) / "a"), build(ROOT, Path(folder) / "b")]
        finally:
            subprocess.run(["git", "worktree", "remove", "--force", str(before)], cwd=ROOT, check=True)
        print(f"| instructions a frame, 240 x 180, or a stream | {revision} | now | ratio |\n|---|---|---|---|")
        for kind in KINDS:
            old, new = ((counted(p, kind, FRAMES) - counted(p, kind, 0)) / FRAMES for p in programs)
            print(f"| {kind} | {old:,.0f} | {new:,.0f} | {new / old:.4f} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1])
