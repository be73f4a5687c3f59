"""Truncated, flipped, edited and half-lost journals: none is taken for whole, none is changed, and
a recovery goes on from the good beginning."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import sqlite3
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.errors import JournalError
from missions.events import Airborne, Event, FrameSeen, Tracked, Vote
from missions.units import Cell, GridPoint
from tests.unit.uavmap.journals import META, contents, read, some_events, write, write_version_1
from uavmap.cli import main
from uavmap.record import chain
from uavmap.record.journal import Journal
from uavmap.record.recovery import recover
from uavmap.record.salvage import confirmed_in_log, salvage

EVENTS = some_events(35)
LONG = FrameSeen(1, 70.0, Cell(0, 0), tuple(Vote(Cell(n, 7), True, 0.5) for n in range(400)))
"""Too long for a page."""


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A journal, closed."""
    return write(tmp_path_factory.mktemp("whole") / "journal.db", [*EVENTS, LONG])


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a killed process leaves: a journal with a log and its index."""
    path = tmp_path_factory.mktemp("killed") / "journal.db"
    left = path.parent / "left"
    with Journal.create(path, META) as journal:
        journal._database.execute("PRAGMA wal_autocheckpoint = 0")  # all of it at stake
        for event in EVENTS:
            journal.append(event)
        left.mkdir()
        for file in path.parent.glob("journal.db*"):
            shutil.copyfile(file, left / file.name)
    assert (left / "journal.db-wal").stat().st_size > 8000
    return left / "journal.db"


def copied(path: Path, folder: Path) -> Path:
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(path.parent, folder)
    return folder / path.name


def refused(path: Path) -> str:
    """The line with which a journal is refused; nothing in its folder has changed."""
    before = contents(path.parent)
    with pytest.raises(JournalError) as caught:
        Journal.open(path)
    assert contents(path.parent) == before
    line = str(caught.value)
    assert str(path) in line
    assert line.isprintable()
    return line


def judge(path: Path, events: list[Event]) -> str:
    """What becomes of a damaged journal; fails when it is anything but honest."""
    before = contents(path.parent)
    try:
        found = read(path)
    except JournalError as error:
        said = str(error)
    else:
        assert found == (events, META)
        return "without effect"
    assert said.isprintable()
    assert contents(path.parent) == before
    if "--recover" not in said:
        assert "no flight plan can be read" in said
        with pytest.raises(JournalError, match="no flight plan can be read"):
            recover(path)
        assert contents(path.parent) == before
        return "no plan"
    done = recover(path)
    assert done is not None
    assert f"{done.kept} event" in said
    after = contents(path.parent)
    for side in ("", "-wal", "-shm"):
        assert after.get(done.aside.name + side) == before.get(path.name + side)
    kept, meta = read(path)
    assert meta == META
    assert kept == events[: done.kept]
    assert recover(path) is None
    assert read(path)[0] == kept
    return "recovered" if kept else "recovered without events"


def cut(path: Path, size: int) -> None:
    path.write_bytes(path.read_bytes()[:size])


def flip(path: Path, bit: int) -> None:
    data = bytearray(path.read_bytes())
    data[bit // 8] ^= 1 << bit % 8
    path.write_bytes(data)


def test_sixty_truncations_of_the_journal(whole: Path, tmp_path: Path) -> None:
    rng, size, seen = np.random.default_rng(1), whole.stat().st_size, Counter[str]()
    for at in rng.integers(0, size, 60):
        path = copied(whole, tmp_path / "cut")
        cut(path, int(at))
        seen[judge(path, [*EVENTS, LONG])] += 1
    assert "without effect" not in seen
    assert seen["recovered"] > 20


def test_forty_truncations_of_the_log(killed: Path, tmp_path: Path) -> None:
    rng, seen = np.random.default_rng(2), Counter[str]()
    size = killed.with_name("journal.db-wal").stat().st_size
    for at in rng.integers(0, size, 40):
        path = copied(killed, tmp_path / "cut")
        cut(path.with_name("journal.db-wal"), int(at))
        seen[judge(path, EVENTS)] += 1
    assert set(seen) <= {"recovered", "recovered without events"}
    assert seen["recovered"] > 30, seen


def test_a_hundred_flipped_bits_of_a_closed_journal(whole: Path, tmp_path: Path) -> None:
    rng, bits, seen = np.random.default_rng(3), 8 * whole.stat().st_size, Counter[str]()
    for bit in rng.integers(0, bits, 100):
        path = copied(whole, tmp_path / "flipped")
        flip(path, int(bit))
        seen[judge(path, [*EVENTS, LONG])] += 1
    assert seen["recovered"] > 40, seen


def test_a_hundred_flipped_bits_after_a_kill(killed: Path, tmp_path: Path) -> None:
    rng, seen = np.random.default_rng(4), Counter[str]()
    for number in range(100):
        path = copied(killed, tmp_path / "flipped")
        victim = path.with_name("journal.db" + ("", "-wal", "-wal", "-shm")[number % 4])
        flip(victim, int(rng.integers(0, 8 * victim.stat().st_size)))
        seen[judge(path, EVENTS)] += 1
    assert seen["recovered"] > 40, seen


@pytest.mark.parametrize(
    "bit", [8 * at + n for at in (18, 19, 21, 24, 47, 59, 60, 71) for n in (0, 5)]
)
def test_a_flipped_bit_of_the_header(whole: Path, tmp_path: Path, bit: int) -> None:
    path = copied(whole, tmp_path / "flipped")
    flip(path, bit)
    assert judge(path, [*EVENTS, LONG]) in ("recovered", "without effect")


def changed_in_place(path: Path, change: Callable[[sqlite3.Connection], object]) -> None:
    """Change a journal as someone with SQLite can."""
    with contextlib.closing(sqlite3.connect(path)) as database:
        database.execute("PRAGMA writable_schema = ON")
        kept = database.execute("SELECT sql FROM sqlite_master WHERE type = 'trigger'").fetchall()
        for name in ("no_update", "no_delete"):
            database.execute(f"DROP TRIGGER {name}")
        change(database)
        for (text,) in kept:
            database.execute(text)
        database.commit()


@given(number=st.integers(1, len(EVENTS)), data=st.data())
@settings(max_examples=30, deadline=None)
def test_a_digit_that_changes_is_noticed(
    whole: Path, tmp_path_factory: pytest.TempPathFactory, number: int, data: st.DataObject
) -> None:
    path = copied(whole, tmp_path_factory.mktemp("digit") / "copy")
    with contextlib.closing(sqlite3.connect(path)) as database:
        query = "SELECT body FROM events WHERE seq = ?"
        (body,) = database.execute(query, (number,)).fetchone()
    places = [i for i, letter in enumerate(body) if letter.isdigit()]
    at = data.draw(st.sampled_from(places))
    digit = data.draw(st.sampled_from([d for d in "0123456789" if d != body[at]]))
    edited = body[:at] + digit + body[at + 1 :]
    changed_in_place(
        path,
        lambda db: db.execute("UPDATE events SET body = ? WHERE seq = ?", (edited, number)),
    )
    line = refused(path)
    assert f"event {number} " in line
    assert f"{number - 1} event" in line
    done = recover(path)
    assert done is not None
    assert (done.kept, done.lost) == (number - 1, len(EVENTS) + 1 - done.kept)
    assert read(path)[0] == EVENTS[: number - 1]


@pytest.mark.parametrize(
    ("statement", "words"),
    [
        ("DELETE FROM events WHERE seq = 9", "event 9 is missing"),
        ("UPDATE events SET seq = 900 WHERE seq = 71", "event 71 is missing"),
        ("UPDATE events SET t_s = 3.0 WHERE seq = 9", "event 9 cannot be read"),
        ("UPDATE events SET body = x'ff' WHERE seq = 9", "event 9 cannot be read"),
        ("UPDATE events SET body = CAST(x'ff' AS TEXT) WHERE seq = 9", "decode"),
        ("UPDATE events SET chain = x'00' WHERE seq = 9", "event 9 is not as it was written"),
        ("UPDATE meta SET value = replace(value, '\"seed\": 7', '\"seed\": 8')", "'plan' in it"),
        ("DELETE FROM meta", "holds no flight plan"),
        ("ALTER TABLE events RENAME COLUMN kind TO sort", "other tables"),
    ],
)
def test_rows_that_were_changed(whole: Path, tmp_path: Path, statement: str, words: str) -> None:
    path = copied(whole, tmp_path / "changed")
    changed_in_place(path, lambda database: database.execute(statement))
    assert words in refused(path)


def test_a_plan_that_was_changed_with_its_checksum_breaks_the_chain(
    whole: Path, tmp_path: Path
) -> None:
    path = copied(whole, tmp_path / "changed")
    changed_in_place(
        path,
        lambda database: database.execute("UPDATE meta SET (value, checksum) = (?, ?)", forged()),
    )
    assert "event 1 is not as it was written" in refused(path)


def forged() -> tuple[str, bytes]:
    plan = json.dumps({**META["plan"], "seed": 8})
    return plan, chain.of_meta("plan", plan)


def test_a_plan_that_cannot_be_read_stops_the_recovery(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = copied(whole, tmp_path / "changed")
    changed_in_place(path, lambda database: database.execute("UPDATE meta SET value = '{}'"))
    before = contents(path.parent)
    assert main(["resume", str(path.parent), "--recover"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "no flight plan can be read" in line
    assert contents(path.parent) == before


def test_a_lost_log(killed: Path, tmp_path: Path) -> None:
    path = copied(killed, tmp_path / "lost")
    path.with_name("journal.db-wal").unlink()
    assert "its log journal.db-wal has lost" in refused(path)
    done = recover(path)
    assert done is not None
    assert read(path)[0] == EVENTS[: done.kept]


def test_a_second_damage_finds_another_name(whole: Path, tmp_path: Path) -> None:
    path = copied(whole, tmp_path / "twice")
    first = path.read_bytes()
    for number in (1, 2):
        data = path.read_bytes()
        cut(path, len(data) - 4096)
        done = recover(path)
        assert done is not None
        assert done.aside.name == f"journal.damaged-{number}.db"
        assert done.aside.read_bytes() == data[:-4096]
    assert (path.parent / "journal.damaged-1.db").read_bytes() == first[:-4096]


@pytest.mark.parametrize("steps", range(4))
def test_an_interrupted_recovery_is_finished(
    killed: Path, tmp_path: Path, steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Names change one by one; after each the process may die."""
    path = copied(killed, tmp_path / "interrupted")
    flip(path.with_name("journal.db-wal"), 8 * 60_000)
    before = contents(path.parent)
    rename, done = os.rename, []

    def limited(source: Path, target: Path) -> None:
        if len(done) == steps:
            raise KeyboardInterrupt
        done.append(target)
        rename(source, target)

    monkeypatch.setattr(os, "rename", limited)
    with pytest.raises(KeyboardInterrupt):
        recover(path)
    monkeypatch.undo()
    if steps:
        with pytest.raises(JournalError, match=r"--recover` finishes it|--recover` goes on"):
            Journal.open(path)
        with pytest.raises(JournalError, match=r"exists already|recovery was interrupted"):
            Journal.create(path, META)
    recover(path)
    kept, _ = read(path)
    assert 0 < len(kept) <= len(EVENTS)
    assert kept == EVENTS[: len(kept)]
    after = contents(path.parent)
    for side in ("", "-wal", "-shm"):
        assert after["journal.damaged-1.db" + side] == before["journal.db" + side]
    assert not [name for name in after if "recovered" in name or "unfinished" in name]


