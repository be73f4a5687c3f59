"""The reducer: the effect of an event, and the next order of each idle vehicle.

    step(state, event) -> (state, orders)

The function is pure: the same state and event give the same orders. So a resume, a replay and a
test are one mechanism. No order takes a vehicle out of its fence, beyond its energy, or through air
that another vehicle has reserved (`missions.flight.airspace.airspace`).
"""

from __future__ import annotations

from dataclasses import replace

from shapely.geometry import Point

from missions.events import AutopilotText, Event, FrameWeighed
from missions.flight.airspace.airspace import Airspace
from missions.flight.operator_orders import failsafe_explained, respond_to_traffic
from missions.flight.return_home import fly_home, has_energy_for, turn_back
from missions.flight.state import Setting, State
from missions.flight.strategy.lane_paths import drop_seen
from missions.flight.strategy.searching import find_work
from missions.flight.transitions import apply
from missions.flight.vehicle_state import Phase, VehicleState
from missions.mission.energy import FRESH
from missions.mission.height_and_speed import MIN_HEIGHT_M
from missions.orders import AwaitBattery, Order, TakeOff

Orders = tuple[tuple[int, Order], ...]

MAX_FRUITLESS_SORTIES = 3
"""Maximum number of sorties in a row without progress to one place."""
CLIMB_ROOM_M = 0.5
"""Maximum distance of a climb from its starting point, m."""


def step(state: State, event: Event) -> tuple[State, Orders]:
    """Return the state after an event, and the new orders by vehicle. An order holds until it ends
    or until another replaces it."""
    if isinstance(event, AutopilotText):  # texts move no vehicle, and no plan depends on their time
        return failsafe_explained(state, event), ()
    if isinstance(event, FrameWeighed):  # for maps of recorded pictures; no flight plans with it
        return state, ()
    after = assign(respond_to_traffic(apply(state, event)))
    orders = tuple(
        (number, vehicle.order)
        for number, vehicle in after.vehicles.items()
        if vehicle.order is not None
        and vehicle.order is not state.vehicles[number].order
        and number in after.our_numbers
    )
    return after, orders


def assign(state: State) -> State:
    """Return the state with an order for each vehicle that can have one."""
    if state.tree is None:
        state = drop_seen(state)
    strategy = state.setting.strategy.in_force(state)
    if state.tree is None and state.setting.lanes and not strategy.flies_all_lanes:
        # the search is over once no vehicle has a lane or a suspicion
        done = all(v.idle_in_search for v in state.vehicles.values())
        state = replace(state, exhausted=done)
    state = Airspace(state).stop_conflicting()
    for number in state.our_numbers:
        state = turn_back(state, state.vehicles[number])
    state = strategy.plan(state)
    for number in state.our_numbers:
        vehicle = state.vehicles[number]
        if vehicle.idle and vehicle.phase is Phase.AIRBORNE:
            state = _airborne(state, vehicle)
        elif vehicle.phase is Phase.GROUNDED and not isinstance(vehicle.order, TakeOff):
            state = _grounded(state, vehicle)
    return state


def _airborne(state: State, vehicle: VehicleState) -> State:
    if vehicle.braking_until_s is not None:
        return state.holding(vehicle)
    if (first := state.setting.team.urgent_order(state, vehicle)) is not None:
        return first
    if vehicle.return_reason is not None:
        return fly_home(state, vehicle)
    if (given_way := Airspace(state).make_way(vehicle)) is not None:
        return given_way
    if state.is_held:
        return state.holding(vehicle)
    return state.setting.strategy.in_force(state).next_order(state, vehicle)


def _grounded(state: State, vehicle: VehicleState) -> State:
    """Give an order on the ground: take off, wait for a battery, or stay."""
    setting = state.setting
    if state.exploration_finished or state.recalled or vehicle.called_home:
        done = vehicle.stood_down(Phase.FINISHED, vehicle.note)
        return state.with_vehicle(replace(done, vertex=None))
    if not vehicle.idle:
        return state
    if not vehicle.cleared:
        return state.with_vehicle(replace(vehicle, order=AwaitBattery()))
    strategy = setting.strategy.in_force(state)
    if state.is_held or not strategy.may_take_off(state):
        return state
    if state.tree is None and vehicle.idle_in_search:
        state = find_work(state, vehicle)
        vehicle = state.vehicles[vehicle.vehicle]
    heights = setting.heights
    vehicle = replace(vehicle, cruise_altitude_m=heights.layer_m(setting, vehicle))
    target = strategy.first_target(state, vehicle)
    if target is None:
        return strategy.without_target(state, vehicle)
    if refusal := _unfit(setting, vehicle):
        return state.with_vehicle(vehicle.stood_down(Phase.FAILED, refusal))
    if vehicle.fruitless_sorties >= MAX_FRUITLESS_SORTIES:
        return _out_of_reach(state, vehicle)
    if not has_energy_for(setting, vehicle, target, setting.look_s):
        if vehicle.remaining_wh < FRESH * setting.energy.capacity_wh:
            return state.with_vehicle(replace(vehicle, order=AwaitBattery()))
        return _out_of_reach(state, vehicle)
    order = TakeOff(heights.take_off_height_m(state, vehicle))
    return Airspace(state).reserve_or_wait(vehicle, order)


def _unfit(setting: Setting, vehicle: VehicleState) -> str:
    """Return the reason that forbids a take-off from the vehicle's position; empty if none does."""
    if not setting.fence.contains(vehicle.position):
        return "it stands outside the geofence; move it, or the fence"
    if refusal := setting.team.refusal(setting, vehicle):
        return refusal
    room_m = setting.fence.outer.boundary.distance(Point(vehicle.position))
    if room_m < min(CLIMB_ROOM_M, setting.mission.fence.margin_m):
        return (
            f"it stands {room_m:.1f} m from the edge of the geofence, and may stray that far while "
            "it climbs; move it, or the fence"
        )
    if vehicle.cruise_height_m < MIN_HEIGHT_M:
        return (
            f"it stands {vehicle.home_level_m:.0f} m higher than the start, and its layer "
            f"is only {vehicle.cruise_height_m:.0f} m above it; raise flight.altitude_m"
        )
    if vehicle.wind_m_s > setting.energy.max_airspeed_m_s:
        return f"it measured a wind of {vehicle.wind_m_s:.0f} m/s, more than it can hold"
    return ""


def _out_of_reach(state: State, vehicle: VehicleState) -> State:
    """Give up places that a full battery does not reach, unless another vehicle may be nearer."""
    others = (v for n, v in state.vehicles.items() if n != vehicle.vehicle)
    if not any(other.phase in (Phase.AIRBORNE, Phase.GROUNDED) for other in others):
        given_up = state.setting.strategy.in_force(state).give_up_far(state, vehicle)
        if given_up is not None:
            return given_up
    note = "its next place is out of reach on a full battery"
    return state.with_vehicle(vehicle.stood_down(Phase.FAILED, note))
