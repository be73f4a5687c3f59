"""Exploring: the explorer says which vertex, this says how to get there and look."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from missions.explorers import Situation
from missions.flight.deconfliction import where
from missions.flight.visiting import visit
from missions.mapping.tree import Tree
from missions.orders import TakeOff
from missions.state import Setting, State, VehicleState
from missions.units import Cell


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
            vehicle = replace(
                state.vehicles[number], vertex=cell, at_target=False, fruitless_sorties=0
            )
            state = state.with_vehicle(vehicle)
    stay = frozenset(n for n, cell in decision.moves.items() if cell is None)
    return replace(state, last_wait=(tree, _present(state, away), waiting | stay))


def _decides(vehicle: VehicleState, tree: Tree) -> bool:
    """Whether a vehicle is at its vertex and has looked."""
    return (
        vehicle.idle
        and vehicle.return_reason is None
        and vehicle.braking_until_s is None
        and vehicle.at_target
        and vehicle.vertex is not None
        and tree.has_looked(vehicle.vertex)
    )


def _away(vehicle: VehicleState) -> bool:
    """Whether a vehicle is on its way home, or on the ground and not taking off."""
    return vehicle.return_reason is not None or (
        vehicle.landed and not isinstance(vehicle.order, TakeOff)
    )


def _present(state: State, away: frozenset[int]) -> dict[int, Cell]:
    """Where those are who explore and are not away."""
    return {n: cell for n, cell in state.robots().items() if n not in away}


def _told_to_wait(state: State, away: frozenset[int]) -> frozenset[int]:
    """Who was told to wait and has nothing new to go by: the tree, and where the others are."""
    if state.last_wait is None:
        return frozenset()
    tree, places, waiting = state.last_wait
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
