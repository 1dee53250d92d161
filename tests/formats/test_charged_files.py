"""Files that would fill memory although none of their parts is large: the budget of the file refuses them."""

from __future__ import annotations

import bz2
import struct
import zipfile
from pathlib import Path

import lz4.frame
import numpy as np
import pytest

import davis_rs
from davis_rs import DecodeError
from davis_rs._util.budget import VARIABLE, Budget
from davis_rs.io.formats.bag_records import scan_messages
from davis_rs.io.formats.mcap_records import MAGIC, McapScan
from davis_rs.io.formats.parquet_footer import read_row_groups
from davis_rs.io.recordings.aedat3 import Aedat3File

LIMIT = 1 << 26
SCHEMA, CHANNEL, MESSAGE, CHUNK = 3, 4, 5, 6


def refused(monkeypatch: pytest.MonkeyPatch, budget: str, what: str) -> pytest.RaisesExc[DecodeError]:
    """The context in which a file must be refused by a budget, which the message names."""
    monkeypatch.setenv(VARIABLE, budget)
    return pytest.raises(DecodeError, match=rf"{what}.*{VARIABLE}={budget.partition('=')[0]}=")


# ---- MCAP ----


def mcap_record(kind: int, content: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(content)) + content


def mcap_string(text: bytes) -> bytes:
    return struct.pack("<I", len(text)) + text


def mcap_chunk(records: bytes) -> bytes:
    packed = lz4.frame.compress(records)
    head = struct.pack("<QQQI", 0, 0, len(records), 0) + mcap_string(b"lz4") + struct.pack("<Q", len(packed))
    return mcap_record(CHUNK, head + packed)


def mcap_names(kind: int) -> bytes:
    """Eight chunks, each with a name of a megabyte that packs to nothing."""
    begin = b"" if kind == SCHEMA else struct.pack("<H", 0)
    return b"".join(
        mcap_chunk(mcap_record(kind, struct.pack("<H", number) + begin + mcap_string(b"n" * (1 << 20))))
        for number in range(1, 9)
    )


