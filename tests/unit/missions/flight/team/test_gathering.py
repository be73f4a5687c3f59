"""A member that has flown its lanes waits over its pad for those out of contact, for a time."""

from __future__ import annotations

from dataclasses import replace

import pytest

from missions.fleet_events import Fact, FactsShared, MemberApart
from missions.flight.state import State
from missions.flight.team.teams import MAX_DELAY_S, PART_WAIT_S, REPORT_MAX_S, SILENT_S
from missions.flight.transitions import apply
from missions.flight.vehicle_state import Allotment, ReturnReason
from missions.orders import FlyPath
from missions.units import Cell, GridPoint
from tests.unit.missions.flight.team.test_parts import flying, report_from, setting


def over_pad(state: State, number: int = 2) -> State:
    pad = setting(2).pad_of(number)
    return state.with_vehicle(replace(state.vehicles[number], position=pad))


def away(state: State, *, with_lanes: bool = True) -> State:
    """Let the third be out of contact, with lanes to fly."""
    lanes = setting(2).lanes[-1:] if with_lanes else ()
    state = state.with_vehicle(replace(state.vehicles[3], lanes=lanes))
    return apply(state, MemberApart(3, state.t_s))


def is_waiting(state: State, t_s: float) -> bool:
    return setting(2).team.gathers(replace(state, t_s=t_s), state.vehicles[2])


def test_member_that_is_due_is_waited_for_and_not_for_ever() -> None:
    state = away(over_pad(flying(2)))
    due_s = state.vehicles[3].due_s
    assert 105.0 < due_s < state.vehicles[3].held_until_s
    assert is_waiting(state, due_s + MAX_DELAY_S - 0.1)
    assert not is_waiting(state, due_s + MAX_DELAY_S)
    assert not is_waiting(away(over_pad(flying(2)), with_lanes=False), 101.0)
    assert not is_waiting(over_pad(flying(2)), 101.0)


def test_member_that_is_due_is_waited_for_where_a_third_has_reported_its_facts() -> None:
    state = away(over_pad(flying(2)))
    gone = replace(state.vehicles[3], lanes=())  # frames show its cells by now
    state = state.with_vehicle(gone)
    assert is_waiting(state, gone.due_s + MAX_DELAY_S - 0.1)
    assert not is_waiting(state, gone.due_s + MAX_DELAY_S)


def test_member_that_maps_already_waits_for_no_other() -> None:
    assert not is_waiting(away(flying(2)), 101.0)


def test_member_back_in_contact_is_given_time_to_send_its_facts() -> None:
    state = apply(replace(away(over_pad(flying(2))), t_s=130.0), report_from(2, 3, "flies"))
    back_s = state.vehicles[3].back_s
    assert back_s == 100.0  # as the message has it
    state = replace(state, allotment=Allotment(1, back_s, {1: (), 2: ()}))
    assert is_waiting(state, back_s + SILENT_S - 0.1)
    assert not is_waiting(state, back_s + SILENT_S)
    reported = apply(state, FactsShared(3, back_s + 4.0, 0, (Fact(90.0, ((Cell(0, 4), True),)),)))
    assert is_waiting(reported, back_s + SILENT_S + 3.0)
    late = apply(reported, FactsShared(3, back_s + 29.0, 1, (Fact(91.0, ((Cell(1, 4), True),)),)))
    assert is_waiting(late, back_s + REPORT_MAX_S - 0.1)
    assert not is_waiting(late, back_s + REPORT_MAX_S)


def test_member_does_not_leave_before_it_has_its_part() -> None:
    state = apply(replace(away(over_pad(flying(2))), t_s=130.0), report_from(2, 3, "flies"))
    back_s = state.vehicles[3].back_s
    led = replace(state, allotment=None)
    assert is_waiting(led, back_s + SILENT_S + 1.0)  # the first has to send the parts
    assert not is_waiting(led, back_s + REPORT_MAX_S + PART_WAIT_S)
    places = (GridPoint(0.0, 20.0),)
    for made_s, parts, waits in (
        (back_s - 1.0, {1: places, 2: places}, True),
        (back_s + 6.0, {1: places}, True),
        (back_s + 6.0, {1: places, 2: places}, False),
    ):
        known = replace(led, allotment=Allotment(1, made_s, parts))
        assert is_waiting(known, back_s + SILENT_S + 2.0) is waits
    home = replace(state.vehicles[1], return_reason=ReturnReason.BATTERY)
    assert not is_waiting(led.with_vehicle(home), back_s + SILENT_S + 1.0)


@pytest.mark.parametrize("alone", [False, True])
def test_waiting_member_plans_nothing_and_leaves_when_the_others_are_back(*, alone: bool) -> None:
    state = apply(
        over_pad(flying(2)), FactsShared(1, 99.0, 0, (Fact(90.0, ((Cell(3, 8), True),)),))
    )
    state = replace(state, t_s=110.0)
    if alone:
        state = away(state)
    planned = setting(2).strategy.plan(state)
    assert isinstance(planned.vehicles[2].order, FlyPath) is not alone
