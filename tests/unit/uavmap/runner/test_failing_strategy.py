"""A strategy that fails in flight: the aircraft returns, and the operator gets the reason."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from missions.errors import StrategyError
from missions.planning.stepwise.interface import Decision, Situation
from missions.planning.stepwise.rdfs import Rdfs
from missions.units import Cell
from tests.benchmarks.watched import WatchedFlight, fly_watched, mission_text

FAR = Cell(40, 40)


def flight_with(
    monkeypatch: pytest.MonkeyPatch, failing: Callable[[Situation], Decision]
) -> WatchedFlight:
    """Fly with a strategy that decides correctly until four cells are known."""
    decide = Rdfs.decide

    def decides(self: Rdfs, situation: Situation) -> Decision:
        few = len(situation.tree.vertices) < 4
        return decide(self, situation) if few else failing(situation)

    monkeypatch.setattr(Rdfs, "decide", decides)
    flight = fly_watched("strategy", mission_text("speck"), 1)
    assert flight.columns >= {"home"}, flight.line()
    assert flight.kinds["airborne"] == 1
    return flight


def raises(failure: Exception) -> Callable[[Situation], Decision]:
    def failing(situation: Situation) -> Decision:
        raise failure

    return failing


def test_strategy_that_raises_its_error_ends_the_mission_with_it(monkeypatch):
    flight = flight_with(monkeypatch, raises(StrategyError("rdfs: the stack is empty")))
    assert flight.code == 2
    assert flight.raised == ""
    home, *_, last = (line for line in flight.stderr.splitlines() if "the stack is empty" in line)
    assert home == (
        "vehicle 1: the mission failed (rdfs: the stack is empty); it is commanded to return (RTL)"
    )
    assert last == "uavmap: rdfs: the stack is empty"
    assert "to continue: uavmap resume" in flight.stderr


def test_strategy_with_a_defect_returns_the_vehicle(monkeypatch):
    flight = flight_with(monkeypatch, raises(ZeroDivisionError("division by zero")))
    assert flight.code is None
    assert "ZeroDivisionError: division by zero" in flight.raised
    assert "the mission failed (division by zero); it is commanded to return" in flight.stderr


def test_strategy_that_moves_to_an_unknown_cell_ends_the_mission(monkeypatch):
    flight = flight_with(monkeypatch, lambda s: Decision(dict.fromkeys(s.robots, FAR)))
    assert flight.code == 2
    assert flight.stderr.splitlines()[-1].startswith("uavmap: rdfs: robot 1 moves from (")
    assert flight.stderr.splitlines()[-1].endswith("to (40, 40), which is not known")


@pytest.mark.parametrize("says", [True, False], ids=["wait", "nothing"])
def test_strategy_that_leaves_all_vehicles_waiting_ends_incomplete(monkeypatch, says):
    flight = flight_with(monkeypatch, lambda s: Decision(dict.fromkeys(s.robots) if says else {}))
    assert flight.code == 3
    assert not flight.summary["completed"]
    assert flight.summary["sorties"] == 1
    assert flight.summary["notes"]["1"] == (
        "the strategy rdfs leaves it waiting, and cells are unexplored"
    )
    assert flight.truth.t_s < 120.0
