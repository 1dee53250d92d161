"""Bags of ROS 1 that say what is not so of their sizes: nothing is taken for it, and nothing stays open."""

from __future__ import annotations

import gc
import struct
import tracemalloc
import warnings
from pathlib import Path

import numpy as np
import pytest

import davis_rs
from davis_rs import DecodeError

CHUNK, ENTRIES, CHUNK_INFO = 5, 4, 6
MOST = 2**32 - 1


def bag(path: Path, packets: int = 3) -> bytearray:
    """A bag of as many messages, in one chunk."""
    with davis_rs.open_writer(path, (240, 180), "bag", message_us=10) as writer:
        for k in range(packets):
            writer.write(np.array([(100 * k, 1, 2, 1)], davis_rs.EVENT_DTYPE))
    return bytearray(path.read_bytes())


def record(content: bytes, operation: int) -> tuple[int, int, int]:
    """Where the first record of an operation begins, where the length of its data stands, and where it ends."""
    place = len(b"#ROSBAG V2.0\n")
    while place < len(content):
        (header,) = struct.unpack_from("<I", content, place)
        data_at = place + 4 + header
        end = data_at + 4 + struct.unpack_from("<I", content, data_at)[0]
        if b"op=%c" % operation in content[place:data_at]:
            return place, data_at, end
        place = end
    raise AssertionError(f"no record of operation {operation}")


def refused(path: Path, content: bytes) -> tuple[str, int]:
    """What is said of a bag, and how much memory was asked for meanwhile; no file stays open."""
    path.write_bytes(content)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        tracemalloc.start()
        try:
            with pytest.raises(DecodeError) as refusal:
                davis_rs.read_events(path)
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        message = str(refusal.value)
        del refusal
        gc.collect()
    assert [str(one.message) for one in said] == []
    return message, peak


@pytest.mark.parametrize(
    ("operation", "part"),
    [(CHUNK, "header"), (CHUNK, "data"), (ENTRIES, "header"), (ENTRIES, "data"), (CHUNK_INFO, "header")],
)
def test_lengths_beyond_the_end(tmp_path: Path, operation: int, part: str) -> None:
    content = bag(tmp_path / "a.bag")
    place, data_at, _ = record(content, operation)
    struct.pack_into("<I", content, place if part == "header" else data_at, MOST)
    message, peak = refused(tmp_path / "b.bag", content)
    assert message.startswith(f"{tmp_path / 'b.bag'}")
    assert peak < 50 << 20


def test_a_chunk_without_entries_beyond_the_end(tmp_path: Path) -> None:
    """Nothing is read of it while the index is."""
    content = bag(tmp_path / "a.bag")
    _, data_at, _ = record(content, CHUNK)
    begin, _, _ = record(content, CHUNK_INFO)
    struct.pack_into("<I", content, data_at, MOST)
    struct.pack_into("<I", content, content.index(b"count=", begin) + len(b"count="), 0)
    message, _ = refused(tmp_path / "b.bag", content)
    assert f"a chunk of {MOST} bytes goes beyond the file's end" in message


def test_an_index_that_is_read_again_and_again(tmp_path: Path) -> None:
    """Many records say that there is a chunk, all of them the same: its entries would be held as many times."""
    content = bag(tmp_path / "a.bag", packets=2000)
    begin, _, end = record(content, CHUNK_INFO)
    content[end:end] = bytes(content[begin:end]) * 500
    struct.pack_into("<I", content, content.index(b"chunk_count=") + len(b"chunk_count="), 501)
    message, peak = refused(tmp_path / "b.bag", content)
    assert "damaged: all parts of the index have more bytes than the file" in message
    assert peak < 50 << 20


def test_the_index_is_charged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    content = bag(tmp_path / "a.bag", packets=100)
    assert len(davis_rs.read_events(tmp_path / "a.bag")) == 100
    monkeypatch.setenv("DAVIS_RS_READ_BUDGET", "bytes=10KiB")
    message, _ = refused(tmp_path / "b.bag", content)
    assert (
        "the index needs 15.6 KiB; 10 KiB may be held in memory (DAVIS_RS_READ_BUDGET=bytes=... allows more)" in message
    )
