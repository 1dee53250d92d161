"""Events by number and by time from files of every format: what is read is a slice of the whole."""

from __future__ import annotations

import pickle
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from davis_rs import DecodeError, open_writer, read_events
from davis_rs.events.arrays import EVENT_DTYPE, EventArray
from davis_rs.io.files.random_access import RandomAccess
from event_files import SIZE, assert_same, events_of, many

for library in ("h5py", "numcodecs", "hdf5plugin", "pyarrow", "rosbags"):
    pytest.importorskip(library)

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
OPTIONS: dict[str, dict[str, Any]] = {"parquet": {"row_group": 20_000}}

every_format = pytest.mark.parametrize("name", FILE_NAMES)


def write(folder: Path, name: str, events: EventArray, packet: int = 7_000) -> Path:
    path = folder / FILE_NAMES[name]
    with open_writer(path, SIZE, name, overwrite=True, **OPTIONS.get(name, {})) as writer:
        for start in range(0, len(events), packet):
            writer.write(events[start : start + packet])
    return path


@pytest.fixture(scope="module")
def whole() -> EventArray:
    """Many blocks of every format, past a round of EVT 3.0's 24 bits of time."""
    events = many(90_000, start_us=5)
    events["t"][30_000:] += 3_000_000
    events["t"][60_000:] += 2**24 + 17
    return events


@pytest.fixture(scope="module")
def opened(whole: EventArray, tmp_path_factory: pytest.TempPathFactory) -> dict[str, RandomAccess]:
    return {name: RandomAccess(write(tmp_path_factory.mktemp(name), name, whole)) for name in FILE_NAMES}


@every_format
@settings(max_examples=25, deadline=None)
@given(numbers=st.tuples(st.integers(0, 90_000), st.integers(0, 3) | st.integers(0, 90_000)), early=st.integers(-2, 2))
def test_what_is_read_is_a_slice_of_the_whole(
    opened: dict[str, RandomAccess], whole: EventArray, name: str, numbers: tuple[int, int], early: int
) -> None:
    """By number and by time, in any order, across blocks, with ties at the ends."""
    access, first = opened[name], numbers[0]
    stop = min(first + numbers[1], len(whole))
    assert access.events == len(whole)
    assert_same(access.read(first, stop), whole[first:stop])
    start_us = int(whole["t"][min(first, len(whole) - 1)]) + early
    stop_us = start_us + numbers[1]
    inside = (whole["t"] >= start_us) & (whole["t"] < stop_us)
    assert_same(access.read_times(start_us, stop_us), whole[inside])


@every_format
def test_ends_pickles_and_threads(opened: dict[str, RandomAccess], whole: EventArray, name: str) -> None:
    """A pickled one opens the file again; threads that share one read the same."""
    access = opened[name]
    assert (access.first_us, access.last_us) == (whole["t"][0], whole["t"][-1])
    assert (access.number_at(0), access.number_at(2**62)) == (0, len(whole))
    again = pickle.loads(pickle.dumps(access))
    access.close()
    with ThreadPoolExecutor(4) as threads:
        for start, part in enumerate(threads.map(lambda k: again.read(1000 * k, 1000 * k + 1500), range(88))):
            assert_same(part, whole[1000 * start : 1000 * start + 1500])
    part = access.read(3, 5)
    part["x"] = 9  # the caller's own
    assert_same(access.read(3, 5), whole[3:5])
    with pytest.raises(ValueError, match=r"has events 0\.\.90000: asked for 2\.\.90001"):
        access.read(2, 90_001)


@pytest.mark.parametrize("name", ["text", "npy", "evt3", "aedat4", "dsec", "parquet"])
def test_files_without_events(tmp_path: Path, name: str) -> None:
    access = RandomAccess(write(tmp_path, name, np.zeros(0, EVENT_DTYPE)))
    assert (access.events, access.first_us, access.last_us, access.number_at(5)) == (0, None, None, 0)
    assert len(access.read(0, 0)) == 0


def test_compressed_archives_say_why_not(tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / "e.npz", events=many(10))
    with pytest.raises(ValueError, match="compressed, so that it is only read from its beginning; convert"):
        RandomAccess(tmp_path / "e.npz")


@pytest.mark.parametrize("name", ["npy", "evt2", "text", "bag"])
def test_times_that_go_back_are_refused(tmp_path: Path, name: str) -> None:
    """While the blocks are found, or when they are read; nothing is handed out in a wrong order."""
    path = write(tmp_path, name, events_of((5, 1, 1, 0), (9, 1, 1, 0)), packet=1)
    data = path.read_bytes()
    if name == "npy":
        np.save(path, np.load(path)[::-1].copy())
    elif name == "evt2":
        path.write_bytes(data + data[data.index(b"% end\n") + 6 :])
    elif name == "text":
        path.write_bytes(data + data)
    else:  # the second message's event is at 9,000 ns in its last bytes: x, y, seconds, nanoseconds, polarity
        event = b"\1\0\1\0" + bytes(4) + (9000).to_bytes(4, "little") + b"\0"
        assert data.count(event) == 1
        path.write_bytes(data.replace(event, event.replace((9000).to_bytes(4, "little"), (3000).to_bytes(4, "little"))))
    with pytest.raises(DecodeError, match=r"go back|must not decrease"):
        RandomAccess(path).read(0, 2)


def test_a_file_that_changed_is_refused(tmp_path: Path) -> None:
    """Where events are would no longer be true."""
    path = write(tmp_path, "evt3", many(1000))
    access = pickle.loads(pickle.dumps(RandomAccess(path)))
    write(tmp_path, "evt3", many(999))
    with pytest.raises(DecodeError, match="has changed since it was opened"):
        access.read(0, 5)


def test_the_lines_of_a_text_without_its_last_newline(tmp_path: Path) -> None:
    path = write(tmp_path, "text", many(3000))
    path.write_bytes(path.read_bytes()[:-1])
    assert_same(RandomAccess(path).read(2990, 3000), read_events(path)[2990:])
