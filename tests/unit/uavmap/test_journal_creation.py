"""A journal is there whole or not at all, and a full disk takes nothing that was confirmed."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import textwrap
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO

import pytest

from missions.errors import EventError, JournalError
from missions.events import Airborne, Landed
from tests.unit.uavmap.journals import META, contents, read, some_events, write
from uavmap.record.journal import Journal
from uavmap.record.journal_file import unfinished

ROOT = Path(__file__).resolve().parents[3]


def program(text: str, *arguments: object) -> list[str]:
    """Run a program of its own to its end; returns its lines."""
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(text), *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


# A child is ended, as by a kill, before the n-th line of the code that makes a journal; n grows
# until a child comes through.
KILLED_AT_EACH_LINE = """
    import os, sys
    from pathlib import Path
    from missions.errors import JournalError
    from tests.unit.uavmap.journals import META
    from uavmap.record.journal import Journal

    def ended_before(line, path):
        seen = 0
        def trace(frame, event, argument):
            nonlocal seen
            if "uavmap/record" not in frame.f_code.co_filename:
                return None
            if event == "line":
                seen += 1
                if seen == line:
                    os._exit(9)
            return trace
        sys.settrace(trace)
        Journal.create(path, META)
        os._exit(0)

    for line in range(1, 1000):
        path = Path(sys.argv[1]) / str(line) / "journal.db"
        if (child := os.fork()) == 0:
            ended_before(line, path)
        _, status = os.waitpid(child, 0)
        print(line, os.waitstatus_to_exitcode(status))
        if status == 0:
            break
