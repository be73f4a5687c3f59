"""What idle vehicles do next.

One rule a function, tried in this order for a vehicle in the air: come home when called, when the
battery or the camera says so, or when all is done; search until the ROI is found; then explore.
No order is given that would take a vehicle out of its fence, beyond its energy, or through the
air that another vehicle claims.
"""

from __future__ import annotations

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
from missions.separation import Volume, is_free
from missions.state import Errand, Phase, Setting, State, VehicleState
from missions.units import Cell, GridPoint

SEPARATION_BUFFER_M = 2.0
"""What two vehicles may stray towards each other while they keep their distance."""
REACTION_S = 3.0
"""Between two reports of the battery, and until a vehicle has turned round."""
EXTRA_FRAMES = 3
"""A look may take so many times its frames before it gives up on a neighbour."""


def assign(setting: Setting, state: State) -> State:
    """The state with an order for everybody who can have one."""
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
    lanes = vehicle.lanes
    if vehicle.on_lane and lanes:  # the next sortie goes on where this one left the lane
        lanes = ((vehicle.position, lanes[0][1]), *lanes[1:])
    return state.with_vehicle(
        replace(
            vehicle,
            errand=errand,
            order=None,
            over_home=False,
            at_target=False,
            on_lane=False,
            lanes=lanes,
        )
    )


def _home_order(setting: Setting, vehicle: VehicleState) -> Order:
    """Fly over home, or land when there."""
    if vehicle.over_home:
        return Land()
    route = setting.fence.route(vehicle.position, vehicle.home) or (vehicle.home,)
    return FlyTo(route, None, stop=True, height_m=vehicle.layer_m)


def _affords(
    setting: Setting, vehicle: VehicleState, target: GridPoint, hover_s: float
) -> bool:
    """Whether a vehicle can fly to a point, hover there, come home, land, and keep its reserve."""
    energy, fence = setting.energy, setting.fence
    there = fence.route(vehicle.position, target) or (target,)
    back = fence.route(target, vehicle.home) or (vehicle.home,)
    out_m = route_length_m(vehicle.position, there)
    need_wh = energy.hover_wh(hover_s, vehicle.drawn_w) + energy.home_wh(
        route_length_m(target, back), vehicle.layer_m, vehicle.drawn_w
    )
    if out_m > 0.0:
        need_wh += energy.leg_wh(out_m, vehicle.drawn_w)
    if vehicle.landed:
        need_wh += energy.hover_wh(vehicle.layer_m / CLIMB_SPEED_M_S + 5.0)
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
    target = _first_target(setting, state, vehicle)
    if not _affords(setting, vehicle, target, setting.look_s):
        if vehicle.remaining_wh < 0.95 * setting.energy.capacity_wh:
            return state.with_vehicle(replace(vehicle, order=AwaitBattery()))
        return _out_of_reach(state, vehicle)
    return _give(setting, state, vehicle, TakeOff(vehicle.layer_m))


def _first_target(setting: Setting, state: State, vehicle: VehicleState) -> GridPoint:
    cell = vehicle.vertex or vehicle.candidate
    if cell is not None:
        return _where(setting, state, cell)
    return vehicle.lanes[0][0] if vehicle.lanes else vehicle.home


def _out_of_reach(state: State, vehicle: VehicleState) -> State:
    """A full battery does not get there and back: somebody nearer, or nobody, will."""
    note = "its next place is out of reach on a full battery"
    return state.with_vehicle(
        replace(vehicle, phase=Phase.FAILED, order=StandDown(), note=note)
    )


# --- in the air ------------------------------------------------------------------------------
def _airborne(setting: Setting, state: State, vehicle: VehicleState) -> State:
    if vehicle.errand is not None:
        return _give(setting, state, vehicle, _home_order(setting, vehicle))
    if state.tree is None:
        return _search(setting, state, vehicle)
    return _explore(setting, state, vehicle)


def _search(setting: Setting, state: State, vehicle: VehicleState) -> State:
    """Look at what may be ROI, else fly the next lane."""
    if vehicle.candidate is not None:
        return _visit(setting, state, vehicle, vehicle.candidate, stop=True)
    if not vehicle.lanes:
        state = _take_over_lanes(state, vehicle)
        vehicle = state.vehicles[vehicle.vehicle]
    if not vehicle.lanes:
        if all(not v.lanes and v.candidate is None for v in state.vehicles.values()):
            return _turn_back_all(replace(state, exhausted=True), setting)
        return _hold(state, vehicle)
    start, end = vehicle.lanes[0]
    if not _affords(setting, vehicle, end if vehicle.on_lane else start, REACTION_S):
        return _go_home(setting, state, vehicle, Errand.BATTERY)
    if vehicle.on_lane:
        order: Order = Sweep(end, setting.mission.grid.cell_m, vehicle.layer_m)
    else:
        route = setting.fence.route(vehicle.position, start) or (start,)
        order = FlyTo(route, None, stop=False, height_m=vehicle.layer_m)
    return _give(setting, state, vehicle, order)


