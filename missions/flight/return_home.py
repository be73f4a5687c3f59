"""Coming home: when a vehicle must turn back, and its path home."""

from __future__ import annotations

import math
from dataclasses import replace

from missions.flight.airspace.airspace import Airspace
from missions.flight.airspace.needs import RTL_HEIGHT_M
from missions.flight.lane_progress import set_free
from missions.flight.path_orders import brake
from missions.flight.state import Setting, State
from missions.flight.vehicle_state import OFF_LAYER_M, Phase, ReturnReason, VehicleState
from missions.geo.braking import braked
from missions.geo.fence import first_part, route_length_m
from missions.mission.height_and_speed import MIN_HEIGHT_M
from missions.orders import FlyPath, Hold, Land, Order, TakeOff
from missions.traffic import Answer
from missions.units import GridPoint

PARTIAL_RETURN_SHARES = (0.75, 0.5, 0.25)
"""Shares of a return path that are tried if it is blocked farther on."""
MIN_PARTIAL_RETURN_M = 40.0
"""Shortest part of a return path that is worth flying, m."""
REACTION_S = 3.0
"""Time between two battery reports, and until a vehicle has turned round, s."""
ORDER_DELAY_S = 1.0
"""Time that a vehicle stays on its path before it receives the order to return, s."""
REST_S = 2.0
"""Time until a vehicle is seen to be at rest and has turned round, s."""
HOMEWARD_M = 10.0
"""Maximum distance from its pad to the end of a path that leads home, m."""
LANDING_BESIDE_M = 20.0
"""Distance of a landing beside the pad, m; its energy is reserved while the pad is blocked."""


def turn_back(state: State, vehicle: VehicleState) -> State:
    """Interrupt a vehicle's task once it has to return."""
    flees = state.traffic.answer is Answer.COME_HOME and not state.exploration_finished
    called = state.recalled or vehicle.called_home
    if vehicle.flees and not flees:
        vehicle = _no_longer_flees(state, vehicle, called=called)
        state = state.with_vehicle(vehicle)
    called = called or flees
    done = ReturnReason.TRAFFIC if flees else ReturnReason.RECALLED if called else ReturnReason.DONE
    if called or (state.exploration_finished and not flies_home(vehicle)):
        if isinstance(vehicle.order, TakeOff):  # it ends where it began, motors on or not
            up = replace(vehicle, phase=Phase.AIRBORNE, landed=False, return_reason=done)
            return state.with_vehicle(replace(up, over_home=True, order=Land()))
        if isinstance(vehicle.order, FlyPath) and vehicle.works and not called:
            return brake(state, vehicle, vehicle.order)  # the place where it stops is known
        return send_home(state, vehicle, done) if vehicle.works else state
    if not vehicle.works:
        return state
    wind_m_s, outside = vehicle.wind_m_s, not state.setting.fence.contains(vehicle.position)
    if outside or wind_m_s > state.setting.energy.max_airspeed_m_s:
        wind = f"the wind of {wind_m_s:.0f} m/s is more than it can hold"
        note = "it was outside the geofence" if outside else wind
        return send_home(state, replace(vehicle, note=note), ReturnReason.FAULT)
    if not _can_still_turn(state, vehicle):
        reason = done if state.exploration_finished else ReturnReason.BATTERY
        return send_home(state, vehicle, reason)
    return _come_lower(state, vehicle) if state.exploration_finished else state


def _no_longer_flees(state: State, vehicle: VehicleState, *, called: bool) -> VehicleState:
    """Return a vehicle after the traffic: it works again, or flies on home for another reason."""
    if called:
        return replace(vehicle, return_reason=ReturnReason.RECALLED)
    if state.exploration_finished:
        return replace(vehicle, return_reason=ReturnReason.DONE)
    if not _can_still_turn(state, vehicle):
        return replace(vehicle, return_reason=ReturnReason.BATTERY)
    return replace(vehicle.interrupted(state.t_s), spare_pad=None, return_reason=None)


def flies_home(vehicle: VehicleState) -> bool:
    """Return whether a vehicle's path leads home; a stop before it would only take time."""
    path = vehicle.path if vehicle.works else None
    return path is not None and path.place_at(path.end_s).distance_to(vehicle.pad) <= HOMEWARD_M


