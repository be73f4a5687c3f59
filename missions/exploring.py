"""Exploring: the explorer says which vertex, this says how to get there and look."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from missions.airspace import give, hold, where
from missions.explorers import Situation
from missions.fence import route_length_m
from missions.homing import REACTION_S, affords, go_home
from missions.orders import FlyTo, Look, TakeOff
from missions.state import Errand, Phase, Setting, State, VehicleState
from missions.tree import Tree
from missions.units import Cell, GridPoint

EXTRA_FRAMES = 6
"""A look may take so many times its frames before it gives up on a neighbour."""


def explore_moves(setting: Setting, state: State) -> State:
    """Let the explorer say where robots move that stand at a vertex which is done."""
    tree = state.tree
    if tree is None or tree.is_explored(tree.root):
        return state
    at = state.robots()
    away = frozenset(n for n in at if _away(state.vehicles[n]))
    waiting = _told_to_wait(state, away)
    asked = tuple(n for n in sorted(at) if n not in waiting and _decides(state.vehicles[n], tree))
    if not asked:
        return state
    metric = replace(setting.metric, passable=_passable(setting, state))
    decision = setting.explorer.decide(Situation(tree, at, asked, state.memory, metric, away))
    state = replace(state, memory=decision.memory)
    for number, cell in decision.moves.items():
        if cell is not None:
            vehicle = replace(state.vehicles[number], vertex=cell, at_target=False, in_vain=0)
            state = state.with_vehicle(vehicle)
    stay = frozenset(n for n, cell in decision.moves.items() if cell is None)
    return replace(state, pondered=(tree, _present(state, away), waiting | stay))


def _decides(vehicle: VehicleState, tree: Tree) -> bool:
    """Whether a vehicle is at its vertex and has looked."""
    return (
        vehicle.idle
        and vehicle.errand is None
        and vehicle.braking_until_s is None
        and vehicle.at_target
        and vehicle.vertex is not None
        and tree.has_looked(vehicle.vertex)
    )


def _away(vehicle: VehicleState) -> bool:
    """Whether a vehicle is on its way home, or on the ground and not taking off."""
    return vehicle.errand is not None or (vehicle.landed and not isinstance(vehicle.order, TakeOff))


def _present(state: State, away: frozenset[int]) -> dict[int, Cell]:
    """Where those are who explore and are not away."""
    return {n: cell for n, cell in state.robots().items() if n not in away}


def _told_to_wait(state: State, away: frozenset[int]) -> frozenset[int]:
    """Who was told to wait and has nothing new to go by: the tree, and where the others are."""
    if state.pondered is None:
        return frozenset()
    tree, places, waiting = state.pondered
    same = tree is state.tree and places == _present(state, away)
    return waiting if same else frozenset()


def _passable(setting: Setting, state: State) -> Callable[[Cell, Cell], bool]:
    """Whether the fence allows the straight way between two cells, where they are now."""

    def allowed(start: Cell, end: Cell) -> bool:
        return setting.fence.allows_leg(where(setting, state, start), where(setting, state, end))

    return allowed


def explore(setting: Setting, state: State, vehicle: VehicleState) -> State:
    """Fly to the vertex; look from it unless somebody has or does."""
    tree = state.tree
    if tree is None or vehicle.vertex is None:
        raise AssertionError("a vehicle explores without a tree or a vertex")
    return visit(setting, state, vehicle, vehicle.vertex, stop=not tree.has_looked(vehicle.vertex))


def visit(
    setting: Setting, state: State, vehicle: VehicleState, cell: Cell, *, stop: bool
) -> State:
    """Fly to a cell, and look from it if nobody has."""
    if not vehicle.at_target:
        return _fly_to_cell(setting, state, vehicle, cell, stop=stop)
    if not stop or _someone_looks(state, vehicle, cell):
        return hold(state, vehicle)
    frames = EXTRA_FRAMES * setting.mission.votes.frames
    return give(setting, state, vehicle, Look(cell, frames, vehicle.layer_m))


def _fly_to_cell(
    setting: Setting, state: State, vehicle: VehicleState, cell: Cell, *, stop: bool
) -> State:
    target = where(setting, state, cell)
    route = setting.fence.route(vehicle.position, target)
    if route is None or (stop and not _stays_inside(setting, state, vehicle, route, cell)):
        return _abandon(state, vehicle, cell)
    if not affords(setting, vehicle, target, setting.look_s if stop else REACTION_S):
        return go_home(setting, state, vehicle, Errand.BATTERY)
    order = FlyTo(route[:-1], cell, stop=stop, height_m=vehicle.layer_m)
    return give(setting, state, vehicle, order)


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
        return hold(state, replace(vehicle, candidate=None, at_target=False))
    state = skip(state, vehicle, cell)
    return hold(state, state.vehicles[vehicle.vehicle])


def skip(state: State, vehicle: VehicleState, cell: Cell) -> State:
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
