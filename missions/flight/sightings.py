"""What frames change: votes, the root of the tree, and how the tree grows."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from missions.events import FrameSeen, LookEnded
from missions.flight.lane_progress import lane_passed, lane_seen
from missions.flight.setting import Setting
from missions.flight.state import Phase, ReturnReason, State, VehicleState
from missions.flight.strategy.searching import drifts_out, give_up
from missions.mapping.belief import Belief, FrameId, Verdicts
from missions.mapping.overview import with_plain
from missions.mapping.tree import Tree
from missions.orders import FlyTo, Look
from missions.units import Cell


def frame_seen(setting: Setting, state: State, event: FrameSeen) -> State:
    """Count the votes; end a look once everything it can see is decided.

    A frame without a vantage is evidence and no more: it is of no look and of no lane.
    """
    if event.overview:
        return _seen_from_above(setting, state, event)
    frame = FrameId(event.vehicle, event.t_s)
    # a late vote must not undo what the tree was grown on
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
        return _seen_in_passing(setting, state, vehicle, event, votes)
    if state.tree is None:
        vehicle = _on_its_lane(setting, state.belief, vehicle, event, event.vantage)
    state = state.with_vehicle(vehicle)
    if isinstance(vehicle.order, Look) and vehicle.order.cell == event.vantage:
        if state.belief.fully_voted(event.vantage):
            return _looked(state, vehicle, event.vantage)
    elif state.tree is not None:
        return replace(state, tree=_late_positives(state.tree, state.belief, event.vantage))
    elif vehicle.candidate is None:
        hint = _hint(setting, state, event)
        if hint is not None:
            if vehicle.works:
                vehicle = replace(vehicle.interrupted(state.t_s), at_target=False)
            return state.with_vehicle(replace(vehicle, candidate=hint))
    return state


def _seen_from_above(setting: Setting, state: State, event: FrameSeen) -> State:
    """A frame from the height of a search counts for the lane, and for what is plain by it."""
    frame = FrameId(event.vehicle, event.t_s)
    said = {vote.cell: vote.positive for vote in event.votes}
    before = state.overview
    votes = before.in_time(None, frame, said)
    fresh = before.undecided(votes)  # what is decided stays so
    overview = before.with_frame(None, frame, votes)
    vehicle = replace(
        state.vehicles[event.vehicle], frames_lost=0, judged_s=state.t_s, fruitless_sorties=0
    )
    belief = with_plain(state.belief, overview, setting.in_box, fresh)
    state = replace(state, belief=belief, overview=overview)
    return on_a_lane(setting, state, vehicle, event)


def on_a_lane(setting: Setting, state: State, vehicle: VehicleState, event: FrameSeen) -> State:
    """What a frame of a vehicle that does not stop means for the lane that it flies."""
    shown, judged = [vote.cell for vote in event.votes], setting.heights.searched(state)
    vehicle = lane_passed(
        vehicle, setting.grid, setting.lane_rows, judged, shown, event.t_s,
        drifts=setting.strategy.lanes_drift,
    )  # fmt: skip
    return state.with_vehicle(vehicle)


def _on_its_lane(
    setting: Setting, belief: Belief, vehicle: VehicleState, event: FrameSeen, vantage: Cell
) -> VehicleState:
    """What a frame of a search means for the lane that its vehicle flies."""
    shown = {vote.cell for vote in event.votes}

    def judged(cell: Cell) -> bool:
        return cell in shown or belief.tally(cell, vantage).total > 0

    return lane_seen(vehicle, setting.grid, setting.lane_rows, vantage, judged, event.t_s)


def _seen_in_passing(
    setting: Setting, state: State, vehicle: VehicleState, event: FrameSeen, votes: Verdicts
) -> State:
    """What a frame from anywhere changes besides the votes: the lanes, the root, the tree."""
    if state.tree is not None:
        tree = grown(state.tree, state.belief, votes)
        return replace(state, tree=tree).with_vehicle(vehicle)
    return setting.strategy.seen_in_passing(setting, state, vehicle, event, votes)


def grown(tree: Tree, belief: Belief, fresh: Iterable[Cell]) -> Tree:
    """The tree after cells got votes: a vertex whose neighbours are all decided was looked from."""
    verdicts, region = belief.verdicts, belief.roi.as_dict()
    (_, *steps) = cross = Cell(0, 0).cross()
    asked = [Cell(e + east, n + north) for e, n in fresh for east, north in cross]
    while asked:
        e, n = cell = asked.pop()
        near = [Cell(e + east, n + north) for east, north in steps]
        undecided = any(verdicts.get(each) is None for each in near)
        if undecided or cell not in tree or tree.has_looked(cell):
            continue
        roi = [each for each in near if each in region]
        asked.extend(each for each in roi if each not in tree)
        tree = tree.looked(cell, roi)
    return tree


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
        if vote.cell in state.skipped:
            continue
        if vote.positive and not looked and _in_reach(setting, state, vote.cell):
            return vote.cell
    return None


def _in_reach(setting: Setting, state: State, cell: Cell) -> bool:
    """Whether the centre of a cell is inside the fence now."""
    grid = setting.grid
    return setting.fence.allows(grid.to_fixed(grid.centre_of(cell), state.t_s))


def look_ended(state: State, event: LookEnded) -> State:
    """An order's frames are used up before every neighbour had its votes."""
    vehicle = state.vehicles[event.vehicle]
    if not isinstance(vehicle.order, Look):
        return state
    cell = vehicle.order.cell
    if state.belief.frames_taken(cell) == 0:
        silent = replace(vehicle, order=None, return_reason=ReturnReason.FAULT)
        return state.with_vehicle(replace(silent, note="the camera is silent"))
    return _looked_in_part(state, vehicle, cell)


def follow_no_farther(setting: Setting, state: State, vehicle: VehicleState) -> State:
    """End a look at, or a leg to, a cell that drifts out of the fence while it is followed.

    Both were given because the cell would stay inside for as long as they should take; lost
    pictures or a head wind make them last longer.
    """
    order = vehicle.order
    if vehicle.phase is not Phase.AIRBORNE or not isinstance(order, Look | FlyTo):
        return state
    if order.cell is None or not drifts_out(setting, state, order.cell):
        return state
    if isinstance(order, FlyTo):  # at rest it is decided anew where to go
        return state.with_vehicle(replace(vehicle.interrupted(state.t_s), at_target=False))
    if state.belief.frames_taken(order.cell) == 0:
        return give_up(state, vehicle, order.cell)
    return _looked_in_part(state, vehicle, order.cell)


def _looked_in_part(state: State, vehicle: VehicleState, cell: Cell) -> State:
    """A look is over before the cell and its neighbours have their votes: what there is counts."""
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
        vehicles[number] = replace(
            other.interrupted(state.t_s) if other.works else other,
            vertex=root,
            candidate=None,
            on_lane=False,
            at_target=number == vehicle.vehicle and root == looked_from,
        )
    return replace(state, vehicles=vehicles)
