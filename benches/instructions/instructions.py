"""Instructions that a frame takes in an engine, and a stream in the decoder, here and at another revision.

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
WORKLOADS = {
    "frames": ("dense", "quiet", "still", "hermite", "sensor"),
    "streams": ("decode-dense", "decode-sparse", "decode-frames"),
}
"""Of each program: frames of 240 x 180 pixels by how many of them change, streams of a camera by what is in them."""

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


def build(program: str, source: Path, folder: Path) -> Path | None:
    """A program, built against a checkout; None if the checkout is older than what the program counts."""
    (folder / "src").mkdir(parents=True)
    (folder / "Cargo.toml").write_text(_MANIFEST.format(source=source))
    (folder / "src" / "main.rs").write_text((HERE / f"{program}.rs").read_text())
    (folder / "Cargo.lock").write_text((source / "Cargo.lock").read_text())
    built = subprocess.run(["cargo", "build", "--release", "--quiet"], cwd=folder, capture_output=True, text=True)
    if built.returncode:
        if source != ROOT and "unresolved import" in built.stderr:
            return None
        raise RuntimeError(built.stderr)
    return folder / "target" / "release" / "instructions"


def counted(program: Path, kind: str, frames: int) -> int:
    """Instructions of a run."""
    command = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null", str(program), kind, str(frames)]
    report = subprocess.run(command, check=True, capture_output=True, text=True).stderr
    found = re.search(r"Collected : (\d+)", report)
    assert found, report
    return int(found[1])


def each(program: Path, kind: str) -> float:
    """Instructions a frame, or a stream, without the start of the program."""
    return (counted(program, kind, FRAMES) - counted(program, kind, 0)) / FRAMES


def main(revision: str) -> None:
    """Build both, count, and print a table."""
    with tempfile.TemporaryDirectory() as folder:
        before = Path(folder) / "before"
        subprocess.run(["git", "worktree", "add", "--quiet", "--detach", str(before), revision], cwd=ROOT, check=True)
        try:
            programs = {
                name: [build(name, root, Path(folder) / f"{name}-{root.name}") for root in (before, ROOT)]
                for name in WORKLOADS
            }
        finally:
            subprocess.run(["git", "worktree", "remove", "--force", str(before)], cwd=ROOT, check=True)
        print(f"| instructions a frame, 240 x 180, or a stream | {revision} | now | ratio |\n|---|---|---|---|")
        for name, (old, new) in programs.items():
            for kind in WORKLOADS[name]:
                assert new is not None
                now = each(new, kind)
                cells = (f"{then:,.0f}", f"{now / then:.4f}") if old and (then := each(old, kind)) else ("-", "-")
                print(f"| {kind} | {cells[0]} | {now:,.0f} | {cells[1]} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1])
