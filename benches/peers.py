"""Event files compared with other programs in one run: ``python benches/peers.py EVENTS.npy [WORD ...]``.

EVENTS.npy holds an array of ``davis_rs.EVENT_DTYPE``. Each row is measured in a process of its own, on one thread, the
file in the page cache without fsync; the best of three. What is not installed (extra ``interop``) is left out.
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
from peers_row import EventArray, Row

from davis_rs import EVENT_DTYPE

ROWS = [*peers_streams.ROWS, *peers_containers.ROWS]


def _one_thread() -> None:
    """Tell the libraries of this process."""
    os.environ["POLARS_MAX_THREADS"] = "1"
    with suppress(ImportError):
        import numcodecs.blosc

        numcodecs.blosc.set_nthreads(1)
    with suppress(ImportError):
        import pyarrow

        pyarrow.set_cpu_count(1)


def measure(row: Row, events: EventArray, rounds: int = 3) -> dict[str, float]:
    """Mev/s by wall and by processor time, bytes an event, and the process's peak memory."""
    _one_thread()
    best: dict[str, float] = {}
    prepared = row.prepare(events)
    count = len(prepared) if isinstance(prepared, np.ndarray) else len(events)

    def timed(name: str, act: Callable[[], object]) -> None:
        wall, processor = time.perf_counter(), time.process_time()
        act()
        wall, processor = time.perf_counter() - wall, time.process_time() - processor
        for key, seconds in ((name, wall), (f"{name} (processor time)", processor)):
            best[key] = max(best.get(key, 0.0), count / 1e6 / seconds)

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"events{row.suffix}"
        for _ in range(rounds):
            path.unlink(missing_ok=True)
            timed("write", lambda: row.write(path, prepared))
        if path.exists():
            best["bytes an event"] = path.stat().st_size / count
        best["peak MB"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        if row.read is not None:
            read = row.read
            for _ in range(rounds):
                timed("read", lambda: read(path))
    return best


def main(arguments: list[str]) -> None:
    """Measure the rows whose format or program has one of the words in it; all without a word."""
    if arguments[:1] == ["--row"]:
        events = np.load(arguments[2]).view(EVENT_DTYPE)
        print(json.dumps(measure(ROWS[int(arguments[1])], events)))
        return
    path, words = arguments[0], arguments[1:]
    for number, row in enumerate(ROWS):
        if words and not any(word in f"{row.format} {row.program}" for word in words):
            continue
        command = [sys.executable, __file__, "--row", str(number), path]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        name = f"{row.format:26} {row.program:19} "
        if done.returncode:
            print(name + done.stderr.splitlines()[-1])
            continue
        figures = json.loads(done.stdout)
        print(name + "  ".join(f"{what} {value:.4g}" for what, value in figures.items()), flush=True)
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")


if __name__ == "__main__":
    main(sys.argv[1:])
