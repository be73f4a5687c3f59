"""Searching without a stop: one path along the lanes of a vehicle that nobody has judged yet.

A lane is flown beside the middle of its rows: to windward, as a camera that tilts with the airframe
looks to leeward; and beside those of its rows that were judged already, so what a frame has missed
once is in the middle of the picture when the lane is flown again.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from missions.flight.deconfliction import hold
from missions.flight.path_orders import NOTICE_S, brake, give_path, through
from missions.flight.return_home import REACTION_S, go_home, has_energy_for
from missions.flight.strip import Strip
from missions.flight.two_heights import searched
from missions.ground.lanes import Lane, unseen
from missions.mission_file.views import beside_rows_m
from missions.orders import FlyPath
from missions.state import Phase, ReturnReason, Setting, State, VehicleState
from missions.units import GridPoint

SHORT_CELLS: Final = 10.0
"""What is left of a lane of a survey, and is shorter, is left to the planner of paths."""

WORTH_S: Final = 8.0
"""A path that ends sooner is flown to its end."""


def search_passes(setting: Setting, state: State, vehicle: VehicleState) -> State:
    """Give an idle vehicle a path along its lanes, as many as its battery is good for."""
    lanes = turned(setting, vehicle.position, still_open(setting, state, vehicle.lanes))
    if lanes != vehicle.lanes:
        vehicle = replace(vehicle, lanes=lanes, on_lane=False, lane_seen_m=())
    if not lanes:
        return hold(state, vehicle)
    points: list[GridPoint] = []
    corners: list[bool] = []
    at = vehicle.position
    for lane in vehicle.lanes:
        start, end = flown_along(setting, state, vehicle, lane)
        route = setting.fence.route(at, start)
        across = setting.fence.route(start, end)
        if route is None or across is None:
            break
        for leg in (route, across):
            points.extend(leg)
            corners.extend([True] * (len(leg) - 1) + [False])
        at = end
    if not points:  # a part of the box that no way inside the fence leads to
        lost = (*state.unreachable_lanes, vehicle.lanes[0])
        state = replace(state, unreachable_lanes=lost)
        return hold(state, replace(vehicle, lanes=vehicle.lanes[1:]))
    if not has_energy_for(setting, vehicle, points[0], REACTION_S):
        return go_home(setting, state, vehicle, ReturnReason.BATTERY)
    path = through(setting, vehicle, points, corners, state.t_s + NOTICE_S)
    return give_path(setting, state, replace(vehicle, on_lane=True), path)


def still_open(setting: Setting, state: State, lanes: tuple[Lane, ...]) -> tuple[Lane, ...]:
    """What of some lanes has a column with a cell that no frame has judged.

    While a region drifts other cells come below a lane: it is flown as it is. Where
    the whole box is seen, what is left of lanes and short is flown to once they are, in the best
    order that is found.
    """
    grid, judged = setting.grid, searched(setting, state)
    if grid.drift_speed_m_s > 0.0:
        return lanes
    least_m = SHORT_CELLS * grid.cell_m if setting.sees_box else 0.0
    found: list[Lane] = []
    for lane in lanes:
        seen_m = Strip.of(grid, lane, setting.lane_rows, state.t_s).judged_m(judged)
        parts = unseen(lane, seen_m, grid.cell_m) if seen_m else (lane,)
        found.extend(
            part
            for part in parts
            if _is_whole(setting, part) or part[0].distance_to(part[1]) >= least_m
        )
    return tuple(found)


def turned(setting: Setting, at: GridPoint, lanes: tuple[Lane, ...]) -> tuple[Lane, ...]:
    """Lanes in such directions that the ways between them are shortest, from a place on.

    With a prior whole lanes are flown as they are: it has chosen their directions.
    """
    ways: list[tuple[float, tuple[Lane, ...]]] = [(0.0, ())]
    for lane in lanes:
        back = (lane[1], lane[0])
        ways = [
            min(
                (
                    (way_m + (done[-1][1] if done else at).distance_to(each[0]), (*done, each))
                    for way_m, done in ways
                ),
                key=lambda way: way[0],
            )
            for each in ((lane,) if setting.likely and _is_whole(setting, lane) else (lane, back))
        ]
    return min(ways, key=lambda way: way[0])[1]


def _is_whole(setting: Setting, lane: Lane) -> bool:
    """Whether it is a lane of the mission, of which nothing was flown yet."""
    return lane in setting.lanes or (lane[1], lane[0]) in setting.lanes


def end_searched(setting: Setting, state: State) -> State:
    """Let those brake whose lanes others have seen meanwhile, from higher up or in their stead."""
    if state.tree is not None or setting.grid.drift_speed_m_s > 0.0:
        return state
    for number in state.our_numbers:
        vehicle = state.vehicles[number]
        order = vehicle.order
        if vehicle.phase is not Phase.AIRBORNE or not isinstance(order, FlyPath):
            continue
        if order.trajectory.end_s <= state.t_s + WORTH_S or not vehicle.on_lane:
            continue
        if not any(_is_open(setting, state, lane) for lane in reversed(vehicle.lanes)):
            state = brake(state, vehicle, order)
    return state


def drop_seen(setting: Setting, state: State) -> State:
    """Without what members of a fleet hold who will not fly it, and others have seen meanwhile.

    They tell it for as long as they are heard, and those out of contact are taken to hold it.
    """
    for number, vehicle in state.vehicles.items():
        gone = vehicle.phase not in (Phase.AIRBORNE, Phase.GROUNDED)
        if not state.is_ours(number) and gone and vehicle.lanes:
            left = still_open(setting, state, vehicle.lanes)
            if left != vehicle.lanes:
                state = state.with_vehicle(replace(vehicle, lanes=left))
    return state


def _is_open(setting: Setting, state: State, lane: Lane) -> bool:
    """Whether a lane has a cell that is not judged; in a survey, not decided."""
    strip = Strip.of(setting.grid, lane, setting.lane_rows, state.t_s)
    if setting.surveys:
        return not strip.is_known(lambda cell: state.belief.verdict(cell) is not None)
    return not strip.is_known(searched(setting, state).__contains__)


def flown_along(setting: Setting, state: State, vehicle: VehicleState, lane: Lane) -> Lane:
    """Where a lane is flown, so far beside the middle of its rows as the fence allows."""
    grid = setting.grid
    strip = Strip.of(grid, lane, setting.lane_rows, state.t_s)
    beside_m = beside_rows_m(
        setting.mission, grid, vehicle.cruise_height_m, east_ahead=setting.east_ahead
    )
    missing = strip.missing_rows(searched(setting, state))
    if missing and grid.drift_speed_m_s == 0.0:
        beside_m += (missing[0] + missing[-1]) / 2 * grid.cell_m - strip.line_m
    for share in (1.0, 0.5):
        away_m = share * beside_m
        east_m, north_m = (0.0, away_m) if strip.eastward else (away_m, 0.0)
        start, end = (GridPoint(p.east_m + east_m, p.north_m + north_m) for p in lane)
        if setting.fence.allows_leg(start, end):
            return start, end
    return lane
