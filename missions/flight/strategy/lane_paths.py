"""Searching without a stop: one path along a vehicle's lanes that no frame has judged yet.

A lane is flown beside the middle of its rows. It is flown to windward, as a camera that tilts with
the airframe looks to leeward. It is also flown beside rows that are judged. So missed rows are in
the middle of the picture when the lane is flown again.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from missions.flight.airspace.airspace import Airspace
from missions.flight.path_orders import PLAN_LEAD_S, brake, give_path, on_paths, through
from missions.flight.return_home import REACTION_S, go_home, has_energy_for
from missions.flight.state import Setting, State
from missions.flight.vehicle_state import Phase, ReturnReason, VehicleState
from missions.geo.path_in_fence import allowed
from missions.geo.trajectory import Trajectory
from missions.mission.views import beside_rows_m
from missions.planning.search.lanes import Lane, turned
from missions.units import GridPoint

WORTH_S: Final = 8.0
"""Minimum remaining time of a path that is ended early, s."""


def search_paths(state: State, vehicle: VehicleState) -> State:
    """Give an idle vehicle a path along its lanes, as many as its battery allows."""
    setting = state.setting
    at = setting.to_lanes(vehicle.position, state.t_s)
    lanes = turned(at, still_open(state, vehicle.lanes), keep=setting.aimed_lanes)
    if lanes != vehicle.lanes:
        vehicle = replace(vehicle, lanes=lanes, on_lane=False, lane_seen_m=())
    if not lanes:
        return state.holding(vehicle)
    points, corners = _points_along_lanes(state, vehicle)
    if not points:  # no path inside the fence leads to this part of the box
        return give_up_lane(state, vehicle)
    first = setting.over_ground(points[0], state.t_s)
    if not has_energy_for(setting, vehicle, first, REACTION_S):
        return go_home(state, vehicle, ReturnReason.BATTERY)

    def along(count: int) -> Trajectory:
        return through(
            setting, vehicle, points[:count], corners[:count], state.t_s + PLAN_LEAD_S,
            drifts=setting.lanes_drift, cuts_m=setting.heights.cuts_m(setting),
        )  # fmt: skip

    path = along(len(points))
    if any(corners) and not allowed(setting.fence, path):
        # a path that drifts round a corner may miss the edge of the fence by a little
        round_at = corners.index(True)
        if round_at == 0:
            # over ground, round the corners of the fence, to the start of the lane
            start = setting.over_ground(points[corners.index(False)], state.t_s)
            route = setting.fence.route(vehicle.position, start)
            if route is None:
                return state.holding(vehicle)
            begins = replace(vehicle, on_lane=False)
            return Airspace(state).reserve_or_wait(begins, vehicle.leg(route))
        path = along(round_at)
    return give_path(state, replace(vehicle, on_lane=True), path)


def give_up_lane(state: State, vehicle: VehicleState) -> State:
    """Note that no path leads to a vehicle's first lane; the vehicle waits."""
    lost = (*state.unreachable_lanes, vehicle.lanes[0])
    state = replace(state, unreachable_lanes=lost)
    left = replace(vehicle, lanes=vehicle.lanes[1:], on_lane=False, lane_seen_m=())
    return state.holding(left)


