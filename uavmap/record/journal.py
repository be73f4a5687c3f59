"""The journal: every event of a mission, in SQLite, in the order in which it was acted on.

A transaction an event, WAL with synchronous FULL: what was acted on is on the disk, also after a
power cut. The mission file's text and the seed lie beside the events, so that a folder is enough
to go on from. A journal is there whole or not at all (`uavmap.record.journal_file`), each event
carries a checksum over all before it (`uavmap.record.chain`), and nothing is written before all of
it has been verified (`uavmap.record.verification`); what fails there is left as it is, and
`uavmap.record.recovery` goes on from its good beginning.

Journals of version 1 have no checksums. They are read and gone on with, and stay what they are:
what is appended has no checksum either. Only a recovery makes one of version 2 out of them.
"""

from __future__ import annotations

import json
import os
import sqlite3
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final, Self

from missions.errors import JournalError
from missions.events import Event, from_json, to_json
from uavmap.record import chain
from uavmap.record.journal_file import (
    APPLICATION_ID,
    SCHEMA_VERSION,
    SIDES,
    EventRow,
    beside,
    build,
    connect,
    lock,
    put_event,
    put_meta,
    to_disk,
)
from uavmap.record.recovery import interrupted_recovery
from uavmap.record.verification import Verified, verify

__all__ = ["APPLICATION_ID", "SCHEMA_VERSION", "Journal"]

PLAN: Final = "plan"
LOG_PAGES: Final = 100
"""Beyond so many the log is taken into the journal: so much a lost log can cost."""


