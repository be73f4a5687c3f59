"""The journal: what is committed stays, and what is no journal is left as it is."""

from __future__ import annotations

import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import textwrap
from collections.abc import Callable
from pathlib import Path

import pytest

from missions.errors import JournalError
from missions.events import Airborne, Recalled
from tests.unit.uavmap.journals import META, contents, read, some_events, write
from uavmap.record.journal import APPLICATION_ID, Journal

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A journal of 80 events, closed."""
    return write(tmp_path_factory.mktemp("journal") / "journal.db", some_events(40))


@pytest.fixture
def path(tmp_path: Path, written: Path) -> Path:
    """A copy of it."""
    return Path(shutil.copy(written, tmp_path / "journal.db"))


def assert_refused_untouched(path: Path, words: str) -> None:
    before = contents(path.parent)
    with pytest.raises(JournalError) as caught:
        Journal.open(path)
    assert words in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert contents(path.parent) == before


def test_what_was_appended_is_read_in_order(path: Path) -> None:
    with Journal.open(path) as journal:
        assert list(journal.events()) == some_events(40)
        assert journal.meta == META
        journal.append(Recalled(99.0))
        journal.put_meta("truth", {"crashes": 0})
    with Journal.open(path) as journal:
        assert list(journal.events()) == [*some_events(40), Recalled(99.0)]
        assert journal.meta == {**META, "truth": {"crashes": 0}}


def test_the_flight_plan_does_not_change(path: Path) -> None:
    with Journal.open(path) as journal, pytest.raises(ValueError, match="does not change"):
        journal.put_meta("plan", {"seed": 8})


def test_the_disk_is_asked_for_all_it_can_promise(tmp_path: Path) -> None:
    with Journal.create(tmp_path / "journal.db", META) as journal:
        (mode,) = journal._database.execute("PRAGMA journal_mode").fetchone()
        (synchronous,) = journal._database.execute("PRAGMA synchronous").fetchone()
        assert (mode, synchronous) == ("wal", 2)
    with Journal.open(tmp_path / "journal.db") as journal:
        (mode,) = journal._database.execute("PRAGMA journal_mode").fetchone()
        (synchronous,) = journal._database.execute("PRAGMA synchronous").fetchone()
        assert (mode, synchronous) == ("wal", 2)


@pytest.mark.parametrize("what", ["journal", "text", "empty"])
def test_nothing_is_ever_overwritten(path: Path, what: str) -> None:
    if what != "journal":
        path.write_text("notes" * (what == "text"))
    before = contents(path.parent)
    with pytest.raises(JournalError, match="exists already"):
        Journal.create(path, META)
    assert contents(path.parent) == before


def test_there_is_no_journal(tmp_path: Path) -> None:
    for place in (tmp_path / "journal.db", tmp_path, tmp_path / "no" / "journal.db"):
        with pytest.raises(JournalError, match="no journal here"):
            Journal.open(place)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "data", [b"", b"x", b"some notes\n" * 50, b"SQLite format 3\x00", bytes(4096)]
)
def test_a_foreign_file(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "journal.db"
    path.write_bytes(data)
    assert_refused_untouched(path, "no SQLite header")


@pytest.mark.parametrize("mode", ["DELETE", "WAL"])
def test_another_database(tmp_path: Path, mode: str) -> None:
    path = tmp_path / "journal.db"
    database = sqlite3.connect(path)
    database.execute(f"PRAGMA journal_mode = {mode}")
    database.execute("CREATE TABLE meta (key, value)")
    database.execute("CREATE TABLE events (seq, body)")
    database.commit()
    database.close()
    assert_refused_untouched(path, "no journal of uavmap")


@pytest.mark.parametrize("part", [0.1, 0.3, 0.5, 0.8, 0.999])
def test_a_truncated_journal(path: Path, part: float) -> None:
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * part)])
    assert_refused_untouched(path, "truncated")


@pytest.mark.parametrize("size", [1, 16, 60, 99])
def test_a_journal_cut_within_its_header(path: Path, size: int) -> None:
    path.write_bytes(path.read_bytes()[:size])
    assert_refused_untouched(path, "no SQLite header")


def test_another_version(path: Path) -> None:
    database = sqlite3.connect(path)
    database.execute("PRAGMA user_version = 7")
    database.close()
    assert_refused_untouched(path, "version 7")


@pytest.mark.parametrize("page", [1, 2, 3, 4])
def test_a_damaged_page(path: Path, page: int) -> None:
    data = bytearray(path.read_bytes())
    assert len(data) > page * 4096
    start = (page - 1) * 4096 + (100 if page == 1 else 0)
    data[start : start + 600] = b"\xa5" * 600
    path.write_bytes(data)
    assert_refused_untouched(path, "damaged")


def test_missing_tables(tmp_path: Path) -> None:
    path = tmp_path / "journal.db"
    database = sqlite3.connect(path)
    database.execute(f"PRAGMA application_id = {APPLICATION_ID}")
    database.execute("PRAGMA user_version = 1")
    database.close()
    assert_refused_untouched(path, "lacks its tables")
    database = sqlite3.connect(path)
    database.execute("CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT)")
    database.close()
    assert_refused_untouched(path, "other tables")


def test_events_cannot_be_unsaid(path: Path) -> None:
    database = sqlite3.connect(path)
    for statement in ("DELETE FROM events", "UPDATE events SET body = '{}' WHERE seq = 5"):
        with pytest.raises(sqlite3.IntegrityError, match="append-only"):
            database.execute(statement)
    database.close()


def unclean(path: Path, change: Callable[[sqlite3.Connection], object]) -> Path:
    """A copy of a journal as a killed process leaves it: with a log that holds `change`."""
    database = sqlite3.connect(path)
    database.execute("PRAGMA wal_autocheckpoint = 0")
    database.execute("PRAGMA journal_mode = WAL")
    change(database)
    database.commit()
    folder = path.parent / "killed"
    folder.mkdir()
    for name in ("journal.db", "journal.db-wal"):
        shutil.copy(path.with_name(name), folder / name)
    database.close()
    assert (folder / "journal.db-wal").stat().st_size > 0
    return folder / "journal.db"


def test_what_is_only_in_the_log_is_read(path: Path) -> None:
    with Journal.open(path) as journal:
        journal.append(Airborne(1, 77.0))
        killed = path.parent / "killed"
        killed.mkdir()
        for name in ("journal.db", "journal.db-wal"):
            shutil.copy(path.with_name(name), killed / name)
    assert read(killed / "journal.db")[0][80:] == [Airborne(1, 77.0)]


def test_a_refused_journal_keeps_its_log_too(path: Path) -> None:
    killed = unclean(path, lambda database: database.execute("PRAGMA user_version = 7"))
    assert_refused_untouched(killed, "version 7")


def test_a_damaged_journal_keeps_its_log_too(path: Path) -> None:
    killed = unclean(
        path, lambda database: database.execute("UPDATE meta SET value = value || ' '")
    )
    data = bytearray(killed.read_bytes())
    data[2 * 4096 : 2 * 4096 + 600] = b"\xa5" * 600
    killed.write_bytes(data)
    assert_refused_untouched(killed, "damaged")


def test_a_second_writer_is_refused(path: Path) -> None:
    with Journal.open(path) as journal:
        with pytest.raises(JournalError, match="in use"):
            Journal.open(path)
        journal.append(Recalled(99.0))
    with Journal.open(path) as journal:
        assert len(journal.bodies()) == 81


def test_events_that_come_again_are_checked_not_written(path: Path) -> None:
    events = some_events(40)
    with Journal.open(path) as journal:
        assert journal.start_verification() == 80
        for event in events[:79]:
            journal.append(event)
        assert journal.expected == 1
        with pytest.raises(JournalError, match=r"does not repeat itself.*--from-home"):
            journal.append(Recalled(1.0))
        assert len(journal.bodies()) == 80
    with Journal.open(path) as journal:
        journal.start_verification()
        for event in events:
            journal.append(event)
        journal.append(Recalled(99.0))
        assert len(journal.bodies()) == 81


PROGRAM = """
    import sys
    from pathlib import Path
    from missions.events import Airborne
    from uavmap.record.journal import Journal
    from tests.unit.uavmap.journals import META
    path = Path(sys.argv[1])
    journal = Journal.open(path) if path.exists() else Journal.create(path, META)
    first = len(journal.bodies())
    for number in range(first, 100000):
        journal.append(Airborne(1, float(number)))
        print(number, flush=True)
"""


def test_a_killed_process_loses_nothing_that_it_acknowledged(tmp_path: Path) -> None:
    path = tmp_path / "journal.db"
    acknowledged = -1
    for after in (1, 40, 7, 150):
        process = subprocess.Popen(
            [sys.executable, "-c", textwrap.dedent(PROGRAM), str(path)],
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )
        assert process.stdout is not None
        with process.stdout:
            said = [int(process.stdout.readline()) for _ in range(after)]
            process.send_signal(signal.SIGKILL)
            said += [int(line) for line in process.stdout.read().split("\n")[:-1]]
        assert process.wait() == -signal.SIGKILL
        assert said[0] > acknowledged
        acknowledged = said[-1]
        # the copy is judged, so that the next process finds what the kill left
        copy = tmp_path / f"after-{after}"
        copy.mkdir()
        for file in tmp_path.glob("journal.db*"):
            shutil.copy(file, copy / file.name)
        with Journal.open(copy / "journal.db") as journal:
            found = [event.t_s for event in journal.events()]
        assert found == [float(n) for n in range(len(found))]
        assert acknowledged < len(found) <= acknowledged + 2
