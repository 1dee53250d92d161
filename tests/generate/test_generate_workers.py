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
from places import HELPERS
from worker_tasks import nothing, write_or_fail


def run(folder: Path, tasks: list[str], workers: int, told: list[str]) -> Iterator[Outcome[str, str]]:
    return run_locally(partial(write_or_fail, folder), tasks, workers=workers, begin=nothing, report=told.append)


@pytest.mark.long
@pytest.mark.parametrize(
    ("workers", "named"),
    [(1, "a killed b wrong"), pytest.param(3, "a killed b wrong once bug c exit d", marks=pytest.mark.long)],
    ids=["one", "three"],
)
def test_a_task_that_kills_its_workers_is_given_up_alone(tmp_path: Path, workers: int, named: str) -> None:
    """Three workers die of it; one that dies once costs an attempt; errors are told; all others are done."""
    told: list[str] = []
    tasks = named.split()
    outcomes = list(run(tmp_path, tasks, workers, told))
    errors = {outcome.task: outcome.error for outcome in outcomes}
    results = {outcome.task: outcome.result for outcome in outcomes if outcome.error is None}
    assert results == {task: task.upper() for task in tasks if task in ("a", "b", "c", "d", "once")}
    assert len(outcomes) == len(tasks)
    expected = {
        "killed": "it was given up after 3 workers; the last one was killed by SIGKILL",
        "exit": "it was given up after 3 workers; the last one ended with exit status 3",
        "wrong": "wrong breaks a rule",
    }
    assert {task: errors[task] for task in expected if task in tasks} == {
        task: error for task, error in expected.items() if task in tasks
    }
    if "bug" in tasks:
        assert "ZeroDivisionError: bug" in str(errors["bug"])
        assert "raise ZeroDivisionError(task)" in str(errors["bug"])
    tries = {task: (tmp_path / task).read_text().split() for task in tasks}
    again = {"killed": ATTEMPTS, "exit": ATTEMPTS, "once": 2}
    assert {task: len(pids) for task, pids in tries.items()} == {task: again.get(task, 1) for task in tasks}
    assert len(set(tries["killed"])) == ATTEMPTS  # each on a worker of its own
    died = {"killed": "was killed by SIGKILL", "exit": "ended with exit status 3", "once": "was killed by SIGKILL"}
    assert sorted(told) == sorted(
        f"{task}: its worker {died[task]}; it is tried again" for task in tasks for _ in range(again.get(task, 1) - 1)
    )
    assert not multiprocessing.active_children()
    assert not any(psutil.pid_exists(int(pid)) for pids in tries.values() for pid in pids)


@pytest.mark.long
def test_workers_are_gone_when_the_caller_leaves(tmp_path: Path) -> None:
    """In the midst of their tasks too."""
    outcomes = run(tmp_path, ["a", "long"], 2, [])
    assert next(outcomes).task == "a"
    while not ((tmp_path / "long").exists() and (tmp_path / "long").read_text().endswith("\n")):
        time.sleep(0.01)
    outcomes.close()  # type: ignore[attr-defined]
    assert not psutil.pid_exists(int((tmp_path / "long").read_text()))


@pytest.mark.long
def test_workers_end_with_their_parent(tmp_path: Path) -> None:
    """Also in the midst of a task that would go on for a minute, when the parent has no time to say a word."""
    program = (
        "import sys; from pathlib import Path; sys.path[:0] = sys.argv[2:]; import test_generate_workers as tests; "
        "list(tests.run(Path(sys.argv[1]), ['long'], 1, []))"
    )
    task = tmp_path / "long"
    with subprocess.Popen(
        [sys.executable, "-c", program, str(tmp_path), str(Path(__file__).parent), str(HELPERS)]
    ) as parent:
        while not (task.exists() and task.read_text().endswith("\n")):
            assert parent.poll() is None
            time.sleep(0.01)
        worker = psutil.Process(int(task.read_text()))
        parent.kill()
    worker.wait(timeout=20)
