"""Coming home: when a vehicle must turn back, and how it gets there."""

from __future__ import annotations

from dataclasses import replace

from missions.energy import CLIMB_SPEED_M_S
from missions.flight.deconfliction import OFF_LAYER_M, give_if_clear, hold
from missions.ground.fence import route_length_m
from missions.ground.lanes import rest_of
from missions.orders import FlyTo, Land, Order, TakeOff
from missions.state import Phase, ReturnReason, Setting, State, VehicleState
from missions.units import GridPoint

REACTION_S = 3.0
"""Between two reports of the battery, and until a vehicle has turned round."""
OVER_HOME_M = 1.0
"""A vehicle that is nearer to home may land."""
PROGRESS_M = 1.0
"""A sortie that searched less of a lane was in vain."""


def turn_back(setting: Setting, state: State, vehicle: VehicleState) -> State:
    """Interrupt whatever a vehicle does once it has to come home."""
    if isinstance(vehicle.order, TakeOff) and (state.recalled or state.exploration_finished):
        return _call_off(state, vehicle)
    if vehicle.phase is not Phase.AIRBORNE or vehicle.return_reason is not None:
        return state
    if state.recalled:
        return send_home(state, vehicle, ReturnReason.RECALLED)
    if state.exploration_finished:
        return send_home(state, vehicle, ReturnReason.DONE)
    if not setting.fence.contains(vehicle.position):
        vehicle = replace(vehicle, note="it was outside of the geofence")
        return send_home(state, vehicle, ReturnReason.FAULT)
    if not has_energy_for(setting, vehicle, vehicle.position, hover_s=REACTION_S):
        return send_home(state, vehicle, ReturnReason.BATTERY)
    return state


def _call_off(state: State, vehicle: VehicleState) -> State:
    """A take-off that is under way ends where it began, whether the motors turn yet or not."""
    return_reason = ReturnReason.RECALLED if state.recalled else ReturnReason.DONE
    called_off = replace(vehicle, phase=Phase.AIRBORNE, landed=False, return_reason=return_reason)
    return state.with_vehicle(replace(called_off, over_home=True, order=Land()))


def has_energy_for(
    setting: Setting, vehicle: VehicleState, target: GridPoint, hover_s: float
) -> bool:
    """Whether a vehicle can fly to a point, hover there, come home, land, and keep its reserve."""
    energy, fence = setting.energy, setting.fence
    there = () if target == vehicle.position else fence.route(vehicle.position, target) or (target,)
    back = fence.route(target, vehicle.home) or (vehicle.home,)
    out_m = route_length_m(vehicle.position, there)
    need_wh = energy.hover_wh(hover_s, vehicle.drawn_w) + energy.home_wh(
        route_length_m(target, back), vehicle.cruise_altitude_m, vehicle.drawn_w
    )
    if out_m > 0.0:
        need_wh += energy.leg_wh(out_m, vehicle.drawn_w)
    climb_m = max(vehicle.cruise_altitude_m - vehicle.height_m, 0.0)
    if climb_m > OFF_LAYER_M:
        need_wh += energy.hover_wh(climb_m / CLIMB_SPEED_M_S + 5.0, vehicle.drawn_w)
    return vehicle.remaining_wh >= need_wh


def go_home(setting: Setting, state: State, vehicle: VehicleState, reason: ReturnReason) -> State:
    """Send a vehicle home and give it its first order to that end."""
    state = send_home(state, vehicle, reason)
    return fly_home(setting, state, state.vehicles[vehicle.vehicle])


def fly_home(setting: Setting, state: State, vehicle: VehicleState) -> State:
    """The next order of a vehicle that comes home, once it is at rest."""
    if vehicle.braking_until_s is not None:
        return hold(state, vehicle)
    if vehicle.position.distance_to(vehicle.home) <= OVER_HOME_M:
        # it is there already, perhaps half-way down: no need to climb first
        vehicle = replace(vehicle, over_home=True)
    return give_if_clear(setting, state, vehicle, home_order(setting, vehicle))


def send_home(state: State, vehicle: VehicleState, return_reason: ReturnReason) -> State:
    """Take back what a vehicle was ordered and send it home for a reason."""
    lanes, fruitless_sorties = vehicle.lanes, vehicle.fruitless_sorties
    if vehicle.on_lane and lanes:  # the next sortie goes on where this one left the lane
        rest = rest_of(lanes[0], vehicle.position)
        if rest[0].distance_to(lanes[0][0]) >= PROGRESS_M:
            fruitless_sorties = 0
        lanes = (rest, *lanes[1:])
    return state.with_vehicle(
        replace(
            vehicle.interrupted(state.t_s),
            return_reason=return_reason,
            over_home=False,
            at_target=False,
            on_lane=False,
            lanes=lanes,
            fruitless_sorties=fruitless_sorties + (return_reason is ReturnReason.BATTERY),
        )
    )


def home_order(setting: Setting, vehicle: VehicleState) -> Order:
    """Fly over home, or land when there."""
    if vehicle.over_home:
        return Land()
    route = setting.fence.route(vehicle.position, vehicle.home) or (vehicle.home,)
    return FlyTo(route, None, stop=True, height_m=vehicle.cruise_altitude_m)
