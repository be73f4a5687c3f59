"""Changes by frames: votes, the root of the tree, and the growth of the tree."""

from __future__ import annotations

from dataclasses import replace

from missions.events import FrameSeen, LookEnded
from missions.flight.lane_progress import lane_passed, lane_seen
from missions.flight.state import State
from missions.flight.strategy.searching import drifts_out, give_up
from missions.flight.vehicle_state import Phase, ReturnReason, VehicleState
from missions.mapping.belief import FrameId
from missions.mapping.overview import with_plain
from missions.mapping.tree import Tree, grown
from missions.orders import FlyTo, Look
from missions.units import Cell


def frame_seen(state: State, event: FrameSeen) -> State:
    """Count the votes of a frame; end an observation once all that it can see is decided."""
    if event.overview:
        return _seen_from_above(state, event)
    frame = FrameId(event.vehicle, event.t_s)
    # a late vote must not undo a decision on which the tree has grown
    votes = state.belief.in_time(
        event.vantage, frame, {vote.cell: vote.positive for vote in event.votes}
    )
    most, tallies = state.belief.frames, state.belief.open_tallies.as_dict()
    counts = any(cell not in tallies or tallies[cell].total < most for cell in votes)
    state = replace(state, belief=state.belief.with_frame(event.vantage, frame, votes))
    vehicle = replace(state.vehicles[event.vehicle], frames_lost=0, judged_s=state.t_s)
    if event.vantage is None:
        if counts:
            vehicle = replace(vehicle, fruitless_sorties=0)
        state = state.with_vehicle(vehicle)
        if state.tree is None:
            return state.setting.strategy.seen_in_passing(state, event, votes)
        return replace(state, tree=grown(state.tree, state.belief, votes))
    if state.tree is None:
        vehicle = lane_seen(state, vehicle, event, event.vantage)
    state = state.with_vehicle(vehicle)
    if isinstance(vehicle.order, Look) and vehicle.order.cell == event.vantage:
        if state.belief.fully_voted(event.vantage):
            return _count_observation(state, vehicle, event.vantage)
    elif (tree := state.tree) is not None:
        # a frame that arrives after its observation may still make a neighbour region
        if event.vantage in tree and tree.is_observed(event.vantage):
            near = (c for c in event.vantage.neighbours() if c in state.belief.roi)
            if new := [c for c in near if c not in tree]:
                return replace(state, tree=tree.with_observation(event.vantage, new))
    elif vehicle.candidate is None and (hint := _hint(state, event)) is not None:
        if vehicle.works:
            vehicle = replace(vehicle.interrupted(state.t_s), at_target=False)
        return state.with_vehicle(replace(vehicle, candidate=hint))
    return state


def _seen_from_above(state: State, event: FrameSeen) -> State:
    """Count a frame from search height for its lane, and for cells that are plain from there."""
    frame = FrameId(event.vehicle, event.t_s)
    said = {vote.cell: vote.positive for vote in event.votes}
    before = state.overview
    votes = before.in_time(None, frame, said)
    fresh = before.undecided(votes)  # decided cells stay decided
    overview = before.with_frame(None, frame, votes)
    vehicle = replace(state.vehicles[event.vehicle], frames_lost=0, judged_s=state.t_s)
    if not state.setting.in_box.isdisjoint(fresh):
        vehicle = replace(vehicle, fruitless_sorties=0)
    belief = with_plain(state.belief, overview, state.setting.in_box, fresh)
    state = replace(state, belief=belief, overview=overview).with_vehicle(vehicle)
    return on_a_lane(state, event)


def on_a_lane(state: State, event: FrameSeen) -> State:
    """Count a frame of a vehicle that does not stop for the lane that it flies."""
    shown, judged = [vote.cell for vote in event.votes], state.setting.heights.searched(state)
    vehicle = state.vehicles[event.vehicle]
    return state.with_vehicle(lane_passed(state.setting, vehicle, event.t_s, shown, judged))


def _hint(state: State, event: FrameSeen) -> Cell | None:
    """Return the first cell, inside the fence and not visited, that a frame shows as region."""
    for vote in event.votes:
        looked = state.belief.frames_taken(vote.cell) >= state.setting.mission.votes.frames
        if not vote.positive or looked or vote.cell in state.skipped:
            continue
        if state.setting.fence.allows(state.setting.where(vote.cell, state.t_s)):
            return vote.cell
    return None


def look_ended(state: State, event: LookEnded) -> State:
    """End an observation whose frames are used up before every neighbour has its votes."""
    vehicle = state.vehicles[event.vehicle]
    if not isinstance(vehicle.order, Look):
        return state
    cell = vehicle.order.cell
    if state.belief.frames_taken(cell) == 0:
        silent = replace(vehicle, order=None, return_reason=ReturnReason.FAULT)
        return state.with_vehicle(replace(silent, note="the camera is silent"))
    return _count_observation(replace(state, undecided=state.undecided | {cell}), vehicle, cell)


def follow_no_farther(state: State, vehicle: VehicleState) -> State:
    """End an observation of a cell, or a leg to it, if the cell drifts out of the fence. Lost
    pictures or a head wind make both last longer than estimated."""
    order = vehicle.order
    if vehicle.phase is not Phase.AIRBORNE or not isinstance(order, Look | FlyTo):
        return state
    if order.cell is None or not drifts_out(state, order.cell):
        return state
    if isinstance(order, FlyTo):  # at rest it gets a new decision
        return state.with_vehicle(replace(vehicle.interrupted(state.t_s), at_target=False))
    cell = order.cell
    if state.belief.frames_taken(cell) == 0:
        return give_up(state, vehicle, cell)
    return _count_observation(replace(state, undecided=state.undecided | {cell}), vehicle, cell)


def _count_observation(state: State, vehicle: VehicleState, cell: Cell) -> State:
    """Grow the tree after an observation, or end the search if it has found a root."""
    roi = [c for c in cell.cross() if c in state.belief.roi]
    vehicle = replace(vehicle, order=None, fruitless_sorties=0)
    if state.tree is not None:
        tree = state.tree
        if cell in tree:
            tree = tree.with_observation(cell, [c for c in roi if c != cell])
        return replace(state, tree=tree).with_vehicle(vehicle)
    vehicle = replace(vehicle, candidate=None, at_target=False)
    if not roi:
        for other in state.vehicles.values():
            if other.candidate == cell:  # two vehicles had the same suspicion
                state = state.with_vehicle(replace(other, candidate=None, at_target=False))
        return state.with_vehicle(vehicle)
    return _root_found(state, vehicle, cell, roi)


def _root_found(state: State, vehicle: VehicleState, looked_from: Cell, roi: list[Cell]) -> State:
    """Have all vehicles leave the search for the root of the region."""
    root = roi[0]
    tree = Tree.rooted(root)
    if root == looked_from:
        tree = tree.with_observation(root, roi[1:])

    def leaving(other: VehicleState) -> VehicleState:
        there = other.vehicle == vehicle.vehicle and root == looked_from
        left = other.interrupted(state.t_s) if other.works else other
        return replace(left, vertex=root, candidate=None, on_lane=False, at_target=there)

    state = replace(state, tree=tree, found_s=state.t_s).with_vehicle(vehicle)
    return state.with_all(leaving)
