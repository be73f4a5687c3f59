"""What frames change: votes, the root of the tree, and how the tree grows."""

from __future__ import annotations

from dataclasses import replace

from missions.events import FrameSeen
from missions.flight.lane_progress import lane_seen
from missions.mapping.belief import Belief, FrameId
from missions.mapping.tree import Tree
from missions.orders import Look
from missions.state import Phase, ReturnReason, Setting, State, VehicleState
from missions.units import Cell


def frame_seen(setting: Setting, state: State, event: FrameSeen) -> State:
    """Count the votes; end a look once everything it can see is decided."""
    frame = FrameId(event.vehicle, event.t_s)
    # a late vote must not undo what the tree was grown on
    votes = state.belief.in_time(
        event.vantage, frame, {vote.cell: vote.positive for vote in event.votes}
    )
    state = replace(state, belief=state.belief.with_frame(event.vantage, frame, votes))
    vehicle = replace(state.vehicles[event.vehicle], frames_lost=0)
    if state.tree is None:
        vehicle = lane_seen(vehicle, setting.grid, event.vantage, event.t_s)
    state = state.with_vehicle(vehicle)
    if isinstance(vehicle.order, Look) and vehicle.order.cell == event.vantage:
        if state.belief.fully_voted(event.vantage):
            return _looked(state, vehicle, event.vantage)
    elif state.tree is not None:
        return replace(state, tree=_late_positives(state.tree, state.belief, event.vantage))
    elif vehicle.candidate is None:
        hint = _hint(setting, state, event)
        if hint is not None:
            if vehicle.phase is Phase.AIRBORNE and vehicle.return_reason is None:
                vehicle = replace(vehicle.interrupted(state.t_s), at_target=False)
            return state.with_vehicle(replace(vehicle, candidate=hint))
    return state


def _late_positives(tree: Tree, belief: Belief, vantage: Cell) -> Tree:
    """A frame that came after its look was over may still make a neighbour ROI."""
    if vantage not in tree or not tree.has_looked(vantage):
        return tree
    new = [c for c in vantage.neighbours() if c in belief.roi and c not in tree]
    return tree.looked(vantage, new) if new else tree


def _hint(setting: Setting, state: State, event: FrameSeen) -> Cell | None:
    """The first cell that a search frame takes for ROI and that nobody has looked from yet."""
    for vote in event.votes:
        looked = state.belief.frames_taken(vote.cell) >= setting.mission.votes.frames
        if vote.positive and not looked and _in_reach(setting, state, vote.cell):
            return vote.cell
    return None


def _in_reach(setting: Setting, state: State, cell: Cell) -> bool:
    """Whether the centre of a cell is inside the fence now."""
    grid = setting.grid
    return setting.fence.allows(grid.to_fixed(grid.centre_of(cell), state.t_s))


def look_ended(state: State, vehicle: VehicleState) -> State:
    """An order's frames are used up before every neighbour had its votes."""
    if not isinstance(vehicle.order, Look):
        return state.with_vehicle(vehicle)
    cell = vehicle.order.cell
    if state.belief.frames_taken(cell) == 0:
        return state.with_vehicle(
            replace(
                vehicle, order=None, return_reason=ReturnReason.FAULT, note="the camera is silent"
            )
        )
    state = replace(state, undecided=state.undecided | {cell})
    return _looked(state, vehicle, cell)


def _looked(state: State, vehicle: VehicleState, cell: Cell) -> State:
    """Somebody has looked from a cell: the tree grows, or the search has found its root."""
    roi = [c for c in cell.cross() if c in state.belief.roi]
    vehicle = replace(vehicle, order=None, fruitless_sorties=0)
    if state.tree is not None:
        tree = state.tree
        if cell in tree:
            tree = tree.looked(cell, [c for c in roi if c != cell])
        return replace(state, tree=tree).with_vehicle(vehicle)
    vehicle = replace(vehicle, candidate=None, at_target=False)
    if not roi:
        for other in state.vehicles.values():
            if other.candidate == cell:  # two vehicles had the same suspicion
                state = state.with_vehicle(replace(other, candidate=None, at_target=False))
        return state.with_vehicle(vehicle)
    return _found(state, vehicle, cell, roi)


def _found(state: State, vehicle: VehicleState, looked_from: Cell, roi: list[Cell]) -> State:
    """The ROI is confirmed: everybody leaves the search and goes to the root."""
    root = roi[0]
    tree = Tree.rooted(root)
    if root == looked_from:
        tree = tree.looked(root, roi[1:])
    state = replace(state, tree=tree, found_s=state.t_s).with_vehicle(vehicle)
    vehicles = {}
    for number, other in state.vehicles.items():
        searching = other.phase is Phase.AIRBORNE and other.return_reason is None
        vehicles[number] = replace(
            other.interrupted(state.t_s) if searching else other,
            vertex=root,
            candidate=None,
            on_lane=False,
            at_target=number == vehicle.vehicle and root == looked_from,
        )
    return replace(state, vehicles=vehicles)