def _turn_back_all(state: State, setting: Setting) -> State:
    """The box is exhausted: everybody who is idle comes home."""
    for number in sorted(state.vehicles):
        vehicle = state.vehicles[number]
        if vehicle.phase is Phase.AIRBORNE and vehicle.errand is None and vehicle.idle:
            state = _go_home(setting, state, vehicle, Errand.DONE)
    return state


def _take_over_lanes(state: State, vehicle: VehicleState) -> State:
    """Help whoever has most lanes left, from the far end; all lanes of one who dropped out."""
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
        if v.phase is Phase.AIRBORNE
        and v.idle
        and v.errand is None
        and v.at_target
        and v.vertex is not None
        and state.tree.has_looked(v.vertex)
    ]
    moves = setting.explorer.moves(state.tree, state.robots(), deciding) if deciding else {}
    for number, cell in moves.items():
        if cell is not None:
            vehicle = replace(state.vehicles[number], vertex=cell, at_target=False)
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
    if route is None:
        return _abandon(setting, state, vehicle, cell)
    if not _affords(setting, vehicle, target, setting.look_s if stop else REACTION_S):
        return _go_home(setting, state, vehicle, Errand.BATTERY)
    order = FlyTo(route[:-1], cell, stop=stop, height_m=vehicle.layer_m)
    return _give(setting, state, vehicle, order)


def _abandon(setting: Setting, state: State, vehicle: VehicleState, cell: Cell) -> State:
    """Nobody may fly there: the vertex counts as done, and the result as incomplete."""
    state = replace(state, abandoned=state.abandoned | {cell})
    if state.tree is None:
        return assign(
            setting, state.with_vehicle(replace(vehicle, candidate=None, at_target=False))
        )
    tree = state.tree.looked(cell, ())
    parent = tree.parent(cell) or cell
    state = replace(state, tree=tree)
    state = state.with_vehicle(replace(vehicle, vertex=parent, at_target=True, order=None))
    return assign(setting, state)


def _someone_looks(state: State, vehicle: VehicleState, cell: Cell) -> bool:
    return any(
        isinstance(other.order, Look) and other.order.cell == cell
        for other in state.vehicles.values()
        if other.vehicle != vehicle.vehicle and other.phase is Phase.AIRBORNE
    )


def _go_home(setting: Setting, state: State, vehicle: VehicleState, errand: Errand) -> State:
    state = _send_home(state, vehicle, errand)
    vehicle = state.vehicles[vehicle.vehicle]
    return _give(setting, state, vehicle, _home_order(setting, vehicle))


# --- giving orders, keeping apart ------------------------------------------------------------
def _hold(state: State, vehicle: VehicleState) -> State:
    if isinstance(vehicle.order, Hold):
        return state
    return state.with_vehicle(replace(vehicle, order=Hold()))


def _give(setting: Setting, state: State, vehicle: VehicleState, order: Order) -> State:
    """Give an order if its air is free; otherwise wait where the vehicle is."""
    distance_m = setting.mission.team.separation_m + SEPARATION_BUFFER_M
    volume = _volume(setting, state, vehicle, order)
    others = [
        claim
        for other in state.vehicles.values()
        if other.vehicle != vehicle.vehicle
        for claim in _claims(setting, state, other, vehicle)
    ]
    if is_free(volume, others, distance_m):
        return state.with_vehicle(replace(vehicle, order=order))
    return state if vehicle.landed else _hold(state, vehicle)


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
    return Volume((vehicle.position, *points), vehicle.layer_m, vehicle.layer_m)


def _claims(
    setting: Setting, state: State, other: VehicleState, asking: VehicleState
) -> list[Volume]:
    """The air that another vehicle claims, as far as it binds the one that asks."""
    climbing = isinstance(other.order, TakeOff)
    if other.landed and not climbing:
        return []
    claims = [_volume(setting, state, other, other.order)]
    if other.over_home and other.idle:
        # it waits to land; whoever is in its column already must be free to leave
        column = Volume((other.home,), 0.0, other.layer_m)
        here = Volume((asking.position,), asking.layer_m, asking.layer_m)
        distance_m = setting.mission.team.separation_m + SEPARATION_BUFFER_M
        if not asking.landed and not here.meets(column, distance_m):
            claims.append(column)
    return claims


def _where(setting: Setting, state: State, cell: Cell) -> GridPoint:
    """Where the centre of a cell is now, in the fixed frame."""
    return setting.grid.to_fixed(setting.grid.centre_of(cell), state.t_s)
