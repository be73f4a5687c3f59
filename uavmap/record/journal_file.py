"""The file of a journal: its tables, its lock, and how it comes to be whole or not at all.

A new journal is built under another name in its folder, forced to the disk, and then takes its
name; the name and the folder are forced to the disk, too. Whoever holds the folder's lock may
remove what a dead process left half-built.
"""

from __future__ import annotations

import errno
import fcntl
import os
import sqlite3
from collections.abc import Iterable, Mapping
from contextlib import closing, suppress
from pathlib import Path
from typing import Final, NamedTuple

from missions.errors import JournalError
from uavmap.record import chain

APPLICATION_ID: Final = 0x5541564D
"""'UAVM', in the header of the file: `file` and SQLite tools show it."""
SCHEMA_VERSION: Final = 2
PAGE_BYTES: Final = 4096
SQLITE_MAGIC: Final = b"SQLite format 3\x00"
LOGS: Final = ("-wal", "-journal")
"""What SQLite may keep beside a file and reads with it: the write-ahead log, the rollback log."""
SIDES: Final = ("", "-shm", *LOGS)
"""A journal, the index of its log, and its logs: one journal, wherever it is moved."""

_APPEND_ONLY: Final = (
    "CREATE TRIGGER no_update BEFORE UPDATE ON events "
    "BEGIN SELECT RAISE(ABORT, 'events are append-only'); END",
    "CREATE TRIGGER no_delete BEFORE DELETE ON events "
    "BEGIN SELECT RAISE(ABORT, 'events are append-only'); END",
)
SCHEMAS: Final[Mapping[int, tuple[str, ...]]] = {
    1: (
        "CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID",
        "CREATE TABLE events (seq INTEGER PRIMARY KEY, t_s REAL NOT NULL, vehicle INTEGER, "
        "kind TEXT NOT NULL, body TEXT NOT NULL)",
        # what was acted on cannot be unsaid
        *_APPEND_ONLY,
    ),
    2: (
        "CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL, checksum BLOB NOT NULL) "
        "WITHOUT ROWID",
        "CREATE TABLE events (seq INTEGER PRIMARY KEY, t_s REAL NOT NULL, vehicle INTEGER, "
        "kind TEXT NOT NULL, body TEXT NOT NULL, chain BLOB NOT NULL)",
        *_APPEND_ONLY,
    ),
}
"""By version; a journal has exactly these tables and triggers."""


class EventRow(NamedTuple):
    """An event as it lies in the file; the first three repeat what the text says, for queries."""

    t_s: float
    vehicle: int | None
    kind: str
    body: str


def connect(path: Path, query: str = "") -> sqlite3.Connection:
    """A connection in which transactions are begun by hand. Raises `sqlite3.Error`."""
    return sqlite3.connect(path.absolute().as_uri() + query, uri=True, isolation_level=None)


def beside(path: Path, side: str) -> Path:
    """The journal itself, its log or its index: `side` is one of `SIDES`."""
    return path.with_name(path.name + side)


def unfinished(path: Path) -> Path:
    """The name under which a journal is built."""
    return path.with_name(path.name + ".unfinished")


def lock(path: Path) -> int:
    """Hold the folder for one process: two would fly the same aircraft. The kernel lets go."""
    try:
        folder = os.open(path.parent, os.O_RDONLY)
    except OSError as error:
        raise JournalError(f"{path} cannot be opened: {error.strerror}") from None
    try:
        fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(folder)
        why = "" if isinstance(error, BlockingIOError) else f" ({error.strerror})"
        raise JournalError(f"{path} is in use by another uavmap; end that first{why}") from None
    return folder


def remove_unfinished(path: Path) -> None:
    """Remove what a process that died left half-built. The caller holds the lock."""
    for side in SIDES:
        beside(unfinished(path), side).unlink(missing_ok=True)


def build(path: Path, meta: Mapping[str, str], events: Iterable[EventRow] = ()) -> Path:
    """Write a whole journal under its unfinished name and to the disk; returns where it lies.

    Raises `JournalError` when the disk refuses. The caller holds the lock.
    """
    temporary = unfinished(path)
    try:
        remove_unfinished(path)
        with closing(connect(temporary)) as database:
            _fill(database, meta, events)
        to_disk(temporary)
    except (sqlite3.Error, OSError) as error:
        with suppress(OSError):
            remove_unfinished(path)
        raise JournalError(f"{path} cannot be written: {error}") from None
    return temporary


def _fill(
    database: sqlite3.Connection, meta: Mapping[str, str], events: Iterable[EventRow]
) -> None:
    database.execute(f"PRAGMA page_size = {PAGE_BYTES}")
    database.execute("PRAGMA synchronous = FULL")
    database.execute("BEGIN")
    database.execute(f"PRAGMA application_id = {APPLICATION_ID}")
    database.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")
    for statement in SCHEMAS[SCHEMA_VERSION]:
        database.execute(statement)
    for key, value in meta.items():
        put_meta(database, SCHEMA_VERSION, key, value)
    last = chain.seed(meta.get("plan"))
    for number, row in enumerate(events, start=1):
        last = chain.link(last, number, row.body)
        put_event(database, number, row, last)
    database.execute("COMMIT")
    # after the tables: the mode stays in the header, and closing leaves no log behind
    database.execute("PRAGMA journal_mode = WAL")


def put_meta(database: sqlite3.Connection, version: int, key: str, value: str) -> None:
    """Write what is said of the mission as a whole."""
    if version == 1:
        database.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (key, value))
    else:
        row = (key, value, chain.of_meta(key, value))
        database.execute("INSERT OR REPLACE INTO meta VALUES (?, ?, ?)", row)


def put_event(
    database: sqlite3.Connection, number: int, row: EventRow, checksum: bytes | None
) -> None:
    """Write an event; version 1 has no checksum."""
    values = (number, *row) if checksum is None else (number, *row, checksum)
    places = ", ".join("?" * len(values))
    database.execute(f"INSERT INTO events VALUES ({places})", values)


def to_disk(path: Path) -> None:
    """Force a file, or the names in a folder, to the disk. Raises `OSError`."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        # some file systems (network, FAT) cannot do it for a folder
        if not (path.is_dir() and error.errno in (errno.EINVAL, errno.EBADF)):
            raise
    finally:
        os.close(handle)