@pytest.mark.parametrize("kind", [SCHEMA, CHANNEL])
def test_names_of_an_mcap_file_add_up(kind: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (path := tmp_path / "a.mcap").write_bytes(MAGIC + mcap_names(kind))
    assert list(McapScan(path, LIMIT).messages()) == []
    with refused(monkeypatch, "bytes=4MiB", "the names of channels and schemas needs"):
        McapScan(path, LIMIT)


def test_a_name_that_is_given_again_is_held_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also in another pass over the file."""
    name = mcap_chunk(mcap_record(SCHEMA, struct.pack("<H", 1) + mcap_string(b"n" * (1 << 20))))
    (path := tmp_path / "a.mcap").write_bytes(MAGIC + 20 * name)
    monkeypatch.setenv(VARIABLE, "bytes=4MiB")
    scan = McapScan(path, LIMIT)
    for _ in range(5):
        assert list(scan.messages()) == []


def test_messages_of_an_mcap_chunk_add_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each takes more in memory than in the chunk."""
    channel = mcap_record(CHANNEL, struct.pack("<HH", 1, 0) + mcap_string(b"/a"))
    message = mcap_record(MESSAGE, struct.pack("<HIQQ", 1, 0, 5, 5))
    (path := tmp_path / "a.mcap").write_bytes(MAGIC + mcap_chunk(channel + 20_000 * message))
    assert sum(1 for _ in McapScan(path, LIMIT).messages()) == 20_000
    with refused(monkeypatch, "bytes=2MiB", "the messages of a chunk needs"):
        McapScan(path, LIMIT)


# ---- ROS 1 ----


def bag_record(data: bytes, **fields: bytes) -> bytes:
    header = b"".join(
        struct.pack("<I", len(name) + 1 + len(value)) + name.encode() + b"=" + value for name, value in fields.items()
    )
    return struct.pack("<I", len(header)) + header + struct.pack("<I", len(data)) + data


def test_connections_of_a_bag_without_an_index_add_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    chunks = b""
    for number in range(8):
        named = bag_record(b"", type=b"std_msgs/String")[4:-4]
        connection = bag_record(named, op=b"\x07", conn=struct.pack("<I", number), topic=b"t" * (1 << 20))
        packed = bz2.compress(connection)
        chunks += bag_record(packed, op=b"\x05", compression=b"bz2", size=struct.pack("<I", len(connection)))
    (path := tmp_path / "a.bag").write_bytes(b"#ROSBAG V2.0\n" + chunks)
    assert list(scan_messages(path, LIMIT)) == []
    with refused(monkeypatch, "bytes=4MiB", "the names of connections needs"):
        list(scan_messages(path, LIMIT))


# ---- Parquet ----


def test_values_of_parquets_metadata_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A value of one byte takes some dozens of bytes in memory."""
    many = 200_000
    assert many < 1 << 21
    count = bytes([many & 127 | 128, many >> 7 & 127 | 128, many >> 14])
    footer = b"\x29" + b"\xf3" + count + bytes(many) + b"\x00"
    (path := tmp_path / "a.parquet").write_bytes(b"PAR1" + footer + struct.pack("<I", len(footer)) + b"PAR1")
    with pytest.raises(DecodeError, match="Parquet's metadata"):
        read_row_groups(path, ("t",), Budget(path))
    with refused(monkeypatch, "items=1e5", "values of Parquet's metadata"):
        davis_rs.read_events(path)


def test_a_row_group_is_charged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    events = np.zeros(100_000, davis_rs.EVENT_DTYPE)
    events["t"], events["x"] = np.arange(100_000), np.random.default_rng(1).integers(0, 240, 100_000)
    with davis_rs.open_writer(path := tmp_path / "a.parquet", (240, 180)) as writer:
        writer.write(events)
    assert len(davis_rs.read_events(path)) == 100_000
    with refused(monkeypatch, "bytes=40KiB", "row group 0 needs"):
        davis_rs.read_events(path)
    with refused(monkeypatch, "bytes=100", "Parquet's metadata needs"):
        davis_rs.read_events(path)


# ---- NumPy ----


def test_members_of_an_archive_are_charged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """zipfile makes an object of each when it opens the archive."""
    with zipfile.ZipFile(path := tmp_path / "a.npz", "w") as archive:
        for number in range(10_000):
            archive.writestr(f"{number}.npy", b"")
    with pytest.raises(DecodeError, match="expected one array of events"):
        davis_rs.read_events(path)
    with refused(monkeypatch, "bytes=4MiB", "the list of the archive's members needs"):
        davis_rs.read_events(path)


def test_a_piece_of_a_compressed_archive_is_charged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    np.savez_compressed(path := tmp_path / "a.npz", events=np.zeros(100_000, davis_rs.EVENT_DTYPE))
    assert len(davis_rs.read_events(path)) == 100_000
    with refused(monkeypatch, "bytes=1MiB", "a piece of the array needs"):
        davis_rs.read_events(path)


# ---- AEDAT 3.1 ----


def test_a_packet_of_aedat_3_is_charged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A frame may have 2 GiB."""
    size = 2 << 20
    head = b"#!AER-DAT3.1\r\n#Format: RAW\r\n#Source 1: DAVIS240C\r\n#!END-HEADER\r\n"
    packet = struct.pack("<hhiiiiii", 2, 1, size, 12, 0, 1, 1, 1)
    (path := tmp_path / "a.aedat").write_bytes(head + packet + bytes(size))
    assert [len(piece.decoded.frames) for piece in Aedat3File(path).pieces()] == [0]
    with refused(monkeypatch, "bytes=1MiB", "a packet at byte"):
        list(Aedat3File(path).pieces())
