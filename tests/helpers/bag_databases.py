"""Databases of rosbag2 that were made to harm: with programs in them, and with tables that lead in circles."""

from __future__ import annotations

import sqlite3
import struct
from pathlib import Path

TOPICS = "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT)"
MESSAGES = "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)"
INDEX = "CREATE INDEX timestamp_idx ON messages(timestamp)"
ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT "


def database(path: Path, *statements: str, rows: int = 3) -> Path:
    """A database of one topic; its messages are rows of three bytes, if there is a table of them."""
    connection = sqlite3.connect(path)
    for statement in statements:
        connection.execute(statement)
    if TOPICS in statements:
        connection.execute("INSERT INTO topics VALUES (1, '/a', 'dvs_msgs/msg/EventArray')")
    if MESSAGES in statements:
        values = [(1, rows - k, b"abc") for k in range(rows)]
        connection.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", values)
    connection.commit()
    connection.close()
    return path


PROGRAMS: dict[str, tuple[str, ...]] = {
    "messages are a view without end": (
        TOPICS,
        f"CREATE VIEW messages AS {ENDLESS} i AS id, 1 AS topic_id, i AS timestamp, x'00' AS data FROM n",
    ),
    "topics are a view without end": (
        MESSAGES,
        f"CREATE VIEW topics AS {ENDLESS} i AS id, 'a' || i AS name, 'b' AS type FROM n",
    ),
    "messages are a virtual table": (TOPICS, "CREATE VIRTUAL TABLE messages USING rtree(id, topic_id, timestamp)"),
    "data are computed": (
        TOPICS,
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, "
        "data BLOB AS (zeroblob(900000)))",
        "INSERT INTO messages(topic_id, timestamp) VALUES (1, 1)",
    ),
}


def page_of(table: str, path: Path) -> int:
    connection = sqlite3.connect(path)
    [(page,)] = connection.execute("SELECT rootpage FROM sqlite_master WHERE name = ?", (table,))
    connection.close()
    return int(page)


def inner_page(child: int, size: int) -> bytes:
    """A page of a table that has the same child 200 times.

    Source: SQLite, Database File Format, 1.6: interior cells are a page's number and a key.
    """
    cells = b"".join(struct.pack(">IB", child, key % 128) for key in range(200))
    begin = size - len(cells)
    places = b"".join(struct.pack(">H", begin + 5 * k) for k in range(200))
    head = struct.pack(">BHHHBI", 5, 0, 200, begin, 0, child) + places
    return head + bytes(begin - len(head)) + cells


def in_circles(path: Path) -> Path:
    """A table whose five levels of pages say a hundred thousand million rows, in a file of a few pages."""
    database(path, TOPICS, MESSAGES)
    content = bytearray(path.read_bytes())
    size = struct.unpack_from(">H", content, 16)[0]
    root = page_of("messages", path)
    leaf = len(content) // size + 1
    content += content[(root - 1) * size : root * size]
    for child in range(leaf, leaf + 4):
        content += inner_page(child, size)
    content[(root - 1) * size : root * size] = inner_page(leaf + 4, size)
    struct.pack_into(">I", content, 28, leaf + 4)
    path.write_bytes(content)
    return path
