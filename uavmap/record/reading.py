"""A journal that another process may be writing: read, never locked, never changed.

Nothing is verified here as `Journal.open` does: what cannot be read is told, and left as it is. A
connection is open only while it is read, so the writer is hardly ever kept from tidying up.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import Any, Final

from missions.errors import JournalError
from missions.events import Event, from_json
from uavmap.record.journal_file import (
    APPLICATION_ID,
    LOGS,
    SCHEMA_VERSION,
    SCHEMAS,
    SQLITE_MAGIC,
    beside,
    connect,
)

PIECE: Final = 2000
"""So many events are read at once."""
_BUSY_MS: Final = 2000


class JournalReader:
    """Reads the journal of a folder. Raises `JournalError` where there is none."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._count = 0
        self._check()
        self._meta = self._read_meta()

    @property
    def meta(self) -> Mapping[str, Any]:
        """What the mission was started with."""
        return self._meta

    @property
    def last_s(self) -> float:
        """Mission time of the last event, 0 without one."""
        found = self._asked("SELECT t_s FROM events ORDER BY seq DESC LIMIT 1")
        return float(found[0][0]) if found else 0.0

    def new_events(self) -> list[Event]:
        """The events after those that were read before, in order; at most `PIECE` at once.

        Raises `JournalError` for one that cannot be read, and where the journal was exchanged.
        """
        rows = self._asked(
            "SELECT seq, body FROM events WHERE seq > ? ORDER BY seq LIMIT ?", self._count, PIECE
        )
        if not rows and self._count:
            (newest,) = self._asked("SELECT max(seq) FROM events")[0]
            if (newest or 0) < self._count:
                raise JournalError(f"{self.path} was exchanged for another; watch it anew")
        events = []
        for number, body in rows:
            try:
                events.append(from_json(body))
            except ValueError:
                raise JournalError(
                    f"{self.path}: event {number} cannot be read; "
                    f"`uavmap resume {self.path.parent}` says what is wrong with the journal"
                ) from None
            self._count = number
        return events

    def _check(self) -> None:
        try:
            with self.path.open("rb") as file:
                header = file.read(100)
        except FileNotFoundError:
            raise JournalError(
                f"{self.path}: there is no journal here; no flight was begun in this folder"
            ) from None
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise JournalError(f"{self.path} cannot be read: {reason}") from None
        ours = APPLICATION_ID.to_bytes(4, "big")
        if not header.startswith(SQLITE_MAGIC) or header[68:72] != ours:
            raise JournalError(f"{self.path} is not a journal of uavmap")
        version = int.from_bytes(header[60:64], "big")
        if version not in SCHEMAS:
            raise JournalError(
                f"{self.path} has journal version {version}, this program knows 1 to "
                f"{SCHEMA_VERSION}: use the version of uavmap that wrote it"
            )

    def _read_meta(self) -> dict[str, Any]:
        try:
            return {
                key: json.loads(value) for key, value in self._asked("SELECT key, value FROM meta")
            }
        except (ValueError, RecursionError):
            raise JournalError(f"{self.path} is damaged: what it says of the mission") from None

    def _asked(self, question: str, *values: object) -> list[tuple[Any, ...]]:
        # without a log nobody writes, and SQLite need not make files beside it in order to read
        writing = any(beside(self.path, side).exists() for side in LOGS)
        try:
            query = "?mode=ro" if writing else "?mode=ro&immutable=1"
            with closing(connect(self.path, query)) as database:
                database.execute(f"PRAGMA busy_timeout = {_BUSY_MS}")
                return database.execute(question, values).fetchall()
        except sqlite3.Error as error:
            raise JournalError(f"{self.path} cannot be read: {error}") from None
