"""The records of the fake fleet can fail a flight; `tests/unit/test_referee.py` has the rules."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace

import pytest

from missions.events import Event, FrameSeen, OrderFailed
from missions.flight.state import State
from missions.flight.step import Orders
from missions.flight.vehicle_state import Phase
from missions.mission.energy import EnergyModel
from missions.units import Cell, GridPoint
from tests.fake_fleet import Fleet, fleet
from tests.fake_fleet.aircraft import Air, Aircraft
from tests.fake_fleet.driver import Link
from tests.fake_fleet.troubles import Trouble
from tests.support.small_missions import mission, square

ROI = frozenset({Cell(2, 6), Cell(2, 7), Cell(3, 7)})


def started(vehicles: int = 1, roi: frozenset[Cell] = ROI) -> Fleet:
    """Return a flight that is in the air and on its way."""
    made = mission(
        square(-10, 16, 40, 30), square(-60, -60, 160, 160), capacity_wh=60.0, vehicles=vehicles
    )
    flight = fleet(made, roi)
    flight.start()
    flight.run(until=lambda f: all(v.phase is Phase.AIRBORNE for v in f.state.vehicles.values()))
    return flight


def kinds(flight: Fleet) -> set[str]:
    return {kind for kind, _ in flight.referee.found}


def test_a_kind_flight_is_not_failed() -> None:
    flight = started(2)
    flight.run()
    flight.conclude(twice=True)
    assert flight.faults == []
    assert flight.state.completed


@pytest.mark.parametrize("link", ["acks lost", "commands lost"])
def test_a_landing_that_telemetry_shows_needs_no_acknowledgement(link: Link) -> None:
    """As in `uavmap.aircraft`: one that was repeated three times ended in an RTL, which climbs."""
    flight = started()
    flight.recall()
    flight.run(until=lambda f: f.vehicles[1].mode == "land")
    flight.drivers[1].link = link
    flight.run()
    assert not any(isinstance(event, OrderFailed) for event in flight.events)
    assert flight.vehicles[1].mode == "land"


def test_a_landing_of_the_world_lasts_no_longer_than_the_energy_model_has_it() -> None:
    """It sank at 0.75 m/s from any height, where the mission states 1.5 m/s down to 10 m."""
    craft = Aircraft(1, GridPoint(0.0, 0.0), GridPoint(0.0, 0.0), 60.0, 5.0, 300.0)
    craft.armed = craft.flying = True
    craft.height_m, ticks = 52.0, 0
    craft.switch("land")
    while craft.flying:
        craft.step(0.25, Air(), 0.0)
        ticks += 1
    model = EnergyModel(300.0, 60.0, 0.1, speed_m_s=5.0, wind_m_s=0.0, descent_m_s=1.5)
    assert 0.8 * model.descent_s(52.0) < 0.25 * ticks < model.descent_s(52.0)


def completed(roi: frozenset[Cell] = ROI) -> Fleet:
    flight = started(roi=roi)
    flight.run()
    assert flight.state.completed
    return flight


def blind(flight: Fleet) -> None:
    flight.roi = {*ROI, Cell(4, 7)}


def forget(flight: Fleet) -> None:
    event = next(e for e in flight.events if isinstance(e, FrameSeen))
    flight.events.append(replace(event, t_s=event.t_s + 0.001))


def dream(flight: Fleet) -> None:
    belief = replace(flight.state.belief, roi=flight.state.belief.roi | {Cell(9, 9)})
    flight.state = replace(flight.state, belief=belief)


@pytest.mark.parametrize(
    ("spoil", "kind"), [(blind, "lie"), (forget, "lost votes"), (dream, "false"), (dream, "fold")]
)
def test_a_map_that_is_not_the_truth_is_seen(spoil: Callable[[Fleet], None], kind: str) -> None:
    flight = completed()
    spoil(flight)
    flight.conclude(twice=True)
    assert kind in kinds(flight)


def test_lane_without_frames_is_seen() -> None:
    flight = completed(roi=frozenset())
    flight.drivers[1].seen_from = flight.drivers[1].seen_from[:5]
    flight.conclude()
    assert kinds(flight) == {"lie"}


def test_reducer_that_raises_is_reported_and_all_vehicles_return(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    flight = started(2)

    def fails(state: State, event: Event) -> tuple[State, Orders]:
        raise ZeroDivisionError("a fault of the test")

    monkeypatch.setattr(sys.modules[Fleet.__module__], "step", fails)
    flight.run()
    assert kinds(flight) == {"traceback"}
    assert {craft.mode for craft in flight.vehicles.values()} == {"rtl"}
    assert not any(craft.flying or craft.crashed for craft in flight.vehicles.values())


def test_a_flight_without_an_end_is_not_waited_for() -> None:
    flight = started()
    flight.troubles = [Trouble("none", 1, "search", 0.0)]
    with pytest.raises(AssertionError, match="no end"):
        flight.run(1.0)
