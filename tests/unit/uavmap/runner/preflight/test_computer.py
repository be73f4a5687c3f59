"""The doctor measures the computer: a loop that stalls, slow frames, slow plans."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import Any

import pytest

from missions.errors import ImageError
from missions.events import Event, FrameSeen
from missions.flight.setting_of import setting_of
from missions.flight.state import Setting, State
from tests.support.flights import small_mission
from uavmap.runner.preflight import computer_check
from uavmap.runner.preflight.computer_check import (
    ComputerSpeed,
    computer_findings,
    frame_s,
    longest_plan_s,
    longest_stall_s,
)
from uavmap.runner.preflight.finding import Finding, Level, warn


def setting(strategy: str = "swath") -> Setting:
    return setting_of(small_mission(strategy=strategy))


@pytest.mark.parametrize(
    ("speed", "vehicles", "levels"),
    [
        (ComputerSpeed(0.01, 0.02, 0.1), 1, ["ok", "ok", "ok"]),
        (ComputerSpeed(0.1, 0.02, 0.1), 1, ["warn", "ok", "ok"]),
        (ComputerSpeed(0.2, 0.02, 0.1), 1, ["bad", "ok", "ok"]),
        (ComputerSpeed(0.01, 0.15, 0.1), 1, ["ok", "warn", "ok"]),
        (ComputerSpeed(0.01, 0.15, 0.1), 3, ["ok", "bad", "ok"]),
        (ComputerSpeed(0.01, 0.02, 0.72), 1, ["ok", "ok", "warn"]),
        (ComputerSpeed(0.01, 0.02, 1.2), 1, ["ok", "ok", "bad"]),
        (ComputerSpeed(0.01, 0.02), 1, ["ok", "ok"]),
    ],
)
def test_slow_computer_is_a_finding_with_figures_and_a_remedy(speed, vehicles, levels):
    made = setting()
    found = list(computer_findings(speed, made, vehicles))
    assert [finding.level.value for finding in found] == levels
    assert all(" ms " in finding.found for finding in found)
    assert all(f.wanted and f.remedy for f in found if f.level is not Level.OK)
    assert not any(finding.binding for finding in found)


def test_check_of_the_computer_without_a_mission_measures_the_loop_only():
    (found,) = computer_findings(ComputerSpeed(0.01), None, 1)
    assert found.line().startswith("ok    event loop: 10 ms late at worst; at most 150 ms: set-")


def test_stall_of_the_event_loop_is_measured():
    async def stalled() -> float:
        asyncio.get_running_loop().call_later(0.1, time.sleep, 0.3)
        return await longest_stall_s(0.5)

    assert 0.25 < asyncio.run(stalled()) < 1.0


def slowed(call: Callable[..., Any], by_s: float, when: Callable[..., bool]) -> Callable[..., Any]:
    def slow(*given: Any) -> Any:
        if when(*given):
            time.sleep(by_s)
        return call(*given)

    return slow


def test_time_of_a_frame_includes_all_its_work(monkeypatch):
    made = setting()
    assert frame_s(made) < 0.1
    slow = slowed(computer_check.decoded, 0.1, lambda *given: True)
    monkeypatch.setattr(computer_check, "decoded", slow)
    assert 0.1 <= frame_s(made) < 0.3


def test_pictures_for_the_measurement_are_evidence_to_the_mission(monkeypatch):
    one = computer_check._picture((160, 120), 1)
    monkeypatch.setattr(computer_check, "_picture", lambda size_px, seed: one)
    with pytest.raises(ImageError):
        frame_s(setting())


def test_slowest_plan_is_that_of_an_exploration(monkeypatch):
    def explores(state: State, event: Event) -> bool:
        return state.tree is not None and isinstance(event, FrameSeen)

    monkeypatch.setattr(computer_check, "step", slowed(computer_check.step, 0.3, explores))
    slow = longest_plan_s(setting(), 1.2)
    assert slow is not None
    assert slow >= 0.3


def test_strategy_that_stops_has_no_plans_to_measure():
    assert longest_plan_s(setting("rdfs")) is None


@pytest.mark.parametrize(
    ("found", "wanted", "remedy"),
    [("dark; no picture", "a picture of the ground", "look"), ("no fix", "", "wait; or go"),
     ("5 (of 6); bad", "6 (all)", "")],
)  # fmt: skip
def test_finding_is_read_from_its_line_as_it_was(found, wanted, remedy):
    if not wanted:
        found = found.partition(";")[0]
    finding = warn("camera", found, wanted, remedy)
    assert Finding.read(finding.line()) == finding
