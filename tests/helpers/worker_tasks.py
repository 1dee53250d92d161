"""What the workers of test_generate_workers do: a module that imports little, because each of them imports it."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path


def nothing() -> None:
    """What a worker may do first."""


def write_or_fail(folder: Path, task: str) -> str:
    """A task that says that it was tried, and then does what its name says."""
    with (folder / task).open("a") as file:
        file.write(f"{os.getpid()}\n")
    if task.startswith("killed") or (task.startswith("once") and (folder / task).read_text().count("\n") == 1):
        os.kill(os.getpid(), signal.SIGKILL)
    if task.startswith("exit"):
        raise SystemExit(3)
    if task.startswith("wrong"):
        raise ValueError(f"{task} breaks a rule")
    if task.startswith("bug"):
        raise ZeroDivisionError(task)
    if task.startswith("long"):
        time.sleep(60)
    return task.upper()
