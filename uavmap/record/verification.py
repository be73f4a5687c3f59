"""Whether a journal is whole: everything is read and checked before anything may be written.

The file is looked at without changing a byte in its folder. Without a write-ahead log SQLite reads
it as immutable; with one, as a killed process leaves it, SQLite could not help writing the log's
index, so both are copied into a temporary directory and looked at there.
"""

from __future__ import annotations

import errno
import json
import shutil
import sqlite3
import struct
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from missions.errors import JournalError
from uavmap.record import chain
from uavmap.record.flight_plan import FlightPlan
from uavmap.record.journal_file import (
    APPLICATION_ID,
    LOGS,
    SCHEMA_VERSION,
    SCHEMAS,
    SQLITE_MAGIC,
    beside,
    connect,
)
from uavmap.record.salvage import agrees, confirmed_in_log, event_row, salvage

_HEADER_BYTES: Final = 100
_LONGEST_SAID: Final = 200
_LOG_INDEX: Final = struct.Struct("=IIIBBHIIII8s8s")
_LOG_INDEX_VERSION: Final = 3007000


@dataclass(frozen=True, slots=True)
class Verified:
    """What is known of a journal that is whole."""

    version: int
    count: int
    """Of its events."""
    chain: bytes
    """The checksum of the last, or where the chain begins."""


class _DamageError(Exception):
    """What is wrong with a journal, in words."""


def verify(path: Path) -> Verified:
    """Read a journal from end to end. The caller holds the lock.

    Raises `JournalError`, in a line that names the file, what is wrong, how many events are good,
    and the remedy; nothing in the folder has changed then. Raises `MissionFileError` when this
    program does not fly the journal's mission.
    """
    try:
        _check_header(path)
        with _opened(path) as database:
            found = _check_content(path, database)
            frames = _frames_in_log(database)
        _check_log(path, found, frames)
    except _DamageError as damage:
        raise JournalError(_told(path, str(damage))) from None
    except (sqlite3.Error, UnicodeError, OverflowError) as error:
        # SQLite quotes what is damaged, and what it quotes may be no text
        raise JournalError(_told(path, f"is damaged: {_readable(str(error))}")) from None
    except OSError as error:
        raise JournalError(f"{path} cannot be read: {error.strerror or error}") from None
    return found


def _readable(text: str) -> str:
    """Words of SQLite in one line, without what a terminal would obey."""
    words = " ".join(text.split())[:_LONGEST_SAID]
    return "".join(letter if letter.isprintable() else "?" for letter in words)


def _told(path: Path, damage: str) -> str:
    """The damage, and what can be done about it."""
    good = salvage(*read_both(path))
    if good is None:
        return f"{path} {damage}; left as it is: no flight plan can be read in it"
    events = "1 event is" if len(good.events) == 1 else f"{len(good.events)} events are"
    return (
        f"{path} {damage}; left as it is: {events} good, and "
        f"`uavmap resume {path.parent} --recover` goes on from there in a copy"
    )


def read_both(path: Path) -> tuple[bytes, bytes]:
    """The bytes of a journal and of its log. Raises `JournalError`."""
    try:
        log = beside(path, "-wal")
        return path.read_bytes(), log.read_bytes() if log.exists() else b""
    except OSError as error:
        raise JournalError(f"{path} cannot be read: {error.strerror or error}") from None


# --- the file --------------------------------------------------------------------------------
def _check_header(path: Path) -> None:
    """Look before SQLite does: what is foreign is not even opened."""
    with path.open("rb") as file:
        header = file.read(_HEADER_BYTES)
    if len(header) < _HEADER_BYTES or not header.startswith(SQLITE_MAGIC):
        raise _DamageError("is not a journal of uavmap (no SQLite header)")
    if int.from_bytes(header[68:72], "big") != APPLICATION_ID:
        raise _DamageError("is an SQLite file, but no journal of uavmap")
    version = int.from_bytes(header[60:64], "big")
    if version not in SCHEMAS and not _has_log(path):
        raise _unknown_version(version)
    # write and read version: 1 without a log, 2 with; then three fractions that never differ
    if header[18:20] not in (b"\1\1", b"\2\2") or header[21:24] != bytes([64, 32, 32]):
        raise _DamageError("is damaged in its header")
    pages, page_size = int.from_bytes(header[28:32], "big"), int.from_bytes(header[16:18], "big")
    size = path.stat().st_size
    whole = pages * (65536 if page_size == 1 else page_size)
    if size < whole and not _has_log(path):
        raise _DamageError(f"is truncated ({size} of {whole} bytes)")


def _unknown_version(version: int) -> _DamageError:
    return _DamageError(
        f"has journal version {version}, this program knows 1 to {SCHEMA_VERSION}: "
        "use the version of uavmap that wrote it"
    )


def _has_log(path: Path) -> bool:
    logs = [beside(path, side) for side in LOGS]
    return any(log.exists() and log.stat().st_size > 0 for log in logs)


@contextmanager
def _opened(path: Path) -> Iterator[sqlite3.Connection]:
    """A connection that changes nothing in the folder."""
    if not _has_log(path):
        with closing(connect(path, query="?mode=ro&immutable=1")) as database:
            yield database
        return
    with _copied(path) as copy, closing(connect(copy)) as database:
        yield database