def _points_along_lanes(state: State, vehicle: VehicleState) -> tuple[list[GridPoint], list[bool]]:
    """Return the points of a way along a vehicle's lanes, and which of them are corners of the
    fence. A way round an obstacle is planned for the time when the vehicle will be there."""
    setting = state.setting
    points: list[GridPoint] = []
    corners: list[bool] = []
    speed_m_s = setting.path_speed_m_s(vehicle.cruise_height_m, vehicle.wind_m_s)
    pause_s = speed_m_s / setting.energy.accel_m_s2  # at a corner it nearly stops
    t_s = state.t_s + PLAN_LEAD_S
    at = setting.to_lanes(vehicle.position, t_s)
    for lane in vehicle.lanes:
        start, end = flown_along(state, vehicle, lane)
        legs = []
        for a, b in ((at, start), (start, end)):
            end_s = t_s + a.distance_to(b) / speed_m_s
            here = setting.over_ground(a, t_s)
            route = setting.fence.route(here, setting.over_ground(b, end_s))
            if route is None:
                return points, corners
            leg = []
            for place in route[:-1]:
                t_s += here.distance_to(place) / speed_m_s
                leg.append(setting.to_lanes(place, t_s))
                t_s, here = t_s + pause_s, place
            t_s = max(end_s, t_s + here.distance_to(setting.over_ground(b, end_s)) / speed_m_s)
            legs.append([*leg, b])
        for leg in legs:
            points.extend(leg)
            corners.extend([True] * (len(leg) - 1) + [False])
        at = end
    return points, corners


def still_open(state: State, lanes: tuple[Lane, ...]) -> tuple[Lane, ...]:
    """Return the parts of lanes that have a cell which no frame has judged. A fixed lane over a
    region that drifts is flown whole: other cells come below it. Parts shorter than the strategy's
    `least_lane_cells` are left to the path planner."""
    setting = state.setting
    if cells_drift_out(setting):
        return lanes
    judged = setting.heights.searched(state)
    least_m = setting.strategy.least_lane_cells * setting.grid.cell_m
    found: list[Lane] = []
    for lane in lanes:
        found.extend(
            part
            for part in setting.strip(lane, state.t_s).parts_left(lane, judged)
            if part in setting.whole_lanes or part[0].distance_to(part[1]) >= least_m
        )
    return tuple(found)


def cells_drift_out(setting: Setting) -> bool:
    """Return whether cells drift out of lanes that are fixed over ground."""
    return setting.grid.drift_speed_m_s > 0.0 and not setting.lanes_drift


def end_searched(state: State) -> State:
    """Have vehicles brake whose lanes others have seen meanwhile."""
    if state.tree is not None or cells_drift_out(state.setting):
        return state
    for vehicle, order in on_paths(state, WORTH_S):
        if not vehicle.on_lane:
            continue
        done = state.setting.strategy.lane_done(state)
        strips = (state.setting.strip(lane, state.t_s) for lane in reversed(vehicle.lanes))
        if all(strip.is_known(done) for strip in strips):
            state = brake(state, vehicle, order)
    return state


def drop_seen(state: State) -> State:
    """Drop lanes that others have seen from members of a fleet that will not fly them."""
    for number, vehicle in state.vehicles.items():
        gone = vehicle.phase not in (Phase.AIRBORNE, Phase.GROUNDED)
        if number not in state.our_numbers and gone and vehicle.lanes:
            left = still_open(state, vehicle.lanes)
            if left != vehicle.lanes:
                state = state.with_vehicle(replace(vehicle, lanes=left))
    return state


def flown_along(state: State, vehicle: VehicleState, lane: Lane) -> Lane:
    """Return the line along which a lane is flown, beside its middle as far as the fence allows."""
    setting, grid = state.setting, state.setting.grid
    strip = setting.strip(lane, state.t_s)
    beside_m = beside_rows_m(
        setting.mission, grid, vehicle.cruise_height_m, east_ahead=setting.east_ahead
    )
    missing = strip.missing_rows(setting.heights.searched(state))
    if missing and not cells_drift_out(setting):
        beside_m += (missing[0] + missing[-1]) / 2 * grid.cell_m - strip.line_m
    lane = setting.heights.shortened(setting, vehicle, lane)
    for share in (1.0, 0.5):
        away_m = share * beside_m
        east_m, north_m = (0.0, away_m) if strip.eastward else (away_m, 0.0)
        start, end = (GridPoint(p.east_m + east_m, p.north_m + north_m) for p in lane)
        legs = (setting.over_ground(place, state.t_s) for place in (start, end))
        if setting.fence.allows_leg(*legs):
            return start, end
    return lane