def _come_lower(state: State, vehicle: VehicleState) -> State:
    """Have a vehicle descend on its path home, to the lowest layer in which all of it is clear."""
    mission, order = state.setting.mission, vehicle.order
    descends = mission.flight.descent_m_s is not None and state.setting.team.climbs_on_path
    for number in range(vehicle.vehicle - 1 if descends else 0):
        layer_m = max(mission.altitude_m(number), vehicle.home_level_m + MIN_HEIGHT_M)
        if layer_m < vehicle.cruise_altitude_m and isinstance(order, FlyPath):
            lower = replace(vehicle, cruise_altitude_m=layer_m)
            down = replace(order, height_m=lower.cruise_height_m)
            if (given := Airspace(state, ahead_s=math.inf).reserve(lower, down)) is not None:
                return given
    return state


def _can_still_turn(state: State, vehicle: VehicleState) -> bool:
    """Return whether the return may begin later than now. A vehicle on a path continues until it
    has received the order and has stopped."""
    setting = state.setting
    if _stalls(state, vehicle):
        return False
    path = vehicle.path
    if path is None:
        return has_energy_for(setting, vehicle, vehicle.position, hover_s=REACTION_S)
    stop = braked(path, max(path.begin_s, state.t_s + ORDER_DELAY_S), setting.energy.accel_m_s2)
    return has_energy_for(setting, vehicle, stop.at(stop.end_s).place, hover_s=REST_S)


def has_energy_for(
    setting: Setting, vehicle: VehicleState, target: GridPoint, hover_s: float
) -> bool:
    """Return whether a vehicle can fly to a point, hover, return, land, and keep its reserve."""
    energy, fence = setting.energy.in_wind(vehicle.wind_m_s), setting.fence
    there = () if target == vehicle.position else fence.route(vehicle.position, target) or (target,)
    out_m = route_length_m(vehicle.position, there)
    layer_m = vehicle.cruise_height_m
    back = return_route(setting, target, vehicle.pad)
    home_m = route_length_m(target, back)
    need_wh = energy.hover_wh(hover_s, vehicle.drawn_w)
    if setting.ground is not None:
        way = (vehicle.position, *there, *back) if there else (target, *back)
        need_wh += energy.relief_wh(setting.ups_and_downs_m(way), vehicle.drawn_w)
    need_wh += energy.home_wh(home_m, max(layer_m, vehicle.height_m), vehicle.drawn_w)
    if out_m > 0.0:
        need_wh += energy.leg_wh(out_m, vehicle.drawn_w)
    climb_m = max(layer_m - vehicle.height_m, 0.0)
    if climb_m > OFF_LAYER_M:
        need_wh += energy.hover_wh(climb_m / energy.climb_m_s + 5.0, vehicle.drawn_w)
    return vehicle.remaining_wh >= need_wh


def return_route(setting: Setting, start: GridPoint, pad: GridPoint) -> tuple[GridPoint, ...]:
    """Return the way to a pad inside the margin; to a pad in the margin the end is straight."""
    return setting.fence.route(start, pad) or setting.fence.route_near(start, pad) or (pad,)


def go_home(state: State, vehicle: VehicleState, reason: ReturnReason) -> State:
    """Send a vehicle home and give it its first order for that."""
    state = send_home(state, vehicle, reason)
    return fly_home(state, state.vehicles[vehicle.vehicle])


def fly_home(state: State, vehicle: VehicleState) -> State:
    """Give the next order to a returning vehicle, once it is at rest."""
    if vehicle.braking_until_s is not None:
        return state.holding(vehicle)
    if vehicle.is_over_pad:
        vehicle = replace(vehicle, over_home=True)  # it may be half-way down: it need not climb
    after = Airspace(state).reserve_or_wait(vehicle, home_order(state.setting, vehicle))
    if not isinstance(after.vehicles[vehicle.vehicle].order, Hold):
        return after
    away = not vehicle.over_home
    if away and (given := _home_at_its_height(state, vehicle) or _come_nearer(state, vehicle)):
        return given
    stalls = away and _stalls(state, vehicle)
    urgent = stalls or not _can_wait(state.setting, vehicle)
    # a member of a fleet that comes from afar has no column of its own but that over its pad
    descends = vehicle.over_home or state.setting.team.climbs_on_path
    if urgent and descends and (given := _land_beside(state, vehicle)):
        return given
    if stalls:  # the air may be free; the battery will certainly be empty
        note = "its return path stayed blocked: its autopilot returns it (RTL)"
        return state.with_vehicle(vehicle.left_to_autopilot(note))
    return after


