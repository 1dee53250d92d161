"""Reads the messages of a rosbag2 in SQLite."""

from __future__ import annotations

import os
import sqlite3
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from ..._core import DecodeError
from ..._util.budget import Budget
from ..._util.untrusted import regular_file
from .bag_records import ScannedMessage

MAGIC = b"SQLite format 3\0"

_JOURNAL_MAGIC = b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7"
_READ = {"topics": ("id", "name", "type"), "messages": ("id", "topic_id", "timestamp", "data")}
"""Tables and columns that are read."""
_FUNCTIONS = ("min", "max", "count", "total", "length")
_LEAST_ROW = 4
"""Bytes of a row in the file: a place in its page, a length and a number."""
_STEPS = 10_000
"""Instructions of SQLite's machine between two looks at the clock."""


class SqliteScan:
    """Reads messages in order of time; one may have ``limit`` bytes.

    A database can hold programs: views, virtual tables, computed columns. None of them is run, because only plain
    tables and their columns are read. A damaged table can lead in circles, so it may not have more rows and bytes than
    the file has room for, and the search for the next row may take the seconds of the budget.

    The database is opened for reading only. Where a killed writer has left a journal, SQLite's own recovery is run
    first, as by any program that opens it.

    Source: rosbag2_storage_sqlite3, tables ``topics`` and ``messages``; SQLite, "Defense Against The Dark Arts".

    Raises:
        DecodeError: if it is no SQLite, or one of the tables is missing or no plain table.
    """

    whole = True

    def __init__(self, path: Path, limit: int) -> None:
        self._path, self._limit = path, limit
        self._budget = Budget(path)
        self._rows: int | None = None
        with path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise DecodeError(f"{path}: a rosbag2 in SQLite must begin with {MAGIC!r}")
        journal = path.with_name(path.name + "-journal")
        if journal.exists():
            _check_journal(journal)
            with closing(sqlite3.connect(path)) as database:
                database.execute("SELECT count(*) FROM sqlite_master").fetchall()
        self._size = path.stat().st_size
        self._topics: dict[object, tuple[str, str]] = {}
        with self._open() as database:
            for number, name, type_ in self._select(database, "SELECT id, name, type FROM topics", self._size):
                name, type_ = str(name), str(type_)
                self._budget.count(1, "topics")
                self._budget.take(len(name) + len(type_), "the list of topics")
                self._topics[number] = name, type_

    def topics(self) -> dict[str, str]:
        """Return the types of all topics."""
        return dict(self._topics.values())

    def messages(self) -> Iterator[ScannedMessage]:
        """Yield all messages."""
        with self._open() as database:
            rows = self._count(database)
            [(first, last)] = self._select(database, "SELECT min(timestamp), max(timestamp) FROM messages", 1)
            query = "SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp, id"
            for number, t_ns, data in self._select(database, query, rows):
                if number not in self._topics:
                    continue
                if not (isinstance(t_ns, int) and isinstance(data, bytes)):
                    raise DecodeError(f"{self._path}: a message must have a time and bytes, found {t_ns!r:.40}")
                fraction = (t_ns - first) / max(1, last - first)
                yield ScannedMessage(*self._topics[number], t_ns, data, fraction)

    def _count(self, database: sqlite3.Connection) -> int:
        """Count the messages before anything sorts them, because pages that lead in circles never end."""
        if self._rows is None:
            most = self._size // _LEAST_ROW + 1
            query = f"SELECT count(*), total(size) FROM (SELECT length(data) AS size FROM messages LIMIT {most})"
            [(rows, held)] = self._select(database, query, 1)
            if rows >= most or held > self._size:
                raise DecodeError(f"{self._path}: damaged: messages have more rows or bytes than the file has")
            self._rows = int(rows)
        return self._rows

    def _select(self, database: sqlite3.Connection, query: str, most: int) -> Iterator[tuple[Any, ...]]:
        """Yield the rows of a query, of which there may be ``most``. Time counts while SQLite works, row by row."""
        self._budget.start_clock()
        try:
            for number, row in enumerate(database.execute(query)):
                if number >= most:
                    raise DecodeError(f"{self._path}: damaged: more rows than there are")
                yield row
                self._budget.start_clock()
        except sqlite3.OperationalError:
            self._budget.check_time("a search in the database")
            raise

    @contextmanager
    def _open(self) -> Iterator[sqlite3.Connection]:
        with closing(sqlite3.connect(f"{self._path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)) as database:
            if sys.version_info >= (3, 11):
                database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, self._limit)
            database.set_progress_handler(self._budget.out_of_time, _STEPS)
            database.execute("PRAGMA trusted_schema=OFF")
            self._check_tables(database)
            database.set_authorizer(_allowed)
            yield database

    def _check_tables(self, database: sqlite3.Connection) -> None:
        """Refuse what is called as a table that is read, and is none."""
        kinds_of: dict[str, list[str]] = {name: [] for name in _READ}
        query = "SELECT lower(name), type, sql FROM sqlite_master WHERE lower(name) IN (?, ?)"
        for name, type_, sql in database.execute(query, tuple(_READ)):
            # The text is what SQLite goes by: a virtual table also has the type of a table.
            plain = str(sql).upper().startswith("CREATE TABLE ")
            kinds_of[name].append(str(type_) if plain or type_ != "table" else "virtual table")
        for name, columns in _READ.items():
            if kinds_of[name] != ["table"]:
                kinds = ", ".join(kinds_of[name])
                fault = f"{name} is a {kinds:.40}, not a table" if kinds else f"there is no table {name}"
                raise DecodeError(f"{self._path}: {fault}: a rosbag2 in SQLite has the tables {', '.join(_READ)}")
            described = database.execute(f"PRAGMA table_xinfo({name})")
            computed = {str(column).lower() for _, column, *_, hidden in described if hidden}
            if not computed.isdisjoint(columns):
                which = ", ".join(sorted(computed))
                raise DecodeError(f"{self._path}: columns of {name} must hold values, these are computed: {which:.80}")


def _allowed(action: int, table: str | None, column: str | None, _: str | None, within: str | None) -> int:
    """Allow what :class:`SqliteScan` asks of its own accord, not what a view or another program of the file asks."""
    if within is None:
        if action == sqlite3.SQLITE_SELECT:
            return sqlite3.SQLITE_OK
        if (
            action == sqlite3.SQLITE_READ
            and table is not None
            and (not column or column.lower() in _READ.get(table, ()))
        ):
            return sqlite3.SQLITE_OK
        if action == sqlite3.SQLITE_FUNCTION and column in _FUNCTIONS:
            return sqlite3.SQLITE_OK
    return sqlite3.SQLITE_DENY


def _check_journal(journal: Path) -> None:
    """Refuse a journal that names another one: SQLite would delete the file of that name once it has recovered.

    Source: SQLite, pager.c, ``readSuperJournal``.
    """
    with regular_file(journal).open("rb") as file:
        file.seek(max(0, file.seek(0, os.SEEK_END) - len(_JOURNAL_MAGIC)))
        if file.read() == _JOURNAL_MAGIC:
            raise DecodeError(f"{journal}: it names another journal, which no rosbag2 has")