def test_an_event_that_was_not_confirmed_is_no_damage(killed: Path, tmp_path: Path) -> None:
    """A full disk takes the first page of a transaction and not the one that ends it."""
    path = copied(killed, tmp_path / "cut")
    log = path.with_name("journal.db-wal")
    data = log.read_bytes()
    (last, *_) = [
        start
        for start in range(len(data) - 4120, 0, -4120)
        if int.from_bytes(data[start + 4 : start + 8], "big") > 0
    ]
    frame = bytearray(data[last : last + 4120])
    frame[4:8] = bytes(4)
    log.write_bytes(data + frame)
    assert confirmed_in_log(log.read_bytes()) == len(EVENTS)
    assert read(path)[0] == EVENTS


# --- version 1 -------------------------------------------------------------------------------
def test_a_journal_of_version_1_is_read_and_gone_on_with(tmp_path: Path) -> None:
    path = write_version_1(tmp_path / "old" / "journal.db", EVENTS)
    assert read(path) == (EVENTS, META)
    with Journal.open(path) as journal:
        assert journal.version == 1
        journal.append(Airborne(1, 99.0))
        journal.put_meta("truth", {"crashes": 0})
    assert read(path) == ([*EVENTS, Airborne(1, 99.0)], {**META, "truth": {"crashes": 0}})


