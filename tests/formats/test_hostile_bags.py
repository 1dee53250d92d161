"""Bags of ROS 1 that say what is not so of their sizes: nothing is taken for it, and nothing stays open."""

from __future__ import annotations

import bz2
import gc
import struct
import tracemalloc
import warnings
from pathlib import Path

import numpy as np
import pytest

import davis_rs
from davis_rs import DecodeError
from davis_rs.io.formats.bag_index import bag_index
from davis_rs.io.formats.unpack import unpack_bz2

CHUNK, ENTRIES, CHUNK_INFO = 5, 4, 6
MOST = 2**32 - 1


def bag(path: Path, packets: int = 3) -> bytearray:
    """A bag of as many messages, in one chunk."""
    with davis_rs.open_writer(path, (240, 180), "bag", message_us=10) as writer:
        for k in range(packets):
            writer.write(np.array([(100 * k, 1, 2, 1)], davis_rs.EVENT_DTYPE))
    return bytearray(path.read_bytes())


def record(content: bytes | bytearray, operation: int) -> tuple[int, int, int]:
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


def refused(path: Path, content: bytes | bytearray) -> tuple[str, int]:
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


@pytest.mark.few(3)
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


def fields(**values: bytes) -> bytes:
    """A header, or what is laid out like one."""
    packed = [name.encode() + b"=" + value for name, value in values.items()]
    return b"".join(struct.pack("<I", len(one)) + one for one in packed)


def a_record(header: bytes, data: bytes) -> bytes:
    return struct.pack("<I", len(header)) + header + struct.pack("<I", len(data)) + data


def in_turns(folder: Path, chunks: int, turns: int) -> Path:
    """A bag of a message, which each of its chunks has; the index asks for it in turns."""
    bag(folder / "one.bag", packets=1)
    reader = bag_index(folder / "one.bag", 1 << 20)
    reader.open()
    [(connection, t_ns, message)] = reader.messages()
    stamp = struct.pack("<II", *divmod(t_ns, 10**9))
    content = bytearray(b"#ROSBAG V2.0\n")
    head = {"op": b"\x03", "index_pos": bytes(8), "conn_count": struct.pack("<I", 1)}
    begin = len(content)
    content += a_record(fields(**head, chunk_count=struct.pack("<I", chunks * turns)), b"")
    plain = a_record(fields(op=b"\x02", conn=bytes(4), time=stamp), message)
    infos = []
    for _ in range(chunks):
        place = len(content)
        size = struct.pack("<I", len(plain))
        content += a_record(fields(op=b"\x05", compression=b"bz2", size=size), bz2.compress(plain))
        entries = a_record(
            fields(op=b"\x04", ver=struct.pack("<I", 1), conn=bytes(4), count=struct.pack("<I", 1)), stamp + bytes(4)
        )
        content += entries
        infos.append(
            a_record(
                fields(
                    op=b"\x06",
                    ver=struct.pack("<I", 1),
                    chunk_pos=struct.pack("<Q", place),
                    start_time=stamp,
                    end_time=stamp,
                    count=struct.pack("<I", 1),
                ),
                bytes(4) + struct.pack("<I", 1),
            )
        )
    head["index_pos"] = struct.pack("<Q", len(content))
    content[begin : begin + len(a_record(fields(**head, chunk_count=bytes(4)), b""))] = a_record(
        fields(**head, chunk_count=struct.pack("<I", chunks * turns)), b""
    )
    described = fields(
        topic=b"/dvs/events", type=b"dvs_msgs/EventArray", md5sum=connection.digest.encode(), message_definition=b""
    )
    content += a_record(fields(op=b"\x07", conn=bytes(4), topic=b"/dvs/events"), described)
    content += b"".join(infos * turns)
    reader.close()
    (folder / "turns.bag").write_bytes(content)
    return folder / "turns.bag"


def test_chunks_in_turns_are_unpacked_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Once for the size of the sensor, and kept since."""
    path = in_turns(tmp_path, chunks=3, turns=4)
    unpacked = []

    def counted(path: Path, data: bytes, limit: int) -> bytes:
        unpacked.append(path)
        return unpack_bz2(path, data, limit)

    monkeypatch.setattr("davis_rs.io.formats.bag_records.unpack_bz2", counted)
    assert davis_rs.read_events(path).tolist() == [(0, 1, 2, 1)] * 12
    assert len(unpacked) == 3


def test_an_index_that_asks_for_many_chunks_in_turns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = in_turns(tmp_path, chunks=5, turns=4)
    assert len(davis_rs.read_events(path)) == 20
    monkeypatch.setenv("DAVIS_RS_READ_BUDGET", "seconds=0.0000001")
    with pytest.raises(
        DecodeError, match="the unpacking of the same chunks, again and again, has taken more than 1e-07 s"
    ):
        davis_rs.read_events(path)
