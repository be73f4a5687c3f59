"""A member of a fleet that ends while another is out of contact."""

from __future__ import annotations

from dataclasses import replace

import pytest

from missions.flight.setting_of import setting_of
from missions.flight.state import State
from missions.flight.vehicle_state import Phase
from missions.mission.fleet_checks import with_own_air
from uavmap.load.mission_source import load
from uavmap.output.facts.figures import aircraft_down


def ended(other: Phase, member: int | None = 1) -> State:
    """Return a state with all mapped and all vehicles at home, as known; the second is `other`."""
    state = setting_of(with_own_air(load("bay")), member=member).initial_state()
    for number, vehicle in state.vehicles.items():
        phase = other if number == 2 else Phase.FINISHED
        state = state.with_vehicle(replace(vehicle, phase=phase, lanes=(), landed=True))
    return replace(state, exhausted=True, surveyed=True)


@pytest.mark.parametrize("member", [1, 0])
@pytest.mark.parametrize("phase", [Phase.APART, Phase.OFFLINE])
def test_member_or_station_is_not_complete_while_another_is_out_of_contact(
    phase: Phase, member: int
) -> None:
    state = ended(phase, member)
    assert state.unreported == (2,)
    assert not state.completed
    assert aircraft_down(state) == ["vehicle 2: out of contact at the end, and may be down"]


def test_member_is_complete_once_all_others_are_known_to_stand() -> None:
    state = ended(Phase.FINISHED)
    assert state.unreported == ()
    assert state.completed
    assert aircraft_down(state) == []


def test_one_service_for_all_knows_its_own_vehicles() -> None:
    state = ended(Phase.OFFLINE, member=None)
    assert state.unreported == ()
    assert state.completed
