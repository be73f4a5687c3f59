"""Confirmed events stay in the journal after kills and on full disks.

A file that is no journal is left unchanged.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import stat
import subprocess
import sys
import textwrap
import zlib
from collections import deque
from pathlib import Path

import pytest

from missions.errors import EventError, JournalError
from missions.events import Airborne, Landed, Recalled
from tests.support.journals import META, contents, read, refused, some_events, write
from uavmap.journal import event_log
from uavmap.journal.event_log import Journal, JournalReader, planner

ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(__file__).resolve().parents[4])}


def program(text: str, *arguments: object) -> list[str]:
    return [sys.executable, "-c", textwrap.dedent(text), *map(str, arguments)]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Write a journal of 80 events and close it."""
    return write(tmp_path_factory.mktemp("journal") / "journal.jsonl", some_events(40))


@pytest.fixture
def path(tmp_path, written):
    """Return a copy of the journal."""
    return Path(shutil.copy(written, tmp_path / "journal.jsonl"))


def test_appended_events_are_read_in_order(path):
    with Journal.open(path) as journal:
        assert list(journal.events()) == some_events(40)
        assert journal.meta == META
        journal.append(Recalled(99.0))
        journal.put_meta("truth", {"crashes": 0})
        assert journal.meta["truth"] == {"crashes": 0}
    with Journal.open(path) as journal:
        assert list(journal.events()) == [*some_events(40), Recalled(99.0)]
        assert journal.meta == {**META, "truth": {"crashes": 0}}


def test_lines_are_json_with_number_event_and_checksum(path):
    lines = path.read_text("utf-8").splitlines()
    opening, *rest = map(json.loads, lines)
    assert opening["journal"] == {
        "format": 1, "version": event_log.__version__, "planner": planner(), "meta": META,
    }  # fmt: skip
    assert [line["seq"] for line in rest] == list(range(2, 82))
    assert rest[0]["event"]["kind"] == "tracked"
    heads = "".join(line[: line.rindex(',"crc"')] for line in lines)
    assert rest[-1]["crc"] == f"{zlib.crc32(heads.encode()):08x}"


def test_flight_plan_does_not_change(path):
    with Journal.open(path) as journal, pytest.raises(ValueError, match="does not change"):
        journal.put_meta("plan", {"seed": 8})


def test_line_is_synced_before_append_returns(tmp_path, monkeypatch):
    path, synced = tmp_path / "out" / "journal.jsonl", list[tuple[bool, int]]()

    def seen(file: int) -> None:
        what = os.fstat(file)
        synced.append((stat.S_ISDIR(what.st_mode), what.st_size))

    monkeypatch.setattr(os, "fsync", seen)
    with Journal.create(path, META) as journal:
        assert [folder for folder, _ in synced] == [False, True, True]
        for event in some_events(2):
            journal.append(event)
            assert synced[-1] == (False, path.stat().st_size)


@pytest.mark.parametrize("what", ["journal", "text", "empty"])
def test_existing_file_is_never_overwritten(path, what):
    if what != "journal":
        path.write_text("notes" * (what == "text"))
    before = contents(path.parent)
    with pytest.raises(JournalError, match="exists already"):
        Journal.create(path, META)
    assert contents(path.parent) == before


def test_place_without_a_journal_is_refused(tmp_path):
    for place in (tmp_path / "journal.jsonl", tmp_path, tmp_path / "no" / "journal.jsonl"):
        with pytest.raises(JournalError, match="no journal here"):
            Journal.open(place)
    assert list(tmp_path.iterdir()) == []


def test_journal_of_another_format_is_refused(path, monkeypatch):
    monkeypatch.setattr(event_log, "FORMAT", 2)
    assert "has journal format 1, this program knows 2" in refused(path)


def test_second_writer_is_refused_and_reader_is_not(path):
    with Journal.open(path) as journal:
        with pytest.raises(JournalError, match="in use"):
            Journal.open(path)
        reader = JournalReader(path)
        assert len(reader.new_events()) == 80
        journal.append(Recalled(99.0))
        assert reader.new_events() == [Recalled(99.0)]
        assert reader.new_events() == []
        assert os.listdir(path.parent) == [path.name]


def test_whole_journal_that_cannot_be_written_is_reported(path, monkeypatch):
    opened = os.open

    def read_only(name: object, flags: int, *more: int) -> int:
        if flags & os.O_RDWR:
            raise PermissionError(13, "Permission denied")
        return opened(name, flags, *more)

    monkeypatch.setattr(os, "open", read_only)
    assert "is whole, but cannot be opened for writing: Permission denied" in refused(path)


def test_journal_with_events_is_not_discarded(path):
    with Journal.open(path) as journal, pytest.raises(JournalError, match="holds events"):
        journal.discard()
    empty = path.with_name("empty.jsonl")
    Journal.create(empty, META).discard()
    assert not empty.exists()


def test_events_that_come_again_are_checked_not_written(path):
    events = some_events(40)
    with Journal.open(path) as journal:
        journal.start_verification()
        assert journal.expected == 80
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


