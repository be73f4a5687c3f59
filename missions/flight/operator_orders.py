"""Orders of the operator, and traffic: pause, continue, recall one vehicle, skip a cell.

In a pause a vehicle still makes way. It still returns if its battery is low or if it has begun to.
"""

from __future__ import annotations

from dataclasses import replace

from missions.events import CAUSE_NOT_REPORTED, AutopilotText, CellSkipped, VehicleRecalled
from missions.flight.lane_progress import lane_left
from missions.flight.state import Setting, State
from missions.flight.vehicle_state import Phase, VehicleState
from missions.orders import FlyPath, FlyTo, Look, Sweep
from missions.traffic import Place, Rule

RECALL_NOTE = "called home by the operator"


def stop_all(state: State) -> State:
    """Have working vehicles stop and hold; take-offs under way continue."""
    return state.with_all(lambda v: _stopped(state, v) if v.works else v)


def respond_to_traffic(state: State) -> State:
    """Return the state with the team's response to traffic at its time."""
    if not state.traffic.tracks and not state.traffic.answer:
        return state
    setting, wanted = state.setting, state.setting.mission.traffic
    rule = Rule(wanted.distance_m, wanted.height_m + setting.relief_m)
    team = (Place(v.position, v.level_m) for v in state.own_vehicles)
    traffic = state.traffic.with_answer(rule, team, state.t_s)
    after = state if traffic is state.traffic else replace(state, traffic=traffic)
    return stop_all(after) if after.is_held and not state.is_held else after


def vehicle_recalled(
    event: VehicleRecalled, vehicle: VehicleState, setting: Setting
) -> VehicleState:
    """Recall a vehicle once it is under our control; it stays on the ground until a resume."""
    return replace(vehicle, called_home=True, note=vehicle.note or RECALL_NOTE)


def skip(state: State, event: CellSkipped) -> State:
    """Skip a cell: vehicles that were about to observe it continue with the next."""
    cell = event.cell
    strategy = state.setting.strategy.in_force(state)
    if strategy.to_skip(state, state.vehicles[event.vehicle]) != cell:
        return state
    for other in state.vehicles.values():
        if cell not in (other.candidate, other.vertex):
            continue
        there = isinstance(other.order, Look | FlyTo) and other.order.cell == cell
        if there and other.works:
            other = other.interrupted(state.t_s)
        dropped = replace(other, candidate=None, at_target=state.tree is not None)
        state = state.with_vehicle(replace(dropped, fruitless_sorties=0))
    return finish_skipped_cells(replace(state, skipped=state.skipped | {cell}))


def finish_skipped_cells(state: State) -> State:
    """Return the state with skipped cells done, including those that became region later."""
    tree = state.tree
    for cell in state.skipped if tree is not None else ():
        if tree is not None and cell in tree and not tree.is_observed(cell):
            tree = tree.with_observation(cell, ())
    return state if tree is state.tree else replace(state, tree=tree)


def failsafe_explained(state: State, event: AutopilotText) -> State:
    """Add the cause of a failsafe that the autopilot reports only afterwards."""
    vehicle = state.vehicles[event.vehicle]
    if event.cause is None or vehicle.phase is not Phase.YIELDED or event.cause in vehicle.note:
        return state
    note = vehicle.note.replace(f": {CAUSE_NOT_REPORTED}", "")
    return state.with_vehicle(replace(vehicle, note=f"{note}: {event.cause}"))


def _stopped(state: State, vehicle: VehicleState) -> VehicleState:
    """Return a vehicle without its order; in a pause it may only hold."""
    if not isinstance(vehicle.order, FlyTo | FlyPath | Sweep | Look):
        return vehicle
    left = vehicle if vehicle.path is None else lane_left(vehicle, state.setting.grid.cell_m)
    return left.interrupted(state.t_s)
