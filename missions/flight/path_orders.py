"""Paths that are flown without stopping: their limits, and when they end early.

A path is given only if the fence allows all of it, and the air of its next
`missions.flight.airspace.needs.RESERVED_AHEAD_S` seconds is clear. Every report repeats that check:
a vehicle brakes along its path before it meets air that another has reserved (`keep_clear`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from missions.flight.airspace.airspace import Airspace
from missions.flight.state import Setting, State
from missions.flight.vehicle_state import OFF_LAYER_M, Phase, VehicleState
from missions.geo.braking import braked
from missions.geo.path_in_fence import allowed, as_far_as_allowed, is_outside
from missions.geo.trajectory import LANE_CUTS_M, Trajectory, at_rest, rounded_path
from missions.orders import FlyPath
from missions.units import GridPoint

PLAN_LEAD_S: Final = 1.0
"""Time from a plan to its beginning, s: setpoints are streamed up to 0.75 s ahead."""
CORNER_CUT_M: Final = 0.005
"""Cut of a corner of the fence, m; a vehicle nearly stops there."""
REENTRY_DEPTH_M: Final = 1.5
"""Distance inside the margin to which a vehicle returns that was outside, m."""


def give_path(
    state: State, vehicle: VehicleState, path: Trajectory, *, partly: bool = False
) -> State:
    """Give a path if the fence allows it and its air is clear; else the vehicle keeps its path.
    With `partly` the vehicle flies the path as far as the fence allows it."""
    setting, mission = state.setting, state.setting.mission
    fits = allowed(setting.fence, path)
    if not fits and partly:
        short = as_far_as_allowed(setting.fence, path, setting.energy.accel_m_s2)
        path, fits = (path, False) if short is None else (short, True)
    order = FlyPath(path, vehicle.cruise_height_m, setting.yaw_deg, mission.camera.interval_s)
    begins = vehicle if vehicle.path is not None else replace(vehicle, judged_s=path.begin_s)
    if fits and (given := Airspace(state).reserve(begins, order)) is not None:
        return given
    return state.holding(vehicle) if vehicle.path is None else state


def through(
    setting: Setting,
    vehicle: VehicleState,
    points: list[GridPoint],
    corners: list[bool],
    begin_s: float,
    *,
    drifts: bool = False,
    cuts_m: Sequence[float] = LANE_CUTS_M,
) -> Trajectory:
    """Return a path from rest through some points, cut as far as the fence allows. `corners` marks
    the points that are corners of the fence, which are not cut. With `drifts` the points lie in the
    frame of the region, else in the fixed one."""
    speed = setting.path_speed_m_s(vehicle.cruise_height_m, vehicle.wind_m_s)
    drift_m_s, here, grid = (0.0, 0.0), vehicle.position, setting.grid
    if drifts:
        drift_m_s = grid.drift_m_s
        here = grid.to_moving(here, begin_s)
    for cut_m in (*cuts_m, CORNER_CUT_M):
        cuts = [CORNER_CUT_M, *(CORNER_CUT_M if corner else cut_m for corner in corners)]
        path = rounded_path(
            [here, *points], round(begin_s, 3), speed_m_s=speed, cut_m=cuts,
            accel_m_s2=setting.energy.accel_m_s2, drift_m_s=drift_m_s,
        )  # fmt: skip
        if allowed(setting.fence, path):
            break
    return path


def along_route(
    setting: Setting, vehicle: VehicleState, route: Sequence[GridPoint], begin_s: float
) -> Trajectory:
    """Return a path from rest along a route inside the fence."""
    corners = [True] * (len(route) - 1) + [False]
    return through(setting, vehicle, list(route), corners, begin_s)


def descent(setting: Setting, vehicle: VehicleState, begin_s: float) -> Trajectory | None:
    """Return a path on which a vehicle only descends to its layer; None if it is there."""
    high_m = vehicle.level_m - vehicle.cruise_altitude_m
    if high_m <= OFF_LAYER_M:
        return None
    return at_rest(vehicle.position, begin_s, high_m / setting.energy.descent_m_s)


def fly_route(state: State, vehicle: VehicleState, route: Sequence[GridPoint]) -> State:
    """Give an idle vehicle a path along a route inside the fence."""
    path = along_route(state.setting, vehicle, route, state.t_s + PLAN_LEAD_S)
    return give_path(state, vehicle, path)


def come_inside(state: State, vehicle: VehicleState) -> State | None:
    """Order a waiting vehicle back inside the margin; None if it is inside, or nearly so."""
    fence = state.setting.fence
    if not is_outside(fence, vehicle.position):
        return None
    route = fence.route(vehicle.position, fence.nearest(vehicle.position, REENTRY_DEPTH_M))
    if route is None:
        return None
    return Airspace(state).reserve_or_wait(vehicle, vehicle.leg(route))


def on_paths(state: State, for_s: float) -> list[tuple[VehicleState, FlyPath]]:
    """Return our vehicles whose paths last more than `for_s` seconds longer, with their orders."""
    flying = ((v, v.order) for v in state.own_vehicles if v.phase is Phase.AIRBORNE)
    paths = ((v, order) for v, order in flying if isinstance(order, FlyPath))
    return [(v, order) for v, order in paths if order.trajectory.end_s > state.t_s + for_s]


def keep_clear(state: State) -> State:
    """Have vehicles brake whose paths lead into air that others reserve."""
    for vehicle, order in on_paths(state, PLAN_LEAD_S):
        if not Airspace(state).is_clear(vehicle, order):
            state = brake(state, vehicle, order)
    return state


def brake(state: State, vehicle: VehicleState, order: FlyPath) -> State:
    """Have a vehicle stop along its path, unless it does so anyway."""
    path = order.trajectory
    stop = braked(path, max(path.begin_s, state.t_s + PLAN_LEAD_S), state.setting.energy.accel_m_s2)
    if stop.end_s >= path.end_s - 0.5:
        return state
    return state.with_vehicle(replace(vehicle, order=replace(order, trajectory=stop)))