def test_event_that_json_cannot_hold_is_refused_and_the_journal_continues(tmp_path):
    path = tmp_path / "journal.jsonl"
    with Journal.create(path, META) as journal:
        journal.append(Airborne(1, 1.0))
        for wild in (float("nan"), float("inf"), float("-inf")):
            with pytest.raises(EventError, match="landed: remaining_wh = "):
                journal.append(Landed(1, 2.0, wild))
        with pytest.raises(EventError, match="landed"):
            journal.append_all([Airborne(1, 2.5), Landed(1, 2.5, float("nan"))])
        journal.append(Airborne(1, 3.0))
    assert read(path)[0] == [Airborne(1, 1.0), Airborne(1, 3.0)]


# --- kills -----------------------------------------------------------------------------------
PROGRAM = """
    import sys
    from pathlib import Path
    from missions.events import Airborne
    from uavmap.journal.event_log import Journal
    from tests.support.journals import META
    path = Path(sys.argv[1])
    journal = Journal.open(path) if path.exists() else Journal.create(path, META)
    for number in range(len(journal), 100000):
        journal.append(Airborne(1, float(number)))
        print(number, flush=True)
"""


def test_killed_process_loses_nothing_that_it_acknowledged(tmp_path):
    path = tmp_path / "journal.jsonl"
    acknowledged = -1
    for after in (1, 40, 7, 150):
        process = subprocess.Popen(
            program(PROGRAM, path), stdout=subprocess.PIPE, text=True, env=ENVIRONMENT
        )
        assert process.stdout is not None
        with process.stdout:
            lines = [int(process.stdout.readline()) for _ in range(after)]
            process.send_signal(signal.SIGKILL)
            lines += [int(line) for line in process.stdout.read().split("\n")[:-1]]
        assert process.wait() == -signal.SIGKILL
        assert lines[0] > acknowledged
        acknowledged = lines[-1]
        found = [event.t_s for event in JournalReader(path).events()]
        assert found == [float(n) for n in range(len(found))]
        assert acknowledged < len(found) <= acknowledged + 2


# A child process ends, as by a kill, before the n-th line of the code that makes a journal. n grows
# until a child completes.
KILLED_AT_EACH_LINE = """
    import os, sys
    from pathlib import Path
    from tests.support.journals import META
    from uavmap.journal.event_log import Journal

    def ended_before(line, path):
        seen = 0
        def trace(frame, event, argument):
            nonlocal seen
            file = frame.f_code.co_filename
            if "uavmap/journal" not in file and "atomic_write" not in file:
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
        path = Path(sys.argv[1]) / str(line) / "journal.jsonl"
        if (child := os.fork()) == 0:
            ended_before(line, path)
        _, status = os.waitpid(child, 0)
        print(line, os.waitstatus_to_exitcode(status))
        if status == 0:
            break
"""


def test_journal_killed_at_each_line_of_its_creation_is_whole_or_none(tmp_path):
    command = program(KILLED_AT_EACH_LINE, tmp_path)
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[-1].endswith(" 0")
    assert all(line.endswith(" 9") for line in lines[:-1])
    whole = 0
    for number in range(1, len(lines)):
        path = tmp_path / str(number) / "journal.jsonl"
        if path.exists():
            whole += 1
            assert read(path) == ([], META)
        else:
            with pytest.raises(JournalError, match="no journal here"):
                Journal.open(path)
            write(path, some_events(1))
            assert read(path) == (some_events(1), META)
        assert [p.name for p in path.parent.iterdir()] == ["journal.jsonl"]
    assert 20 < whole < len(lines) - 20, (whole, len(lines))


def test_folder_in_which_another_process_writes_is_left_alone(tmp_path):
    path = tmp_path / "journal.jsonl"
    unfinished = tmp_path / ".journal.jsonl.abc"
    with Journal.create(tmp_path / "other.jsonl", META):
        unfinished.write_bytes(b"half")
        with pytest.raises(JournalError, match="in use"):
            Journal.create(path, META)
        assert unfinished.exists()


# --- a full disk -----------------------------------------------------------------------------
def test_full_disk_begins_no_journal(tmp_path, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    path = tmp_path / "journal.jsonl"
    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(JournalError, match="No space left on device"):
            Journal.create(path, META)
    assert not list(tmp_path.iterdir())
    write(path, some_events(1))


@pytest.mark.parametrize("cuttable", [True, False])
def test_full_disk_keeps_confirmed_events_and_continues_with_room(tmp_path, monkeypatch, cuttable):
    events, path = some_events(50), tmp_path / "journal.jsonl"
    pwrite = os.pwrite

    def limited(file: int, data: bytes, offset: int) -> int:
        if offset >= 9000:
            raise OSError(28, "No space left on device")
        return pwrite(file, data[: 9000 - offset], offset)

    def uncut(*_: object) -> None:
        raise OSError(5, "Input/output error")

    with Journal.create(path, META) as journal:
        with monkeypatch.context() as patch:
            patch.setattr(os, "pwrite", limited)
            if not cuttable:
                patch.setattr(os, "ftruncate", uncut)
            with pytest.raises(JournalError, match="cannot be written: No space left on device"):
                deque(map(journal.append, events))
            confirmed = len(journal)
            assert 20 < confirmed < 100
            with pytest.raises(JournalError, match="cannot be written"):
                journal.append_all(events[confirmed:])
            assert (path.stat().st_size == 9000) is not cuttable
        left = shutil.copytree(tmp_path, tmp_path / "killed") / path.name
        assert read(left)[0] == events[:confirmed]
        journal.append(Recalled(1.0))
    assert read(path)[0] == [*events[:confirmed], Recalled(1.0)]