@contextmanager
def _copied(path: Path) -> Iterator[Path]:
    """A copy of a journal and its log in a temporary directory, and no more after the block."""
    try:
        folder = tempfile.TemporaryDirectory(prefix="uavmap-")
    except OSError as error:
        raise JournalError(
            f"{path} cannot be checked: there is no temporary directory ({error.strerror}); "
            "set TMPDIR to a folder with room for a copy of it"
        ) from None
    with folder as name:
        copy = Path(name) / path.name
        try:
            shutil.copyfile(path, copy)
            for side in LOGS:
                if beside(path, side).exists():
                    shutil.copyfile(beside(path, side), beside(copy, side))
        except OSError as error:
            if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
                raise
            raise JournalError(
                f"{path} cannot be checked: the temporary directory {Path(name).parent} is full; "
                "make room there, or set TMPDIR to a folder that has it"
            ) from None
        yield copy


# --- the content -----------------------------------------------------------------------------
def _check_content(path: Path, database: sqlite3.Connection) -> Verified:
    (version,) = database.execute("PRAGMA user_version").fetchone()
    if version not in SCHEMAS:
        raise _unknown_version(version)
    (verdict,) = database.execute("PRAGMA integrity_check(1)").fetchone()
    if verdict != "ok":
        raise _DamageError(f"is damaged: {_readable(verdict)}")
    written = {
        sql for (sql,) in database.execute("SELECT sql FROM sqlite_master WHERE sql NOTNULL")
    }
    if written != set(SCHEMAS[version]):
        lacking = "lacks its tables" if not written else "has other tables than a journal has"
        raise _DamageError(f"is damaged: it {lacking}")
    meta = _meta(database, version)
    vehicles = len(FlightPlan.of_meta(meta, path).mission.vehicles)
    last, count = chain.seed(meta["plan"]), 0
    columns = "seq, t_s, vehicle, kind, body" + (", chain" if version > 1 else "")
    for number, row in enumerate(
        database.execute(f"SELECT {columns} FROM events ORDER BY seq"), start=1
    ):
        _check_event(number, row, vehicles)
        count, last = number, chain.link(last, number, row[4])
        if version > 1 and row[5] != last:
            raise _DamageError(f"is damaged: event {number} is not as it was written")
    return Verified(version, count, last)


def _meta(database: sqlite3.Connection, version: int) -> dict[str, str]:
    meta: dict[str, str] = {}
    for key, value, *checksum in database.execute("SELECT * FROM meta"):
        if not (isinstance(key, str) and isinstance(value, str)):
            raise _DamageError("is damaged: what it says of the mission is no text")
        if version > 1 and checksum != [chain.of_meta(key, value)]:
            raise _DamageError(f"is damaged: {key!r} in it is not as it was written")
        try:
            json.loads(value)
        except (ValueError, RecursionError):
            raise _DamageError(f"is damaged: {key!r} in it cannot be read") from None
        meta[key] = value
    return meta


def _check_event(number: int, values: tuple[Any, ...], vehicles: int) -> None:
    row = event_row(list(values[1:5]))
    if values[0] != number:
        raise _DamageError(f"is damaged: event {number} is missing")
    if row is None or not agrees(row):
        raise _DamageError(f"is damaged: event {number} cannot be read")
    if row.vehicle is not None and not 1 <= row.vehicle <= vehicles:
        raise _DamageError(
            f"is damaged: event {number} is of vehicle {row.vehicle}, the mission has {vehicles}"
        )


# --- the log ---------------------------------------------------------------------------------
def _frames_in_log(database: sqlite3.Connection) -> int:
    """How many pages SQLite takes in from the log (of the copy that it looks at)."""
    (_, frames, _) = database.execute("PRAGMA wal_checkpoint(PASSIVE)").fetchone()
    return int(max(frames, 0))


def _check_log(path: Path, found: Verified, frames: int) -> None:
    """Whether the log has lost what was confirmed: SQLite reads it up to its first fault, and
    takes the rest for what a crash has left unfinished."""
    log = read_both(path)[1]
    lost = confirmed_in_log(log) - found.count
    if lost > 0:
        raise _DamageError(f"is damaged: its log is, and {lost} events at its end cannot be read")
    known = _frames_by_index(path, log)
    if known > frames:
        raise _DamageError(
            f"is damaged: its log {path.name}-wal has lost {known - frames} of {known} pages"
        )


def _frames_by_index(path: Path, log: bytes) -> int:
    """How many pages the log had, by its index, which a killed process leaves behind; 0 where
    that says nothing, or all of them are in the journal itself."""
    index = beside(path, "-shm")
    data = index.read_bytes() if index.exists() else b""
    size = _LOG_INDEX.size
    if len(data) < 2 * size + 4 or data[:size] != data[size : 2 * size]:
        return 0
    version, _, _, _, _, _, frames, _, _, _, salts, _ = _LOG_INDEX.unpack(data[:size])
    (in_journal,) = struct.unpack_from("=I", data, 2 * size)
    if version != _LOG_INDEX_VERSION or in_journal >= frames:
        return 0
    if log and log[16:24] != salts:  # an index of before, as a power cut leaves it
        return 0
    return int(frames)