"""


def test_killed_at_each_line_of_its_creation(tmp_path: Path) -> None:
    lines = program(KILLED_AT_EACH_LINE, tmp_path)
    assert lines[-1].endswith(" 0")
    assert all(line.endswith(" 9") for line in lines[:-1])
    assert len(lines) > 50
    whole = 0
    for number in range(1, len(lines)):
        path = tmp_path / str(number) / "journal.db"
        if path.exists():
            whole += 1
            assert read(path) == ([], META)
        else:
            with pytest.raises(JournalError, match="no journal here"):
                Journal.open(path)
            write(path, some_events(1))
            assert read(path) == (some_events(1), META)
        assert [p.name for p in path.parent.iterdir()] == ["journal.db"]
    assert 5 < whole < len(lines) - 40


def test_what_a_dead_creation_left_is_removed(tmp_path: Path) -> None:
    path = tmp_path / "journal.db"
    for side in ("", "-wal", "-shm", "-journal"):
        unfinished(path).with_name(unfinished(path).name + side).write_bytes(b"half")
    write(path, [])
    assert [p.name for p in tmp_path.iterdir()] == ["journal.db"]


def test_a_folder_that_somebody_is_building_in_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "journal.db"
    with Journal.create(tmp_path / "other.db", META):
        unfinished(path).write_bytes(b"half")
        with pytest.raises(JournalError, match="in use"):
            Journal.create(path, META)
        assert unfinished(path).exists()


# --- a full disk -----------------------------------------------------------------------------
def test_a_full_disk_keeps_what_was_confirmed_and_goes_on_with_room(tmp_path: Path) -> None:
    events = some_events(200)
    with Journal.create(tmp_path / "journal.db", META) as journal:
        (pages,) = journal._database.execute("PRAGMA page_count").fetchone()
        journal._database.execute(f"PRAGMA max_page_count = {pages + 3}")
        with pytest.raises(JournalError, match="cannot be written: database or disk is full"):
            deque(map(journal.append, events))
        confirmed = len(journal)
        assert 20 < confirmed < 100
        with pytest.raises(JournalError, match="full"):
            journal.append(events[confirmed])
        killed = tmp_path / "killed"
        killed.mkdir()
        for file in tmp_path.glob("journal.db*"):
            shutil.copyfile(file, killed / file.name)
        assert read(killed / "journal.db")[0] == events[:confirmed]
        journal._database.execute("PRAGMA max_page_count = 100000")
        for event in events[confirmed:]:
            journal.append(event)
    assert read(tmp_path / "journal.db")[0] == events


# One process that has imported the journal, and a copy of it for each that fills the file system.
LIMITED = """
    import json, os, resource, sys
    from pathlib import Path
    from missions.errors import JournalError
    from tests.unit.uavmap.journals import META, some_events
    from uavmap.record.journal import Journal

    def fill(path, room):
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))
        try:
            journal = Journal.open(path) if path.exists() else Journal.create(path, META)
            for event in some_events(400)[len(journal):]:
                journal.append(event)
                print(len(journal), flush=True)
        except JournalError as error:
            print("refused", error, flush=True)
        os._exit(0)  # no orderly end: the file system takes nothing more

    for line in sys.stdin:
        name, room = json.loads(line)
        if (child := os.fork()) == 0:
            fill(Path(name), room)
        print("ended", os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""
Fill = Callable[[Path, int], list[str]]


@pytest.fixture(scope="module")
def fill() -> Iterator[Fill]:
    """Has a process of its own write a journal while no file may grow beyond so many bytes."""
    command = [sys.executable, "-c", textwrap.dedent(LIMITED)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    pipe = subprocess.PIPE
    with subprocess.Popen(command, env=environment, stdin=pipe, stdout=pipe, text=True) as process:
        asked, told = process.stdin, process.stdout
        assert asked is not None
        assert told is not None

        def filled(path: Path, room: int) -> list[str]:
            print(json.dumps([str(path), room]), file=asked, flush=True)
            *lines, end = _until_ended(told)
            assert end == "ended 0"
            return lines

        yield filled
        asked.close()


def _until_ended(told: IO[str]) -> Iterator[str]:
    """The lines of one that fills, and of its end."""
    for line in told:
        yield line.rstrip("\n")
        if line.startswith("ended "):
            return


@pytest.mark.parametrize("kilobytes", [1, 13, 33, 101])
def test_a_file_system_that_takes_no_more(tmp_path: Path, kilobytes: int, fill: Fill) -> None:
    """No file may grow beyond so much; the second process finds it so, the third has room."""
    path, confirmed = tmp_path / "out" / "journal.db", 0
    for _ in range(2):
        *numbers, last = fill(path, kilobytes * 1000)
        assert last.startswith("refused")
        confirmed = int(numbers[-1]) if numbers else confirmed
        if path.exists():
            copy = shutil.copytree(path.parent, tmp_path / "copy") / path.name
            assert read(copy)[0] == some_events(400)[:confirmed]
            shutil.rmtree(copy.parent)
    assert fill(path, 10**9)[-1] == "800"
    assert read(path) == (some_events(400), META)


def test_a_full_temporary_directory_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path / "journal.db", some_events(3))
    with Journal.open(path) as journal:
        journal.append(Airborne(1, 9.0))
        killed = tmp_path / "killed"
        killed.mkdir()
        for file in tmp_path.glob("journal.db*"):
            shutil.copyfile(file, killed / file.name)
    before = contents(killed)

    def full(source: Path, target: Path) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(shutil, "copyfile", full)
    with pytest.raises(JournalError, match=r"temporary directory .* is full; make room"):
        Journal.open(killed / "journal.db")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "nowhere"))
    with pytest.raises(JournalError, match="set TMPDIR"):
        Journal.open(killed / "journal.db")
    assert contents(killed) == before


# --- events that cannot be written down ------------------------------------------------------
def test_an_event_that_json_cannot_hold_is_refused_and_the_journal_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "journal.db"
    with Journal.create(path, META) as journal:
        journal.append(Airborne(1, 1.0))
        for wild in (float("nan"), float("inf"), float("-inf")):
            with pytest.raises(EventError, match="landed: remaining_wh = "):
                journal.append(Landed(1, 2.0, wild))
        journal.append(Airborne(1, 3.0))
    assert read(path)[0] == [Airborne(1, 1.0), Airborne(1, 3.0)]
