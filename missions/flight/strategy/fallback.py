"""The end of the time for paths: the rest is explored with stops.

Let B(C, D) be the maximum time of `rdfs` for a tree of C cells and depth D, in seconds (Lemma 1). A
move is a leg between two cells and half an observation. Paths may take `patience_s`. If the region
is not decided by then, all vehicles fly to its root, and `rdfs` explores it. Cells whose neighbours
are all decided count as visited. B grows with C and D, so the exploration takes at most

    max(MIN_PATIENCE_S, B(C, D)) + a leg to the root + B(C, D)

seconds, without returns and battery swaps. Paths take a fifth of B or less.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from missions.flight.state import Setting, State
from missions.flight.vehicle_state import VehicleState
from missions.planning.stepwise.rdfs import rdfs_bound_moves

MIN_PATIENCE_S: Final = 120.0


def bound_s(setting: Setting, cells: int, depth: int) -> float:
    """Return B: the maximum time in which `rdfs` explores a tree, s."""
    return setting.moves_s(rdfs_bound_moves(cells, depth, len(setting.mission.vehicles)))


def patience_s(state: State) -> float:
    """Return the time that paths may take to explore the known part of a region, s."""
    if state.tree is None:
        return MIN_PATIENCE_S
    known = max(len(state.tree), len(state.belief.roi))
    return max(MIN_PATIENCE_S, bound_s(state.setting, known, state.tree.depth))


def whole_bound_s(setting: Setting, cells: int, depth: int) -> float:
    """Return the maximum time of an exploration by paths and their fallback, s."""
    stops_s = bound_s(setting, cells, depth)
    to_root_s = setting.energy.leg_s(cells * setting.grid.cell_m)
    return max(MIN_PATIENCE_S, stops_s) + to_root_s + stops_s


def fall_back(state: State) -> State:
    """Have all vehicles that explore leave their paths for the root."""
    root = None if state.tree is None else state.tree.root

    def leaving(vehicle: VehicleState) -> VehicleState:
        if vehicle.works and vehicle.path is not None:
            vehicle = vehicle.interrupted(state.t_s)
        return replace(vehicle, vertex=root, at_target=False)

    return replace(state, falls_back=True, memory=None, last_wait=None).with_all(leaving)
