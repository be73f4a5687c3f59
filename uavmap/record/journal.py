"""The journal: every event of a mission, in SQLite, in the order in which it was acted on.

A transaction an event, WAL with synchronous FULL: what was acted on is on the disk, also after a
power cut. The mission file's text and the seed lie beside the events, so that a folder is enough
to go on from. A file that is truncated, foreign or of another version is refused, never touched.
"""

from __future__ import annotations

import fcntl
import json
import os
import sqlite3
from collections import deque
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from missions.errors import JournalError
from missions.events import Event, from_json, to_json

APPLICATION_ID: Final = 0x5541564D
"""'UAVM', in the header of the file: `file` and SQLite tools show it."""
SCHEMA_VERSION: Final = 1

_SCHEMA: Final = (
    "CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID",
    "CREATE TABLE events (seq INTEGER PRIMARY KEY, t_s REAL NOT NULL, vehicle INTEGER, "
    "kind TEXT NOT NULL, body TEXT NOT NULL)",
    # what was acted on cannot be unsaid
    "CREATE TRIGGER no_update BEFORE UPDATE ON events "
    "BEGIN SELECT RAISE(ABORT, 'events are append-only'); END",
    "CREATE TRIGGER no_delete BEFORE DELETE ON events "
    "BEGIN SELECT RAISE(ABORT, 'events are append-only'); END",
)


