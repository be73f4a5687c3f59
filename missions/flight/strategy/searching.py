"""Searching the box with stops, visiting cells, and sharing the rest of the lanes. A search flies
lanes and visits suspicions; an exploration visits vertices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from missions.flight.airspace.airspace import Airspace
from missions.flight.lane_progress import lane_left
from missions.flight.return_home import REACTION_S, go_home, has_energy_for, home_order
from missions.flight.state import State
from missions.flight.strategy.lane_paths import give_up_lane
from missions.flight.vehicle_state import OVER_PAD_M, Phase, ReturnReason, VehicleState
from missions.geo.fence import route_length_m
from missions.orders import FlyTo, Look, Order, Sweep
from missions.units import Cell, GridPoint

EXTRA_FRAMES = 6
"""Maximum frames of an observation, in multiples of a ballot."""


def visit(state: State, vehicle: VehicleState, cell: Cell, *, stop: bool) -> State:
    """Fly to a cell, and observe it if no vehicle has."""
    setting = state.setting
    if not vehicle.at_target:
        return _fly_to_cell(state, vehicle, cell, stop=stop)
    if setting.grid.drift_speed_m_s > 0.0:
        # the cell may have drifted away, or out of the fence, during a wait
        off_m = vehicle.position.distance_to(setting.where(cell, state.t_s))
        if off_m > setting.grid.cell_m / 4:
            return _fly_to_cell(state, replace(vehicle, at_target=False), cell, stop=stop)
        if stop and not _stays_inside(state, vehicle, (vehicle.position,), cell):
            return give_up(state, vehicle, cell)
    others = (v for n, v in state.vehicles.items() if n != vehicle.vehicle)
    looks = (v.order for v in others if v.phase is Phase.AIRBORNE and isinstance(v.order, Look))
    if not stop or any(look.cell == cell for look in looks):
        return state.holding(vehicle)
    frames = EXTRA_FRAMES * setting.mission.votes.frames
    return Airspace(state).reserve_or_wait(vehicle, Look(cell, frames, vehicle.cruise_height_m))


def _fly_to_cell(state: State, vehicle: VehicleState, cell: Cell, *, stop: bool) -> State:
    setting = state.setting
    target = setting.where(cell, state.t_s)
    route = setting.fence.route(vehicle.position, target)
    if route is None or not _stays_inside(state, vehicle, route, cell, look=stop):
        return give_up(state, vehicle, cell)
    if not has_energy_for(setting, vehicle, target, setting.look_s if stop else REACTION_S):
        return go_home(state, vehicle, ReturnReason.BATTERY)
    order = FlyTo(route[:-1], cell, stop=stop, height_m=vehicle.cruise_height_m)
    return Airspace(state).reserve_or_wait(vehicle, order)


def _stays_inside(
    state: State,
    vehicle: VehicleState,
    route: Sequence[GridPoint],
    cell: Cell,
    *,
    look: bool = True,
) -> bool:
    """Return whether the fence still allows a drifting cell when it is reached and observed."""
    setting, mission = state.setting, state.setting.mission
    drift_m_s = setting.grid.drift_speed_m_s
    if drift_m_s == 0.0:
        return True
    closing_m_s = mission.flight.speed_m_s - drift_m_s
    gone_s = route_length_m(vehicle.position, route) / closing_m_s + REACTION_S
    if look:
        frames = EXTRA_FRAMES * mission.votes.frames
        gone_s += setting.look_s + frames * mission.camera.interval_s
    return setting.fence.allows_leg(route[-1], setting.where(cell, state.t_s + gone_s))


def drifts_out(state: State, cell: Cell) -> bool:
    """Return whether a cell is outside the fence, or will be within `REACTION_S`."""
    setting = state.setting
    now, soon = (setting.where(cell, state.t_s + ahead_s) for ahead_s in (0.0, REACTION_S))
    return setting.grid.drift_speed_m_s > 0.0 and not setting.fence.allows_leg(now, soon)


def give_up(state: State, vehicle: VehicleState, cell: Cell) -> State:
    """Have a vehicle wait whose cell is beyond the fence."""
    if state.tree is None:
        return state.holding(replace(vehicle, candidate=None, at_target=False))
    state = mark_unreachable(state, vehicle, cell)
    return state.holding(state.vehicles[vehicle.vehicle])


def mark_unreachable(state: State, vehicle: VehicleState, cell: Cell) -> State:
    """Continue in the tree as if the vehicle had been at a vertex; the result is incomplete."""
    if state.tree is not None and not state.tree.is_observed(cell):
        tree = state.tree.with_observation(cell, ())
        state = replace(state, tree=tree, abandoned=state.abandoned | {cell})
    return state.with_vehicle(replace(vehicle, at_target=True, fruitless_sorties=0))


def search(state: State, vehicle: VehicleState) -> State:
    """Observe a suspicion, else fly the next lane."""
    setting = state.setting
    if vehicle.candidate is not None:
        return visit(state, vehicle, vehicle.candidate, stop=True)
    if not vehicle.lanes:
        state = find_work(state, vehicle)
        vehicle = state.vehicles[vehicle.vehicle]
        if not vehicle.idle_in_search:
            return state
        if vehicle.position.distance_to(vehicle.home) <= OVER_PAD_M:
            return state.holding(vehicle)
        # it waits over its own pad, out of the way of vehicles that have to land
        return Airspace(state).reserve_or_wait(vehicle, home_order(setting, vehicle))
    start, end = vehicle.lanes[0]
    if vehicle.on_lane and setting.fence.allows_leg(vehicle.position, end):
        # flown as far as the battery lasts; the next sortie flies the rest
        order: Order = Sweep(end, setting.mission.grid.cell_m, vehicle.cruise_height_m)
        return Airspace(state).reserve_or_wait(vehicle, order)
    if vehicle.on_lane:  # it left the lane for a suspicion, and the fence lies between
        vehicle = lane_left(vehicle, setting.grid.cell_m)
        if not vehicle.lanes:
            return state.holding(vehicle)
        start, end = vehicle.lanes[0]
    route = setting.fence.route(vehicle.position, start)
    if route is None:  # no path inside the fence leads to this part of the box
        return give_up_lane(state, vehicle)
    if not has_energy_for(setting, vehicle, start, REACTION_S):
        return go_home(state, vehicle, ReturnReason.BATTERY)
    order = FlyTo(route, None, stop=False, height_m=vehicle.cruise_height_m)
    return Airspace(state).reserve_or_wait(vehicle, order)


def find_work(state: State, vehicle: VehicleState) -> State:
    """Take over a suspicion of a vehicle that dropped out, or a lane of the one with most left.
    Lanes are taken from the far end; a vehicle that dropped out leaves all of its lanes."""
    for other in state.vehicles.values():
        gone = other.phase not in (Phase.AIRBORNE, Phase.GROUNDED)
        if gone and other.candidate is not None:
            state = state.with_vehicle(replace(other, candidate=None))
            heir = replace(vehicle, candidate=other.candidate, at_target=False)
            return state.with_vehicle(heir)

    orphan = state.setting.team.free_lane(state)
    if orphan is not None:
        return state.with_vehicle(replace(vehicle, lanes=(orphan,), on_lane=False))

    def spare(other: VehicleState) -> int:
        if state.setting.strategy.flies_all_lanes and other.on_lane and other.path is not None:
            return 0  # it is on a path along all of them
        if other.phase is Phase.APART and state.t_s < other.held_until_s:
            return 0  # out of contact: it should still be working
        active = other.phase in (Phase.AIRBORNE, Phase.GROUNDED)
        return len(other.lanes) - (1 if active else 0)

    others = [v for v in state.vehicles.values() if v.vehicle != vehicle.vehicle and spare(v) > 0]
    if not others:
        return state
    busiest = max(others, key=lambda v: (spare(v), -v.vehicle))
    state = state.with_vehicle(replace(busiest, lanes=busiest.lanes[:-1]))
    return state.with_vehicle(replace(vehicle, lanes=(busiest.lanes[-1],), on_lane=False))
