"""Workers of this machine: any of them may die, at any time."""

from __future__ import annotations

import multiprocessing
import subprocess
import sys
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import psutil
import pytest

from davis_rs.generate.local import ATTEMPTS, Outcome, run_locally
from worker_tasks import nothing, write_or_fail


def run(folder: Path, tasks: list[str], workers: int, told: list[str]) -> Iterator[Outcome[str, str]]:
    return run_locally(partial(write_or_fail, folder), tasks, workers=workers, begin=nothing, report=told.append)


@pytest.mark.parametrize("workers", [1, 3])
def test_a_task_that_kills_its_workers_is_given_up_alone(tmp_path: Path, workers: int) -> None:
    """Three workers die of it; one that dies once costs an attempt; errors are told; all others are done."""
    told: list[str] = []
    tasks = ["a", "killed", "b", "wrong", "once", "bug", "c", "exit", "d"]
    outcomes = list(run(tmp_path, tasks, workers, told))
    errors = {outcome.task: outcome.error for outcome in outcomes}
    results = {outcome.task: outcome.result for outcome in outcomes if outcome.error is None}
    assert results == {"a": "A", "b": "B", "c": "C", "d": "D", "once": "ONCE"}
    assert len(outcomes) == len(tasks)
    assert errors["killed"] == "it was given up after 3 workers; the last one was killed by SIGKILL"
    assert errors["exit"] == "it was given up after 3 workers; the last one ended with exit status 3"
    assert errors["wrong"] == "wrong breaks a rule"
    assert "ZeroDivisionError: bug" in str(errors["bug"])
    assert "raise ZeroDivisionError(task)" in str(errors["bug"])
    tries = {task: (tmp_path / task).read_text().split() for task in tasks}
    assert {task: len(pids) for task, pids in tries.items() if len(pids) > 1} == {
        "killed": ATTEMPTS,
        "exit": ATTEMPTS,
        "once": 2,
    }
    assert len(set(tries["killed"])) == ATTEMPTS  # each on a worker of its own
    assert sorted(told) == sorted(
        ["once: its worker was killed by SIGKILL; it is tried again"]
        + 2 * ["killed: its worker was killed by SIGKILL; it is tried again"]
        + 2 * ["exit: its worker ended with exit status 3; it is tried again"]
    )
    assert not multiprocessing.active_children()
    assert not any(psutil.pid_exists(int(pid)) for pids in tries.values() for pid in pids)


def test_workers_are_gone_when_the_caller_leaves(tmp_path: Path) -> None:
    """In the midst of their tasks too."""
    outcomes = run(tmp_path, ["a", "long"], 2, [])
    assert next(outcomes).task == "a"
    while not ((tmp_path / "long").exists() and (tmp_path / "long").read_text().endswith("\n")):
        time.sleep(0.01)
    outcomes.close()  # type: ignore[attr-defined]
    assert not psutil.pid_exists(int((tmp_path / "long").read_text()))


def test_workers_end_with_their_parent(tmp_path: Path) -> None:
    """Also in the midst of a task that would go on for a minute, when the parent has no time to say a word."""
    program = (
        "import sys; from pathlib import Path; sys.path.insert(0, sys.argv[1]); import test_generate_workers as tests; "
        "list(tests.run(Path(sys.argv[2]), ['long'], 1, []))"
    )
    task = tmp_path / "long"
    with subprocess.Popen([sys.executable, "-c", program, str(Path(__file__).parent), str(tmp_path)]) as parent:
        while not (task.exists() and task.read_text().endswith("\n")):
            assert parent.poll() is None
            time.sleep(0.01)
        worker = psutil.Process(int(task.read_text()))
        parent.kill()
    worker.wait(timeout=20)