class Journal:
    """An open journal. Use `create` or `open`; close it, or use it as a context manager."""

    def __init__(self, path: Path, database: sqlite3.Connection, lock: int) -> None:
        self.path = path
        self._database = database
        self._lock = lock
        self._closed = False
        self._expected: deque[str] = deque()

    @classmethod
    def create(cls, path: Path, meta: Mapping[str, Any]) -> Journal:
        """A new journal, and its folder. Raises `JournalError` when there is one already."""
        if path.exists():
            raise JournalError(
                f"{path} exists already; go on with `uavmap resume {path.parent}`, "
                "or choose another --out"
            )
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise JournalError(f"{path.parent} cannot be made: {error.strerror}") from None
        lock = _lock(path)
        database = None
        try:
            database = _connect(path)
            _begin(database, meta)
        except BaseException as error:
            _release(database, lock)
            if isinstance(error, sqlite3.Error):
                raise JournalError(f"{path} cannot be written: {error}") from None
            raise
        return cls(path, database, lock)

    @classmethod
    def open(cls, path: Path) -> Journal:
        """An existing journal. Raises `JournalError` for anything that is not a whole one."""
        if not path.is_file():
            raise JournalError(f"{path}: there is no journal here")
        lock = _lock(path)
        database = None
        try:
            _check_header(path)
            # read-only: to close another connection would write the log into a damaged file
            database = _connect(path, query="?mode=ro")
            _check_content(path, database)
            database.close()
            database = _connect(path)
            database.execute("PRAGMA synchronous = FULL")
        except BaseException as error:
            _release(database, lock)
            if isinstance(error, sqlite3.Error):
                raise JournalError(f"{path} is damaged and left as it is: {error}") from None
            raise
        return cls(path, database, lock)

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; everything in it was safe before."""
        if not self._closed:
            self._closed = True
            _release(self._database, self._lock)

    def discard(self) -> None:
        """Close and remove a journal in which nothing has happened. Raises `JournalError`."""
        if self.bodies():
            raise JournalError(f"{self.path} holds events and is not removed")
        self.close()
        for suffix in ("", "-wal", "-shm"):
            self.path.with_name(self.path.name + suffix).unlink(missing_ok=True)

    # --- what is in it ---------------------------------------------------------------------
    @property
    def meta(self) -> dict[str, Any]:
        """What the mission was started with."""
        rows = self._database.execute("SELECT key, value FROM meta ORDER BY key")
        return {key: json.loads(value) for key, value in rows}

    def put_meta(self, key: str, value: Any) -> None:
        """Change what is said of the mission as a whole."""
        with self._database:
            self._database.execute("BEGIN")
            self._database.execute(
                "INSERT OR REPLACE INTO meta VALUES (?, ?)",
                (key, json.dumps(value)),
            )

    def bodies(self) -> list[str]:
        """The texts of the events, in order."""
        return [body for (body,) in self._database.execute("SELECT body FROM events ORDER BY seq")]

    def events(self) -> Iterator[Event]:
        """The events in order. Raises `JournalError` for a row that is not one."""
        for number, body in enumerate(self.bodies(), start=1):
            try:
                yield from_json(body)
            except ValueError:
                raise JournalError(
                    f"{self.path}: event {number} cannot be read: {body[:80]}"
                ) from None

    # --- writing ---------------------------------------------------------------------------
    def append(self, event: Event) -> None:
        """Commit an event; when this returns, it is on the disk."""
        body = to_json(event)
        if self._expected:
            self._verify(body)
            return
        vehicle = getattr(event, "vehicle", None)
        try:
            with self._database:
                self._database.execute("BEGIN")
                self._database.execute(
                    "INSERT INTO events (t_s, vehicle, kind, body) VALUES (?, ?, ?, ?)",
                    (event.t_s, vehicle, event.kind, body),
                )
        except sqlite3.Error as error:  # a full disk, mostly
            raise JournalError(f"{self.path} cannot be written: {error}") from None

    def start_verification(self) -> int:
        """Let the events that are in the file be appended again, and check each.

        This is how a simulated flight is taken up: its world died with the process and is made
        again from the seed, so every event must come out as it was recorded. Returns how many
        events are expected; from then on `append` writes.
        """
        self._expected = deque(self.bodies())
        return len(self._expected)

    @property
    def expected(self) -> int:
        """How many recorded events are still to come again."""
        return len(self._expected)

    def _verify(self, body: str) -> None:
        recorded = self._expected.popleft()
        if body != recorded:
            raise JournalError(
                f"{self.path}: the simulated flight does not repeat itself (recorded: {recorded}; "
                f"now: {body}); was it flown with another version? "
                f"`uavmap resume {self.path.parent} --from-home` goes on without repeating it"
            )


def _connect(path: Path, query: str = "") -> sqlite3.Connection:
    try:
        uri = path.absolute().as_uri() + query
        return sqlite3.connect(uri, uri=True, isolation_level=None)
    except sqlite3.Error as error:
        raise JournalError(f"{path} cannot be opened: {error}") from None


def _lock(path: Path) -> int:
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


def _release(database: sqlite3.Connection | None, lock: int) -> None:
    if database is not None:
        database.close()
    os.close(lock)


def _begin(database: sqlite3.Connection, meta: Mapping[str, Any]) -> None:
    """All or nothing: a journal that exists has its tables and its mission."""
    database.execute("PRAGMA synchronous = FULL")
    with database:
        database.execute("BEGIN")
        database.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        database.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")
        for table in _SCHEMA:
            database.execute(table)
        database.executemany(
            "INSERT INTO meta VALUES (?, ?)",
            [(key, json.dumps(value)) for key, value in meta.items()],
        )
    # only now: in WAL mode the header would stay out of the file until the first checkpoint,
    # and a journal is known by its header
    database.execute("PRAGMA journal_mode = WAL")


def _check_header(path: Path) -> None:
    """Look before SQLite does: opening a foreign file could already change it."""
    try:
        with path.open("rb") as file:
            header = file.read(100)
    except OSError as error:
        raise JournalError(f"{path} cannot be read: {error}") from None
    if len(header) < 100 or not header.startswith(b"SQLite format 3\x00"):
        raise JournalError(f"{path} is not a journal of uavmap (no SQLite header); left as it is")
    if int.from_bytes(header[68:72], "big") != APPLICATION_ID:
        raise JournalError(f"{path} is an SQLite file, but no journal of uavmap; left as it is")
    pages, page_size = int.from_bytes(header[28:32], "big"), int.from_bytes(header[16:18], "big")
    size = path.stat().st_size
    whole = pages * (65536 if page_size == 1 else page_size)
    if size < whole and not path.with_name(path.name + "-wal").exists():
        raise JournalError(f"{path} is truncated ({size} of {whole} bytes); left as it is")


def _check_content(path: Path, database: sqlite3.Connection) -> None:
    (version,) = database.execute("PRAGMA user_version").fetchone()
    if version != SCHEMA_VERSION:
        raise JournalError(
            f"{path} has journal version {version}, this program knows {SCHEMA_VERSION}; "
            "use the version of uavmap that wrote it"
        )
    (verdict,) = database.execute("PRAGMA integrity_check(1)").fetchone()
    if verdict != "ok":
        verdict = " ".join(verdict.split())  # SQLite's report has several lines
        raise JournalError(f"{path} is damaged and left as it is: {verdict}")
    tables = {name for (name,) in database.execute("SELECT name FROM sqlite_master")}
    if not {"meta", "events"} <= tables:
        raise JournalError(f"{path} lacks its tables; it was never begun; left as it is")
