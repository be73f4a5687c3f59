"""Who may fly where: orders are given only if their air is free.

Every vehicle flies in its layer; whoever climbs or descends claims the column over its pad
(`missions.flight.volumes`). An order that would meet a claim waits, and its vehicle holds.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from missions.flight.volumes import Volume, is_free
from missions.ground.fence import route_length_m
from missions.orders import FlyTo, Hold, Land, Look, Order, ReturnToLaunch, Sweep, TakeOff
from missions.state import Phase, Setting, State, VehicleState
from missions.units import Cell, GridPoint

RTL_HEIGHT_M = 15.0
"""ArduCopter's RTL_ALT."""
SEPARATION_BUFFER_M = 2.0
"""What two vehicles may stray towards each other while they keep their distance."""
OFF_LAYER_M = 1.5
"""A vehicle that is farther from its layer claims all heights between."""


def give_if_clear(setting: Setting, state: State, vehicle: VehicleState, order: Order) -> State:
    """Give an order if its air is free; otherwise wait where the vehicle is."""
    distance_m = _distance_m(setting)
    volume = _volume(setting, state, vehicle, order)
    others = [
        claim
        for other in state.vehicles.values()
        if other.vehicle != vehicle.vehicle
        for claim in _claims(setting, state, other, vehicle)
    ]
    if is_free(volume, others, distance_m):
        return state.with_vehicle(replace(vehicle, order=order))
    if isinstance(order, FlyTo) and vehicle.return_reason is not None:
        for detour in _detours(setting, vehicle, order, others):
            if is_free(_volume(setting, state, vehicle, detour), others, distance_m):
                return state.with_vehicle(replace(vehicle, order=detour))
    return state if vehicle.landed else hold(state, vehicle)


def hold(state: State, vehicle: VehicleState) -> State:
    """Let a vehicle wait where it is."""
    order = vehicle.order if isinstance(vehicle.order, Hold) else Hold()
    return state.with_vehicle(replace(vehicle, order=order))


def where(setting: Setting, state: State, cell: Cell) -> GridPoint:
    """Where the centre of a cell is now, in the fixed frame."""
    return setting.grid.to_fixed(setting.grid.centre_of(cell), state.t_s)


def _detours(
    setting: Setting, vehicle: VehicleState, order: FlyTo, others: Sequence[Volume]
) -> list[FlyTo]:
    """Ways home round the columns of others, the shortest first.

    A landing takes half a minute, which who comes home for a battery cannot always wait.
    """
    fence, away_m = setting.fence, 2 * _distance_m(setting)
    ways = []
    for centre in {volume.path[0] for volume in others if len(set(volume.path)) == 1}:
        for eighth in range(8):
            turn_rad = eighth * math.tau / 8
            via = GridPoint(
                centre.east_m + away_m * math.sin(turn_rad),
                centre.north_m + away_m * math.cos(turn_rad),
            )
            there, back = fence.route(vehicle.position, via), fence.route(via, vehicle.home)
            if there is not None and back is not None:
                ways.append((*there, *back))
    ways.sort(key=lambda way: (route_length_m(vehicle.position, way), way))
    return [replace(order, route=way) for way in ways]


def _distance_m(setting: Setting) -> float:
    """How far the claims of two vehicles lie apart; never so far that layers meet."""
    team = setting.mission.team
    return min(team.separation_m + SEPARATION_BUFFER_M, team.layer_m)


def _volume(setting: Setting, state: State, vehicle: VehicleState, order: Order | None) -> Volume:
    """The air that an order needs."""
    if isinstance(order, TakeOff | Land):
        return Volume((vehicle.home,), 0.0, vehicle.cruise_altitude_m)
    if isinstance(order, ReturnToLaunch):  # at a height of the autopilot's choice
        return Volume(
            (vehicle.position, vehicle.home), 0.0, max(vehicle.cruise_altitude_m, RTL_HEIGHT_M)
        )
    points: Sequence[GridPoint] = ()
    if isinstance(order, Sweep):
        points = (order.end,)
    elif isinstance(order, FlyTo):
        cell = () if order.cell is None else (where(setting, state, order.cell),)
        points = (*order.route, *cell)
    elif isinstance(order, Look):
        points = (where(setting, state, order.cell),)
    low_m = high_m = vehicle.cruise_altitude_m
    if abs(vehicle.height_m - vehicle.cruise_altitude_m) > OFF_LAYER_M:
        low_m, high_m = sorted((vehicle.height_m, vehicle.cruise_altitude_m))
    stray_m = 0.0
    if vehicle.braking_until_s is not None:  # what it flew since its last report, and its braking
        speed, accel = setting.energy.speed_m_s, setting.energy.accel_m_s2
        stray_m = speed + speed**2 / (2 * accel)
    return Volume((vehicle.position, *points), low_m, high_m, stray_m)


def _claims(
    setting: Setting, state: State, other: VehicleState, asking: VehicleState
) -> list[Volume]:
    """The air that another vehicle claims, as far as it binds the one that asks."""
    climbing = isinstance(other.order, TakeOff)
    if other.landed and not climbing:
        return []
    here = Volume((asking.position,), asking.cruise_altitude_m, asking.cruise_altitude_m)
    claim = _volume(setting, state, other, other.order)
    claims = [claim]
    if other.phase is not Phase.AIRBORNE and not climbing and not asking.landed:
        # nobody can tell it to make way: who is near it must be free to leave
        claims = [] if here.meets(claim, _distance_m(setting)) else [claim]
    if other.over_home and other.idle:
        # it waits to land; whoever is in its column already must be free to leave
        column = Volume((other.home,), 0.0, other.cruise_altitude_m)
        if not asking.landed and not here.meets(column, _distance_m(setting)):
            claims.append(column)
    return claims