def _home_at_its_height(state: State, vehicle: VehicleState) -> State | None:
    """Return the state in which a vehicle above its layer returns at its height. A vehicle that
    waits below for its own return would block the descent for as long as both have energy."""
    above = vehicle.level_m - vehicle.cruise_altitude_m > OFF_LAYER_M
    if not above or not state.setting.team.climbs_on_path:
        return None
    level = replace(vehicle, cruise_altitude_m=vehicle.level_m)
    return Airspace(state).reserve(level, home_order(state.setting, level))


def _come_nearer(state: State, vehicle: VehicleState) -> State | None:
    """Fly a part of a return path whose air is reserved farther on. A vehicle that waited where it
    is would use up the energy for its own return."""
    route = return_route(state.setting, vehicle.position, vehicle.pad)
    length_m, air = route_length_m(vehicle.position, route), Airspace(state)
    parts_m = [share * length_m for share in PARTIAL_RETURN_SHARES]
    long_m = [part_m for part_m in parts_m if part_m >= MIN_PARTIAL_RETURN_M]
    legs = (vehicle.leg(first_part(vehicle.position, route, part_m)) for part_m in long_m)
    return next(filter(None, (air.reserve(vehicle, leg) for leg in legs)), None)


def _stalls(state: State, vehicle: VehicleState) -> bool:
    """Return whether an uncontrolled vehicle blocks the return path until the last moment. After
    that moment the autopilot, which climbs first, cannot bring it home with the reserve."""
    air, setting, energy = Airspace(state), state.setting, state.setting.energy
    if not air.uncontrolled_but(vehicle):
        return False
    returns_m = max(RTL_HEIGHT_M, vehicle.cruise_height_m) + setting.relief_m
    climb_m = max(returns_m - vehicle.height_m, 0.0)
    hover_s = 2.0 * REACTION_S + climb_m / energy.climb_m_s + climb_m / energy.descent_m_s
    enough = has_energy_for(setting, vehicle, vehicle.position, hover_s)
    return not enough and not air.is_clear(vehicle, home_order(setting, vehicle))


def _can_wait(setting: Setting, vehicle: VehicleState) -> bool:
    """Return whether the energy allows to wait, and to land beside the pad with the reserve."""
    beside_s = LANDING_BESIDE_M / setting.energy.speed_m_s
    return has_energy_for(setting, vehicle, vehicle.position, hover_s=REACTION_S + beside_s)


def _land_beside(state: State, vehicle: VehicleState) -> State | None:
    """Land beside a pad that stays blocked, while the reserve is whole."""
    air = Airspace(state)
    for spot in air.places_beside_pad(vehicle):
        elsewhere = replace(vehicle, spare_pad=spot, over_home=False)
        order = home_order(state.setting, elsewhere)
        landing = replace(elsewhere, position=spot, over_home=True)
        if air.is_clear(landing, Land()) and (given := air.reserve(elsewhere, order)) is not None:
            return given
    return None


def send_home(state: State, vehicle: VehicleState, reason: ReturnReason) -> State:
    """Interrupt a vehicle's task, and send it home for a reason."""
    fruitless = 0 if vehicle.on_lane and vehicle.lane_seen_m else vehicle.fruitless_sorties
    # the next sortie continues with the unseen rest
    left = set_free(vehicle, state.setting.grid.cell_m)
    return state.with_vehicle(
        replace(
            left.interrupted(state.t_s),
            return_reason=reason,
            fruitless_sorties=fruitless + (reason is ReturnReason.BATTERY and not state.is_held),
        )
    )


def home_order(setting: Setting, vehicle: VehicleState) -> Order:
    """Return the order to fly over the pad, or to land if the vehicle is there."""
    if vehicle.over_home:
        return Land()
    return vehicle.leg(return_route(setting, vehicle.position, vehicle.pad))