class Journal:
    """An open journal. Use `create` or `open`; close it, or use it as a context manager."""

    def __init__(
        self, path: Path, database: sqlite3.Connection, held: int, found: Verified
    ) -> None:
        self.path = path
        self.version = found.version
        self._database = database
        self._lock = held
        self._closed = False
        self._count = found.count
        self._chain = found.chain
        self._expected: deque[str] = deque()

    @classmethod
    def create(cls, path: Path, meta: Mapping[str, Any]) -> Journal:
        """A new journal, and its folder. Raises `JournalError` when there is one already.

        A process that is killed in here leaves no journal, or a whole one.
        """
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise JournalError(f"{path.parent} cannot be made: {reason}") from None
        _refuse_occupied(path)
        held = lock(path)
        try:
            _refuse_occupied(path)  # again: nobody else can make one now
            texts = {key: json.dumps(value) for key, value in meta.items()}
            temporary = build(path, texts)
            os.rename(temporary, path)
            to_disk(path.parent)
            to_disk(path.parent.absolute().parent)
            found = Verified(SCHEMA_VERSION, 0, chain.seed(texts.get(PLAN)))
            return cls(path, _open_to_write(path), held, found)
        except BaseException as error:
            os.close(held)
            if isinstance(error, OSError):
                raise JournalError(f"{path} cannot be written: {error.strerror}") from None
            raise

    @classmethod
    def open(cls, path: Path) -> Journal:
        """An existing journal. Raises `JournalError` for anything that is not a whole one, and
        leaves that as it is."""
        _refuse_missing(path)
        held = lock(path)
        try:
            found = verify(path)
            return cls(path, _open_to_write(path), held, found)
        except BaseException:
            os.close(held)
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; everything in it was safe before."""
        if not self._closed:
            self._closed = True
            self._database.close()
            os.close(self._lock)

    def discard(self) -> None:
        """Close and remove a journal in which nothing has happened. Raises `JournalError`."""
        if self._count:
            raise JournalError(f"{self.path} holds events and is not removed")
        self.close()
        for side in SIDES:
            beside(self.path, side).unlink(missing_ok=True)

    # --- what is in it ---------------------------------------------------------------------
    def __len__(self) -> int:
        """How many events it holds."""
        return self._count

    @property
    def meta(self) -> dict[str, Any]:
        """What the mission was started with."""
        rows = self._database.execute("SELECT key, value FROM meta ORDER BY key")
        return {key: json.loads(value) for key, value in rows}

    def put_meta(self, key: str, value: Any) -> None:
        """Change what is said of the mission as a whole. Raises `JournalError`.

        All but the flight plan: the checksums of the events begin with it.
        """
        if key == PLAN:
            raise ValueError("the flight plan of a journal does not change")
        try:
            with self._database:
                self._database.execute("BEGIN")
                put_meta(self._database, self.version, key, json.dumps(value))
        except sqlite3.Error as error:
            raise JournalError(f"{self.path} cannot be written: {error}") from None

    def bodies(self) -> list[str]:
        """The texts of the events, in order."""
        return [body for (body,) in self._database.execute("SELECT body FROM events ORDER BY seq")]

    def events(self) -> Iterator[Event]:
        """The events in order."""
        for body in self.bodies():
            yield from_json(body)

    # --- writing ---------------------------------------------------------------------------
    def append(self, event: Event) -> None:
        """Commit an event; when this returns, it is on the disk.

        Raises `EventError` for an event that cannot be written down (the journal is as before, and
        goes on), `JournalError` when the disk refuses.
        """
        body = to_json(event)
        if self._expected:
            self._verify(body)
            return
        number = self._count + 1
        checksum = chain.link(self._chain, number, body)
        row = EventRow(event.t_s, getattr(event, "vehicle", None), event.kind, body)
        try:
            with self._database:
                self._database.execute("BEGIN")
                put_event(self._database, number, row, None if self.version == 1 else checksum)
        except sqlite3.Error as error:  # a full disk, mostly
            raise JournalError(f"{self.path} cannot be written: {error}") from None
        self._count, self._chain = number, checksum

    def append_all(self, events: Iterable[Event]) -> None:
        """Commit events all at once; when this returns, they are on the disk, or none is.

        For what did not happen just now. Raises as `append` does.
        """
        number, checksum = self._count, self._chain
        try:
            with self._database:
                self._database.execute("BEGIN")
                for event in events:
                    body, number = to_json(event), number + 1
                    checksum = chain.link(checksum, number, body)
                    row = EventRow(event.t_s, getattr(event, "vehicle", None), event.kind, body)
                    put_event(self._database, number, row, None if self.version == 1 else checksum)
        except sqlite3.Error as error:
            raise JournalError(f"{self.path} cannot be written: {error}") from None
        self._count, self._chain = number, checksum

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


def _refuse_occupied(path: Path) -> None:
    if path.exists():
        raise JournalError(
            f"{path} exists already; go on with `uavmap resume {path.parent}`, "
            "or choose another --out"
        )
    if interrupted_recovery(path) is not None:
        raise JournalError(
            f"{path.parent} holds a mission whose recovery was interrupted; "
            f"`uavmap resume {path.parent} --recover` finishes it, or choose another --out"
        )


def _refuse_missing(path: Path) -> None:
    try:
        there = path.is_file()
        begun = interrupted_recovery(path) is not None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise JournalError(f"{path} cannot be opened: {reason}") from None
    if begun:
        raise JournalError(
            f"{path.parent}: the recovery of its journal was interrupted; "
            f"`uavmap resume {path.parent} --recover` finishes it"
        )
    if not there:
        raise JournalError(f"{path}: there is no journal here; no flight was begun in this folder")


def _open_to_write(path: Path) -> sqlite3.Connection:
    try:
        database = connect(path)
    except sqlite3.Error as error:
        raise JournalError(f"{path} cannot be opened: {error}") from None
    try:
        database.execute("PRAGMA synchronous = FULL")
        # a journal of version 1 whose creation was cut short is not in this mode yet
        database.execute("PRAGMA journal_mode = WAL")
        database.execute(f"PRAGMA wal_autocheckpoint = {LOG_PAGES}")
        database.execute("SELECT count(*) FROM meta").fetchone()
    except sqlite3.Error as error:
        database.close()
        raise JournalError(
            f"{path} is whole, but cannot be opened for writing: {error} (is the disk full, or "
            "the folder read-only?)"
        ) from None
    return database