def test_a_poisoned_journal_of_version_1_goes_on_from_before(tmp_path: Path) -> None:
    """One latitude of 214 degrees was an infinity, and the infinity a null."""
    path = write_version_1(tmp_path / "old" / "journal.db", EVENTS)
    body = (
        '{"vehicle":1,"t_s":80.0,"position":[null,null],"height_m":1.0,"remaining_wh":2.0,'
        '"kind":"tracked"}'
    )
    with contextlib.closing(sqlite3.connect(path)) as database:
        for t_s, kind, text in ((80.0, "tracked", body), (81.0, "airborne", "{}")):
            database.execute(
                "INSERT INTO events (t_s, vehicle, kind, body) VALUES (?, 1, ?, ?)",
                (t_s, kind, text),
            )
        database.commit()
    assert f"event {len(EVENTS) + 1} cannot be read" in refused(path)
    done = recover(path)
    assert done is not None
    assert (done.kept, done.lost) == (len(EVENTS), 2)
    with Journal.open(path) as journal:
        assert journal.version == 2
        assert list(journal.events()) == EVENTS


def test_an_event_of_a_vehicle_that_there_is_not(tmp_path: Path) -> None:
    stranger = Tracked(7, 1.0, GridPoint(0.0, 0.0), 0.0, 1.0)
    path = write(tmp_path / "journal.db", [*EVENTS, stranger])
    line = refused(path)
    assert f"event {len(EVENTS) + 1} is of vehicle 7" in line
    done = recover(path)
    assert done is not None
    assert read(path)[0] == EVENTS


# --- anything at all -------------------------------------------------------------------------
@given(st.binary(max_size=9000), st.binary(max_size=9000))
@settings(max_examples=100, deadline=None)
def test_whatever_the_bytes_are_nothing_is_made_of_them(data: bytes, log: bytes) -> None:
    assert salvage(data, log) is None
    confirmed_in_log(log)


@given(st.lists(st.tuples(st.integers(0, 2**17 - 1), st.integers(0, 255)), max_size=30))
@settings(max_examples=60, deadline=None)
def test_scattered_bytes_never_become_other_events(
    whole: Path, changes: list[tuple[int, int]]
) -> None:
    data = bytearray(whole.read_bytes())
    for at, value in changes:
        data[at % len(data)] = value
    found = salvage(bytes(data))
    if found is not None and found.version == 2:
        bodies = [row.body for row in found.events]
        with Journal.open(whole) as journal:
            assert bodies == journal.bodies()[: len(bodies)]
