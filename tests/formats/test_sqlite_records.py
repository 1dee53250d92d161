"""Databases of rosbag2 that were made to harm: views and other programs, tables that lead in circles, journals."""

from __future__ import annotations

import sqlite3
import struct
from pathlib import Path

import pytest

import davis_rs
from bag_databases import INDEX, MESSAGES, PROGRAMS, TOPICS, database, in_circles, page_of
from davis_rs import DecodeError
from davis_rs.formats.sqlite_records import SqliteScan

LIMIT = 1 << 20


def times(path: Path) -> list[int]:
    return [message.t_ns for message in SqliteScan(path, LIMIT).messages()]


@pytest.mark.parametrize("kind", PROGRAMS)
def test_programs_of_a_database_are_not_run(tmp_path: Path, kind: str) -> None:
    path = database(tmp_path / "a.db3", *PROGRAMS[kind])
    with pytest.raises(
        DecodeError, match=r"a.db3: (messages|topics) is a (view|virtual table), not a table|are computed: data"
    ):
        times(path)
    with pytest.raises(DecodeError, match=r"not a table|are computed"):
        davis_rs.read_events(path)


def test_a_table_is_missing(tmp_path: Path) -> None:
    path = database(tmp_path / "a.db3", TOPICS)
    with pytest.raises(DecodeError, match="there is no table messages"):
        SqliteScan(path, LIMIT)


def test_pages_that_lead_in_circles(tmp_path: Path) -> None:
    with pytest.raises(DecodeError, match="damaged: messages have more rows or bytes than the file has"):
        times(in_circles(tmp_path / "a.db3"))


def test_rows_that_share_their_bytes(tmp_path: Path) -> None:
    """Five messages of 100 kB whose bytes are all those of the first."""
    path = database(tmp_path / "a.db3", TOPICS, MESSAGES, rows=0)
    connection = sqlite3.connect(path)
    connection.execute("INSERT INTO messages VALUES (1, 1, 1, ?)", (bytes(100_000),))
    connection.commit()
    connection.close()
    content = bytearray(path.read_bytes())
    size, root = struct.unpack_from(">H", content, 16)[0], page_of("messages", path)
    page = (root - 1) * size
    (cell,) = struct.unpack_from(">H", content, page + 8)
    struct.pack_into(">H", content, page + 3, 5)
    struct.pack_into(">5H", content, page + 8, *[cell] * 5)
    path.write_bytes(content)
    with pytest.raises(DecodeError, match="damaged: messages have more rows or bytes than the file has"):
        times(path)


def test_the_clock_runs_while_the_database_works(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = database(tmp_path / "a.db3", TOPICS, MESSAGES, rows=5000)
    monkeypatch.setenv("DAVIS_RS_READ_BUDGET", "seconds=0.0000001")
    with pytest.raises(DecodeError, match=r"a search in the database has taken more than 1e-07 s"):
        times(path)


def test_the_clock_stands_while_a_message_is_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = database(tmp_path / "a.db3", TOPICS, MESSAGES, INDEX, rows=5000)
    now = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    found = 0
    for message in SqliteScan(path, LIMIT).messages():
        found += message.data == b"abc"
        now[0] += 1000.0
    assert found == 5000


def test_topics_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = database(tmp_path / "a.db3", TOPICS, MESSAGES)
    connection = sqlite3.connect(path)
    connection.executemany("INSERT INTO topics(name, type) VALUES (?, 'b')", [(f"t{k}",) for k in range(20)])
    connection.commit()
    connection.close()
    assert len(SqliteScan(path, LIMIT).topics()) == 21
    monkeypatch.setenv("DAVIS_RS_READ_BUDGET", "items=20")
    with pytest.raises(DecodeError, match="more than 20 parts, the last of them topics"):
        SqliteScan(path, LIMIT)


@pytest.mark.parametrize("index", [(), (INDEX,)])
def test_tables_are_read_in_order_of_time(tmp_path: Path, index: tuple[str, ...]) -> None:
    """In either case of letters, and of whatever else stands in the database."""
    others = "CREATE VIEW other AS SELECT 1"
    path = database(tmp_path / "a.db3", TOPICS, MESSAGES, *index, others, rows=100)
    assert times(path) == list(range(1, 101))


def test_a_journal_that_names_another_deletes_nothing(tmp_path: Path) -> None:
    """SQLite would delete the file that the journal names, once it has played the journal back."""
    path = database(tmp_path / "a.db3", TOPICS, MESSAGES)
    precious = tmp_path / "precious"
    precious.write_bytes(b"")
    magic, name = b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7", str(precious).encode()
    size = struct.unpack_from(">H", path.read_bytes(), 16)[0]
    pages = path.stat().st_size // size
    head = magic + struct.pack(">IIIII", 0, 1, pages, 512, size)
    lost = struct.pack(">I", (1 << 30) // size + 1) + name + struct.pack(">II", len(name), sum(name)) + magic
    journal = Path(f"{path}-journal")
    journal.write_bytes(head + bytes(512 - len(head)) + lost)
    with pytest.raises(DecodeError, match=r"a.db3-journal: it names another journal"):
        times(path)
    assert precious.exists()
