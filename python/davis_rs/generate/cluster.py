"""Gives work to a cluster, through Dask distributed."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar
from uuid import uuid4

from .local import Outcome, error_text

if TYPE_CHECKING:
    from distributed import Client

Task = TypeVar("Task")
Result = TypeVar("Result")

_ONE_AT_A_TIME = threading.Lock()
"""Mitsuba's variant belongs to the process: of a worker's threads one simulates, the others wait."""


def connect(cluster: str | Path | Client) -> Client:
    """Connect to a scheduler: by its address (``tcp://HOST:PORT``), by its scheduler file, or as it is.

    Raises:
        ImportError: without Dask distributed.
        OSError: if the scheduler cannot be reached.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise ImportError("a cluster needs Dask distributed: pip install 'davis_rs[cluster]'") from error
    if isinstance(cluster, Client):
        return cluster
    if Path(cluster).is_file():
        return Client(scheduler_file=str(cluster))
    return Client(str(cluster))


def run_on_cluster(
    function: Callable[[Task, int], Result], tasks: Sequence[Task], client: Client
) -> Iterator[Outcome[Task, Result]]:
    """Call ``function`` with each task and the number of threads of the worker that has it; yields outcomes.

    Tasks of workers that die are given to others by the scheduler, as often as its ``allowed-failures`` says. Whenever
    the caller leaves the loop, tasks that have not begun are cancelled.

    Args:
        function, tasks: to be pickled, as are results.
    """
    from distributed import as_completed

    # Names of this run alone: the scheduler remembers those of others.
    run = uuid4().hex
    futures = {client.submit(_call, function, task, key=f"{task}-{run}", pure=False): task for task in tasks}
    try:
        for future in as_completed(futures):
            task = futures[future]
            if future.status == "finished":
                yield Outcome(task, future.result())
            elif future.status == "error":
                yield Outcome(task, error=_reason(future.exception()))
            else:
                yield Outcome(task, error=f"the cluster lost it ({future.status})")
    finally:
        client.cancel(list(futures))


def _call(function: Callable[[Task, int], Result], task: Task) -> Result:
    from distributed import get_worker

    with _ONE_AT_A_TIME:
        return function(task, get_worker().state.nthreads)


def _reason(error: Any) -> str:
    return f"{type(error).__name__}: {error}" if type(error).__module__.startswith("distributed") else error_text(error)
