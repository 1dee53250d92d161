"""The messages of a rosbag2 in SQLite."""

from __future__ import annotations

import sqlite3
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from ..._core import DecodeError
from .bag_records import ScannedMessage

MAGIC = b"SQLite format 3\0"


class SqliteScan:
    """Reads messages in order of time; one may have ``limit`` bytes.

    The database is opened for reading only. Where a killed writer has left a journal, SQLite's own recovery is run
    first, as by any program that opens it.

    Source: rosbag2_storage_sqlite3, tables ``topics`` and ``messages``.
    """

    whole = True

    def __init__(self, path: Path, limit: int) -> None:
        self._path, self._limit = path, limit
        with path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise DecodeError(f"{path}: a rosbag2 in SQLite must begin with {MAGIC!r}")
        journal = path.with_name(path.name + "-journal")
        if journal.exists():
            with closing(sqlite3.connect(path)) as database:
                database.execute("SELECT count(*) FROM sqlite_master").fetchall()

    def topics(self) -> dict[str, str]:
        """The types of all topics."""
        with closing(self._open()) as database:
            return {str(name): str(type_) for name, type_ in database.execute("SELECT name, type FROM topics")}

    def messages(self) -> Iterator[ScannedMessage]:
        """All messages."""
        with closing(self._open()) as database:
            ((first, last),) = database.execute("SELECT min(timestamp), max(timestamp) FROM messages")
            rows = database.execute(
                "SELECT topics.name, topics.type, messages.timestamp, messages.data FROM messages "
                "JOIN topics ON messages.topic_id = topics.id ORDER BY messages.timestamp, messages.id"
            )
            for topic, type_, t_ns, data in rows:
                if not (isinstance(t_ns, int) and isinstance(data, bytes)):
                    raise DecodeError(f"{self._path}: a message must have a time and bytes, found {t_ns!r:.40}")
                share = (t_ns - first) / max(1, last - first)
                yield ScannedMessage(str(topic), str(type_), t_ns, data, share)

    def _open(self) -> sqlite3.Connection:
        database = sqlite3.connect(f"{self._path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)
        if sys.version_info >= (3, 11):
            database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, self._limit)
        return database
