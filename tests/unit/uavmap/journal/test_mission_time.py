"""Mission time of a resumed mission: it never runs backwards, and reports every long jump."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from uavmap.journal import event_log
from uavmap.journal import mission_time as module
from uavmap.journal.event_log import Journal
from uavmap.journal.mission_time import (
    CLOCK,
    DOUBTFUL_S,
    Basis,
    Clocks,
    Mark,
    Marks,
    last_mark,
    mission_time,
    read_clocks,
    resume_time_s,
)

EPOCH_S = 1.8e9
DAY_S = 86400.0
THEN = Clocks(EPOCH_S + 500.0, "boot-1", 9000.0, 7000.0)
MARK = Mark(500.0, THEN)
LAST_EVENT_S = 512.0


def later(seconds: float, **other: object) -> Clocks:
    """Return the clocks at a time after the mark."""
    now = Clocks(
        THEN.wall_utc_s + seconds, THEN.boot_id, THEN.since_boot_s + seconds, 7000.0 + seconds
    )
    return replace(now, **other)


def wall(seconds: float, **other: object) -> Clocks:
    """Return clocks of 100 s later, with a wall clock that was set by some seconds."""
    return later(100.0, wall_utc_s=THEN.wall_utc_s + 100.0 + seconds, **other)


ANEW = {"boot_id": "boot-2", "since_boot_s": 20.0}
OTHER_BOOT = {**ANEW, "vehicle_since_boot_s": None}
THREE_S = 3 * DAY_S
DRIFT = {"drift_m_s": 0.4}
NO_MARK = {"mark": None}
FAST = {"speedup": 10.0}
EARLY = Clocks(EPOCH_S + 600.0, "boot-1", 1.0)
COMPUTER, VEHICLE, WALL, LAST = Basis
Case = tuple[Clocks, dict[str, Any], float, Basis, float | None, str]
"""Clocks and further arguments; the expected time and basis, also after a yes, and the note."""
CASES: dict[str, Case] = {
    "same boot": (later(100.0), {}, 600.0, COMPUTER, None, ""),
    "same boot, a night": (later(36e3), {}, 36_500.0, COMPUTER, None, "9 h 59 min have passed"),
    "same boot, clock ahead": (wall(THREE_S), {}, 600.0, COMPUTER, None, "set forward by"),
    "same boot, years ahead": (wall(3650 * DAY_S), {}, 600.0, COMPUTER, None, "set forward by"),
    "same boot, clock back": (wall(-THREE_S), {}, 600.0, COMPUTER, None, "set back by"),
    "same boot, 1970": (wall(-THEN.wall_utc_s), {}, 600.0, COMPUTER, None, "set back by"),
    "new boot": (later(100.0, **ANEW), {}, 600.0, VEHICLE, None, ""),
    # the vehicle may have restarted itself, and be up for longer than it was then
    "new boot, clock ahead": (
        wall(THREE_S, **ANEW), {}, 600.0, VEHICLE, 600.0 + THREE_S, "set forward by",
    ),
    "new boot, clock back": (wall(-THREE_S, **ANEW), {}, 600.0, VEHICLE, None, "set back by"),
    "new boot of both": (
        later(100.0, **ANEW, vehicle_since_boot_s=30.0), {}, 600.0, WALL, None, "",
    ),
    "silent vehicle": (later(100.0, **OTHER_BOOT), {}, 600.0, WALL, None, ""),
    "silent, a minute back": (later(-60.0, **OTHER_BOOT), {}, LAST_EVENT_S, WALL, None, ""),
    "silent, three days": (
        later(THREE_S, **OTHER_BOOT), {}, LAST_EVENT_S, LAST, 500.0 + THREE_S,
        "2 d 23 h have passed",
    ),
    "drift": (
        later(3612.0, **OTHER_BOOT), DRIFT, LAST_EVENT_S, LAST, 4112.0, "displaced by 1,440 m",
    ),
    "drift, clock back": (
        later(-THREE_S, **OTHER_BOOT), DRIFT, LAST_EVENT_S, LAST, None,
        "displaced by 0.4 m for each second",
    ),
    # a Raspberry Pi without a battery for its clock reports 1970, or a time of days ago
    **{
        f"silent, wall clock {wall_s:g}": (
            later(0.0, **OTHER_BOOT, wall_utc_s=wall_s), {}, LAST_EVENT_S, LAST, None,
            "before the last event",
        )
        for wall_s in (0.0, 40.0, EPOCH_S - THREE_S)
    },
    "no mark": (EARLY, NO_MARK, 600.0, WALL, None, ""),
    "no mark, twelve days": (
        replace(EARLY, wall_utc_s=EPOCH_S + 12 * DAY_S), NO_MARK, LAST_EVENT_S, LAST, 12 * DAY_S,
        "nothing confirms it",
    ),
    "fast clock": (later(100.0, vehicle_since_boot_s=None), FAST, 1500.0, COMPUTER, None, ""),
    "fast clock, new boot": (
        later(1000.0, boot_id="boot-2", wall_utc_s=THEN.wall_utc_s + 100.0), FAST, 1500.0,
        VEHICLE, None, "",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_mission_time_by_clocks_follows_the_best_of_them(case):
    now, more, start_s, basis, yes_s, words = CASES[case]
    mark = more.get("mark", MARK)
    options = {key: value for key, value in more.items() if key != "mark"}
    found = mission_time(LAST_EVENT_S, mark, now, epoch_utc_s=EPOCH_S, **options)
    assert (found.start_s, found.basis) == (start_s, basis)
    assert (bool(found.question), found.if_yes_s) == (yes_s is not None, yes_s or 0.0)
    assert words in found.note
    assert bool(words) == bool(found.note)
    assert ("displaced" in found.note) == (more is DRIFT)


clocks = st.builds(
    Clocks,
    st.floats(0.0, 4e9),
    st.sampled_from([None, "boot-1", "boot-2"]),
    st.floats(0.0, 1e7),
    st.none() | st.floats(0.0, 1e7),
)


@given(
    st.floats(0.0, 1e5),
    st.none() | st.builds(Mark, st.floats(0.0, 1e5), clocks),
    clocks,
    st.floats(0.0, 4e9),
    st.floats(0.01, 100.0),
)
def test_mission_time_never_runs_backwards_and_reports_jumps(last_s, mark, now, epoch_s, speedup):
    found = mission_time(last_s, mark, now, epoch_utc_s=epoch_s, speedup=speedup)
    assert found.start_s >= last_s
    if found.question:
        assert found.if_yes_s >= last_s
    if (found.start_s - last_s) / speedup > DOUBTFUL_S + 1e-6:
        assert found.note
    if found.basis is Basis.COMPUTER:
        assert mark is not None
        assert mark.clocks.boot_id == now.boot_id


# --- in a journal ----------------------------------------------------------------------------
def test_marks_are_kept_in_the_journal_now_and_then(tmp_path, monkeypatch):
    now_s = [100.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now_s[0])
    with Journal.create(tmp_path / "journal.jsonl", {}) as journal:
        assert last_mark(journal.meta) is None
        marks = Marks(journal, lambda: THEN)
        for mission_s, passed_s in ((1.0, 0.0), (2.0, 10.0), (3.0, 15.0)):
            now_s[0] += passed_s
            marks.note(mission_s)
            assert last_mark(journal.meta) == Mark(1.0 if mission_s < 3.0 else 3.0, THEN)


def test_mark_that_cannot_be_written_stops_nothing(tmp_path, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with Journal.create(tmp_path / "journal.jsonl", {}) as journal:
        monkeypatch.setattr(event_log, "write_at", full)
        Marks(journal).note(1.0)
        assert last_mark(journal.meta) is None


@pytest.mark.parametrize("mark", [None, 5, [], {}, {"mission_s": "x"}, {"mission_s": 1.0}])
def test_invalid_mark_is_ignored(mark):
    assert last_mark({CLOCK: mark}) is None


@pytest.mark.parametrize("answer", [True, False, None])
def test_doubtful_time_is_asked_of_an_operator(answer):
    found = mission_time(LAST_EVENT_S, MARK, later(3 * DAY_S, **OTHER_BOOT), epoch_utc_s=EPOCH_S)
    said: list[str] = []
    asked: list[str] = []

    def ask(question: str) -> bool:
        asked.append(question)
        return bool(answer)

    start_s = resume_time_s(found, said.append, None if answer is None else ask)
    assert start_s == (500.0 + 3 * DAY_S if answer else LAST_EVENT_S)
    assert len(asked) == (answer is not None)
    assert len(said) == 1


def test_clocks_of_this_computer_go_forward():
    one, other = read_clocks(), read_clocks()
    assert other.since_boot_s >= one.since_boot_s
    assert other.boot_id == one.boot_id
    assert other.wall_utc_s > 1.7e9
