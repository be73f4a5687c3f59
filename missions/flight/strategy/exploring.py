"""Exploring: the explorer says which vertex, this says how to get there and look."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

from missions.flight.airspace.deconfliction import where
from missions.flight.return_home import send_home
from missions.flight.setting import Setting
from missions.flight.state import ReturnReason, State, VehicleState
from missions.flight.strategy.visiting import visit
from missions.mapping.tree import Tree
from missions.orders import TakeOff
from missions.planning.stepwise import Situation
from missions.planning.stepwise.interface import refuse_impossible
from missions.units import Cell

WAIT_S: Final = 20.0
"""Where everybody is told to wait, and for so long nothing new is known, nothing will be."""


def explore_moves(setting: Setting, state: State) -> State:
    """Let the explorer say where robots move that stand at a vertex which is done.

    Raises `StrategyError` for a move that cannot be.
    """
    tree = state.tree
    if tree is None or tree.is_explored(tree.root):
        return state
    at = state.robots()
    away = frozenset(n for n in at if _away(state.vehicles[n]))
    waiting = _told_to_wait(state, away)
    asked = tuple(n for n in sorted(at) if n not in waiting and _decides(state.vehicles[n], tree))
    if not asked:
        return _end_in_vain(setting, state, waiting)
    metric = replace(setting.metric, passable=_passable(setting, state))
    situation = Situation(tree, at, asked, state.memory, metric, away)
    decision = setting.explorer.decide(situation)
    refuse_impossible(setting.explorer.name, situation, decision)
    state = replace(state, memory=decision.memory)
    for number in asked:
        cell = decision.moves.get(number)
        if cell is not None:
            vehicle = replace(
                state.vehicles[number], vertex=cell, at_target=False, fruitless_sorties=0
            )
            state = state.with_vehicle(vehicle)
    stay = frozenset(n for n in asked if decision.moves.get(n) is None)
    return replace(state, last_wait=(tree, _present(state, away), waiting | stay, state.t_s))


def _end_in_vain(setting: Setting, state: State, waiting: frozenset[int]) -> State:
    """Send everybody home whom the strategy leaves waiting, while nobody is there to change it.

    Else they would hover, battery after battery.
    """
    still = [v for v in state.vehicles.values() if not v.ended]
    alone = all(v.vehicle in waiting and _waits(v) for v in still)
    if not waiting or not alone or state.last_wait is None:
        return state
    if state.t_s - state.last_wait[3] < WAIT_S:
        return state
    for vehicle in still:
        note = f"the strategy {setting.explorer.name} leaves it waiting, and cells are unexplored"
        state = send_home(setting, state, replace(vehicle, note=note), ReturnReason.FAULT)
    return state


def _waits(vehicle: VehicleState) -> bool:
    """Whether a vehicle hovers at its vertex, with nothing else to do."""
    return vehicle.at_target and vehicle.idle and not _away(vehicle)


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
    tree, places, waiting, _ = state.last_wait
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
