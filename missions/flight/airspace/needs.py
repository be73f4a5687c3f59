"""The air that a vehicle needs: for an order, while it hovers, or while it may be uncontrolled.

Every vehicle flies in its layer. One that climbs or descends needs the column over its pad. Heights
are measured from one level, so homes need not be level.
"""

from __future__ import annotations

from dataclasses import replace

from missions.flight.state import Setting, State
from missions.flight.vehicle_state import OFF_LAYER_M, Column, Phase, VehicleState
from missions.geo.trajectory import places_ahead
from missions.geo.volumes import Volume
from missions.orders import FlyPath, FlyTo, Land, Look, Order, ReturnToLaunch, Sweep, TakeOff
from missions.units import GridPoint

RTL_HEIGHT_M = 30.0
"""Maximum expected height of an autopilot's return above home, m (PX4: 30 m, ArduCopter: 15 m)."""
RESERVED_AHEAD_S = 8.0
"""Reserved part of a path, s: longer than the stop before another vehicle's air takes."""
SILENT_AHEAD_S = 12.0
"""Reserved part of a silent vehicle's path from its last report on, s. Five until its link counts
as lost, one until its stream ends, and the time to stop."""


def hover_air(vehicle: VehicleState, place: GridPoint | None = None) -> Volume:
    """Return the air of a vehicle that hovers in its layer, at its position or at `place`."""
    layer_m = vehicle.cruise_altitude_m
    return Volume((place or vehicle.position,), layer_m, layer_m)


def column_air(column: Column) -> Volume:
    """Return the air of a column."""
    return Volume((column.place,), column.low_m, column.high_m)


def needed_air(
    state: State, vehicle: VehicleState, order: Order | None, ahead_s: float = RESERVED_AHEAD_S
) -> Volume:
    """Return the air that an order needs now; of a path, the next `ahead_s` seconds."""
    top_m = max(vehicle.cruise_altitude_m, vehicle.level_m)
    if isinstance(order, TakeOff):
        return Volume((vehicle.position,), vehicle.home_level_m, top_m)
    if isinstance(order, Land):
        return Volume((vehicle.pad,), vehicle.home_level_m, top_m)
    low_m = high_m = vehicle.cruise_altitude_m
    if abs(vehicle.level_m - low_m) > OFF_LAYER_M:
        own_m, level_m = state.setting.mission.altitude_m(vehicle.vehicle - 1), vehicle.level_m
        in_own = abs(level_m - own_m) <= OFF_LAYER_M  # it is still in its layer
        low_m, high_m = sorted((own_m if in_own else level_m, low_m))
    stray_m = 0.0 if vehicle.braking_until_s is None else stopping_m(state.setting)
    return Volume((vehicle.position, *_places(state, order, ahead_s)), low_m, high_m, stray_m)


def uncontrolled_air(state: State, vehicle: VehicleState) -> list[Volume]:
    """Return the air in which a vehicle that cannot be commanded may be. A silent vehicle continues
    its last order. Its failsafe may return it home from anywhere on that order, at its return
    height. A returning vehicle flies straight home. A pilot flies anywhere near."""
    low_m = vehicle.home_level_m
    # it returns level, at a height above home, also where the ground is lower than its highest
    # point
    returns_m = max(vehicle.level_m, vehicle.cruise_altitude_m, low_m + RTL_HEIGHT_M)
    top_m = returns_m + state.setting.relief_m
    order = vehicle.last_order if vehicle.phase is Phase.OFFLINE else vehicle.order
    if isinstance(order, TakeOff | Land):
        return [Volume((vehicle.pad,), low_m, top_m), Volume((vehicle.position,), low_m, top_m)]
    column = Volume((vehicle.home,), low_m, top_m)
    if vehicle.phase is Phase.OFFLINE:
        leg = needed_air(state, vehicle, order)
        if isinstance(order, FlyPath):
            # its stream continues until its link counts as lost; then it brakes
            along = places_ahead(order.trajectory, vehicle.tracked_s, SILENT_AHEAD_S)
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
    """Return the distance that a vehicle flies between two reports and until it has stopped, m."""
    speed, accel = setting.energy.speed_m_s, setting.energy.accel_m_s2
    return speed + speed**2 / (2 * accel)


def _places(state: State, order: Order | None, ahead_s: float) -> tuple[GridPoint, ...]:
    """Return the places that an order leads to, in the fixed frame."""
    if isinstance(order, Sweep):
        return (order.end,)
    if isinstance(order, FlyTo):
        cell = () if order.cell is None else (state.setting.where(order.cell, state.t_s),)
        return (*order.route, *cell)
    if isinstance(order, Look):
        return (state.setting.where(order.cell, state.t_s),)
    if isinstance(order, FlyPath):
        return places_ahead(order.trajectory, state.t_s, ahead_s)
    return ()
