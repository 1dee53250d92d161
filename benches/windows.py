"""Windows of events, in order and at random: EventWindows next to plain h5py (DSEC's ms_to_idx) and tonic's slicing.

Each row reads the same windows of 5 ms from the same stream, in turn with the others, best of several rounds. Random
windows are others in each round. Printed are windows and millions of events a second of processor time, and the ratio
to h5py. Run: python benches/windows.py
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import davis_rs
from davis_rs.events.arrays import EVENT_DTYPE, EventArray

SIZE, WINDOW_MS = (640, 480), 5
FILE_NAMES = {
    "npy": "e.npy",
    "dsec": "e.h5",
    "parquet": "e.parquet",
    "aedat4": "e.aedat4",
    "evt3": "e.raw",
    "evt2": "e2.raw",
    "text": "e.txt",
    "bag": "e.bag",
}
Read = Callable[[int], int]
"""Reads the window that begins at a time in milliseconds, and returns its number of events."""


def stream(count: int) -> EventArray:
    """Events at 5 million a second."""
    rng = np.random.default_rng(0)
    events = np.zeros(count, EVENT_DTYPE)
    events["t"] = np.sort(rng.integers(0, count // 5, count))
    for name, limit in (("x", SIZE[0]), ("y", SIZE[1]), ("p", 2)):
        events[name] = rng.integers(0, limit, count)
    return events


def plain_h5py(path: Path) -> Read:
    """As DSEC's own EventSlicer: from the millisecond's index, then by the times in between."""
    import h5py
    import hdf5plugin  # noqa: F401

    file = h5py.File(path)
    index = file["ms_to_idx"][:]
    columns = [file[f"events/{name}"] for name in "txyp"]

    def read(start_ms: int) -> int:
        part = slice(int(index[start_ms]), int(index[start_ms + WINDOW_MS]))
        t, *_ = [column[part] for column in columns]
        return len(t)

    return read


def tonic_slicing(events: EventArray) -> Read:
    """tonic's slice_events_by_time over the whole array in memory; the windows are then looked up."""
    from tonic.slicers import SliceByTime

    array = davis_rs.to_tonic(events)
    slicer = SliceByTime(time_window=1000.0 * WINDOW_MS, overlap=1000.0 * (WINDOW_MS - 1))
    metadata = slicer.get_slice_metadata(array, None)

    def read(start_ms: int) -> int:
        parts, _ = slicer.slice_with_metadata(array, None, metadata[start_ms : start_ms + 1])
        return len(parts[0])

    return read


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--events", type=int, default=5_000_000)
    parser.add_argument("--windows", type=int, default=60)
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    events, reads, opened = stream(options.events), {}, {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for format, file in FILE_NAMES.items():
            with davis_rs.open_writer(folder / file, SIZE, format) as writer:
                for start in range(0, len(events), 50_000):
                    writer.write(events[start : start + 50_000])
            begin = time.process_time()
            windows = davis_rs.EventWindows(folder / file, duration_us=1000 * WINDOW_MS, stride_us=1000, start_us=0)
            opened[format] = time.process_time() - begin
            reads[format] = lambda start_ms, windows=windows: len(windows[start_ms].events)
        reads = {"plain h5py, ms_to_idx": plain_h5py(folder / FILE_NAMES["dsec"])} | reads
        try:
            reads["tonic, in memory"] = tonic_slicing(events)
        except ImportError:
            print("tonic is not installed: no row of it")
        rng = np.random.default_rng(1)
        last_ms = options.events // 5000 - WINDOW_MS - 1
        orders = {
            "in order": [k * WINDOW_MS for k in range(min(options.windows, last_ms // WINDOW_MS))],
            "at random": [],
        }
        best = {(row, order): (float("inf"), 0) for row in reads for order in orders}
        for _ in range(options.rounds):
            # Others in each round: windows that were read before may still be in a reader's cache.
            orders["at random"] = rng.integers(0, last_ms, options.windows).tolist()
            for row, read in reads.items():
                for order, starts in orders.items():
                    begin = time.process_time()
                    count = sum(map(read, starts))
                    best[row, order] = min(best[row, order], (time.process_time() - begin, count))
    print("| | opening, s | windows/s in order | Mev/s | at random | Mev/s | to h5py, in order | at random |")
    print("|---|---|---|---|---|---|---|---|")
    for row in reads:
        cells = [f"{opened[row]:.2f}" if row in opened else ""]
        ratios = []
        for order, starts in orders.items():
            seconds, count = best[row, order]
            cells += [f"{len(starts) / seconds:,.0f}", f"{count / seconds / 1e6:.1f}"]
            ratios.append(f"{best['plain h5py, ms_to_idx', order][0] / seconds:.2f}")
        print(f"| {row} | {' | '.join(cells + ratios)} |")


if __name__ == "__main__":
    main()
