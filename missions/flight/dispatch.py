"""What idle vehicles do next.

A vehicle in the air comes home when called, when the battery or the camera says so, or when all
is done (`missions.flight.return_home`); it searches until the ROI is found
(`missions.flight.strategy.searching`), then explores (`missions.flight.strategy.exploring`). No
order is given that would take a vehicle out of its fence, beyond its energy, or through the air
that another vehicle claims (`missions.flight.airspace.deconfliction`).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from shapely.geometry import Point

from missions.flight.airspace.deconfliction import give_if_clear, give_way, hold, revise, where
from missions.flight.path_orders import come_inside, keep_clear
from missions.flight.return_home import fly_home, has_energy_for, turn_back
from missions.flight.setting import Setting
from missions.flight.state import Phase, State, VehicleState
from missions.flight.strategy.exploring import explore, explore_moves
from missions.flight.strategy.gathering import gathers
from missions.flight.strategy.lane_passes import drop_seen, end_searched, search_passes
from missions.flight.strategy.leapfrogging import both_ready, take_turns
from missions.flight.strategy.searching import find_work, idle_in_search, search
from missions.flight.strategy.sweep_passes import awaits_others, explore_passes, give_up_rest
from missions.flight.strategy.two_heights import (
    back_to_layer,
    change_layer,
    is_over_pad,
    layer_of,
    over_own_pad,
    strays_from_layer,
    take_off_height_m,
)
from missions.flight.strategy.visiting import mark_unreachable
from missions.flight.whole_box import open_cells
from missions.geo.columns import PAD_M
from missions.mission.energy import FRESH
from missions.mission.height_and_speed import LEAST_HEIGHT_M
from missions.orders import AwaitBattery, TakeOff
from missions.units import Cell, GridPoint

MOST_FRUITLESS_SORTIES = 3
"""After so many in a row the next place counts as out of reach."""

CLIMB_ROOM_M = 0.5
"""A climb strays from where it began by less than this."""


def assign(setting: Setting, state: State) -> State:
    """The state with an order for everybody who can have one."""
    if state.tree is None and setting.member is not None:
        state = drop_seen(setting, state)
    if state.tree is None and setting.lanes:
        done = all(idle_in_search(v) for v in state.vehicles.values())
        if not setting.sees_box:  # else it is done when its cells are decided
            state = replace(state, exhausted=done)
    state = revise(setting, state)
    for number in state.our_numbers:
        state = turn_back(setting, state, state.vehicles[number])
    if setting.nonstop and not state.falls_back:
        state = end_searched(setting, keep_clear(setting, state))
        if not state.paused:
            plan = take_turns if setting.leapfrogs else explore_passes
            state = plan(setting, state)
    elif not state.paused:
        state = explore_moves(setting, state)
    for number in state.our_numbers:
        vehicle = state.vehicles[number]
        if vehicle.idle and vehicle.phase is Phase.AIRBORNE:
            state = _airborne(setting, state, vehicle)
        elif vehicle.phase is Phase.GROUNDED and not isinstance(vehicle.order, TakeOff):
            state = _grounded(setting, state, vehicle)
    return state


def _airborne(setting: Setting, state: State, vehicle: VehicleState) -> State:
    if vehicle.braking_until_s is not None:
        return hold(state, vehicle)
    if setting.member is not None and strays_from_layer(vehicle):
        return back_to_layer(setting, state, vehicle)
    if vehicle.return_reason is not None:
        return fly_home(setting, state, vehicle)
    if (given_way := give_way(setting, state, vehicle)) is not None:
        return given_way
    if state.paused:
        return hold(state, vehicle)
    if setting.nonstop and not state.falls_back:
        return _waiting_for_a_path(setting, state, vehicle)
    if state.tree is None:
        return search(setting, state, vehicle)
    return explore(setting, state, vehicle)


def _waiting_for_a_path(setting: Setting, state: State, vehicle: VehicleState) -> State:
    """A path along the lanes; in an exploration paths are planned for all at once."""
    inside = come_inside(setting, state, vehicle)
    if inside is not None:
        return inside
    if gathers(setting, state, vehicle):
        if not is_over_pad(vehicle):
            return over_own_pad(setting, state, vehicle)
    elif setting.sees_box and not vehicle.lanes:
        state = find_work(setting, state, vehicle)
        vehicle = state.vehicles[vehicle.vehicle]
    changed = change_layer(setting, state, vehicle)
    if changed is not None:
        return changed
    if vehicle.asks is not None:  # it is there: the air is the others' again
        vehicle = replace(vehicle, asks=None)
        state = state.with_vehicle(vehicle)
    if state.tree is None and vehicle.lanes:
        return search_passes(setting, state, vehicle)
    if state.tree is None and not setting.sees_box:
        return search(setting, state, vehicle)  # others have lanes left, or it waits over its pad
    if awaits_others(setting, state, vehicle) and not is_over_pad(vehicle):
        return over_own_pad(setting, state, vehicle)  # where everybody comes, and is heard again
    return hold(state, vehicle)


def _grounded(setting: Setting, state: State, vehicle: VehicleState) -> State:
    """Take off, wait for a battery, or stay."""
    if state.exploration_finished or state.recalled or vehicle.called_home:
        done = vehicle.stood_down(Phase.FINISHED, vehicle.note)
        return state.with_vehicle(replace(done, vertex=None))
    if not vehicle.idle:
        return state
    if not vehicle.cleared:
        return state.with_vehicle(replace(vehicle, order=AwaitBattery()))
    if state.paused or not both_ready(setting, state):
        return state
    if state.tree is None and idle_in_search(vehicle):
        state = find_work(setting, state, vehicle)
        vehicle = state.vehicles[vehicle.vehicle]
    if setting.searches_high:
        vehicle = replace(vehicle, cruise_altitude_m=layer_of(setting, vehicle))
    target = _first_target(setting, state, vehicle)
    # some milliseconds over a large region: once a report of the vehicle is soon enough
    if target is None and setting.searches_high and vehicle.tracked_s == state.t_s:
        # who has no lane maps at once
        target = _nearest(setting, state, vehicle, _beside_patches(state))
    if target is None and setting.sees_box and not any(v.lanes for v in state.vehicles.values()):
        target = _nearest(setting, state, vehicle, open_cells(setting, state))
        if target is None:
            return give_up_rest(setting, state)
    if target is None and not setting.lanes and state.tree is None:
        note = (
            "no part of the search box can be flown inside the geofence; move the one or the other"
        )
        return state.with_vehicle(vehicle.stood_down(Phase.FAILED, note))
    if target is None:
        return state
    if refusal := _unfit(setting, vehicle):
        return state.with_vehicle(vehicle.stood_down(Phase.FAILED, refusal))
    if vehicle.fruitless_sorties >= MOST_FRUITLESS_SORTIES:
        return _out_of_reach(setting, state, vehicle)
    if not has_energy_for(setting, vehicle, target, setting.look_s):
        if vehicle.remaining_wh < FRESH * setting.energy.capacity_wh:
            return state.with_vehicle(replace(vehicle, order=AwaitBattery()))
        return _out_of_reach(setting, state, vehicle)
    order = TakeOff(take_off_height_m(setting, state, vehicle))
    return give_if_clear(setting, state, vehicle, order)


def _unfit(setting: Setting, vehicle: VehicleState) -> str:
    """Why a vehicle may not take off from where it stands; empty if it may."""
    if not setting.fence.contains(vehicle.position):
        return "it stands outside of the geofence; move it, or the fence"
    off_m = setting.pad_of(vehicle.vehicle).distance_to(vehicle.position)
    if setting.member is not None and off_m > PAD_M:
        return (
            f"it stands {off_m:.1f} m from the place that its fleet keeps clear for it; move it, "
            "or its home in the mission of everybody"
        )
    room_m = setting.fence.outer.boundary.distance(Point(vehicle.position))
    if room_m < min(CLIMB_ROOM_M, setting.mission.fence.margin_m):
        return (
            f"it stands {room_m:.1f} m from the edge of the geofence, and may stray that far while "
            "it climbs; move it, or the fence"
        )
    if vehicle.cruise_height_m < LEAST_HEIGHT_M:
        return (
            f"it stands {vehicle.home_level_m:.0f} m higher than the start, and its layer "
            f"is only {vehicle.cruise_height_m:.0f} m above it; raise flight.altitude_m"
        )
    if vehicle.wind_m_s > setting.energy.max_airspeed_m_s:
        return f"it measured a wind of {vehicle.wind_m_s:.0f} m/s, more than it can hold"
    return ""


def _first_target(setting: Setting, state: State, vehicle: VehicleState) -> GridPoint | None:
    """Where the vehicle would fly first, None when there is nothing for it to do."""
    cell = vehicle.vertex or vehicle.candidate
    if cell is not None:
        return where(setting, state, cell)
    return setting.over_ground(vehicle.lanes[0][0], state.t_s) if vehicle.lanes else None


def _beside_patches(state: State) -> set[Cell]:
    """The cells beside a patch that nobody has decided."""
    belief = state.belief
    beside = {near for cell in belief.roi for near in cell.neighbours()}
    return {cell for cell in beside if belief.verdict(cell) is None}


def _nearest(
    setting: Setting, state: State, vehicle: VehicleState, cells: Collection[Cell]
) -> GridPoint | None:
    """Where the nearest of some cells is, of equal ones the lowest; None where there is none."""
    places = (where(setting, state, cell) for cell in sorted(cells))
    return min(places, key=vehicle.position.distance_to, default=None)


def _out_of_reach(setting: Setting, state: State, vehicle: VehicleState) -> State:
    """A full battery does not get there and back: somebody nearer, or nobody, will."""
    alone = not any(
        other.phase in (Phase.AIRBORNE, Phase.GROUNDED)
        for other in state.vehicles.values()
        if other.vehicle != vehicle.vehicle
    )
    searches = state.tree is None and any(v.lanes for v in state.vehicles.values())
    if alone and setting.nonstop and not state.falls_back and not searches:
        return give_up_rest(setting, state)
    if alone and vehicle.vertex is not None:
        return mark_unreachable(state, vehicle, vehicle.vertex)
    note = "its next place is out of reach on a full battery"
    return state.with_vehicle(vehicle.stood_down(Phase.FAILED, note))
