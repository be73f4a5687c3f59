"""Vehicles and the map in the planner's form, in the frame of the region."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from itertools import chain
from typing import Final

import numpy as np
import shapely
from shapely.geometry import LineString

from missions.flight.lane_progress import lane_left
from missions.flight.state import Setting, State
from missions.flight.vehicle_state import VehicleState
from missions.geo.columns import gate_past_columns
from missions.geo.trajectory import Trajectory
from missions.planning.sweep.chart import BEHIND, Chart, KnownMap
from missions.planning.sweep.paths import Flyer, Route
from missions.units import Cell, GridPoint

LONGEST_S: Final = 300.0
"""Maximum planning horizon, s: later, a region that drifts would be outside the fence."""


def flyer_of(
    setting: Setting,
    vehicle: VehicleState,
    planned: Trajectory | None,
    route: Route | None,
    begin_s: float,
) -> Flyer:
    """Return a vehicle in the planner's form, in the frame of the region. `planned` is the last
    path that was planned for it, and `route` the route of that path."""
    grid, path = setting.grid, vehicle.path
    home_s = over_home_s(path, planned, begin_s)
    # at the end of its path it is at that end, until it reports its arrival
    place = vehicle.position if path is None else path.place_at(begin_s)
    mine = path is not None and path.goes_on(planned, begin_s)
    if mine:  # the fence may allow less than the planned path
        path = planned
    if path is not None and not mine:  # a search path was planned in the fixed frame
        path = path.in_frame(grid.drift_m_s, begin_s)
    flown = setting.kinematics(vehicle.cruise_height_m, vehicle.wind_m_s)
    # a speed that is by now too high for the wind is reduced where the path is slower
    if path is not None:
        moves = path.at(begin_s)
        now_m_s = math.hypot(
            moves.v_east_m_s - path.drift_m_s[0], moves.v_north_m_s - path.drift_m_s[1]
        )
        flown = replace(flown, speed_m_s=max(flown.speed_m_s, now_m_s))
    above_m, descent_m_s = setting.mission.overview_above_m, setting.mission.flight.descent_m_s
    blind_s = 0.0  # while it descends from search height it still takes search pictures
    if above_m is not None and descent_m_s is not None:
        blind_s = max(vehicle.height_m - above_m, 0.0) / descent_m_s
    end = grid.to_moving(gate_of(setting, vehicle), home_s)
    return Flyer(
        flown,
        grid.to_moving(place, begin_s),
        end,
        path,
        route if mine else None,
        blind_s,
    )


def over_home_s(path: Trajectory | None, planned: Trajectory | None, begin_s: float) -> float:
    """Return when a vehicle on a path will be over its pad, by its last plan, s."""
    if path is None or planned is None or not path.goes_on(planned, begin_s):
        return begin_s
    return min(max(begin_s, planned.end_s), begin_s + LONGEST_S)


def in_map_layer(setting: Setting, vehicle: VehicleState) -> VehicleState:
    """Return a vehicle in the layer in which it maps."""
    return replace(vehicle, cruise_altitude_m=setting.mission.altitude_m(vehicle.vehicle - 1))


def gate_of(setting: Setting, vehicle: VehicleState) -> GridPoint:
    """Return where a path ends among pads of others: before its own, if none leads past their
    columns. From there to the pad a vehicle flies straight."""
    pad = setting.fence.inside(vehicle.pad)
    if setting.whole_fence is None:
        return pad
    return gate_past_columns(setting.fence, setting.whole_fence, pad, setting.mission.grid.cell_m)


def chart_of(
    state: State,
    root: Cell | None,
    begin_s: float,
    team: Mapping[int, VehicleState],
    home_s: float | None = None,
) -> KnownMap:
    """Return the known map around the region at a time; without a `root`, of the box. `home_s` is
    the time when our vehicle of a fleet will be over its pad. Lanes that are still to be flown are
    closed; the ground behind their vehicles is `BEHIND`."""
    setting = state.setting
    belief, cell_m = state.belief, setting.mission.grid.cell_m
    tallies = belief.open_tallies.as_dict()
    box = setting.box_cells if root is None else ()
    ways = _end_cells(setting, begin_s, team)
    chart = Chart.around([*((root,) if root else box), *tallies, *ways], cell_m)
    if tallies:
        index = chart.indices(tallies.keys())
        counted = chain.from_iterable(tallies.values())
        positive, total = np.fromiter(counted, np.int64, 2 * len(tallies)).reshape(-1, 2).T
        chart.yes[index], chart.no[index] = positive, total - positive
    region = chart.indices(belief.roi.as_dict().keys())
    chart.yes[region], chart.no[region] = belief.positive, 0
    _fence(setting, chart, begin_s, begin_s if home_s is None else home_s, team)
    if root is not None:
        return KnownMap(chart, chart.index(root))
    wanted = np.zeros(chart.columns * chart.rows, np.uint8)
    wanted[chart.indices(list(setting.strategy.required_cells(state)))] = 1
    lanes = {lane for vehicle in state.vehicles.values() for lane in vehicle.lanes}
    for lane in sorted(lanes):
        chart.close(setting.strip(lane, state.t_s), BEHIND)
    unflown = {part for v in state.vehicles.values() for part in lane_left(v, cell_m).lanes}
    for lane in sorted(unflown):
        chart.close(setting.strip(lane, state.t_s))
    return KnownMap(chart, -1, wanted, patches=setting.strategy.patches)


def _end_cells(setting: Setting, begin_s: float, team: Mapping[int, VehicleState]) -> list[Cell]:
    """Return the cells where vehicles are and will end; the chart must contain them."""
    grid, cell_m = setting.grid, setting.mission.grid.cell_m
    cells = []
    for vehicle in team.values():
        path, pad = vehicle.path, vehicle.pad
        end_s = begin_s if path is None else path.end_s
        places = [
            grid.to_moving(vehicle.position, begin_s),
            grid.to_moving(pad, begin_s),
            grid.to_moving(pad, min(max(end_s, begin_s), begin_s + LONGEST_S)),
        ]
        cells += [
            Cell(round(place.east_m / cell_m), round(place.north_m / cell_m)) for place in places
        ]
    return cells


def _fence(
    setting: Setting,
    chart: Chart,
    begin_s: float,
    home_s: float,
    team: Mapping[int, VehicleState],
) -> None:
    """Close the cells outside the fence, half a cell inside its margin. The chart drifts with the
    region. The fence is taken as it lies now. The columns over others' pads are taken as they lie
    when our vehicle returns."""
    cell_m = chart.cell_m
    whole = setting.fence if setting.whole_fence is None else setting.whole_fence
    inner = whole.shrunk(cell_m / 2.0)
    middles = chart.middles_m(setting.grid, begin_s)
    allowed = shapely.contains_xy(inner, *middles).astype(np.uint8)
    if setting.whole_fence is not None:
        x, y = chart.middles_m(setting.grid, home_s)
        column = shapely.contains_xy(inner, x, y)
        column &= ~shapely.contains_xy(setting.fence.inner, x, y)
        allowed[column] = 0
        ours = next((v for n, v in team.items() if setting.team.controls(n)), None)
        if ours is not None:  # the way to its own pad is free, wherever the middle of a cell lies
            way = LineString([setting.fence.inside(ours.pad), gate_of(setting, ours)])
            allowed[shapely.dwithin(shapely.points(x, y), way, cell_m)] = 1
    low = (in_map_layer(setting, vehicle) for vehicle in team.values())
    flown = (setting.kinematics(vehicle.cruise_height_m, vehicle.wind_m_s) for vehicle in low)
    chart.allow(allowed, [each.reach(cell_m) for each in flown])
