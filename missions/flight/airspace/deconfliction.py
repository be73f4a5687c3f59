"""Who may fly where: orders are given only if their air is free.

Every vehicle flies in its layer; whoever climbs or descends claims the column over its pad
(`missions.flight.airspace.volumes`). An order that would meet a claim waits, and its vehicle holds.
Heights here are above the home of the vehicle that spoke first, so homes need not be level.

A vehicle that cannot be told to make way claims all the air that it may be in: a silent one flies
on with its last order, and may return by itself; a pilot or a failsafe may go anywhere near. When
such a claim changes, orders under way are checked again (`revise`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from missions.flight.airspace.volumes import Volume
from missions.flight.lane_progress import lane_left
from missions.flight.setting import Setting
from missions.flight.state import Column, Phase, State, VehicleState
from missions.geo.fence import route_length_m
from missions.geo.trajectory import Trajectory
from missions.orders import FlyPath, FlyTo, Hold, Land, Look, Order, ReturnToLaunch, Sweep, TakeOff
from missions.units import GridPoint

RTL_HEIGHT_M = 30.0
"""Up to this height above home a vehicle is expected that returns by its autopilot: the height
of PX4; that of ArduCopter is 15 m."""
SEPARATION_BUFFER_M = 2.0
"""What two vehicles may stray towards each other while they keep their distance."""
OFF_LAYER_M = 1.5
"""A vehicle that is farther from its layer claims all heights between."""
WAY_TIMES = (1.5, 2.5, 4.0)
"""How far a vehicle flies to make way, in the distances that claims keep; the nearest first."""
AHEAD_S = 8.0
"""Of a path that is flown without stopping the next seconds are claimed: more than it takes to hear
of another claim and to come to rest."""
SILENT_AHEAD_S = 12.0
"""... and of the path of a silent vehicle the seconds after it was heard last: five until its link
is called lost, one until its stream counts as ended, and what it takes to come to rest."""
_AHEAD_STEP_S = 0.5
_REMEMBERED = 256
_PLACES: dict[tuple[int, float, float], tuple[Trajectory, tuple[GridPoint, ...]]] = {}
"""Where paths lead: in one step of a mission everybody asks that of everybody else. A path is kept
with its answer, so that no other can have its number."""
CLOSED_S = 3.0
"""So much longer than was asked for air stays closed: clocks of members differ a little."""


def give_if_clear(setting: Setting, state: State, vehicle: VehicleState, order: Order) -> State:
    """Give an order if its air is free; otherwise wait where the vehicle is."""
    if is_clear(setting, state, vehicle, order):
        return state.with_vehicle(replace(vehicle, order=order))
    if isinstance(order, FlyTo) and vehicle.return_reason is not None:
        others = _claims_of_others(setting, state, vehicle, order)
        for detour in _detours(setting, vehicle, order, others):
            if is_clear(setting, state, vehicle, detour):
                return state.with_vehicle(replace(vehicle, order=detour))
    return state if vehicle.landed else hold(state, vehicle)


def is_clear(setting: Setting, state: State, vehicle: VehicleState, order: Order) -> bool:
    """Whether the air that an order needs is free of all claims that bind the vehicle."""
    others = _claims_of_others(setting, state, vehicle, order)
    if not others:
        return True
    needs, apart = _volume(setting, state, vehicle, order), _apart(setting)
    return not any(needs.meets(claim, *apart) for claim in others)


def revise(setting: Setting, state: State) -> State:
    """Stop vehicles that fly towards air claimed by one that cannot be told to make way."""
    for vehicle in state.ours:
        flying = vehicle.phase is Phase.AIRBORNE and not vehicle.landed
        if not flying or not isinstance(vehicle.order, FlyTo | Sweep | Look | FlyPath):
            continue
        if leads_into_untold(setting, state, vehicle, vehicle.order):
            state = state.with_vehicle(replace(vehicle.interrupted(state.t_s), at_target=False))
    return state


def leads_into_untold(setting: Setting, state: State, vehicle: VehicleState, order: Order) -> bool:
    """Whether an order leads through air claimed by one that cannot be told to make way.

    Who is in such air already may leave it.
    """
    others, closed = untold_but(state, vehicle), _closed(state)
    if not others and not closed:
        return False
    apart, here = _apart(setting), _here(vehicle)
    volume = _volume(setting, state, vehicle, order)
    leaves = vehicle.return_reason is not None  # on its way out of whatever air it is in
    end = replace(volume, path=volume.path[-1:])
    for claim in closed:
        # who is in it leaves it: it was not promised yet
        if not here.meets(claim, *apart) and volume.meets(claim, *apart):
            return True
    for other in others:
        for claim in _untold_claims(setting, state, other):
            out = here.meets(claim, *apart) and (leaves or not end.meets(claim, *apart))
            if not out and volume.meets(claim, *apart):
                return True
    return False


def untold_but(state: State, vehicle: VehicleState) -> list[VehicleState]:
    """The others in the air that cannot be told to make way."""
    others = (v for v in state.vehicles.values() if v.vehicle != vehicle.vehicle)
    return [other for other in others if other.untold]


def give_way(setting: Setting, state: State, vehicle: VehicleState) -> State | None:
    """Order a vehicle out of air that is claimed by one that cannot be told to make way.

    None where it is in no such air, or where no place beside it is free.
    """
    apart = _apart(setting)
    untold = untold_but(state, vehicle)
    claims = [claim for other in untold for claim in _untold_claims(setting, state, other)]
    claims += _closed(state)
    if not any(_here(vehicle).meets(claim, *apart) for claim in claims):
        return None
    for spot in _ring(setting, vehicle.position, WAY_TIMES):
        route = setting.fence.route(vehicle.position, spot)
        if route is None or any(_here(vehicle, spot).meets(claim, *apart) for claim in claims):
            continue
        order = vehicle.leg(route)
        if is_clear(setting, state, vehicle, order):
            off_lane = lane_left(vehicle, setting.grid.cell_m)
            return state.with_vehicle(replace(off_lane, order=order, at_target=False))
    return None


def hold(state: State, vehicle: VehicleState) -> State:
    """Let a vehicle wait where it is."""
    order = vehicle.order if isinstance(vehicle.order, Hold) else Hold()
    return state.with_vehicle(replace(vehicle, order=order))


def spots_beside(setting: Setting, vehicle: VehicleState) -> list[GridPoint]:
    """Places inside the fence where a vehicle can land beside its pad, the nearest first."""
    allowed = filter(setting.fence.allows, _ring(setting, vehicle.home, (1.5, 2.5)))
    return sorted(allowed, key=lambda spot: (vehicle.position.distance_to(spot), spot))


def spots_around(setting: Setting, vehicle: VehicleState) -> list[GridPoint]:
    """Places inside the fence around a vehicle, just out of the air that it is in, and farther."""
    return list(filter(setting.fence.allows, _ring(setting, vehicle.position, (1.5, 4.0))))


def _ring(setting: Setting, centre: GridPoint, times: Iterable[float]) -> Iterator[GridPoint]:
    """Eight places around a centre, from north on, at so many times the distance of claims."""
    for each, eighth in itertools.product(times, range(8)):
        distance_m, turn_rad = each * _distance_m(setting), eighth * math.tau / 8
        yield GridPoint(
            round(centre.east_m + distance_m * math.sin(turn_rad), 2),
            round(centre.north_m + distance_m * math.cos(turn_rad), 2),
        )


def _detours(
    setting: Setting, vehicle: VehicleState, order: FlyTo, others: Sequence[Volume]
) -> list[FlyTo]:
    """Ways home round the columns of others, the shortest first.

    A landing takes half a minute: a vehicle that comes home for a battery cannot always wait so
    long.
    """
    fence, ways = setting.fence, []
    for centre in {volume.path[0] for volume in others if len(set(volume.path)) == 1}:
        for via in _ring(setting, centre, (2.0,)):
            there, back = fence.route(vehicle.position, via), fence.route(via, vehicle.pad)
            if there is not None and back is not None:
                ways.append((*there, *back))
    ways.sort(key=lambda way: (route_length_m(vehicle.position, way), way))
    return [replace(order, route=way) for way in ways]


def _distance_m(setting: Setting) -> float:
    """How far the claims of two vehicles lie apart over ground."""
    return setting.mission.team.separation_m + SEPARATION_BUFFER_M


def _apart(setting: Setting) -> tuple[float, float]:
    """How far the claims of two vehicles lie apart over ground and in height; layers never meet."""
    return _distance_m(setting), setting.mission.team.layer_m


# --- what an order needs ----------------------------------------------------------------------
def _points(setting: Setting, state: State, order: Order | None) -> tuple[GridPoint, ...]:
    """Where an order leads, in the fixed frame."""
    if isinstance(order, Sweep):
        return (order.end,)
    if isinstance(order, FlyTo):
        cell = () if order.cell is None else (setting.where(order.cell, state.t_s),)
        return (*order.route, *cell)
    if isinstance(order, Look):
        return (setting.where(order.cell, state.t_s),)
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


def _volume(setting: Setting, state: State, vehicle: VehicleState, order: Order | None) -> Volume:
    """The air that an order needs."""
    top_m = max(vehicle.cruise_altitude_m, vehicle.level_m)
    if isinstance(order, TakeOff):
        return Volume((vehicle.position,), vehicle.home_level_m, top_m)
    if isinstance(order, Land):
        return Volume((vehicle.pad,), vehicle.home_level_m, top_m)
    low_m = high_m = vehicle.cruise_altitude_m
    if abs(vehicle.level_m - vehicle.cruise_altitude_m) > OFF_LAYER_M:
        low_m, high_m = sorted((vehicle.level_m, vehicle.cruise_altitude_m))
    stray_m = 0.0 if vehicle.braking_until_s is None else _stray_m(setting)
    return Volume((vehicle.position, *_points(setting, state, order)), low_m, high_m, stray_m)


def _stray_m(setting: Setting) -> float:
    """What a vehicle flies between two of its reports, and until it has come to rest."""
    speed, accel = setting.energy.speed_m_s, setting.energy.accel_m_s2
    return speed + speed**2 / (2 * accel)


# --- what others claim ------------------------------------------------------------------------
def _here(vehicle: VehicleState, spot: GridPoint | None = None) -> Volume:
    """The air of a vehicle that hovers in its layer where it is, or at a spot."""
    layer_m = vehicle.cruise_altitude_m
    return Volume((spot or vehicle.position,), layer_m, layer_m)


def _claims_of_others(
    setting: Setting, state: State, asking: VehicleState, order: Order
) -> list[Volume]:
    claims = [
        claim
        for other in state.vehicles.values()
        if other.vehicle != asking.vehicle
        for claim in _claims(setting, state, other, asking, order)
    ]
    here, apart = _here(asking), _apart(setting)
    closed = [] if asking.landed or isinstance(order, Land) else _closed(state)
    return claims + [claim for claim in closed if not here.meets(claim, *apart)]


def _claims(
    setting: Setting, state: State, other: VehicleState, asking: VehicleState, order: Order
) -> list[Volume]:
    """The air that another vehicle claims, as far as it binds the one that asks."""
    climbing = isinstance(other.order, TakeOff)
    if other.phase is Phase.LOST or (other.landed and not climbing):
        return []
    here, apart = _here(asking), _apart(setting)
    if other.untold:
        claims = _untold_claims(setting, state, other)
        if asking.landed or isinstance(order, Land):
            return claims
        # nobody can tell it to make way: who is near it must be free to leave
        return [claim for claim in claims if not here.meets(claim, *apart)]
    if not state.is_ours(other.vehicle):
        return []  # each keeps to air that nobody else may enter (`missions.geo.columns`)
    claims = [_volume(setting, state, other, other.order)]
    if other.idle and _leads_out(setting, state, asking, order, claims[0]):
        claims = []  # two that a pilot has left too near would else wait for each other
    if other.over_home and other.idle:
        # it waits to land; whoever is in its column already must be free to leave
        column = _volume(setting, state, other, Land())
        if not asking.landed and not here.meets(column, *apart):
            claims.append(column)
    return claims


def _leads_out(
    setting: Setting, state: State, asking: VehicleState, order: Order, claim: Volume
) -> bool:
    """Whether an order leads out of air that another hovers in, and never nearer to it."""
    now = Volume((asking.position,), asking.level_m, asking.level_m)
    apart = _apart(setting)
    if asking.landed or not now.meets(claim, *apart):
        return False
    needs = _volume(setting, state, asking, order)
    end = replace(needs, path=needs.path[-1:])
    past = needs.low_m < claim.high_m and needs.high_m > claim.low_m  # through its height
    return not past and not end.meets(claim, *apart) and needs.parts_from(claim)


def _untold_claims(setting: Setting, state: State, other: VehicleState) -> list[Volume]:
    """The air in which a vehicle may be that cannot be told to make way.

    A silent one flies on with its last order, and its failsafe may bring it home from any point of
    that, at its return height. One that returns flies straight home. A pilot's goes anywhere near.
    """
    low_m = other.home_level_m
    # it returns level, at a height above home, also over ground that is lower than the highest
    returns_m = max(other.level_m, other.cruise_altitude_m, low_m + RTL_HEIGHT_M)
    top_m = returns_m + setting.relief_m
    order = other.last_order if other.phase is Phase.OFFLINE else other.order
    if isinstance(order, TakeOff | Land):
        return [Volume((other.pad,), low_m, top_m), Volume((other.position,), low_m, top_m)]
    column = Volume((other.home,), low_m, top_m)
    if other.phase is Phase.OFFLINE:
        leg = _volume(setting, state, other, order)
        if isinstance(order, FlyPath):
            # its stream is sent on until its link is called lost, and then it brakes
            along = _next_places(order, other.tracked_s, SILENT_AHEAD_S)
            leg = replace(leg, path=(other.position, *along), stray_m=_stray_m(setting))
        way = Volume((*leg.path, other.home), min(leg.low_m, other.level_m), top_m, leg.stray_m)
        return [leg, way, column]
    if other.returns_by_itself or isinstance(order, ReturnToLaunch):
        way = Volume((other.position, other.home), min(other.level_m, top_m), top_m)
        return [way, column, Volume((other.position,), low_m, top_m)]
    here_m = other.level_m
    near = Volume((other.position,), min(low_m, here_m), here_m + OFF_LAYER_M, _stray_m(setting))
    return [near]


# --- air that others of a fleet have asked for -------------------------------------------------
def _closed(state: State) -> list[Volume]:
    """The columns that are closed to ours now."""
    return [
        _air(column)
        for _, column in sorted(state.closed.items())
        if column.until_s + CLOSED_S > state.t_s
    ]


def _air(column: Column) -> Volume:
    return Volume((column.place,), column.low_m, column.high_m)


def clear_of(setting: Setting, state: State, vehicle: VehicleState, column: Column) -> bool:
    """Whether a vehicle is out of a column, and what it does next does not lead into it."""
    here = replace(_here(vehicle), stray_m=_stray_m(setting))
    needs = _volume(setting, state, vehicle, vehicle.order)
    return not any(each.meets(_air(column), *_apart(setting)) for each in (here, needs))


def meets(setting: Setting, one: Column, other: Column) -> bool:
    """Whether two columns come too near to each other."""
    return _air(one).meets(_air(other), *_apart(setting))
