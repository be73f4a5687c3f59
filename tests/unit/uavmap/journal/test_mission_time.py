"""Mission time of a mission that is taken up again: whatever the clocks do, it neither runs
backwards nor jumps by days without a word."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.journals import PLAN, some_events, write
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
    MissionTime,
    last_mark,
    mission_time,
    read_clocks,
    taken_up_at,
)

EPOCH_S = 1.8e9
DAY_S = 86400.0
THEN = Clocks(EPOCH_S + 500.0, "boot-1", 9000.0, 7000.0)
MARK = Mark(500.0, THEN)
LAST_EVENT_S = 512.0


def later(seconds: float, **other: object) -> Clocks:
    """The clocks so much later than the mark."""
    now = Clocks(
        THEN.wall_utc_s + seconds, THEN.boot_id, THEN.since_boot_s + seconds, 7000.0 + seconds
    )
    return replace(now, **other)  # type: ignore[arg-type]


def decided(now: Clocks, mark: Mark | None = MARK, **more: float) -> MissionTime:
    return mission_time(LAST_EVENT_S, mark, now, epoch_utc_s=EPOCH_S, **more)


def test_the_same_boot_and_a_clock_that_nobody_touched() -> None:
    assert decided(later(100.0)) == MissionTime(600.0, Basis.COMPUTER)


@pytest.mark.parametrize("jump_s", [3 * DAY_S, -3 * DAY_S, 10 * 365 * DAY_S, -THEN.wall_utc_s])
def test_in_the_same_boot_the_wall_clock_can_do_what_it_likes(jump_s: float) -> None:
    now = later(100.0)
    found = decided(replace(now, wall_utc_s=now.wall_utc_s + jump_s))
    assert (found.start_s, found.basis, found.question) == (600.0, Basis.COMPUTER, "")
    assert f"set {'forward' if jump_s > 0 else 'back'} by" in found.note


def test_the_vehicle_tells_when_the_computer_was_started_anew() -> None:
    now = later(100.0, boot_id="boot-2", since_boot_s=20.0)
    assert decided(now) == MissionTime(600.0, Basis.VEHICLE)
    ahead = decided(replace(now, wall_utc_s=now.wall_utc_s + 3 * DAY_S))
    assert (ahead.start_s, ahead.basis) == (600.0, Basis.VEHICLE)
    # it might have been started anew itself, and be up for longer than it was then
    assert ahead.question
    assert ahead.if_yes_s == 600.0 + 3 * DAY_S
    behind = decided(replace(now, wall_utc_s=now.wall_utc_s - 3 * DAY_S))
    assert (behind.start_s, behind.question) == (600.0, "")


def test_a_vehicle_that_was_started_anew_tells_nothing() -> None:
    now = later(100.0, boot_id="boot-2", since_boot_s=20.0, vehicle_since_boot_s=30.0)
    assert decided(now) == MissionTime(600.0, Basis.WALL_CLOCK)


OTHER_BOOT = {"boot_id": "boot-2", "since_boot_s": 20.0, "vehicle_since_boot_s": None}


def test_another_boot_and_a_few_minutes() -> None:
    assert decided(later(100.0, **OTHER_BOOT)) == MissionTime(600.0, Basis.WALL_CLOCK)
    assert decided(later(-60.0, **OTHER_BOOT)).start_s == LAST_EVENT_S


def test_another_boot_and_a_clock_three_days_ahead() -> None:
    found = decided(later(3 * DAY_S, **OTHER_BOOT))
    assert (found.start_s, found.basis) == (LAST_EVENT_S, Basis.LAST_EVENT)
    assert "2 d 23 h have passed" in found.note
    assert found.question
    assert found.if_yes_s == 500.0 + 3 * DAY_S
    assert "displaced" not in found.note


def test_with_drift_it_is_said_how_far_the_cells_may_be_off() -> None:
    found = decided(later(12.0 + 3600.0, **OTHER_BOOT), drift_m_s=0.4)
    assert found.start_s == LAST_EVENT_S
    assert "displaced by 1,440 m" in found.note
    back = decided(later(-3 * DAY_S, **OTHER_BOOT), drift_m_s=0.4)
    assert "displaced by 0.4 m for each second" in back.note


@pytest.mark.parametrize("wall_utc_s", [0.0, 40.0, EPOCH_S - 3 * DAY_S])
def test_no_battery_behind_the_clock(wall_utc_s: float) -> None:
    """After another boot a Raspberry Pi thinks that it is 1970, or what it was days ago."""
    found = decided(later(0.0, **OTHER_BOOT, wall_utc_s=wall_utc_s))
    assert (found.start_s, found.basis, found.question) == (LAST_EVENT_S, Basis.LAST_EVENT, "")
    assert "before the last event" in found.note


def test_a_journal_without_a_mark_has_the_wall_clock_only() -> None:
    now = Clocks(EPOCH_S + 600.0, "boot-1", 1.0)
    assert decided(now, None) == MissionTime(600.0, Basis.WALL_CLOCK)
    found = decided(replace(now, wall_utc_s=EPOCH_S + 12 * DAY_S), None)
    assert (found.start_s, found.if_yes_s) == (LAST_EVENT_S, 12 * DAY_S)


def test_a_night_in_the_same_boot_is_said() -> None:
    found = decided(later(10 * 3600.0))
    assert found.start_s == 500.0 + 10 * 3600.0
    assert "9 h 59 min have passed" in found.note


def test_on_a_fast_clock_a_second_is_more() -> None:
    assert decided(later(100.0, vehicle_since_boot_s=None), speedup=10.0).start_s == 1500.0
    now = later(1000.0, boot_id="boot-2", wall_utc_s=THEN.wall_utc_s + 100.0)
    assert decided(now, speedup=10.0) == MissionTime(1500.0, Basis.VEHICLE)


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
def test_it_never_runs_backwards_and_never_jumps_silently(
    last_s: float, mark: Mark | None, now: Clocks, epoch_s: float, speedup: float
) -> None:
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
def test_marks_are_kept_in_the_journal_now_and_then(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = [100.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now_s[0])
    with Journal.create(tmp_path / "journal.jsonl", {}) as journal:
        assert last_mark(journal.meta) is None
        marks = Marks(journal, lambda: THEN)
        for mission_s, passed_s in ((1.0, 0.0), (2.0, 10.0), (3.0, 15.0)):
            now_s[0] += passed_s
            marks.note(mission_s)
            assert last_mark(journal.meta) == Mark(1.0 if mission_s < 3.0 else 3.0, THEN)


def test_a_mark_that_cannot_be_written_stops_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with Journal.create(tmp_path / "journal.jsonl", {}) as journal:
        monkeypatch.setattr(event_log, "write_at", full)
        marks = Marks(journal)
        marks.note(1.0)
        assert marks.lost == 1


@pytest.mark.parametrize("mark", [None, 5, [], {}, {"mission_s": "x"}, {"mission_s": 1.0}])
def test_what_is_no_mark(mark: object) -> None:
    assert last_mark({CLOCK: mark}) is None


@pytest.mark.parametrize("answer", [True, False, None])
def test_what_is_doubtful_is_asked_where_somebody_is(tmp_path: Path, answer: bool | None) -> None:
    path = write(tmp_path / "journal.jsonl", some_events(2))
    now = later(3 * DAY_S, **OTHER_BOOT)
    said: list[str] = []
    asked: list[str] = []

    def ask(question: str) -> bool:
        asked.append(question)
        return bool(answer)

    with Journal.open(path) as journal:
        Marks(journal, lambda: THEN).note(500.0)
        start_s = taken_up_at(
            last_mark(journal.meta),
            LAST_EVENT_S,
            now,
            epoch_utc_s=PLAN.epoch_utc_s,
            speedup=1.0,
            drift_m_s=0.0,
            say=said.append,
            ask=None if answer is None else ask,
        )
    assert start_s == (500.0 + 3 * DAY_S if answer else LAST_EVENT_S)
    assert len(asked) == (answer is not None)
    assert len(said) == 1


def test_the_clocks_of_this_computer_go_forward() -> None:
    one, other = read_clocks(), read_clocks()
    assert other.since_boot_s >= one.since_boot_s
    assert other.boot_id == one.boot_id
    assert other.wall_utc_s > 1.7e9
