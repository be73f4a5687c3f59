"""A member by its reducer: lanes that others hold, and air that it requests."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import pytest

from missions.events import Arrived, FrameSeen, Vote
from missions.fleet_events import AirLeased, MemberApart, MemberReport
from missions.flight.airspace.airspace import MAX_LEASE_WAIT_S, Airspace
from missions.flight.setting_of import setting_of
from missions.flight.state import Setting, State
from missions.flight.strategy.lane_paths import drop_seen
from missions.flight.strategy.sweep import change_layer
from missions.flight.team.members import member_reported
from missions.flight.transitions import apply
from missions.flight.vehicle_state import Column, Phase, VehicleState
from missions.geo.trajectory import rounded_path
from missions.mission.checks import parse_mission
from missions.orders import FlyPath, FlyTo, Hold, StandDown, TakeOff
from missions.units import GridPoint
from tests.support.fleet_rig import field_text

OURS = 2


@lru_cache
def setting() -> Setting:
    return setting_of(parse_mission(field_text(high=True), "test"), OURS)


def in_the_air(*, on_lane: bool) -> State:
    """Return the state in which our vehicle flies along the first lane of its box."""
    state, lanes = setting().initial_state(), setting().lanes[:1]
    start, end = lanes[0]
    path = rounded_path([start, end], 0.0, speed_m_s=5.0)
    layer_m = setting().mission.search_altitude_m(OURS - 1) or 0.0
    ours = replace(
        state.vehicles[OURS], phase=Phase.AIRBORNE, landed=False, position=start,
        cruise_altitude_m=layer_m, height_m=layer_m, home=setting().pad_of(OURS),
        remaining_wh=60.0, lanes=lanes, on_lane=on_lane, lane_seen_m=(4.0,),
        order=FlyPath(path, layer_m, None, 0.25),
    )  # fmt: skip
    return state.with_vehicle(ours)


def report_of(does: str, vehicle: int = 1) -> MemberReport:
    """Return the report of another member that it holds that lane."""
    return MemberReport(
        vehicle, 1.0, GridPoint(0.0, 20.0), 30.0, 50.0, does, setting().pad_of(vehicle), (0,)
    )  # type: ignore[arg-type]


def test_a_lane_that_is_given_away_in_flight_is_not_counted_as_flown() -> None:
    state = member_reported(in_the_air(on_lane=False), report_of("flies"))
    ours = state.vehicles[OURS]
    assert (ours.lanes, ours.on_lane, ours.lane_seen_m) == ((), False, ())
    state = apply(state, Arrived(OURS, 12.0, setting().lanes[0][1]))
    assert state.vehicles[OURS].order is None


@pytest.mark.parametrize("on_lane", [True, False])
def test_own_lane_is_kept_on_it_or_while_the_other_does_not_fly(*, on_lane: bool) -> None:
    for does in ("stands", "down", "ended", "pilot", "guarded", *(["flies"] if on_lane else [])):
        ours = member_reported(in_the_air(on_lane=on_lane), report_of(does)).vehicles[OURS]
        assert (ours.lanes, ours.lane_seen_m) == (setting().lanes[:1], (4.0,)), does


def test_lane_of_a_vehicle_that_is_down_is_not_flown_again_once_it_is_seen() -> None:
    state = in_the_air(on_lane=False)
    state = state.with_vehicle(replace(state.vehicles[OURS], lanes=()))
    state = member_reported(state, report_of("down"))
    assert drop_seen(state).vehicles[1].lanes == setting().lanes[:1]
    votes = tuple(Vote(cell, False, 0.0) for cell in setting().box_cells)
    state = apply(state, FrameSeen(OURS, 2.0, None, votes, overview=True))
    state = member_reported(state, report_of("down"))
    assert drop_seen(state).vehicles[1].lanes == ()


def test_air_that_was_reserved_once_is_requested_again_the_next_time() -> None:
    state = in_the_air(on_lane=False)
    for vehicle in (1, 3):
        state = member_reported(state, replace(report_of("flies", vehicle), lanes=()))
    mine = replace(state.vehicles[OURS], lanes=(), order=None, leased_until_s=500.0)
    after = change_layer(state.with_vehicle(mine), mine)
    assert after is not None
    ours = after.vehicles[OURS]
    assert ours.asks is not None
    assert isinstance(ours.order, Hold)
    assert ours.leased_until_s == -math.inf
    again = change_layer(after, ours)
    assert again is None or isinstance(again.vehicles[OURS].order, Hold)


# --- between two layers ------------------------------------------------------------------------
def stopped_between(*, leased_s: float, apart: bool = False) -> State:
    """Return a state with our vehicle stopped 2 m above the layer from which it maps."""
    state = replace(in_the_air(on_lane=False), t_s=100.0)
    for vehicle in (1, 3):
        state = member_reported(state, replace(report_of("flies", vehicle), lanes=()))
    if apart:
        state = apply(state, MemberApart(3, 100.0))
    mine, low_m = state.vehicles[OURS], setting().mission.altitude_m(OURS - 1)
    high_m = setting().mission.search_altitude_m(OURS - 1) or 0.0
    asks = Column(mine.position, low_m, high_m, 80.0, 80.0 + leased_s)
    mine = replace(
        mine, lanes=(), order=None, asks=asks, leased_until_s=asks.until_s, height_m=low_m + 2.0,
        cruise_altitude_m=high_m,
    )  # fmt: skip
    return state.with_vehicle(mine)


def sent_back(state: State) -> VehicleState:
    after = setting().team.urgent_order(state, state.vehicles[OURS])
    assert after is not None
    return after.vehicles[OURS]


def test_vehicle_stopped_between_its_layers_continues_while_its_air_is_reserved() -> None:
    ours = sent_back(stopped_between(leased_s=120.0))
    assert isinstance(ours.order, FlyTo)
    assert ours.order.height_m == setting().mission.search_altitude_m(OURS - 1)


def test_vehicle_stopped_for_longer_requests_air_for_the_shorter_path() -> None:
    state, low_m = stopped_between(leased_s=10.0), setting().mission.altitude_m(OURS - 1)
    ours = sent_back(state)
    assert isinstance(ours.order, Hold)
    assert ours.asks is not None
    assert (ours.asks.low_m, ours.asks.high_m) == (low_m, low_m + 2.0)
    assert ours.asks.asked_s == 100.0
    waits = replace(state.with_vehicle(ours), t_s=101.0)
    assert sent_back(waits).asks == ours.asks
    promised = apply(waits, AirLeased(OURS, 101.0, ours.asks.place, ours.asks.until_s))
    down = sent_back(promised)
    assert isinstance(down.order, FlyTo)
    assert down.order.height_m == low_m
    unanswered = sent_back(replace(waits, t_s=100.0 + MAX_LEASE_WAIT_S + 0.1))
    assert isinstance(unanswered.order, FlyTo)


def test_vehicle_that_cannot_ask_all_members_leaves_the_layer_of_others_at_once() -> None:
    ours = sent_back(stopped_between(leased_s=10.0, apart=True))
    assert isinstance(ours.order, FlyTo)
    assert ours.order.height_m == setting().mission.altitude_m(OURS - 1)


# --- air that ours promises --------------------------------------------------------------------
@pytest.mark.parametrize(
    ("changes", "promises"),
    [
        ({"phase": Phase.GROUNDED, "landed": True, "order": None}, True),
        ({}, True),
        ({"phase": Phase.GROUNDED, "landed": True, "order": TakeOff(30.0)}, False),
        ({"phase": Phase.GUARDED, "order": StandDown()}, False),
        ({"phase": Phase.YIELDED, "order": StandDown()}, False),
        ({"phase": Phase.OFFLINE, "order": StandDown()}, False),
    ],
)
def test_air_is_reserved_only_for_a_vehicle_under_our_control(
    changes: dict[str, object], promises: bool
) -> None:
    state = in_the_air(on_lane=False)
    mine = replace(state.vehicles[OURS], order=Hold(), lanes=())
    column = Column(GridPoint(60.0, 60.0), 5.0, 35.0, 0.0, 60.0)
    if isinstance(changes.get("order"), TakeOff):
        column = replace(column, place=mine.position)
    state = state.with_vehicle(replace(mine, **changes))  # type: ignore[arg-type]
    assert Airspace(state).can_promise(column) == promises


@pytest.mark.parametrize("does", ["pilot", "guarded"])
def test_air_is_not_requested_while_others_control_a_vehicle_of_the_team(does: str) -> None:
    """Its member does not know where that vehicle flies: ours changes its layer over its pad."""
    state = replace(in_the_air(on_lane=False), t_s=100.0)
    for vehicle, doing in ((1, does), (3, "flies")):
        state = member_reported(state, replace(report_of(doing, vehicle), lanes=()))
    mine = replace(state.vehicles[OURS], lanes=(), order=None, position=GridPoint(20.0, 40.0))
    after = change_layer(state.with_vehicle(mine), mine)
    assert after is not None
    order = after.vehicles[OURS].order
    assert after.vehicles[OURS].asks is None
    assert isinstance(order, FlyTo)
    assert order.route[-1] == setting().pad_of(OURS)
