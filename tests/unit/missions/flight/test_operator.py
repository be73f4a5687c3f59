"""Commands of the operator: pause, return of one vehicle, skipped cells; texts of a vehicle."""

from __future__ import annotations

import pytest

from missions.events import (
    Airborne,
    AutopilotText,
    BatterySwapped,
    CellSkipped,
    Continued,
    Landed,
    Overridden,
    Paused,
    Recalled,
    Released,
    Resumed,
    VehicleRecalled,
)
from missions.flight.step import step
from missions.flight.vehicle_state import Phase, ReturnReason
from missions.orders import FlyTo, Hold, Land, Look, StandDown, Sweep
from missions.units import Cell, GridPoint
from tests.fake_fleet import Fleet, fleet
from tests.support.folding import fold
from tests.support.small_missions import random_scenario
from tests.unit.missions.flight.test_step import ROOT, Service, frame, pair, service

__all__ = ["pair", "service"]
NORTH, EAST = Cell(2, 7), Cell(3, 6)


def test_pause_holds_all_vehicles_and_lets_none_take_off(pair: Service) -> None:
    pair.connect(1)
    pair.exploring(1)
    assert isinstance(pair.order(1), Look)
    pair.post(Paused(pair.now_s))
    assert pair.order(1) == Hold()
    pair.connect(2)
    assert pair.order(2) is None  # it stays on the ground
    pair.post(Continued(pair.now_s))
    assert isinstance(pair.order(1), Look)
    assert pair.order(2) is not None


def test_lane_is_resumed_where_it_was_left(service: Service) -> None:
    service.connect()
    service.post(Airborne(1, 8.0))
    lane = service.setting.lanes[0]
    service.put(1, on_lane=True, order=Sweep(lane[1], 4.0, 12.0), position=lane[0])
    service.post(Paused(20.0))
    at = GridPoint(lane[0].east_m + 4.0, lane[0].north_m)
    for _ in range(10):
        service.track(1, at)
    assert service.order() == Hold()
    service.post(Continued(service.now_s))
    assert service.order() == Sweep(lane[1], 4.0, 12.0)


def test_pause_does_not_keep_a_vehicle_in_the_air_too_long(service: Service) -> None:
    service.connect()
    service.exploring()
    service.post(Paused(service.now_s))
    service.put(1, remaining_wh=1.0)
    service.track(1, service.setting.grid.centre_of(ROOT))
    assert service.state.vehicles[1].return_reason is ReturnReason.BATTERY
    assert isinstance(service.order(), FlyTo)
    service.post(Landed(1, service.now_s, 1.0, position=GridPoint(0.0, 0.0)))
    service.post(BatterySwapped(1, service.now_s, 60.0))
    assert service.order() is None
    assert not service.state.is_over
    service.post(Continued(service.now_s))
    assert service.order() is not None


def test_returning_vehicle_continues_in_a_pause(service: Service) -> None:
    service.connect()
    service.exploring()
    service.post(VehicleRecalled(1, service.now_s))
    before = service.leg()
    service.post(Paused(service.now_s))
    assert service.order() is before


@pytest.mark.parametrize("event", [Recalled(50.0), Resumed(50.0)])
def test_a_recall_and_a_resume_end_a_pause(service: Service, event: Recalled | Resumed) -> None:
    service.connect()
    service.post(Paused(10.0), event)
    assert not service.state.paused


def test_one_vehicle_is_called_home_and_stays_there(pair: Service) -> None:
    pair.connect(1)
    pair.connect(2)
    pair.exploring(1)
    pair.exploring(2, at=ROOT)
    pair.post(VehicleRecalled(1, pair.now_s))
    assert pair.state.vehicles[1].return_reason is ReturnReason.RECALLED
    assert pair.state.vehicles[2].return_reason is None
    pair.post(Landed(1, pair.now_s, 30.0, position=GridPoint(0.0, 0.0)))
    assert pair.state.vehicles[1].phase is Phase.FINISHED
    assert pair.order(1) == StandDown()
    assert pair.state.vehicles[1].note == "called home by the operator"
    pair.post(Resumed(pair.now_s))
    assert not pair.state.vehicles[1].called_home


def test_a_take_off_is_called_off_and_a_vehicle_on_the_ground_stays(pair: Service) -> None:
    pair.connect(1)
    pair.post(VehicleRecalled(1, 1.0))
    assert pair.order(1) == Land()
    pair.post(VehicleRecalled(2, 2.0))
    pair.connect(2)
    assert pair.state.vehicles[2].phase is Phase.FINISHED


