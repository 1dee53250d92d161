"""Event files compared with other programs in one run: ``python benches/peers.py EVENTS.npy [WORD ...]``.

EVENTS.npy holds an array of ``davis_rs.EVENT_DTYPE``. Rows are measured in turn, each time in a process of its own, on
one thread, the file in the page cache without fsync; the best of five rounds, by wall time and by the processor time of
the process and its children, after a short run that loads the libraries. What is not installed (extra ``interop``) is
left out.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import peers_containers
import peers_streams
from peers_row import PACKET, EventArray, Row

from davis_rs import EVENT_DTYPE

ROWS = [*peers_streams.ROWS, *peers_containers.ROWS]
ROUNDS = 5


def _one_thread() -> None:
    """Tell the libraries of this process."""
    os.environ["POLARS_MAX_THREADS"] = "1"
    with suppress(ImportError):
        import numcodecs.blosc

        numcodecs.blosc.set_nthreads(1)
    with suppress(ImportError):
        import pyarrow

        pyarrow.set_cpu_count(1)


def _processor_s() -> float:
    """Processor time of this process and of the children that it waited for."""
    return time.process_time() + sum(os.times()[2:4])


def measure(row: Row, events: EventArray) -> dict[str, float]:
    """Mev/s by wall and by processor time, bytes an event, and the process's peak memory, of one round."""
    _one_thread()
    found: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"events{row.suffix}"
        row.write(path, row.prepare(events[:PACKET]))
        if row.read is not None:
            row.read(path)
        path.unlink(missing_ok=True)
        prepared = row.prepare(events)
        count = len(prepared) if isinstance(prepared, np.ndarray) else len(events)

        def timed(name: str, act: Callable[[], object]) -> None:
            wall, processor = time.perf_counter(), _processor_s()
            act()
            wall, processor = time.perf_counter() - wall, _processor_s() - processor
            for key, seconds in ((name, wall), (f"{name} (processor time)", processor)):
                found[key] = count / 1e6 / seconds

        timed("write", lambda: row.write(path, prepared))
        if path.exists():
            found["bytes an event"] = path.stat().st_size / count
        found["peak MB"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        if row.read is not None:
            read = row.read
            timed("read", lambda: read(path))
    return found


def best(before: dict[str, float], found: dict[str, float]) -> dict[str, float]:
    """The larger of each speed; of the rest the latest, which every round finds alike."""
    return {
        name: max(before.get(name, value), value) if name.startswith(("write", "read")) else value
        for name, value in found.items()
    }


def main(arguments: list[str]) -> None:
    """Measure the rows whose format or program has one of the words in it; all without a word."""
    if arguments[:1] == ["--row"]:
        events = np.load(arguments[2]).view(EVENT_DTYPE)
        print(json.dumps(measure(ROWS[int(arguments[1])], events)))
        return
    path, words = arguments[0], arguments[1:]
    chosen = [
        (number, row)
        for number, row in enumerate(ROWS)
        if not words or any(word in f"{row.format} {row.program}" for word in words)
    ]
    figures: dict[int, dict[str, float]] = {}
    failed: dict[int, str] = {}
    for _ in range(ROUNDS):
        for number, _row in chosen:
            if number in failed:
                continue
            command = [sys.executable, __file__, "--row", str(number), path]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode:
                failed[number] = done.stderr.splitlines()[-1]
            else:
                figures[number] = best(figures.get(number, {}), json.loads(done.stdout))
    for number, row in chosen:
        cells = "  ".join(f"{what} {value:.4g}" for what, value in figures.get(number, {}).items())
        print(f"{row.format:26} {row.program:19} {failed.get(number, cells)}")
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")


if __name__ == "__main__":
    main(sys.argv[1:])
