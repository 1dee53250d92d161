"""Gives work to processes of this machine, any of which may die."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import traceback
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Generic, TypeVar

from .._util.platforms import ctrl_c_blocked, unblock_ctrl_c
from .._util.stop_requests import interrupts_deferred

Task = TypeVar("Task")
Result = TypeVar("Result")

ATTEMPTS = 3
"""A task is given up after this many workers died on it."""


@dataclass(frozen=True)
class Outcome(Generic[Task, Result]):
    """Holds a task that is over, with its result or an error: what went wrong, in words."""

    task: Task
    result: Result | None = None
    error: str | None = None


@dataclass
class _Worker(Generic[Task]):
    process: BaseProcess
    connection: Connection
    task: Task | None = None
    number: int = -1
    """The task's place among all."""


class _WaitingTasks(Generic[Task]):
    """Holds tasks that no worker has, with their positions; each is taken from the sequence when its turn comes."""

    def __init__(self, tasks: Sequence[Task]) -> None:
        self._rest = enumerate(tasks)
        self._again: deque[tuple[int, Task]] = deque()
        self._left = len(tasks)

    def __len__(self) -> int:
        return self._left

    def take(self) -> tuple[int, Task]:
        self._left -= 1
        return self._again.popleft() if self._again else next(self._rest)

    def put_back(self, number: int, task: Task) -> None:
        self._left += 1
        self._again.appendleft((number, task))


def run_locally(
    function: Callable[[Task], Result],
    tasks: Sequence[Task],
    *,
    workers: int,
    begin: Callable[[], None],
    report: Callable[[str], None],
) -> Iterator[Outcome[Task, Result]]:
    """Call ``function`` with each task in worker processes; yields outcomes as they come.

    Workers are spawned, not forked: Dr.Jit has threads. One that is killed costs its task an attempt and is replaced;
    the others never notice. Whenever the caller leaves the loop, all of them are killed; and they end by themselves
    when this process does, however it does.

    Args:
        function, begin, tasks: to be pickled, as are results; ``begin`` is called in each worker first.
        workers: the most worker processes at a time.
        report: is told of workers that died.
    """
    context = multiprocessing.get_context("spawn")
    waiting, deaths = _WaitingTasks(tasks), Counter[int]()
    team: list[_Worker[Task]] = []

    def start() -> _Worker[Task]:
        ours, theirs = context.Pipe()
        # Daemons, so that an end of this process by an exception takes them along.
        process = context.Process(target=_work, args=(theirs, function, begin), daemon=True)
        # Before the signal is blocked, because starting it unblocks the signal (until Python 3.12).
        resource_tracker.ensure_running()
        # A Ctrl-C waits until the worker is there and has all that it is sent: another thread may still receive it. The
        # worker inherits the mask, and lets it wait while it imports.
        with interrupts_deferred(), ctrl_c_blocked():
            process.start()
        theirs.close()  # the worker's alone: when it dies, ours is at its end
        return _Worker(process, ours)

    try:
        while waiting or any(worker.task is not None for worker in team):
            while waiting and len(team) < workers and len(team) < len(waiting) + _busy(team):
                team.append(start())
            for worker in team:
                if worker.task is None and waiting:
                    _give(worker, waiting)
            ready = wait([worker.connection for worker in team if worker.task is not None])
            for worker in [worker for worker in team if worker.connection in ready]:
                task = worker.task
                assert task is not None
                try:
                    result, error = worker.connection.recv()
                except (EOFError, OSError):
                    team.remove(worker)
                    why = _cause_of_death(worker)
                    deaths[worker.number] += 1
                    if deaths[worker.number] < ATTEMPTS:
                        report(f"{task}: its worker {why}; it is tried again")
                        waiting.put_back(worker.number, task)
                    else:
                        yield Outcome(task, error=f"it was given up after {ATTEMPTS} workers; the last one {why}")
                    continue
                worker.task = None
                yield Outcome(task, result, error)
    finally:
        for worker in team:
            worker.process.kill()
        for worker in team:
            worker.process.join()
            worker.connection.close()


def error_text(error: BaseException) -> str:
    """Say what a user has to know of an error: of an unexpected one also where it came from."""
    if isinstance(error, ValueError | OSError | ImportError):
        return str(error)
    return "".join(traceback.format_exception(error)).strip()


def _busy(team: Sequence[_Worker[Task]]) -> int:
    return sum(worker.task is not None for worker in team)


def _give(worker: _Worker[Task], waiting: _WaitingTasks[Task]) -> None:
    worker.number, task = waiting.take()
    worker.task = task
    with suppress(OSError):  # dead already: waiting for its answer will tell
        worker.connection.send(task)


def _cause_of_death(worker: _Worker[Task]) -> str:
    worker.process.join()
    worker.connection.close()
    code = worker.process.exitcode or 0
    if code >= 0:
        return f"ended with exit status {code}"
    with suppress(ValueError):
        return f"was killed by {signal.Signals(-code).name}"
    return f"was killed by signal {-code}"


def _work(connection: Connection, function: Callable[[Task], Result], begin: Callable[[], None]) -> None:
    """Run the tasks that a worker gets, until there are no more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends Ctrl-C to all; what to do is the parent's to say
    unblock_ctrl_c()
    threading.Thread(target=_end_with_parent, daemon=True).start()
    begin()
    while True:
        try:
            task = connection.recv()
        except (EOFError, OSError):
            return
        result, error = None, None
        try:
            result = function(task)
        except Exception as raised:
            error = error_text(raised)
        connection.send((result, error))


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