def test_vehicle_called_home_under_a_pilot_returns_once_it_is_given_back(service: Service) -> None:
    service.connect()
    service.exploring()
    here = service.setting.grid.centre_of(ROOT)
    service.post(Overridden(1, service.now_s, "LOITER"), VehicleRecalled(1, service.now_s))
    assert service.order() == StandDown()
    service.post(Released(1, service.now_s, here, 12.0))
    assert service.state.vehicles[1].return_reason is ReturnReason.RECALLED


# --- cells -------------------------------------------------------------------------------------
def test_skipped_vertex_is_reported_and_not_observed(service: Service) -> None:
    service.connect()
    service.exploring()
    for k in range(5):
        service.post(frame(1, service.now_s + k / 10, ROOT, ROOT, NORTH))
    assert service.state.vehicles[1].vertex == NORTH
    assert isinstance(service.order(), FlyTo)
    service.post(CellSkipped(1, service.now_s, NORTH))
    assert service.state.skipped == {NORTH}
    assert service.state.tree is not None
    assert service.state.tree.is_observed(NORTH)
    for _ in range(10):
        service.track(1, service.setting.grid.centre_of(ROOT))
    assert service.state.exploration_finished
    service.post(Landed(1, service.now_s, 30.0, position=GridPoint(0.0, 0.0)))
    assert not service.state.completed


def test_cell_without_a_vehicle_is_not_skipped(service: Service) -> None:
    service.connect()
    service.exploring()
    before = service.state
    service.post(CellSkipped(1, service.now_s, EAST))
    assert service.state == before


def test_a_skipped_suspicion_stays_skipped(service: Service) -> None:
    service.connect()
    service.post(Airborne(1, 8.0))
    suspect = Cell(0, 6)
    service.post(frame(1, 14.0, suspect, suspect))
    assert service.state.vehicles[1].candidate == suspect
    service.post(CellSkipped(1, 15.0, suspect), frame(1, 16.0, suspect, suspect))
    assert service.state.vehicles[1].candidate is None
    service.exploring(at=Cell(0, 5))
    for k in range(5):
        service.post(frame(1, service.now_s + k / 10, Cell(0, 5), Cell(0, 5), suspect))
    tree = service.state.tree
    assert tree is not None
    assert suspect in tree
    assert tree.is_observed(suspect)


# --- words -------------------------------------------------------------------------------------
def test_text_of_a_vehicle_changes_no_state(service: Service) -> None:
    service.connect()
    before = service.state
    assert step(before, AutopilotText(1, 99.0, 4, "EKF variance")) == (before, ())


def test_a_failsafe_is_named_with_its_cause_early_or_late(service: Service) -> None:
    service.connect()
    service.exploring()
    cause = "battery failsafe: Battery 1 is low 9.90V"
    early = fold_after(service, Overridden(1, 30.0, "RTL", cause=cause))
    assert early == f"yielded to RTL: {cause}"
    late = fold_after(
        service, Overridden(1, 30.0, "RTL"), AutopilotText(1, 31.0, 2, "x", cause=cause)
    )
    assert late == early


def fold_after(service: Service, *events: Overridden | AutopilotText) -> str:
    state = service.state
    for event in events:
        state, _ = step(state, event)
    return state.vehicles[1].note


# --- whole flights -----------------------------------------------------------------------------
def _flown(seed: int, interventions: dict[float, object]) -> Fleet:
    scenario = random_scenario(seed)
    flight = fleet(scenario.mission, scenario.roi)
    flight.start()
    due = sorted(interventions.items())
    while not flight.state.is_over and flight.t_s < 5000.0:
        while due and flight.t_s >= due[0][0]:
            _, make = due.pop(0)
            flight.post(make(flight))  # type: ignore[operator]
        flight.tick()
    return flight


@pytest.mark.parametrize("seed", range(3))
def test_pauses_at_any_time_leave_the_map_as_it_would_be(seed: int) -> None:
    acts: dict[float, object] = {}
    for k in range(8):
        acts[10.0 + 37.0 * k + seed] = lambda f: Paused(f.state.t_s)
        acts[25.0 + 37.0 * k + seed] = lambda f: Continued(f.state.t_s)
    flight = _flown(seed, acts)
    assert flight.faults == []
    plain = _flown(seed, {})
    assert flight.state.completed == plain.state.completed
    assert flight.state.belief.roi == plain.state.belief.roi
    assert fold(flight.setting, flight.events) == flight.state
