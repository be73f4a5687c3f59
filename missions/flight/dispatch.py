"""What idle vehicles do next.

A vehicle in the air comes home when called, when the battery or the camera says so, or when all
is done (`missions.flight.return_home`); it searches until the ROI is found
(`missions.flight.strategy.searching`), then explores (`missions.flight.strategy.stepwise`). No
order is given that would take a vehicle out of its fence, beyond its energy, or through air that
another vehicle has reserved (`missions.flight.airspace.airspace`).
"""

from __future__ import annotations

from dataclasses import replace

from shapely.geometry import Point

from missions.flight.airspace.airspace import Airspace
from missions.flight.return_home import fly_home, has_energy_for, turn_back
from missions.flight.setting import Setting
from missions.flight.state import Phase, State, VehicleState
from missions.flight.strategy.lane_passes import drop_seen
from missions.flight.strategy.searching import find_work
from missions.mission.energy import FRESH
from missions.mission.height_and_speed import LEAST_HEIGHT_M
from missions.orders import AwaitBattery, TakeOff

MOST_FRUITLESS_SORTIES = 3
"""After so many in a row the next place counts as out of reach."""

CLIMB_ROOM_M = 0.5
"""A climb strays from where it began by less than this."""


def assign(setting: Setting, state: State) -> State:
    """The state with an order for everybody who can have one."""
    if state.tree is None:
        state = drop_seen(setting, state)
    strategy = setting.strategy.in_force(state)
    if state.tree is None and setting.lanes:
        state = strategy.searched(setting, state)
    state = Airspace(setting, state).stop_conflicting()
    for number in state.our_numbers:
        state = turn_back(setting, state, state.vehicles[number])
    state = strategy.plan(setting, state)
    for number in state.our_numbers:
        vehicle = state.vehicles[number]
        if vehicle.idle and vehicle.phase is Phase.AIRBORNE:
            state = _airborne(setting, state, vehicle)
        elif vehicle.phase is Phase.GROUNDED and not isinstance(vehicle.order, TakeOff):
            state = _grounded(setting, state, vehicle)
    return state


def _airborne(setting: Setting, state: State, vehicle: VehicleState) -> State:
    if vehicle.braking_until_s is not None:
        return state.holding(vehicle)
    if (first := setting.team.urgent_order(setting, state, vehicle)) is not None:
        return first
    if vehicle.return_reason is not None:
        return fly_home(setting, state, vehicle)
    if (given_way := Airspace(setting, state).make_way(vehicle)) is not None:
        return given_way
    if state.paused:
        return state.holding(vehicle)
    return setting.strategy.in_force(state).next_order(setting, state, vehicle)


def _grounded(setting: Setting, state: State, vehicle: VehicleState) -> State:
    """Take off, wait for a battery, or stay."""
    if state.exploration_finished or state.recalled or vehicle.called_home:
        done = vehicle.stood_down(Phase.FINISHED, vehicle.note)
        return state.with_vehicle(replace(done, vertex=None))
    if not vehicle.idle:
        return state
    if not vehicle.cleared:
        return state.with_vehicle(replace(vehicle, order=AwaitBattery()))
    strategy = setting.strategy.in_force(state)
    if state.paused or not strategy.may_take_off(state):
        return state
    if state.tree is None and vehicle.idle_in_search:
        state = find_work(setting, state, vehicle)
        vehicle = state.vehicles[vehicle.vehicle]
    heights = setting.heights
    vehicle = replace(vehicle, cruise_altitude_m=heights.layer_m(setting, vehicle))
    target = strategy.first_target(setting, state, vehicle)
    if target is None:
        return strategy.without_target(setting, state, vehicle)
    if refusal := _unfit(setting, vehicle):
        return state.with_vehicle(vehicle.stood_down(Phase.FAILED, refusal))
    if vehicle.fruitless_sorties >= MOST_FRUITLESS_SORTIES:
        return _out_of_reach(setting, state, vehicle)
    if not has_energy_for(setting, vehicle, target, setting.look_s):
        if vehicle.remaining_wh < FRESH * setting.energy.capacity_wh:
            return state.with_vehicle(replace(vehicle, order=AwaitBattery()))
        return _out_of_reach(setting, state, vehicle)
    order = TakeOff(heights.take_off_height_m(setting, state, vehicle))
    return Airspace(setting, state).reserve_or_wait(vehicle, order)


def _unfit(setting: Setting, vehicle: VehicleState) -> str:
    """Why a vehicle may not take off from where it stands; empty if it may."""
    if not setting.fence.contains(vehicle.position):
        return "it stands outside of the geofence; move it, or the fence"
    if refusal := setting.team.refusal(setting, vehicle):
        return refusal
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


def _out_of_reach(setting: Setting, state: State, vehicle: VehicleState) -> State:
    """A full battery does not get there and back: somebody nearer, or nobody, will."""
    alone = not any(
        other.phase in (Phase.AIRBORNE, Phase.GROUNDED)
        for other in state.vehicles.values()
        if other.vehicle != vehicle.vehicle
    )
    if alone:
        given_up = setting.strategy.in_force(state).give_up_far(setting, state, vehicle)
        if given_up is not None:
            return given_up
    note = "its next place is out of reach on a full battery"
    return state.with_vehicle(vehicle.stood_down(Phase.FAILED, note))
