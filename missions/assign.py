"""What idle vehicles do next.

One rule a function, tried in this order for a vehicle in the air: come home when called, when the
battery or the camera says so, or when all is done; search until the ROI is found; then explore.
No order is given that would take a vehicle out of its fence, beyond its energy, or through the
air that another vehicle claims.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from missions.energy import CLIMB_SPEED_M_S
from missions.fence import route_length_m
from missions.orders import (
    AwaitBattery,
    FlyTo,
    Hold,
    Land,
    Look,
    Order,
    StandDown,
    Sweep,
    TakeOff,
)
from missions.search import rest_of
from missions.separation import Volume, is_free
from missions.state import Errand, Phase, Setting, State, VehicleState
from missions.units import Cell, GridPoint

SEPARATION_BUFFER_M = 2.0
"""What two vehicles may stray towards each other while they keep their distance."""
OFF_LAYER_M = 1.5
"""A vehicle that is farther from its layer claims all heights between."""
REACTION_S = 3.0
"""Between two reports of the battery, and until a vehicle has turned round."""
OVER_HOME_M = 1.0
"""A vehicle that is nearer to home may land."""
PROGRESS_M = 1.0
"""A sortie that searched less of a lane was in vain."""
SORTIES_IN_VAIN = 3
"""So many in a row, and the next place counts as out of reach."""
EXTRA_FRAMES = 3
"""A look may take so many times its frames before it gives up on a neighbour."""


def assign(setting: Setting, state: State) -> State:
    """The state with an order for everybody who can have one."""
    if state.tree is None and all(_idle_in_search(v) for v in state.vehicles.values()):
        state = replace(state, exhausted=True)
    for number in sorted(state.vehicles):
        state = _turn_back(setting, state, state.vehicles[number])
    state = _explore_moves(setting, state)
    for number in sorted(state.vehicles):
        vehicle = state.vehicles[number]
        if vehicle.idle and vehicle.phase is Phase.AIRBORNE:
            state = _airborne(setting, state, vehicle)
        elif vehicle.phase is Phase.GROUNDED and not isinstance(vehicle.order, TakeOff):
            state = _grounded(setting, state, vehicle)
    return state


# --- coming home -----------------------------------------------------------------------------
def _turn_back(setting: Setting, state: State, vehicle: VehicleState) -> State:
    """Interrupt whatever a vehicle does once it has to come home."""
    if vehicle.phase is not Phase.AIRBORNE or vehicle.errand is not None:
        return state
    if state.recalled:
        return _send_home(state, vehicle, Errand.RECALLED)
    if state.mapped:
        return _send_home(state, vehicle, Errand.DONE)
    if not _affords(setting, vehicle, vehicle.position, hover_s=REACTION_S):
        return _send_home(state, vehicle, Errand.BATTERY)
    return state


def _send_home(state: State, vehicle: VehicleState, errand: Errand) -> State:
    lanes, in_vain = vehicle.lanes, vehicle.in_vain
    if vehicle.on_lane and lanes:  # the next sortie goes on where this one left the lane
        rest = rest_of(lanes[0], vehicle.position)
        if rest[0].distance_to(lanes[0][0]) >= PROGRESS_M:
            in_vain = 0
        lanes = (rest, *lanes[1:])
    return state.with_vehicle(
        replace(
            vehicle.interrupted(state.t_s),
            errand=errand,
            over_home=False,
            at_target=False,
            on_lane=False,
            lanes=lanes,
            in_vain=in_vain + (errand is Errand.BATTERY),
        )
    )


def _home_order(setting: Setting, vehicle: VehicleState) -> Order:
    """Fly over home, or land when there."""
    if vehicle.over_home:
        return Land()
    route = setting.fence.route(vehicle.position, vehicle.home) or (vehicle.home,)
    return FlyTo(route, None, stop=True, height_m=vehicle.layer_m)


def _affords(setting: Setting, vehicle: VehicleState, target: GridPoint, hover_s: float) -> bool:
    """Whether a vehicle can fly to a point, hover there, come home, land, and keep its reserve."""
    energy, fence = setting.energy, setting.fence
    there = () if target == vehicle.position else fence.route(vehicle.position, target) or (target,)
    back = fence.route(target, vehicle.home) or (vehicle.home,)
    out_m = route_length_m(vehicle.position, there)
    need_wh = energy.hover_wh(hover_s, vehicle.drawn_w) + energy.home_wh(
        route_length_m(target, back), vehicle.layer_m, vehicle.drawn_w
    )
    if out_m > 0.0:
        need_wh += energy.leg_wh(out_m, vehicle.drawn_w)
    climb_m = max(vehicle.layer_m - vehicle.height_m, 0.0)
    if climb_m > OFF_LAYER_M:
        need_wh += energy.hover_wh(climb_m / CLIMB_SPEED_M_S + 5.0, vehicle.drawn_w)
    return vehicle.remaining_wh >= need_wh


# --- on the ground ---------------------------------------------------------------------------
def _grounded(setting: Setting, state: State, vehicle: VehicleState) -> State:
    """Take off, wait for a battery, or stay."""
    if state.mapped or state.recalled:
        return state.with_vehicle(
            replace(vehicle, phase=Phase.FINISHED, order=StandDown(), vertex=None)
        )
    if not vehicle.idle:
        return state
    if not vehicle.cleared:
        return state.with_vehicle(replace(vehicle, order=AwaitBattery()))
    if state.tree is None and _idle_in_search(vehicle):
        state = _find_work(state, vehicle)
        vehicle = state.vehicles[vehicle.vehicle]
    target = _first_target(setting, state, vehicle)
    if target is None:
        return state
    if vehicle.in_vain >= SORTIES_IN_VAIN:
        return _out_of_reach(state, vehicle)
    if not _affords(setting, vehicle, target, setting.look_s):
        if vehicle.remaining_wh < 0.95 * setting.energy.capacity_wh:
            return state.with_vehicle(replace(vehicle, order=AwaitBattery()))
        return _out_of_reach(state, vehicle)
    return _give(setting, state, vehicle, TakeOff(vehicle.layer_m))


def _first_target(setting: Setting, state: State, vehicle: VehicleState) -> GridPoint | None:
    """Where the vehicle would fly first, None when there is nothing for it to do."""
    cell = vehicle.vertex or vehicle.candidate
    if cell is not None:
        return _where(setting, state, cell)
    return vehicle.lanes[0][0] if vehicle.lanes else None


def _out_of_reach(state: State, vehicle: VehicleState) -> State:
    """A full battery does not get there and back: somebody nearer, or nobody, will."""
    alone = not any(
        other.phase in (Phase.AIRBORNE, Phase.GROUNDED)
        for other in state.vehicles.values()
        if other.vehicle != vehicle.vehicle
    )
    if alone and vehicle.vertex is not None:
        return _skip(state, vehicle, vehicle.vertex)
    note = "its next place is out of reach on a full battery"
    return state.with_vehicle(replace(vehicle, phase=Phase.FAILED, order=StandDown(), note=note))


# --- in the air ------------------------------------------------------------------------------
def _airborne(setting: Setting, state: State, vehicle: VehicleState) -> State:
    if vehicle.braking_until_s is not None:
        return _hold(state, vehicle)
    if vehicle.errand is not None:
        if vehicle.position.distance_to(vehicle.home) <= OVER_HOME_M:
            # it is there already, perhaps half-way down: no need to climb first
            vehicle = replace(vehicle, over_home=True)
        return _give(setting, state, vehicle, _home_order(setting, vehicle))
    if state.tree is None:
        return _search(setting, state, vehicle)
    return _explore(setting, state, vehicle)


def _search(setting: Setting, state: State, vehicle: VehicleState) -> State:
    """Look at what may be ROI, else fly the next lane."""
    if vehicle.candidate is not None:
        return _visit(setting, state, vehicle, vehicle.candidate, stop=True)
    if not vehicle.lanes:
        state = _find_work(state, vehicle)
        vehicle = state.vehicles[vehicle.vehicle]
        if not _idle_in_search(vehicle):
            return state
        if vehicle.position.distance_to(vehicle.home) <= OVER_HOME_M:
            return _hold(state, vehicle)
        # it waits over its own pad, where it is not in the way of anybody who has to land
        return _give(setting, state, vehicle, _home_order(setting, vehicle))
    start, end = vehicle.lanes[0]
    if vehicle.on_lane and setting.fence.allows_leg(vehicle.position, end):
        # flown as far as the battery lasts; the next sortie takes up the rest
        order: Order = Sweep(end, setting.mission.grid.cell_m, vehicle.layer_m)
        return _give(setting, state, vehicle, order)
    if vehicle.on_lane:  # it left the lane for a suspicion, and the fence lies between
        start, end = rest_of(vehicle.lanes[0], vehicle.position)
        vehicle = replace(vehicle, on_lane=False, lanes=((start, end), *vehicle.lanes[1:]))
    route = setting.fence.route(vehicle.position, start)
    if route is None:  # a part of the box that no way inside the fence leads to
        return _hold(state, replace(vehicle, lanes=vehicle.lanes[1:]))
    if not _affords(setting, vehicle, start, REACTION_S):
        return _go_home(setting, state, vehicle, Errand.BATTERY)
    order = FlyTo(route, None, stop=False, height_m=vehicle.layer_m)
    return _give(setting, state, vehicle, order)


def _idle_in_search(vehicle: VehicleState) -> bool:
    """Whether a vehicle has neither a lane nor a suspicion to look at."""
    return not vehicle.lanes and vehicle.candidate is None


def _find_work(state: State, vehicle: VehicleState) -> State:
    """Look at what one who dropped out suspected; or help whoever has most lanes left.

    Lanes are taken from the far end, and all from one who dropped out.
    """
    for other in state.vehicles.values():
        gone = other.phase not in (Phase.AIRBORNE, Phase.GROUNDED)
        if gone and other.candidate is not None:
            state = state.with_vehicle(replace(other, candidate=None))
            heir = replace(vehicle, candidate=other.candidate, at_target=False)
            return state.with_vehicle(heir)

    def spare(other: VehicleState) -> int:
        active = other.phase in (Phase.AIRBORNE, Phase.GROUNDED)
        return len(other.lanes) - (1 if active else 0)

    others = [v for v in state.vehicles.values() if v.vehicle != vehicle.vehicle and spare(v) > 0]
    if not others:
        return state
    busiest = max(others, key=lambda v: (spare(v), -v.vehicle))
    state = state.with_vehicle(replace(busiest, lanes=busiest.lanes[:-1]))
    return state.with_vehicle(replace(vehicle, lanes=(busiest.lanes[-1],), on_lane=False))


def _explore_moves(setting: Setting, state: State) -> State:
    """Let the explorer say where robots move that stand at a vertex which is done."""
    if state.tree is None or state.tree.is_explored(state.tree.root):
        return state
    deciding = [
        number
        for number, v in sorted(state.vehicles.items())
        if v.phase in (Phase.AIRBORNE, Phase.GROUNDED)
        and v.idle
        and v.errand is None
        and v.braking_until_s is None
        and v.at_target
        and v.vertex is not None
        and state.tree.has_looked(v.vertex)
    ]
    moves = setting.explorer.moves(state.tree, state.robots(), deciding) if deciding else {}
    for number, cell in moves.items():
        if cell is not None:
            vehicle = replace(state.vehicles[number], vertex=cell, at_target=False, in_vain=0)
            state = state.with_vehicle(vehicle)
    return state


def _explore(setting: Setting, state: State, vehicle: VehicleState) -> State:
    """Fly to the vertex; look from it unless somebody has or does."""
    tree = state.tree
    if tree is None or vehicle.vertex is None:
        raise AssertionError("a vehicle explores without a tree or a vertex")
    return _visit(setting, state, vehicle, vehicle.vertex, stop=not tree.has_looked(vehicle.vertex))


def _visit(
    setting: Setting, state: State, vehicle: VehicleState, cell: Cell, *, stop: bool
) -> State:
    """Fly to a cell, and look from it if nobody has."""
    if not vehicle.at_target:
        return _fly_to_cell(setting, state, vehicle, cell, stop=stop)
    if not stop or _someone_looks(state, vehicle, cell):
        return _hold(state, vehicle)
    frames = EXTRA_FRAMES * setting.mission.votes.frames
    return _give(setting, state, vehicle, Look(cell, frames, vehicle.layer_m))


def _fly_to_cell(
    setting: Setting, state: State, vehicle: VehicleState, cell: Cell, *, stop: bool
) -> State:
    target = _where(setting, state, cell)
    route = setting.fence.route(vehicle.position, target)
    if route is None or (stop and not _stays_inside(setting, state, vehicle, route, cell)):
        return _abandon(state, vehicle, cell)
    if not _affords(setting, vehicle, target, setting.look_s if stop else REACTION_S):
        return _go_home(setting, state, vehicle, Errand.BATTERY)
    order = FlyTo(route[:-1], cell, stop=stop, height_m=vehicle.layer_m)
    return _give(setting, state, vehicle, order)


def _stays_inside(
    setting: Setting,
    state: State,
    vehicle: VehicleState,
    route: Sequence[GridPoint],
    cell: Cell,
) -> bool:
    """Whether the fence still allows a drifting cell by the time that the longest look ends."""
    grid, mission = setting.grid, setting.mission
    if grid.drift_speed_m_s == 0.0:
        return True
    closing_m_s = mission.flight.speed_m_s - grid.drift_speed_m_s
    there_s = route_length_m(vehicle.position, route) / closing_m_s + REACTION_S
    look_s = setting.look_s + EXTRA_FRAMES * mission.votes.frames * mission.camera.interval_s
    then = grid.to_fixed(grid.centre_of(cell), state.t_s + there_s + look_s)
    return setting.fence.allows_leg(route[-1], then)


def _abandon(state: State, vehicle: VehicleState, cell: Cell) -> State:
    """Nobody may fly there now."""
    if state.tree is None:
        return _hold(state, replace(vehicle, candidate=None, at_target=False))
    state = _skip(state, vehicle, cell)
    return _hold(state, state.vehicles[vehicle.vehicle])


def _skip(state: State, vehicle: VehicleState, cell: Cell) -> State:
    """Go on in the tree as if the vehicle had been at a vertex where it cannot fly.

    If nobody has looked from there, nobody will: the result is incomplete.
    """
    if state.tree is not None and not state.tree.has_looked(cell):
        tree = state.tree.looked(cell, ())
        state = replace(state, tree=tree, abandoned=state.abandoned | {cell})
    return state.with_vehicle(replace(vehicle, at_target=True, in_vain=0))


def _someone_looks(state: State, vehicle: VehicleState, cell: Cell) -> bool:
    return any(
        isinstance(other.order, Look) and other.order.cell == cell
        for other in state.vehicles.values()
        if other.vehicle != vehicle.vehicle and other.phase is Phase.AIRBORNE
    )


def _go_home(setting: Setting, state: State, vehicle: VehicleState, errand: Errand) -> State:
    state = _send_home(state, vehicle, errand)
    return _airborne(setting, state, state.vehicles[vehicle.vehicle])


# --- giving orders, keeping apart ------------------------------------------------------------
def _hold(state: State, vehicle: VehicleState) -> State:
    order = vehicle.order if isinstance(vehicle.order, Hold) else Hold()
    return state.with_vehicle(replace(vehicle, order=order))


def _give(setting: Setting, state: State, vehicle: VehicleState, order: Order) -> State:
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
    if isinstance(order, FlyTo) and vehicle.errand is not None:
        for detour in _detours(setting, vehicle, order, others):
            if is_free(_volume(setting, state, vehicle, detour), others, distance_m):
                return state.with_vehicle(replace(vehicle, order=detour))
    return state if vehicle.landed else _hold(state, vehicle)


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
        return Volume((vehicle.home,), 0.0, vehicle.layer_m)
    points: Sequence[GridPoint] = ()
    if isinstance(order, Sweep):
        points = (order.end,)
    elif isinstance(order, FlyTo):
        cell = () if order.cell is None else (_where(setting, state, order.cell),)
        points = (*order.route, *cell)
    elif isinstance(order, Look):
        points = (_where(setting, state, order.cell),)
    low_m = high_m = vehicle.layer_m
    if abs(vehicle.height_m - vehicle.layer_m) > OFF_LAYER_M:
        low_m, high_m = sorted((vehicle.height_m, vehicle.layer_m))
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
    here = Volume((asking.position,), asking.layer_m, asking.layer_m)
    claim = _volume(setting, state, other, other.order)
    claims = [claim]
    if other.phase is not Phase.AIRBORNE and not climbing and not asking.landed:
        # nobody can tell it to make way: who is near it must be free to leave
        claims = [] if here.meets(claim, _distance_m(setting)) else [claim]
    if other.over_home and other.idle:
        # it waits to land; whoever is in its column already must be free to leave
        column = Volume((other.home,), 0.0, other.layer_m)
        if not asking.landed and not here.meets(column, _distance_m(setting)):
            claims.append(column)
    return claims


def _where(setting: Setting, state: State, cell: Cell) -> GridPoint:
    """Where the centre of a cell is now, in the fixed frame."""
    return setting.grid.to_fixed(setting.grid.centre_of(cell), state.t_s)
