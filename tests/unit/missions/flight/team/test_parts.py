"""Parts of a fleet: every cell is one member's, also after a drop-out.

No member waits for ever for one out of contact.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.fleet_events import Fact, FactsShared, MemberApart, MemberReport, Part, PartsAllotted
from missions.flight.setting_of import setting_of
from missions.flight.state import Setting, State
from missions.flight.strategy.charting import chart_of, flyer_of
from missions.flight.strategy.searching import find_work
from missions.flight.strategy.sweep_paths import NEAR_PAD_M
from missions.flight.team.work_shares import PARTS_VALID_S, SHARE_INTERVAL_S, own_part, share_parts
from missions.flight.transitions import apply
from missions.flight.vehicle_state import Allotment, Phase
from missions.mission.checks import parse_mission
from missions.orders import FlyPath
from missions.planning.sweep.chart import Chart
from missions.planning.sweep.open_work import OpenWork, TourMemory
from missions.units import Cell, GridPoint
from tests.support.fleet_rig import field_text

TEAM = (1, 2, 3)
AREA = [Cell(-2, 2), Cell(14, 16)]
spots = st.builds(GridPoint, st.integers(-20, 60).map(float), st.integers(0, 70).map(float))
tours = st.fixed_dictionaries(
    {number: st.lists(spots, min_size=1, max_size=4).map(tuple) for number in TEAM}
)


@lru_cache
def setting(member: int) -> Setting:
    return setting_of(parse_mission(field_text(high=True), "test"), member)


def flying(member: int, *, t_s: float = 100.0) -> State:
    """Return a state in which all three members map, and hold no lanes."""
    state = replace(setting(member).initial_state(), t_s=t_s)
    for number in TEAM:
        vehicle = state.vehicles[number]
        low_m = setting(member).mission.altitude_m(number - 1)
        state = state.with_vehicle(
            replace(
                vehicle, phase=Phase.AIRBORNE, landed=False, lanes=(), cruise_altitude_m=low_m,
                height_m=low_m, position=GridPoint(16.0 * number - 16.0, 20.0), tracked_s=t_s,
                home=setting(member).pad_of(number), remaining_wh=60.0,
            )
        )  # fmt: skip
    return state


def with_parts(state: State, parts: dict[int, tuple[GridPoint, ...]], by: int = 1) -> State:
    return replace(state, allotment=Allotment(by, state.t_s, parts))


@settings(max_examples=40, deadline=None)
@given(tours, st.sets(st.sampled_from(TEAM), max_size=2))
def test_each_cell_is_of_exactly_one_that_maps(
    parts: dict[int, tuple[GridPoint, ...]], home: set[int]
) -> None:
    whose = np.zeros((17 + 16) * (15 + 16), np.int64)
    for member in sorted(set(TEAM) - home):
        state = with_parts(flying(member), parts)
        for number in home:
            state = apply(state, report_from(member, number, "returns"))
        chart = Chart.around(AREA, 4.0)
        others, _, _ = own_part(member, state, chart, TourMemory())
        assert others is not None
        whose[: others.size] += ~others
    assert (whose[: others.size] == 1).all()


def report_from(member: int, number: int, does: str) -> MemberReport:
    pad = setting(member).pad_of(number)
    return MemberReport(number, 100.0, GridPoint(0.0, 20.0), 12.0, 50.0, does, pad)  # type: ignore[arg-type]


def test_parts_expire_after_their_validity() -> None:
    parts = {number: (GridPoint(0.0, 10.0 * number),) for number in TEAM}
    state = with_parts(flying(2), parts)
    for later_s, kept in ((PARTS_VALID_S - 1.0, True), (PARTS_VALID_S, False)):
        now = replace(state, t_s=state.t_s + later_s)
        others, _, _ = own_part(2, now, Chart.around(AREA, 4.0), TourMemory())
        assert (others is not None) is kept


def test_member_without_a_part_plans_for_all() -> None:
    state = with_parts(flying(2), {1: (GridPoint(0.0, 10.0),)})
    assert own_part(2, state, Chart.around(AREA, 4.0), TourMemory())[0] is None


def test_plan_begins_once_with_the_parts_received() -> None:
    state = apply(
        flying(2), PartsAllotted(1, 100.0, (Part(1, ()), Part(2, (GridPoint(4.0, 8.0),))))
    )
    _, memory, waypoints = own_part(2, state, Chart.around(AREA, 4.0), TourMemory())
    assert [(x, y) for x, y, _ in waypoints[0]] == [(4.0, 8.0)]
    _, _, again = own_part(2, state, Chart.around(AREA, 4.0), memory)
    assert again == ()


def test_member_out_of_contact_keeps_its_part_for_as_long_as_that_takes() -> None:
    parts = {number: (GridPoint(4.0, 10.0 * number),) for number in TEAM}
    state = apply(with_parts(flying(2), parts), MemberApart(3, 100.0))
    until_s = state.vehicles[3].held_until_s
    assert 130.0 < until_s < 180.0
    chart = Chart.around(AREA, 4.0)
    its = chart.index(Cell(1, 8))
    for t_s, closed in ((until_s - 1.0, True), (until_s, False)):
        now = replace(state, t_s=t_s, allotment=Allotment(1, t_s, parts))
        others, _, _ = own_part(2, now, Chart.around(AREA, 4.0), TourMemory())
        assert others is not None
        assert bool(others[its]) is closed


def test_lanes_of_a_member_out_of_contact_are_taken_when_they_should_be_flown() -> None:
    state, lanes = flying(2), setting(2).lanes
    state = state.with_vehicle(replace(state.vehicles[3], lanes=lanes))
    state = apply(state, MemberApart(3, 100.0))
    until_s = state.vehicles[3].held_until_s
    assert until_s > 130.0
    for t_s, taken in ((until_s - 0.1, ()), (until_s, lanes[-1:])):
        now = replace(state, t_s=t_s)
        now = now.with_vehicle(replace(now.vehicles[1], phase=Phase.FINISHED))
        now = find_work(now, now.vehicles[2])
        assert now.vehicles[2].lanes == taken


@pytest.mark.parametrize("member", TEAM)
def test_lowest_number_of_the_mapping_members_lays_out_the_parts(member: int) -> None:
    state, here = flying(member), setting(member)
    flyers = {n: flyer_of(here, state.vehicles[n], None, None, 101.0) for n in TEAM}
    known = chart_of(state, None, 101.0, state.vehicles)
    before = known.chart.closed.copy()
    laid = share_parts(member, state, OpenWork(known, flyers, TourMemory(), 1)).allotment
    assert (known.chart.closed == before).all()
    if member > 1:
        assert laid is None
        return
    assert laid is not None
    assert laid.parts.keys() == set(TEAM)
    assert all(laid.parts.values())
    soon = replace(state, t_s=100.0 + SHARE_INTERVAL_S - 0.1, allotment=laid)
    again = share_parts(member, soon, OpenWork(known, flyers, TourMemory(), 2))
    assert again.allotment is laid
    # then the lowest of those that are left lays out the parts
    rest = {n: flyer for n, flyer in flyers.items() if n != 1}
    assert share_parts(2, soon, OpenWork(known, rest, TourMemory(), 2)).allotment != laid


@pytest.mark.parametrize("at", [GridPoint(40.0, 50.0), GridPoint(16.0, 4.0)])
def test_member_without_a_part_flies_home_and_may_be_called_on_its_way(at: GridPoint) -> None:

    state = flying(2)
    state = state.with_vehicle(replace(state.vehicles[2], position=at))
    state = with_parts(state, {1: (GridPoint(10.0, 30.0),), 2: (), 3: (GridPoint(30.0, 30.0),)})
    order = setting(2).strategy.plan(state).vehicles[2].order
    pad = setting(2).pad_of(2)
    if at.distance_to(pad) < NEAR_PAD_M:
        assert order is None
        return
    assert isinstance(order, FlyPath)
    assert order.trajectory.place_at(order.trajectory.end_s).distance_to(pad) < 1.0
    called = with_parts(
        setting(2).strategy.plan(state), {1: (), 2: (GridPoint(30.0, 30.0),), 3: ()}
    )
    called = replace(called, t_s=103.0)
    again = setting(2).strategy.plan(replace(called, memory=None)).vehicles[2].order
    assert isinstance(again, FlyPath)
    assert again is not order


def test_member_that_waits_over_its_pad_has_a_part() -> None:
    found = FactsShared(3, 99.0, 0, (Fact(90.0, ((Cell(3, 8), True),)),))
    for member, lays in ((1, True), (2, False)):
        state = apply(flying(member), found)
        for number in (1, 3):
            at = setting(member).pad_of(number)
            state = state.with_vehicle(replace(state.vehicles[number], position=at))
        state = setting(member).strategy.plan(state)
        assert (state.allotment is not None) is lays
        if lays:
            assert state.allotment is not None
            assert set(state.allotment.parts) == set(TEAM)
