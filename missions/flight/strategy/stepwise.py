"""`rdfs` and all other strategies with stops: an explorer chooses the next cell, this flies there.

Each explorer of `missions.planning.stepwise` is a strategy by this module.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from missions.flight.return_home import send_home
from missions.flight.state import Setting, State, Strategy
from missions.flight.strategy.searching import mark_unreachable, search, visit
from missions.flight.strategy.work import Area, Lanes
from missions.flight.vehicle_state import Phase, ReturnReason, VehicleState
from missions.mapping.tree import Tree
from missions.orders import TakeOff
from missions.planning.search.lanes import LANE_CELLS, along_east, search_length_m
from missions.planning.search.search_order import Pace
from missions.planning.stepwise import EXPLORERS, Explorer, Situation
from missions.planning.stepwise.interface import promised_moves, refuse_impossible
from missions.units import Cell, GridPoint

WAIT_S: Final = 20.0
"""Maximum time that all vehicles wait without news, s."""


def explore_moves(explorer: Explorer, state: State) -> State:
    """Ask the explorer for the moves of robots whose vertex is done. Raises `StrategyError`."""
    tree = state.tree
    if tree is None or tree.is_explored(tree.root):
        return state
    at = _robots(state)
    away = frozenset(n for n in at if _away(state.vehicles[n]))
    places, waiting = {n: at[n] for n in at.keys() - away}, frozenset[int]()
    if state.last_wait is not None and state.last_wait[0] is tree and state.last_wait[1] == places:
        waiting = state.last_wait[2]
    asked = tuple(n for n in sorted(at) if n not in waiting and _decides(state.vehicles[n], tree))
    if not asked:
        return _end_stalled(explorer, state, waiting)

    def passable(*cells: Cell) -> bool:
        places = (state.setting.where(cell, state.t_s) for cell in cells)
        return state.setting.fence.allows_leg(*places)

    metric = replace(state.setting.metric, passable=passable)
    situation = Situation(tree, at, asked, state.memory, metric, away)
    decision = explorer.decide(situation)
    refuse_impossible(explorer.name, situation, decision)
    state = replace(state, memory=decision.memory)
    for number in asked:
        if (cell := decision.moves.get(number)) is not None:
            moves = replace(state.vehicles[number], vertex=cell, fruitless_sorties=0)
            state = state.with_vehicle(replace(moves, at_target=False))
    stay = frozenset(n for n in asked if decision.moves.get(n) is None)
    places = {n: cell for n, cell in _robots(state).items() if n not in away}
    return replace(state, last_wait=(tree, places, waiting | stay, state.t_s))


def _end_stalled(explorer: Explorer, state: State, waiting: frozenset[int]) -> State:
    """Send all vehicles home that the strategy leaves waiting: they would hover for ever."""
    still = [v for v in state.vehicles.values() if not v.ended]
    if not waiting or state.last_wait is None or state.t_s - state.last_wait[3] < WAIT_S:
        return state
    if not all(v.vehicle in waiting and v.at_target and v.idle and not _away(v) for v in still):
        return state
    for vehicle in still:
        note = f"the strategy {explorer.name} leaves it waiting, and cells are unexplored"
        state = send_home(state, replace(vehicle, note=note), ReturnReason.FAULT)
    return state


def _decides(vehicle: VehicleState, tree: Tree) -> bool:
    """Return whether a vehicle is at its vertex and has observed it."""
    return (
        vehicle.idle
        and vehicle.return_reason is None
        and vehicle.braking_until_s is None
        and vehicle.at_target
        and vehicle.vertex is not None
        and tree.is_observed(vehicle.vertex)
    )


def _away(vehicle: VehicleState) -> bool:
    """Return whether a vehicle is returning, or on the ground and not taking off."""
    return vehicle.return_reason is not None or (
        vehicle.landed and not isinstance(vehicle.order, TakeOff)
    )


def _robots(state: State) -> dict[int, Cell]:
    """Return the vertex of each vehicle that takes part in the exploration."""
    return {
        number: v.vertex
        for number, v in state.vehicles.items()
        if v.vertex is not None and v.phase in (Phase.AIRBORNE, Phase.GROUNDED)
    }


class Stepwise(Strategy):
    """Search with stops, then explore cell by cell as an explorer decides."""

    stops = True

    def __init__(self, explorer: Explorer) -> None:
        self.about = self.explorer = explorer

    def lay(self, area: Area) -> Lanes:
        """Lay lanes as far apart as the view from above one allows, along the longer side."""
        return area.lanes(LANE_CELLS, along_east(area.box))

    def pace(self, setting: Setting) -> Pace:
        """Return the speed of legs, and the time of a stop."""
        return Pace(setting.energy.speed_m_s, setting.energy.leg_s(0.0))

    def search_s(self, setting: Setting) -> float:
        """Return the time of the longest share with a stop at every end of a lane."""
        energy, home = setting.energy, GridPoint(0.0, 0.0)
        longest_m = max(search_length_m(block, home) for block in setting.shares)
        legs = 2 * max(map(len, setting.shares)) + 1
        return longest_m / energy.speed_m_s + legs * energy.speed_m_s / energy.accel_m_s2

    def cell_s(self, setting: Setting) -> float:
        """Return the time of a leg to the next cell, and of an observation."""
        return setting.look_s + setting.energy.leg_s(setting.grid.cell_m)

    def bound_s(self, setting: Setting, tree: Tree) -> float | None:
        """Return the explorer's bound in moves, as seconds."""
        robots = len(setting.mission.vehicles)
        moves = promised_moves(self.explorer, tree, robots, setting.metric)
        return None if moves is None else round(setting.moves_s(moves), 1)

    def plan(self, state: State) -> State:
        """Ask the explorer for the vehicles that have observed their cell."""
        return state if state.is_held else explore_moves(self.explorer, state)

    def next_order(self, state: State, vehicle: VehicleState) -> State:
        """Search until there is a root; then fly to the vertex and observe it if need be."""
        if state.tree is None:
            return search(state, vehicle)
        assert vehicle.vertex is not None
        at = vehicle.vertex
        return visit(state, vehicle, at, stop=not state.tree.is_observed(at))

    def give_up_far(self, state: State, vehicle: VehicleState) -> State | None:
        """Go on in the tree without the vertex."""
        if vehicle.vertex is None:
            return None
        return mark_unreachable(state, vehicle, vehicle.vertex)

    def to_skip(self, state: State, vehicle: VehicleState) -> Cell | None:
        """Return the vehicle's suspicion, or its vertex if that is not observed yet."""
        if state.tree is None:
            return vehicle.candidate
        at = vehicle.vertex
        tree = state.tree
        return None if at is None or at not in tree or tree.is_observed(at) else at


RDFS: Final = Stepwise(EXPLORERS["rdfs"])
"""Fallback of strategies without stops."""
