"""The share and the time left along a recorded flight: correct, and empty if unknown."""

from __future__ import annotations

import io
from dataclasses import replace

import pytest

from missions.events import from_json
from missions.flight.state import State
from missions.flight.step import step
from missions.flight.vehicle_state import Phase
from tests.golden.recording import STOPS, Recording
from uavmap.base.terminal import Terminal
from uavmap.runner.operator import progress
from uavmap.runner.operator.progress import ProgressTable
from uavmap.runner.operator.time_left import TimeLeft, time_left


def course(recording: Recording, every: int = 10) -> list[tuple[State, TimeLeft]]:
    """Return the values shown now and then, and the last one."""
    setting, told = recording.setting(), []
    state = setting.initial_state()
    lines = recording.lines()
    for index, line in enumerate(lines):
        state, _ = step(state, from_json(line))
        if index % every == 0 or index == len(lines) - 1:
            told.append((state, time_left(state)))
    return told


def test_share_is_whole_only_at_home_and_never_decreases_in_the_search():
    told = course(STOPS)
    *before, (last, end) = told
    assert last.is_over
    assert (end.share, end.about_s) == (1.0, None)
    shares = [left.share for _, left in before if left.share is not None]
    assert max(shares) < 1.0
    searching = [left.share or 0.0 for state, left in before if state.tree is None]
    assert searching == sorted(searching)
    assert searching[-1] > searching[0] == 0.0
    home = [(state, left) for state, left in before if state.exploration_finished]
    assert home
    for state, left in home:  # the return path is known: it is right within a half, and 15 s
        assert left.about_s == pytest.approx(last.t_s - state.t_s, rel=0.5, abs=15.0)
    exploring = [left for state, left in before if state.tree and not state.exploration_finished]
    assert all("of the known region" in left.text for left in exploring)


def test_time_left_is_empty_if_unknown():
    setting = STOPS.setting()
    state = setting.initial_state()
    assert time_left(replace(state, recalled=True)) == TimeLeft()
    down = replace(state.vehicles[1], phase=Phase.DOWN)
    others = {n: replace(v, phase=Phase.LOST) for n, v in state.vehicles.items()}
    nobody = replace(state, vehicles={**others, 1: down})
    assert time_left(nobody) == TimeLeft()


@pytest.mark.parametrize("live", [False, True])
def test_time_left_is_shown_on_a_terminal_and_a_pipe(live, monkeypatch):
    class Stream(io.StringIO):
        def isatty(self) -> bool:
            return live

    clock = iter(range(10**6))
    monkeypatch.setattr(progress.time, "monotonic", lambda: 2.0 * next(clock))
    monkeypatch.setenv("COLUMNS", "200")
    setting, out = STOPS.setting(), Stream()
    terminal, state = ProgressTable(Terminal(out)), setting.initial_state()
    assert progress.phase(replace(state, recalled=True, paused=True)) == "recalled"
    terminal.begin(setting, again=False)
    for index, line in enumerate(STOPS.lines()[:400]):
        state, _ = step(state, event := from_json(line))
        if index % 20 == 0:
            terminal.update(event, state, 0)
    terminal.end()
    rest = " for " if live else "  ["
    assert f"% of the search lanes, less than 10 s left{rest}" in out.getvalue()
    assert "100 % of the mission" in out.getvalue()
    lines = out.getvalue().splitlines()
    assert live or max(map(len, lines)) <= 110
