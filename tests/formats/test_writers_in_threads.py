"""Writers that several threads share: whole packets, in the order in which they came, and none lost."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from davis_rs import EVENT_DTYPE, open_writer, read_events
from davis_rs.events.arrays import EventArray

THREADS, PACKETS, EVENTS = 6, 60, 1000
WIDTH, HEIGHT = EVENTS, THREADS * PACKETS

EXTRAS = {"dsec": "h5py", "e2vid": "h5py", "parquet": "pyarrow", "bag": "rosbags"}
FILE_NAMES = {
    "text": "e.txt",
    "npy": "e.npy",
    "npz": "e.npz",
    "evt2": "e.raw",
    "evt3": "e.raw",
    "aedat4": "e.aedat4",
    "dsec": "e.h5",
    "e2vid": "e.h5",
    "parquet": "e.parquet",
    "bag": "e.bag",
}


@pytest.fixture(autouse=True)
def eager_switches() -> Iterator[None]:
    """Threads take turns as often as they can."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


def in_threads(work: Callable[[int], None]) -> None:
    """``work(number)`` in all threads at once; the first error is raised here."""
    start, errors = threading.Barrier(THREADS), []

    def run(number: int) -> None:
        start.wait()
        try:
            work(number)
        except Exception as error:  # told below
            errors.append(error)

    threads = [threading.Thread(target=run, args=(number,)) for number in range(THREADS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if errors:
        raise errors[0]


def packet(row: int) -> EventArray:
    """A packet that fills a row of its own, all at one time: any order of packets is an order of time."""
    events = np.zeros(EVENTS, EVENT_DTYPE)
    events["t"], events["x"], events["y"], events["p"] = 7, np.arange(EVENTS), row, row % 2
    return events


@pytest.mark.parametrize("format_name", FILE_NAMES)
def test_every_packet_is_written_once_and_whole(tmp_path: Path, format_name: str) -> None:
    if format_name in EXTRAS:
        pytest.importorskip(EXTRAS[format_name])
    path = tmp_path / FILE_NAMES[format_name]
    writer = open_writer(path, (WIDTH, HEIGHT), format_name)

    def write(number: int) -> None:
        for i in range(PACKETS):
            writer.write(packet(number * PACKETS + i))
            if i % 10 == 9:
                writer.flush()

    in_threads(write)
    report = writer.finish()
    assert report.events == THREADS * PACKETS * EVENTS
    written = read_events(path)
    assert len(written) == report.events
    rows = written["y"].reshape(-1, EVENTS)
    assert (rows == rows[:, :1]).all(), "packets are mixed"
    np.testing.assert_array_equal(np.sort(rows[:, 0]), np.arange(HEIGHT))
    np.testing.assert_array_equal(written["x"].reshape(-1, EVENTS), np.tile(np.arange(EVENTS), (HEIGHT, 1)))


def test_threads_may_finish_a_writer_together(tmp_path: Path) -> None:
    writer = open_writer(tmp_path / "e.npz", (WIDTH, HEIGHT))
    writer.write(packet(0))
    reports = []
    in_threads(lambda _: reports.append(writer.finish()))
    assert len(reports) == THREADS
    assert len(set(reports)) == 1
    np.testing.assert_array_equal(read_events(tmp_path / "e.npz"), packet(0))
