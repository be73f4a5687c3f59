"""Searching the box: lanes, suspicions, and sharing what is left of the work."""

from __future__ import annotations

from dataclasses import replace

from missions.flight.airspace.airspace import Airspace
from missions.flight.lane_progress import lane_left
from missions.flight.return_home import OVER_HOME_M, REACTION_S, go_home, has_energy_for, home_order
from missions.flight.setting import Setting
from missions.flight.state import Phase, ReturnReason, State, VehicleState
from missions.flight.strategy.lane_passes import give_up_lane
from missions.flight.strategy.visiting import visit
from missions.orders import FlyTo, Order, Sweep


def search(setting: Setting, state: State, vehicle: VehicleState) -> State:
    """Look at what may be ROI, else fly the next lane."""
    if vehicle.candidate is not None:
        return visit(setting, state, vehicle, vehicle.candidate, stop=True)
    if not vehicle.lanes:
        state = find_work(setting, state, vehicle)
        vehicle = state.vehicles[vehicle.vehicle]
        if not vehicle.idle_in_search:
            return state
        if vehicle.position.distance_to(vehicle.home) <= OVER_HOME_M:
            return state.holding(vehicle)
        # it waits over its own pad, where it is not in the way of anybody who has to land
        return Airspace(setting, state).reserve_or_wait(vehicle, home_order(setting, vehicle))
    start, end = vehicle.lanes[0]
    if vehicle.on_lane and setting.fence.allows_leg(vehicle.position, end):
        # flown as far as the battery lasts; the next sortie takes up the rest
        order: Order = Sweep(end, setting.mission.grid.cell_m, vehicle.cruise_height_m)
        return Airspace(setting, state).reserve_or_wait(vehicle, order)
    if vehicle.on_lane:  # it left the lane for a suspicion, and the fence lies between
        vehicle = lane_left(vehicle, setting.grid.cell_m)
        if not vehicle.lanes:
            return state.holding(vehicle)
        start, end = vehicle.lanes[0]
    route = setting.fence.route(vehicle.position, start)
    if route is None:  # a part of the box that no way inside the fence leads to
        return give_up_lane(state, vehicle)
    if not has_energy_for(setting, vehicle, start, REACTION_S):
        return go_home(setting, state, vehicle, ReturnReason.BATTERY)
    order = FlyTo(route, None, stop=False, height_m=vehicle.cruise_height_m)
    return Airspace(setting, state).reserve_or_wait(vehicle, order)


def find_work(setting: Setting, state: State, vehicle: VehicleState) -> State:
    """Take over a suspicion of a vehicle that dropped out, or lanes of the one with most left.

    Lanes are taken from the far end; a vehicle that dropped out leaves all of its lanes. A path
    leads along all lanes of a vehicle. In a search it pays to be at the far end sooner than that;
    in a survey the lane would be flown twice.
    """
    for other in state.vehicles.values():
        gone = other.phase not in (Phase.AIRBORNE, Phase.GROUNDED)
        if gone and other.candidate is not None:
            state = state.with_vehicle(replace(other, candidate=None))
            heir = replace(vehicle, candidate=other.candidate, at_target=False)
            return state.with_vehicle(heir)

    orphan = setting.team.free_lane(setting, state)
    if orphan is not None:
        return state.with_vehicle(replace(vehicle, lanes=(orphan,), on_lane=False))

    def spare(other: VehicleState) -> int:
        if setting.strategy.keeps_lanes(other):
            return 0
        if other.phase is Phase.APART and state.t_s < other.held_until_s:
            return 0  # out of contact: it should still be at it
        active = other.phase in (Phase.AIRBORNE, Phase.GROUNDED)
        return len(other.lanes) - (1 if active else 0)

    others = [v for v in state.vehicles.values() if v.vehicle != vehicle.vehicle and spare(v) > 0]
    if not others:
        return state
    busiest = max(others, key=lambda v: (spare(v), -v.vehicle))
    state = state.with_vehicle(replace(busiest, lanes=busiest.lanes[:-1]))
    return state.with_vehicle(replace(vehicle, lanes=(busiest.lanes[-1],), on_lane=False))
