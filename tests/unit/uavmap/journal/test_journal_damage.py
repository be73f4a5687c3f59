"""Truncated, flipped and edited journals.

No damage gives another event, reading changes no journal, and a recovery continues from the
undamaged beginning.
"""

from __future__ import annotations

import os
import shutil
from collections import Counter
from itertools import accumulate
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from missions.errors import JournalError
from missions.events import Airborne, Event, FrameSeen, Vote
from missions.units import Cell
from tests.support.journals import META, contents, read, refused, some_events, write
from uavmap.journal import event_log
from uavmap.journal.event_log import Journal, JournalReader
from uavmap.journal.recovery import recover
from uavmap.ui.cli import main

EVENTS = some_events(35)
LONG = FrameSeen(1, 70.0, Cell(0, 0), tuple(Vote(Cell(n, 7), True, 0.5) for n in range(400)))


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Write a journal and close it."""
    return write(tmp_path_factory.mktemp("whole") / "journal.jsonl", [*EVENTS, LONG])


def copied(path: Path, folder: Path) -> Path:
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(path.parent, folder)
    return folder / path.name


def lines_of(path: Path) -> list[bytes]:
    return path.read_bytes().splitlines(keepends=True)


def judge(path: Path, events: list[Event]) -> str:
    """Check the outcome of a damaged journal; fail if it hides the damage."""
    before = contents(path.parent)
    try:
        with Journal.open(path) as journal:
            found, meta, torn = list(journal.events()), journal.meta, journal.torn
    except JournalError as error:
        said = str(error)
    else:
        assert contents(path.parent) == before
        assert meta == META
        assert found == events[: len(found)]
        assert torn or found == events
        return "healed" if torn else "without effect"
    assert said.isprintable()
    assert contents(path.parent) == before
    if "--recover" not in said:
        assert "no flight plan can be read" in said or "is not a journal" in said
        with pytest.raises(JournalError, match=r"no flight plan can be read|is not a journal"):
            recover(path)
        assert contents(path.parent) == before
        return "no plan"
    done = recover(path)
    assert done is not None
    assert f"{done.kept} event" in said
    assert contents(path.parent)[done.aside.name] == before[path.name]
    kept, meta = read(path)
    assert meta == META
    assert kept == events[: done.kept]
    assert recover(path) is None
    assert read(path)[0] == kept
    return "recovered"


def test_truncation_at_each_byte_heals_to_the_last_whole_line(tmp_path):
    events, path = some_events(2), tmp_path / "journal.jsonl"
    with Journal.create(path, {}) as journal:
        journal.append_all(events)
    data, ends = path.read_bytes(), list(accumulate(map(len, lines_of(path))))
    for size in range(len(data)):
        path.write_bytes(data[:size])
        if size < ends[0]:
            assert "no flight plan can be read" in (line := refused(path)) or "is not a" in line
        else:
            kept = events[: sum(end <= size for end in ends[1:])]
            assert list(JournalReader(path).events()) == kept
            with Journal.open(path) as journal:
                assert journal.torn == (size not in ends)
                journal.append(Airborne(1, 99.0))
            assert read(path)[0] == [*kept, Airborne(1, 99.0)]


@pytest.mark.parametrize("tail", [b"\0" * 700, b"half a line", b"a whole line\n", b"\xff\n"])
def test_torn_end_of_a_power_cut_is_cut_off(whole, tmp_path, tail):
    path = copied(whole, tmp_path / "torn")
    good = path.read_bytes()
    path.write_bytes(good + tail)
    with Journal.open(path) as journal:
        assert journal.torn
        assert path.read_bytes() == good + tail
        journal.put_meta("truth", {})
        assert not journal.torn
    assert path.read_bytes().startswith(good + b'{"seq":73,"meta":{"truth":{}}')
    with Journal.open(path) as journal:
        assert not journal.torn  # nothing of the tail is behind the new line
    assert recover(path) is None


def test_hundred_flipped_bits_are_noticed(whole, tmp_path):
    rng, size, seen = np.random.default_rng(3), whole.stat().st_size, Counter[str]()
    last = len(lines_of(whole)[-1])
    for bit in rng.integers(0, 8 * (size - last), 100):
        path = copied(whole, tmp_path / "flipped")
        data = bytearray(path.read_bytes())
        data[bit // 8] ^= 1 << bit % 8
        path.write_bytes(data)
        seen[judge(path, [*EVENTS, LONG])] += 1
    assert set(seen) == {"recovered", "no plan"}
    assert seen["recovered"] > 40, seen


def test_flipped_bit_of_the_last_line_costs_that_line(whole, tmp_path):
    path = copied(whole, tmp_path / "flipped")
    data = bytearray(path.read_bytes())
    for at in (-1, -5, -200):
        data[at] ^= 1
        path.write_bytes(data)
        assert judge(path, [*EVENTS, LONG]) == "healed"
        assert read(path)[0] == EVENTS


@given(number=st.integers(1, len(EVENTS)), data=st.data())
@settings(max_examples=30, deadline=None)
def test_digit_that_changes_is_noticed(whole, tmp_path_factory, number, data):
    path = copied(whole, tmp_path_factory.mktemp("digit") / "copy")
    lines = [line.decode() for line in lines_of(path)]
    line = lines[number]
    at = data.draw(st.sampled_from([i for i, letter in enumerate(line) if letter.isdigit()]))
    digit = data.draw(st.sampled_from([d for d in "0123456789" if d != line[at]]))
    lines[number] = line[:at] + digit + line[at + 1 :]
    path.write_text("".join(lines), "utf-8")
    said = refused(path)
    assert f"line {number + 1} is not as it was written" in said
    assert f"{number - 1} event" in said
    done = recover(path)
    assert done is not None
    assert (done.kept, done.lost) == (number - 1, len(EVENTS) + 1 - done.kept)
    assert read(path)[0] == EVENTS[: number - 1]


@pytest.mark.parametrize("change", ["lost", "doubled", "reordered", "of another journal"])
def test_lines_that_do_not_belong_here_are_noticed(whole, tmp_path, change):
    path = copied(whole, tmp_path / "changed")
    lines = lines_of(path)
    other = lines_of(write(tmp_path / "other" / "journal.jsonl", [Airborne(1, 0.0), *EVENTS[1:]]))
    nine = {
        "lost": [lines[10]], "doubled": [lines[9], lines[9], lines[10]],
        "reordered": [lines[10], lines[9]], "of another journal": [other[9], lines[10]],
    }[change]  # fmt: skip
    path.write_bytes(b"".join([*lines[:9], *nine, *lines[11:]]))
    assert ("line 11" if change == "doubled" else "line 10") in refused(path)
    assert judge(path, [*EVENTS, LONG]) == "recovered"


def test_unknown_event_is_lost_in_the_recovery(tmp_path, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(event_log, "to_json", lambda event: '{"kind":"from the future"}')
        path = write(tmp_path / "journal.jsonl", EVENTS[:1])
    assert "event 1 cannot be read" in refused(path)
    done = recover(path)
    assert done is not None
    assert (done.kept, done.lost) == (0, 1)


def test_plan_that_cannot_be_read_stops_the_recovery(whole, tmp_path, capsys):
    path = copied(whole, tmp_path / "changed")
    path.write_bytes(path.read_bytes().replace(b'"seed":7', b'"seed":8'))
    before = contents(path.parent)
    assert main(["resume", str(path.parent), "--recover"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "no flight plan can be read" in line
    assert contents(path.parent) == before


def test_second_damage_finds_another_name(whole, tmp_path):
    path = copied(whole, tmp_path / "twice")
    for number in (1, 2):
        lines = lines_of(path)
        path.write_bytes(b"".join([*lines[:-3], *lines[-2:]]))
        damaged = path.read_bytes()
        done = recover(path)
        assert done is not None
        assert done.aside.name == f"journal.damaged-{number}.jsonl"
        assert done.aside.read_bytes() == damaged


@pytest.mark.parametrize("steps", range(2))
def test_interrupted_recovery_is_begun_anew(whole, tmp_path, steps, monkeypatch):
    path = copied(whole, tmp_path / "interrupted")
    lines = lines_of(path)
    path.write_bytes(b"".join([*lines[:40], *lines[41:]]))
    damaged, take_name, done = path.read_bytes(), os.replace, list[Path]()

    def limited(source: Path, target: Path) -> None:
        if len(done) == steps:
            raise KeyboardInterrupt
        done.append(target)
        take_name(source, target)

    monkeypatch.setattr(os, "replace", limited)
    with pytest.raises(KeyboardInterrupt):
        recover(path)
    monkeypatch.undo()
    assert path.read_bytes() == damaged
    found = recover(path)
    assert found is not None
    assert found.aside.read_bytes() == damaged
    assert read(path)[0] == EVENTS[:39]
    assert not list(path.parent.glob(".*"))


@given(st.binary(max_size=9000))
@example(b"")
@example(b"SQLite format 3\0" + bytes(99))
@settings(max_examples=100, deadline=None)
def test_arbitrary_bytes_are_no_journal(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("any") / "journal.jsonl"
    path.write_bytes(data)
    assert "not a journal" in refused(path)


@given(st.lists(st.tuples(st.integers(0, 2**17 - 1), st.integers(0, 255)), max_size=30))
@settings(max_examples=60, deadline=None)
def test_scattered_bytes_never_become_other_events(whole, tmp_path_factory, changes):
    path = copied(whole, tmp_path_factory.mktemp("scattered") / "copy")
    data = bytearray(path.read_bytes())
    for at, value in changes:
        data[at % len(data)] = value
    path.write_bytes(data)
    judge(path, [*EVENTS, LONG])
