"""The air that a vehicle needs: for an order, while it hovers, or where it may be uncontrolled.

Every vehicle flies in its layer; one that climbs or descends needs the column over its pad. Heights
are above one level, so homes need not be level.
"""

from __future__ import annotations

from dataclasses import replace

from missions.flight.state import Setting, State
from missions.flight.vehicle_state import OFF_LAYER_M, Column, Phase, VehicleState
from missions.geo.trajectory import Trajectory
from missions.geo.volumes import Volume
from missions.orders import FlyPath, FlyTo, Land, Look, Order, ReturnToLaunch, Sweep, TakeOff
from missions.units import GridPoint

RTL_HEIGHT_M = 30.0
"""Greatest height above home that is expected of an autopilot's return, m: PX4's; ArduCopter's is
15 m."""
AHEAD_S = 8.0
"""Part of a path that is reserved, s: more than it takes to come to rest for another's air."""
SILENT_AHEAD_S = 12.0
"""The same of a silent vehicle from its last report on, s: five until its link counts as lost, one
until its stream ends, and what it takes to come to rest."""
_AHEAD_STEP_S = 0.5
_REMEMBERED = 256
_PLACES: dict[tuple[int, float, float], tuple[Trajectory, tuple[GridPoint, ...]]] = {}
"""Where paths lead. A path is kept with its answer, so that no other can have its id."""


def hover_air(vehicle: VehicleState, place: GridPoint | None = None) -> Volume:
    """Return the air of a vehicle that hovers in its layer where it is, or at a place."""
    layer_m = vehicle.cruise_altitude_m
    return Volume((place or vehicle.position,), layer_m, layer_m)


def column_air(column: Column) -> Volume:
    """Return the air of a column."""
    return Volume((column.place,), column.low_m, column.high_m)


def needed_air(state: State, vehicle: VehicleState, order: Order | None) -> Volume:
    """Return the air that an order needs now."""
    top_m = max(vehicle.cruise_altitude_m, vehicle.level_m)
    if isinstance(order, TakeOff):
        return Volume((vehicle.position,), vehicle.home_level_m, top_m)
    if isinstance(order, Land):
        return Volume((vehicle.pad,), vehicle.home_level_m, top_m)
    low_m = high_m = vehicle.cruise_altitude_m
    if abs(vehicle.level_m - vehicle.cruise_altitude_m) > OFF_LAYER_M:
        low_m, high_m = sorted((vehicle.level_m, vehicle.cruise_altitude_m))
    stray_m = 0.0 if vehicle.braking_until_s is None else stopping_m(state.setting)
    return Volume((vehicle.position, *_places(state, order)), low_m, high_m, stray_m)


def uncontrolled_air(state: State, vehicle: VehicleState) -> list[Volume]:
    """Return the air in which a vehicle may be that cannot be commanded.

    A silent one flies on with its last order, and its failsafe may bring it home from anywhere on
    that, at its return height. One that returns flies straight home. A pilot flies anywhere near.
    """
    low_m = vehicle.home_level_m
    # it returns level, at a height above home, also over ground that is lower than the highest
    returns_m = max(vehicle.level_m, vehicle.cruise_altitude_m, low_m + RTL_HEIGHT_M)
    top_m = returns_m + state.setting.relief_m
    order = vehicle.last_order if vehicle.phase is Phase.OFFLINE else vehicle.order
    if isinstance(order, TakeOff | Land):
        return [Volume((vehicle.pad,), low_m, top_m), Volume((vehicle.position,), low_m, top_m)]
    column = Volume((vehicle.home,), low_m, top_m)
    if vehicle.phase is Phase.OFFLINE:
        leg = needed_air(state, vehicle, order)
        if isinstance(order, FlyPath):
            # its stream is sent on until its link is called lost, and then it brakes
            along = _next_places(order, vehicle.tracked_s, SILENT_AHEAD_S)
            leg = replace(leg, path=(vehicle.position, *along), stray_m=stopping_m(state.setting))
        back = Volume(
            (*leg.path, vehicle.home), min(leg.low_m, vehicle.level_m), top_m, leg.stray_m
        )
        return [leg, back, column]
    if vehicle.returns_by_itself or isinstance(order, ReturnToLaunch):
        back = Volume((vehicle.position, vehicle.home), min(vehicle.level_m, top_m), top_m)
        return [back, column, Volume((vehicle.position,), low_m, top_m)]
    here_m = vehicle.level_m
    low_m, high_m = min(low_m, here_m), here_m + OFF_LAYER_M
    return [Volume((vehicle.position,), low_m, high_m, stopping_m(state.setting))]


def stopping_m(setting: Setting) -> float:
    """Return what a vehicle flies between two of its reports and until it has come to rest, m."""
    speed, accel = setting.energy.speed_m_s, setting.energy.accel_m_s2
    return speed + speed**2 / (2 * accel)


def _places(state: State, order: Order | None) -> tuple[GridPoint, ...]:
    """Where an order leads, in the fixed frame."""
    if isinstance(order, Sweep):
        return (order.end,)
    if isinstance(order, FlyTo):
        cell = () if order.cell is None else (state.setting.where(order.cell, state.t_s),)
        return (*order.route, *cell)
    if isinstance(order, Look):
        return (state.setting.where(order.cell, state.t_s),)
    if isinstance(order, FlyPath):
        return _next_places(order, state.t_s)
    return ()


def _next_places(order: FlyPath, t_s: float, ahead_s: float = AHEAD_S) -> tuple[GridPoint, ...]:
    """Where a path leads in the next seconds, until it could have come to rest."""
    path = order.trajectory
    question = (id(path), t_s, ahead_s)  # to hash or compare whole paths would take as long
    known = _PLACES.get(question)
    if known is not None and known[0] is path:
        return known[1]
    begin_s = max(t_s, path.begin_s)
    end_s = max(begin_s, min(begin_s + ahead_s, path.end_s))
    steps = max(1, round((end_s - begin_s) / _AHEAD_STEP_S))
    share_s = end_s - begin_s
    places = tuple(path.place_at(begin_s + share_s * k / steps) for k in range(steps + 1))
    if len(_PLACES) >= _REMEMBERED:
        _PLACES.clear()
    _PLACES[question] = path, places
    return places
