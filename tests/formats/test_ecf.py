"""Metavision's HDF5: what is read of it, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import davis_rs
from davis_rs.io.formats import FORMATS

pytest.importorskip("h5py")
pytest.importorskip("hdf5plugin")

import h5py

from event_files import many
from recording_files import ecf_chunk, write_ecf

EVENTS = many(300, start_us=1000)


def test_chunks_become_events_of_the_sensor_that_the_file_names(tmp_path: Path) -> None:
    path = write_ecf(tmp_path / "e.hdf5", EVENTS, size=(640, 480))
    with FORMATS["ecf"].open_reader(path) as reader:
        assert (reader.format, reader.size, reader.events) == ("ecf", (640, 480), len(EVENTS))
        np.testing.assert_array_equal(np.concatenate(list(reader.iter(70))), EVENTS)
    start, stop = int(EVENTS["t"][100]), int(EVENTS["t"][201])
    window = EVENTS[(EVENTS["t"] >= start) & (EVENTS["t"] < stop)]
    np.testing.assert_array_equal(davis_rs.read_events(path, start_us=start, stop_us=stop), window)


def rewrite(path: Path, chunk: bytes, skipped: int = 0) -> None:
    with h5py.File(path, "r+") as file:
        file["CD/events"].id.write_direct_chunk((64,), chunk, skipped)


@pytest.mark.parametrize(
    ("chunk", "skipped", "rule"),
    [
        (ecf_chunk(EVENTS[64:127]), 0, "the chunk at 64: it has 63 events of 64"),
        (ecf_chunk(EVENTS[64:129]), 0, "it says 65 events, and may have 64"),
        (ecf_chunk(EVENTS[64:128])[:-1], 0, "it ends within its events"),
        (ecf_chunk(EVENTS[64:128]), 1, "it is not compressed"),
    ],
)
def test_damaged_chunks_are_refused(tmp_path: Path, chunk: bytes, skipped: int, rule: str) -> None:
    path = write_ecf(tmp_path / "e.h5", EVENTS)
    rewrite(path, chunk, skipped)
    with pytest.raises(davis_rs.DecodeError, match=rule):
        davis_rs.read_events(path)
    np.testing.assert_array_equal(next(davis_rs.iter_events(path, chunk=64)), EVENTS[:64])


def test_other_datasets_are_refused(tmp_path: Path) -> None:
    with pytest.raises(davis_rs.DecodeError, match="expected ECF"):
        davis_rs.read_events(write_ecf(tmp_path / "e.h5", EVENTS, filter=0x8ECE))
    with h5py.File(tmp_path / "columns.h5", "w") as file:
        file["CD/events"] = EVENTS["t"]
    with pytest.raises(davis_rs.DecodeError, match="must have t, x, y and p"):
        davis_rs.read_events(tmp_path / "columns.h5")
